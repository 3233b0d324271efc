/* How deep points lie in a polygon. */
#include "kernel.h"

/* Distances `depth` (m) of points `at` (m) from the outline of a polygon of `n` corners, positive inside (where lines of sight cross it an odd
 * number of times), negative outside. */
KERNEL(rcdn_depth, (SIZE, n, corners, 0), (SIZE, m, at, 0), (IN, double, corners, n, 2), (IN, double, at, m, 2), (OUT, double, depth, m)) {
    for (index_t j = 0; j < m; j++) {
        const double x = at[2 * j], y = at[2 * j + 1];
        double least = INFINITY;
        int inside = 0;
        for (index_t i = 0; i < n; i++) {
            const double *a = corners + 2 * i, *b = corners + 2 * (i + 1 < n ? i + 1 : 0);
            const double dx = b[0] - a[0], dy = b[1] - a[1], px = x - a[0], py = y - a[1];
            const double length = dx * dx + dy * dy;
            double t = length > 0 ? (px * dx + py * dy) / length : 0;
            t = t < 0 ? 0 : t > 1 ? 1 : t;
            const double ex = px - t * dx, ey = py - t * dy, square = ex * ex + ey * ey;
            least = square < least ? square : least;
            if ((a[1] > y) != (b[1] > y) && px < py * dx / dy)
                inside = !inside;
        }
        depth[j] = inside ? sqrt(least) : -sqrt(least);
    }
    return 0;
}
