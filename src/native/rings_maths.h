/* exp and erf in float32 without branches, for loops over many samples. */
#ifndef RCDN_RINGS_MATHS_H
#define RCDN_RINGS_MATHS_H

#include "rcdn.h"

/* exp x, -87 <= x <= 87, to 3e-6: 2 to the nearest integer n of y = x / ln 2, times a polynomial of y - n. */
INLINE float short_exp(float x) {
    const float y = x * 1.44269504f;
    const int32_t n = (int32_t)(y + 128.5f) - 128;
    const float f = y - (float)n;
    union {
        int32_t bits;
        float value;
    } power = {(n + 127) * (1 << 23)};
    return power.value * (((((1.32764701e-3f * f + 9.67554189e-3f) * f + 5.55071346e-2f) * f + 0.240221202f) * f + 0.693146944f) * f + 1.0f);
}

/* exp 2z of the z with tanh z = erf x to 4e-6: x times a polynomial of x * x, fitted to the smallest largest error; beyond |x| = 4 erf is 1. */
INLINE float short_erf_power(float x) {
    x = x < -4.0f ? -4.0f : x;
    x = x > 4.0f ? 4.0f : x;
    const float q = x * x;
    const float slope = (((3.22497554e-05f * q - 4.15182660e-04f) * q - 4.96721319e-04f) * q + 1.02932856e-01f) * q + 1.12835818f;
    return short_exp(2.0f * x * slope);
}

/* erf x and erf y to 4e-6, by one division. */
INLINE void short_erfs(float x, float y, float *erf_x, float *erf_y) {
    const float a = short_erf_power(x) + 1.0f, b = short_erf_power(y) + 1.0f, twice = 2.0f / (a * b);
    *erf_x = 1.0f - b * twice;
    *erf_y = 1.0f - a * twice;
}

#endif
