/* Links between neighbouring corners: see boards/graph.py. */
#include "sampling.h"

/* Rows `out`, ascending, of the points `xy` (n, 2) that are `open` (n,) and in the box; returns their number. */
KERNEL(rcdn_inside, (SIZE, n, xy, 0), (IN, double, xy, n, 2), (IN, uint8_t, open, n), (REAL, left), (REAL, top),
       (REAL, right), (REAL, bottom), (OUT, int64_t, out, n)) {
    index_t count = 0;
    for (index_t k = 0; k < n; k++) {
        const double x = xy[2 * k], y = xy[2 * k + 1];
        out[count] = k;
        count += open[k] && x >= left && x <= right && y >= top && y <= bottom;
    }
    return count;
}

/* Whether the link of length `length` to corner `j` is preferred to the one that is `taken` (−1: none): the shorter
 * one, of equal ones the later corner. */
INLINE int preferred(double length, int64_t j, double shortest, int64_t taken) {
    return taken < 0 || length < shortest || (length == shortest && j > taken);
}

/* Keep in `out` (n, slots), where −1 is none, only the links whose other end has a link back; in place, with `chosen`
 * as a buffer of the same size. */
INLINE void keep_mutual(int64_t *out, int64_t *chosen, index_t n, index_t slots) {
    memcpy(chosen, out, (size_t)(n * slots) * sizeof *out);
    for (index_t i = 0; i < n; i++)
        for (index_t k = 0; k < slots; k++) {
            const int64_t j = chosen[i * slots + k];
            int back = 0;
            for (index_t m = 0; j >= 0 && m < slots; m++)
                back |= chosen[j * slots + m] == i;
            out[i * slots + k] = back ? j : -1;
        }
}

/* The shortest of the `count` links i → j of each slot to `out` (n, slots), −1 for none, where both ends choose each
 * other. `shortest`, `chosen` (n, slots) are buffers. */
KERNEL(rcdn_mutual, (SIZE, count, length, 0), (SIZE, n, out, 0), (SIZE, slots, out, 1),
       (WITHIN, int64_t, i, 0, n - 1, count), (WITHIN, int64_t, j, 0, n - 1, count), (IN, double, length, count),
       (WITHIN, int64_t, slot, 0, slots - 1, count), (OUT, double, shortest, n, slots),
       (OUT, int64_t, chosen, n, slots), (OUT, int64_t, out, n, slots)) {
    for (index_t k = 0; k < n * slots; k++)
        out[k] = -1;
    for (index_t k = 0; k < count; k++) {
        const index_t at = i[k] * slots + slot[k];
        if (preferred(length[k], j[k], shortest[at], out[at])) {
            shortest[at] = length[k];
            out[at] = j[k];
        }
    }
    keep_mutual(out, chosen, n, slots);
    return 0;
}

/* A corner's two axes as unit vectors, and its polarity and contrast. */
typedef struct {
    double axes[4], polarity, contrast;
} Looks;

/* The axis of a corner that is nearest to the direction (x, y); `turn`: sine of the angle to it, ≥ 0. */
INLINE int nearest_axis(const Looks *corner, double x, double y, double *turn) {
    const double *a = corner->axes, one = fabs(a[0] * y - a[1] * x), other = fabs(a[2] * y - a[3] * x);
    *turn = other < one ? other : one;
    return other < one;
}

INLINE int leads_to(const int64_t *row, int64_t corner) {
    return row[0] == corner || row[1] == corner || row[2] == corner || row[3] == corner;
}

/* `out` (n, 4): mutual links between corners `xy` (n, 2) px with `looks` (n, 6): cosine and sine of each axis, polarity
 * ±1, contrast. `near`, `distance` (n, most): neighbours, the nearest first; n is no corner. Links shorter than `small`
 * px may deviate from the axes by `loose`, longer ones by `strict`, sines. `least`: least contrast of each third of a
 * link, share of the weaker corner's. `shortest`, `chosen` (n, 4) are buffers. */
FAST_KERNEL(rcdn_links, (PICTURE, p), (SIZE, n, near, 0), (SIZE, most, near, 1), (IN, double, xy, n, 2),
            (IN, double, looks, n, 6), (WITHIN, int64_t, near, 0, n, n, most), (IN, double, distance, n, most),
            (REAL, small), (REAL, strict), (REAL, loose), (REAL, least), (OUT, double, shortest, n, 4),
            (OUT, int64_t, chosen, n, 4), (OUT, int64_t, out, n, 4)) {
    const Looks *corner = (const Looks *)looks;
    Places w;
    for (index_t i = 0; i < n; i++) {
        for (index_t k = 0; k < 4; k++)
            out[4 * i + k] = -1;
        for (index_t m = 0; m < most; m++) {
            const int64_t j = near[i * most + m];
            const double length = distance[i * most + m];
            if (j >= n || j == i || !(length > 0))
                continue;
            const double x = (xy[2 * j] - xy[2 * i]) / length, y = (xy[2 * j + 1] - xy[2 * i + 1]) / length;
            const double limit = length < small ? loose : strict;
            double turn, back, shown[3];
            const int axis = nearest_axis(corner + i, x, y, &turn), other = nearest_axis(corner + j, x, y, &back);
            if (!(turn < limit && back < limit))
                continue;
            /* colour of the side at rising angle from the link: opposite at its ends, since neighbours are negatives of
             * each other */
            const double colour = axis ? -corner[i].polarity : corner[i].polarity;
            if (colour != (other ? corner[j].polarity : -corner[j].polarity))
                continue;
            const double *way = corner[i].axes + 2 * axis;
            const index_t slot = 4 * i + axis + (way[0] * x + way[1] * y < 0 ? 2 : 0);
            if (!preferred(length, j, shortest[slot], out[slot]))
                continue;
            /* an edge already found visible from its other end need not be tested again */
            int seen = j < i && leads_to(out + 4 * j, i);
            for (int close = 0; !seen && close < 2; close++) { /* a marker may leave only a narrow rim of a square */
                sides_differ(&p, xy + 2 * i, xy + 2 * j, close, &w, shown);
                const double weaker = corner[i].contrast < corner[j].contrast ? corner[i].contrast : corner[j].contrast;
                seen = colour * shown[0] > least * weaker && colour * shown[1] > least * weaker &&
                       colour * shown[2] > least * weaker;
            }
            if (seen) {
                shortest[slot] = length;
                out[slot] = j;
            }
        }
    }
    keep_mutual(out, chosen, n, 4);
    return 0;
}
