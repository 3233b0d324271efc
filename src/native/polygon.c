/* Depth of points inside a polygon. */
#include "kernel.h"

/* Squared distance of a point from a side a–b of a polygon, and whether a ray from the point to the right crosses that
 * side. */
INLINE double from_side(const double *a, const double *b, double x, double y, int *crosses) {
    const double dx = b[0] - a[0], dy = b[1] - a[1], px = x - a[0], py = y - a[1];
    const double length = dx * dx + dy * dy;
    double t = length > 0 ? (px * dx + py * dy) / length : 0;
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    const double ex = px - t * dx, ey = py - t * dy;
    *crosses = (a[1] > y) != (b[1] > y) && px < py * dx / dy;
    return ex * ex + ey * ey;
}

/* Distances `depth` (m) of points `at` (m) from the boundary of a polygon of `n` corners, positive inside (where rays
 * cross it an odd number of times), negative outside. */
KERNEL(rcdn_depth, (SIZE, n, corners, 0), (SIZE, m, at, 0), (IN, double, corners, n, 2), (IN, double, at, m, 2),
       (OUT, double, depth, m)) {
    for (index_t j = 0; j < m; j++) {
        double least = INFINITY;
        int inside = 0;
        for (index_t i = 0; i < n; i++) {
            int crosses;
            const double square =
                from_side(corners + 2 * i, corners + 2 * (i + 1 < n ? i + 1 : 0), at[2 * j], at[2 * j + 1], &crosses);
            least = square < least ? square : least;
            inside ^= crosses;
        }
        depth[j] = inside ? sqrt(least) : -sqrt(least);
    }
    return 0;
}

/* Which of `count` bands, from `top` on, each `size` high, contains y. */
INLINE index_t band_of(double y, double top, double size, index_t count) {
    const double k = (y - top) / size;
    return k >= (double)count ? count - 1 : k > 0 ? (index_t)k : 0;
}

/* Which of the points `at` (m) lie inside a polygon of `n` corners and further than `limit` from its boundary, `out`
 * (m). Sides are sorted into horizontal bands by their vertical extent, enlarged by `limit`. */
KERNEL(rcdn_deeper, (SIZE, n, corners, 0), (SIZE, m, at, 0), (IN, double, corners, n, 2), (IN, double, at, m, 2),
       (REAL, limit), (OUT, uint8_t, out, m)) {
    double top = INFINITY, low = -INFINITY, usual = 0;
    for (index_t i = 0; i < n; i++) {
        top = fmin(top, corners[2 * i + 1]);
        low = fmax(low, corners[2 * i + 1]);
        usual += fabs(corners[2 * (i + 1 < n ? i + 1 : 0) + 1] - corners[2 * i + 1]) / (double)n;
    }
    const double size = fmax(fmax(usual + 2 * limit, (low - top) / (double)(n + 1)), 1e-9);
    const index_t bands = n > 0 && low > top ? (index_t)fmin((low - top) / size, (double)n) + 1 : 1;
    index_t *first = calloc((size_t)bands + 2, sizeof *first), *side = NULL;
    for (int pass = 0; first && pass < 2; pass++) { /* count, then sort */
        for (index_t i = 0; i < n; i++) {
            const double y = corners[2 * i + 1], z = corners[2 * (i + 1 < n ? i + 1 : 0) + 1];
            const index_t from = band_of(fmin(y, z) - limit, top, size, bands),
                          to = band_of(fmax(y, z) + limit, top, size, bands);
            for (index_t k = from; k <= to; k++) {
                if (pass)
                    side[first[k + 1]++] = i;
                else
                    first[k + 2]++;
            }
        }
        if (pass)
            break;
        for (index_t k = 2; k < bands + 2; k++)
            first[k] += first[k - 1];
        side = malloc(((size_t)first[bands + 1] + 1) * sizeof *side);
        if (!side)
            break;
    }
    for (index_t j = 0; side && j < m; j++) {
        const double x = at[2 * j], y = at[2 * j + 1];
        const index_t band = band_of(y, top, size, bands);
        int inside = 0, far = 1;
        for (index_t k = first[band]; k < first[band + 1]; k++) {
            const double *a = corners + 2 * side[k], *b = corners + 2 * (side[k] + 1 < n ? side[k] + 1 : 0);
            int crosses;
            far &= sqrt(from_side(a, b, x, y, &crosses)) > limit;
            inside ^= crosses;
        }
        out[j] = (uint8_t)(inside && far);
    }
    free(first);
    free(side);
    return side ? 0 : NO_MEMORY;
}
