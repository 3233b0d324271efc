/* Saddles of the grey surface by least-squares quadratic fits; see rcdn.corners.saddle. */
#include "kernel.h"
#include "solvers.h"

/* smallest ratio of the two curvatures of a saddle; a corner whose edges cross at an angle t has tan²(t/2): 7° here */
#define FLATNESS 0.004
#define FAINT 0.01 /* smallest rise of the fitted saddle from the centre to the side of its window, grey levels */

/* A fit: `matrix` (5, (2 reach + 1)²) from raw pixels to the coefficients of x², xy, y², x and y within `half` px. */
typedef struct {
    const double *matrix;
    index_t half, reach, repeats;
    double slack;
} Fit;

/* The step from (x, y) to the saddle of the surface there, px; returns 0 if there is none in the window. */
INLINE int fit_step(const Picture *p, const Fit *fit, index_t x, index_t y, float *window, double step[2]) {
    const index_t side = 2 * fit->reach + 1, size = side * side;
    const double *m = fit->matrix;
    double a1 = 0, a2 = 0, a3 = 0, a4 = 0, a5 = 0;
    gather(p, x, y, fit->reach, window);
    for (index_t k = 0; k < size; k++) {
        const double w = window[k];
        a1 += m[k] * w;
        a2 += m[size + k] * w;
        a3 += m[2 * size + k] * w;
        a4 += m[3 * size + k] * w;
        a5 += m[4 * size + k] * w;
    }
    const double det = solve_two(2 * a1, a2, a2, 2 * a3, -a4, -a5, step), half = (double)fit->half;
    const double curve = fabs(a1 + a3) + sqrt((a1 - a3) * (a1 - a3) + a2 * a2); /* twice the larger curvature */
    const double total = curve * curve;
    if (!(-det > FLATNESS * total && total * half * half * half * half > 4 * FAINT * FAINT))
        return 0;
    return fabs(step[0]) <= half && fabs(step[1]) <= half;
}

/* The saddle near a pixel: the window is recentred on the nearest pixel until the saddle is at its centre. */
INLINE int surface_fit(const Picture *p, const Fit *fit, const int64_t seed[2], float *window, double out[2]) {
    index_t x = (index_t)seed[0], y = (index_t)seed[1];
    double step[2];
    if (!fit_step(p, fit, x, y, window, step))
        return 0;
    for (index_t k = 0; k < fit->repeats && (fabs(step[0]) > fit->slack || fabs(step[1]) > fit->slack); k++) {
        x += (index_t)rint(step[0]);
        y += (index_t)rint(step[1]);
        if (!fit_step(p, fit, x, y, window, step))
            return 0;
    }
    const double rest = fit->slack > 1 ? fit->slack : 1, far = 2.0 * (double)fit->half;
    out[0] = (double)x + step[0];
    out[1] = (double)y + step[1];
    return fabs(step[0]) <= rest && fabs(step[1]) <= rest && fabs(out[0] - (double)seed[0]) <= far &&
           fabs(out[1] - (double)seed[1]) <= far;
}

/* Whether `many` fits have matrices within `entries` in all, and windows of at most `room` pixels. */
static int are_fits(const int64_t *first, const int64_t *sizes, index_t many, index_t entries, index_t room) {
    for (index_t f = 0; f < many; f++) {
        const int64_t half = sizes[3 * f], reach = sizes[3 * f + 1], repeats = sizes[3 * f + 2];
        if (half < 0 || half > 10000 || reach < 0 || reach > 10000 || repeats < 0 || repeats > 1000)
            return 0;
        const int64_t side = 2 * reach + 1;
        if (side * side > room || first[f] < 0 || first[f] > entries - 5 * side * side)
            return 0;
    }
    return 1;
}

/* Saddles `xy` (count, 2) near `seeds` (count, 2), each by the fit `which` (count,); NaN where there is none. For fit
 * f: half window, reach and repeats in `sizes` (., 3), the matrix from `first[f]` on. `window`: buffer for the largest
 * window. */
FAST_KERNEL(rcdn_surface_fit, (PICTURE, p), (SIZE, count, seeds, 0), (SIZE, many, first, 0),
            (SIZE, entries, matrices, 0), (SIZE, room, window, 0),
            (WITHIN, int64_t, seeds, -FURTHEST, FURTHEST, count, 2), (WITHIN, int64_t, which, 0, many - 1, count),
            (IN, double, matrices, entries), (IN, int64_t, first, many), (IN, int64_t, sizes, many, 3),
            (IN, double, slack, many), (WHERE, are_fits(first, sizes, many, entries, room)), (OUT, float, window, room),
            (OUT, double, xy, count, 2)) {
    for (index_t n = 0; n < count; n++) {
        const int64_t f = which[n], *size = sizes + 3 * f;
        const Fit fit = {matrices + first[f], (index_t)size[0], (index_t)size[1], (index_t)size[2], slack[f]};
        if (!surface_fit(&p, &fit, seeds + 2 * n, window, xy + 2 * n))
            xy[2 * n] = xy[2 * n + 1] = NAN;
    }
    return 0;
}
