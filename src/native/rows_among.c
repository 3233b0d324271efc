/* Indices of identical points in another list. See rcdn/geometry/rows.py. */
#include "kernel.h"

/* The first slot to search for a point among `slots`, a power of two. -0 equals 0. */
INLINE index_t slot_of(const double *point, index_t slots) {
    const double at[2] = {point[0] + 0.0, point[1] + 0.0};
    uint64_t bits[2];
    memcpy(bits, at, sizeof bits);
    uint64_t mixed = (bits[0] ^ (bits[1] << 31 | bits[1] >> 33)) * 0x9e3779b97f4a7c15u;
    mixed ^= mixed >> 32;
    return (index_t)(mixed * 0x9e3779b97f4a7c15u >> 20 & (uint64_t)(slots - 1));
}

INLINE int same(const double *a, const double *b) {
    return a[0] == b[0] && a[1] == b[1];
}

/* `row` (n): for each of the points `xy` (n), its first row in `among` (m), -1 if it is not there or not a number.
 * `held`: hash table of the rows. */
KERNEL(rcdn_rows_among, (SIZE, n, xy, 0), (SIZE, m, among, 0), (SIZE, slots, held, 0), (IN, double, xy, n, 2),
       (IN, double, among, m, 2), (WHERE, slots > m && (slots & (slots - 1)) == 0), (OUT, int64_t, held, slots),
       (OUT, int64_t, row, n)) {
    for (index_t k = 0; k < slots; k++)
        held[k] = -1;
    for (index_t k = 0; k < m; k++) {
        const double *point = among + 2 * k;
        index_t at = slot_of(point, slots);
        while (held[at] >= 0 && !same(among + 2 * held[at], point))
            at = (at + 1) & (slots - 1);
        if (held[at] < 0 && same(point, point))
            held[at] = k;
    }
    for (index_t k = 0; k < n; k++) {
        const double *point = xy + 2 * k;
        index_t at = slot_of(point, slots);
        while (held[at] >= 0 && !same(among + 2 * held[at], point))
            at = (at + 1) & (slots - 1);
        row[k] = held[at];
    }
    return 0;
}
