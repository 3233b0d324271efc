/* Elementary functions of arrays: see rcdn.elementary. */
#include "elementary.h"

/* `out` (n,): exp x. */
EXPORT void rcdn_exp(index_t n, const double *x, double *out) {
    for (index_t k = 0; k < n; k++)
        out[k] = exponential(x[k]);
}

/* `out` (n,): ln x. */
EXPORT void rcdn_log(index_t n, const double *x, double *out) {
    for (index_t k = 0; k < n; k++)
        out[k] = natural_log(x[k]);
}

/* `cosine`, `sine` (n,) of x (n,). */
EXPORT void rcdn_cos_sin(index_t n, const double *x, double *cosine, double *sine) {
    for (index_t k = 0; k < n; k++)
        cosine_sine(x[k], cosine + k, sine + k);
}

/* `out` (n,): the angle of (x, y) (n,). */
EXPORT void rcdn_arctan2(index_t n, const double *y, const double *x, double *out) {
    for (index_t k = 0; k < n; k++)
        out[k] = angle_of(y[k], x[k]);
}
