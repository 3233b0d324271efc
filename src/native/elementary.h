/* Elementary functions in double precision by sums, products and quotients alone, accurate to a few units in the last
 * place. Those of the system's library differ in the last bits between versions, and between processors with and
 * without fused multiply–add. */
#ifndef RCDN_ELEMENTARY_H
#define RCDN_ELEMENTARY_H

#include "rcdn.h"

#define PI 3.14159265358979323846
/* Constants in two parts; the first has so few digits that its small multiples are exact. */
#define LN2_HIGH 0.693147180369123816490
#define LN2_LOW 1.90821492927058770002e-10
#define QUARTER_HIGH 1.57079632673412561417
#define QUARTER_LOW 6.07710050650619224932e-11

/* 2^k for k within −1022..1023. */
INLINE double power_of_two(int64_t k) {
    const int64_t bits = (k + 1023) * ((int64_t)1 << 52);
    double out;
    memcpy(&out, &bits, sizeof out);
    return out;
}

/* exp x; results below 1e-307 are 0. */
INLINE double exponential(double x) {
    if (!(x > -707))
        return x < 0 ? 0 : x;
    if (x > 709.7)
        return INFINITY;
    const double k = rint(x * 1.44269504088896340736), r = x - k * LN2_HIGH - k * LN2_LOW;
    double sum = 1;
    for (int n = 13; n > 0; n--)
        sum = 1 + r * sum / n;
    return 2 * sum * power_of_two((int64_t)k - 1);
}

/* ln x; NaN for x < 0. */
INLINE double natural_log(double x) {
    if (!(x > 0) || x == INFINITY)
        return x == 0 ? -INFINITY : x < 0 ? NAN : x;
    const int tiny = x < 1e-300;
    const double grown = tiny ? x * power_of_two(64) : x;
    int64_t bits;
    memcpy(&bits, &grown, sizeof bits);
    /* k such that m is within √½..√2 */
    const int64_t above = bits - 0x3fe6a09e667f3bcd,
                  k = (above - (above & (((int64_t)1 << 52) - 1))) / ((int64_t)1 << 52);
    bits -= k * ((int64_t)1 << 52);
    double m, sum = 0;
    memcpy(&m, &bits, sizeof m);
    const double s = (m - 1) / (m + 1), q = s * s, whole = (double)(k - 64 * tiny);
    for (int n = 23; n > 0; n -= 2)
        sum = 1.0 / n + q * sum;
    return whole * LN2_HIGH + (2 * s * sum + whole * LN2_LOW);
}

/* erf x, error below 1e-15: 1 − exp(−x²) c(x) ÷ (1 + 2x) for x ≥ 0, c by its Chebyshev series in (x − k) ÷ (x + k), k =
 * 3.75, over 0..6 (Shepherd and Laframboise, 1981). */
INLINE double error_function(double x) {
    static const double series[] = {
        1.2041486607769258,      0.06254486451634342,    -0.09011170320100993,   0.03830804303776603,
        -0.010667072297549509,   0.0021626241391861367,  -0.0003206727593973206, 3.225748803923452e-05,
        -1.5419939712642087e-06, -9.807199682060284e-08, 2.0344095804603294e-08, -4.1571376333869653e-10,
        -1.6701600725103775e-10, 9.998587841771379e-12,  1.4363992020186967e-12, -1.248436087293526e-13,
        -1.4996986016102383e-14, 1.33360214961859e-15,   1.895208150114328e-16};
    const double t = fabs(x);
    if (!(t < 6))
        return t >= 6 ? copysign(1, x) : x;
    const double y = (2 * (t - 3.75) / (t + 3.75) + 10.0 / 13) * (13.0 / 16);
    double next = 0, after = 0;
    for (int n = (int)(sizeof series / sizeof *series) - 1; n > 0; n--) {
        const double one = 2 * y * next - after + series[n];
        after = next;
        next = one;
    }
    return copysign(1 - exponential(-t * t) * (y * next - after + series[0]) / (1 + 2 * t), x);
}

/* cos x and sin x for |x| up to a million. */
INLINE void cosine_sine(double x, double *cosine, double *sine) {
    if (!(fabs(x) < 1e6)) {
        *cosine = *sine = NAN;
        return;
    }
    const double k = rint(x * (2 / PI)), r = x - k * QUARTER_HIGH - k * QUARTER_LOW, q = r * r;
    double c = 1, s = 1;
    for (int n = 18; n > 0; n -= 2) {
        c = 1 - q * c / (n * (n - 1));
        s = 1 - q * s / (n * (n + 1));
    }
    s *= r;
    const int64_t quarter = (int64_t)k & 3;
    const double swapped_c = quarter & 1 ? s : c, swapped_s = quarter & 1 ? c : s;
    *cosine = quarter == 1 || quarter == 2 ? -swapped_c : swapped_c;
    *sine = quarter >= 2 ? -swapped_s : swapped_s;
}

/* The angle of (x, y), −π..π; 0 for (0, 0). */
INLINE double angle_of(double y, double x) {
    const double a = fabs(x), b = fabs(y), most = a > b ? a : b, least = a > b ? b : a;
    const double ratio = most > 0 ? least / most : most, steep = ratio > 0.41421356237309503,
                 t = steep ? (ratio - 1) / (ratio + 1) : ratio, q = t * t;
    double sum = 0;
    for (int n = 43; n > 0; n -= 2)
        sum = 1.0 / n - q * sum;
    double out = t * sum + (steep ? PI / 4 : 0);
    out = b > a ? PI / 2 - out : out;
    out = x < 0 ? PI - out : out;
    return y < 0 ? -out : out;
}

#endif
