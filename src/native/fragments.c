/* Triples of corners placed like three corners of a square. See rcdn/boards/fragments.py. */
#include "kernel.h"

/* For each corner (n) with its neighbours `near` (n, most): every two of them that turn clockwise about it by an angle
 * of sine above `skew` and whose distances have a ratio below `ratio`; in the order of the second, then of the first.
 * `three` (room, 3): the corner, the first and the second; `fourth` (room, 2): the fourth corner of the parallelogram;
 * `side` (room): the shorter distance. Returns their number, at most `room`. */
KERNEL(rcdn_three_of_quads, (SIZE, n, xy, 0), (SIZE, most, near, 1), (SIZE, room, side, 0), (IN, double, xy, n, 2),
       (WITHIN, int64_t, near, 0, n - 1, n, most), (WHERE, room >= n * most * most), (IN, double, length, n, most),
       (REAL, skew), (REAL, ratio), (OUT, int64_t, three, room, 3), (OUT, double, fourth, room, 2),
       (OUT, double, side, room)) {
    index_t found = 0;
    for (index_t k = 0; k < n; k++) {
        const double *at = xy + 2 * k, *distance = length + k * most;
        for (index_t two = 0; two < most; two++) {
            const double *c = xy + 2 * near[k * most + two], cx = c[0] - at[0], cy = c[1] - at[1];
            for (index_t one = 0; one < most; one++) {
                const double *b = xy + 2 * near[k * most + one], bx = b[0] - at[0], by = b[1] - at[1];
                const double lower = distance[one] < distance[two] ? distance[one] : distance[two];
                const double upper = distance[one] < distance[two] ? distance[two] : distance[one];
                if (!(bx * cy - by * cx > skew * lower * upper) || !(upper < ratio * lower))
                    continue;
                const int64_t corners[3] = {k, near[k * most + one], near[k * most + two]};
                memcpy(three + 3 * found, corners, sizeof corners);
                fourth[2 * found] = b[0] + c[0] - at[0];
                fourth[2 * found + 1] = b[1] + c[1] - at[1];
                side[found++] = lower;
            }
        }
    }
    return found;
}
