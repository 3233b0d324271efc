/* Mathematical functions in single precision, without branches or calls, so that loops over them are vectorised. */
#ifndef RCDN_MATHS_H
#define RCDN_MATHS_H

#include "rcdn.h"

/* The iterations of the loop that follows are independent, and nothing is summed over them: clang would reorder such a
 * sum. */
#if defined(__clang__)
#define INDEPENDENT _Pragma("clang loop vectorize(assume_safety)")
#else
#define INDEPENDENT _Pragma("GCC ivdep")
#endif

/* erf x, error below 5e-6: 1 - p(|x|)^8, where p is the minimax fit up to 3.4, beyond which erf is 1. */
INLINE float erf_near(float x) {
    float t = fabsf(x);
    t = t < 3.4f ? t : 3.4f;
    float p = -0.00113082286f;
    p = p * t + 0.00826456496f;
    p = p * t - 0.00314638428f;
    p = p * t - 0.069327104f;
    p = p * t - 0.141078296f;
    p = p * t + 1.00000048f;
    p *= p;
    p *= p;
    return copysignf(1 - p * p, x);
}

/* exp(-x²), error below 5e-7, and at least exp(-10): p(x²)^8. */
INLINE float bell_near(float x) {
    float t = x * x;
    t = t < 10.0f ? t : 10.0f;
    float p = 7.38376737e-06f;
    p = p * t - 0.000314776519f;
    p = p * t + 0.00779725308f;
    p = p * t - 0.124993436f;
    p = p * t + 0.999999622f;
    p *= p;
    p *= p;
    return p * p;
}

#endif
