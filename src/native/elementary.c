/* Elementary functions of arrays: see rcdn.geometry.elementary. */
#include "elementary.h"
#include "kernel.h"

/* `out` (n,): exp x. */
KERNEL(rcdn_exp, (SIZE, n, x, 0), (IN, double, x, n), (OUT, double, out, n)) {
    for (index_t k = 0; k < n; k++)
        out[k] = exponential(x[k]);
    return 0;
}

/* `out` (n,): ln x. */
KERNEL(rcdn_log, (SIZE, n, x, 0), (IN, double, x, n), (OUT, double, out, n)) {
    for (index_t k = 0; k < n; k++)
        out[k] = natural_log(x[k]);
    return 0;
}

/* `out` (n,): erf x. */
KERNEL(rcdn_erf, (SIZE, n, x, 0), (IN, double, x, n), (OUT, double, out, n)) {
    for (index_t k = 0; k < n; k++)
        out[k] = error_function(x[k]);
    return 0;
}

/* `cosine`, `sine` (n,) of x (n,). */
KERNEL(rcdn_cos_sin, (SIZE, n, x, 0), (IN, double, x, n), (OUT, double, cosine, n), (OUT, double, sine, n)) {
    for (index_t k = 0; k < n; k++)
        cosine_sine(x[k], cosine + k, sine + k);
    return 0;
}

/* `out` (n,): the angle of (x, y) (n,). */
KERNEL(rcdn_arctan2, (SIZE, n, x, 0), (IN, double, y, n), (IN, double, x, n), (OUT, double, out, n)) {
    for (index_t k = 0; k < n; k++)
        out[k] = angle_of(y[k], x[k]);
    return 0;
}
