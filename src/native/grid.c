/* Labelled grids: windows around labels, and predicted corners. */
#include "grid.h"

/* Rows of a grid's corners around `spots` (count, 2): windows (2 reach + 1)², row by row, -1 for none. */
KERNEL(rcdn_grid_around, (SIZE, n, labels, 0), (SIZE, count, spots, 0),
       (WITHIN, int64_t, labels, -ANYWHERE, ANYWHERE, n, 2), (WITHIN, int64_t, spots, -ANYWHERE, ANYWHERE, count, 2),
       (INT, reach, 0, 100), (OUT, int64_t, out, count, (2 * reach + 1) * (2 * reach + 1))) {
    Table t;
    if (!open_table(&t, labels, n))
        return NO_MEMORY;
    for (index_t k = 0; k < count; k++, spots += 2)
        for (index_t e = -reach; e <= reach; e++)
            for (index_t d = -reach; d <= reach; d++)
                *out++ = corner_at(&t, spots[0] + d, spots[1] + e);
    free(t.row);
    return 0;
}

/* Predictions at `spots` (count, 2): `out` (count, 6) as from `predicted`, the number of corners used, `support`
 * (count), and their shorter steps, `pitch` (count); NaN where `support` is 0. */
INLINE void predict(const Table *t, const double *xy, const int64_t *spots, index_t count, double *out,
                    int64_t *support, double *pitch) {
    for (index_t k = 0; k < count; k++, spots += 2, out += 6) {
        support[k] = predicted(t, xy, spots[0], spots[1], out);
        for (int i = 0; !support[k] && i < 6; i++)
            out[i] = NAN;
        pitch[k] = pitch_of(out);
    }
}

/* `predict` from corners with `labels`, `xy` (n, 2). */
KERNEL(rcdn_grid_predict, (SIZE, n, labels, 0), (SIZE, count, spots, 0),
       (WITHIN, int64_t, labels, -ANYWHERE, ANYWHERE, n, 2), (IN, double, xy, n, 2),
       (WITHIN, int64_t, spots, -ANYWHERE, ANYWHERE, count, 2), (OUT, double, out, count, 6),
       (OUT, int64_t, support, count), (OUT, double, pitch, count)) {
    Table t;
    if (!open_table(&t, labels, n))
        return NO_MEMORY;
    predict(&t, xy, spots, count, out, support, pitch);
    free(t.row);
    return 0;
}

/* Labels that are at most sqrt(`reach`) from one of `added` (count, 2), by cell of the table; all if there are none.
 * NULL without memory. */
static uint8_t *near_added(const Table *t, const int64_t *added, index_t count, index_t reach) {
    uint8_t *marks = malloc((size_t)(t->width * t->height));
    if (!marks)
        return NULL;
    memset(marks, count == 0, (size_t)(t->width * t->height));
    for (index_t k = 0; k < count; k++) {
        const int64_t i = added[2 * k] - t->low_u, j = added[2 * k + 1] - t->low_v;
        for (int64_t d = -MARGIN; d <= MARGIN; d++)
            for (int64_t e = -MARGIN; e <= MARGIN; e++)
                if (d * d + e * e <= reach && i + d >= 0 && j + e >= 0 && i + d < t->width && j + e < t->height)
                    marks[(i + d) * t->height + j + e] = 1;
    }
    return marks;
}

/* The empty labels beside a grid's corners, in order, (at most 4 n, 2), with steps of at least `least`, and the results
 * of `predict` for them; only those within sqrt(`reach`) of one of the labels `added` (a, 2), if there are any. Returns
 * their number. */
KERNEL(rcdn_grid_beside, (SIZE, n, labels, 0), (SIZE, additions, added, 0),
       (WITHIN, int64_t, labels, -ANYWHERE, ANYWHERE, n, 2), (IN, double, xy, n, 2),
       (WITHIN, int64_t, added, -ANYWHERE, ANYWHERE, additions, 2), (INT, reach, 0, 2 * WIDEST * WIDEST), (REAL, least),
       (OUT, int64_t, spots, 4 * n, 2), (OUT, double, out, 4 * n, 6), (OUT, int64_t, support, 4 * n),
       (OUT, double, pitch, 4 * n)) {
    Table t;
    if (!open_table(&t, labels, n))
        return NO_MEMORY;
    uint8_t *marks = near_added(&t, added, additions, reach);
    index_t count = marks ? 0 : NO_MEMORY;
    for (index_t i = MARGIN - 1; marks && n > 0 && i <= t.width - MARGIN; i++)
        for (index_t j = MARGIN - 1; j <= t.height - MARGIN; j++) {
            const int32_t *row = t.row + i * t.height + j;
            if (!marks[i * t.height + j] || *row >= 0 ||
                (row[1] < 0 && row[-1] < 0 && row[t.height] < 0 && row[-t.height] < 0))
                continue;
            spots[2 * count] = t.low_u + i;
            spots[2 * count + 1] = t.low_v + j;
            predict(&t, xy, spots + 2 * count, 1, out + 6 * count, support + count, pitch + count);
            count += pitch[count] >= least;
        }
    free(marks);
    free(t.row);
    return count;
}

/* `excess_of` the corners with indices `which` (count). */
KERNEL(rcdn_grid_excess, (SIZE, n, labels, 0), (SIZE, count, which, 0),
       (WITHIN, int64_t, labels, -ANYWHERE, ANYWHERE, n, 2), (IN, double, xy, n, 2),
       (WITHIN, int64_t, which, 0, n - 1, count), (REAL, tight), (REAL, loose), (OUT, double, out, count)) {
    Table t;
    if (!open_table(&t, labels, n))
        return NO_MEMORY;
    for (index_t k = 0; k < count; k++)
        out[k] = excess_of(&t, xy, labels + 2 * which[k], xy + 2 * which[k], tight, loose);
    free(t.row);
    return 0;
}

/* `usual_near` at `spots` (count, 2) of the two `values` (n, 2) of each corner. */
KERNEL(rcdn_grid_usual, (SIZE, n, labels, 0), (SIZE, count, spots, 0),
       (WITHIN, int64_t, labels, -ANYWHERE, ANYWHERE, n, 2), (IN, double, values, n, 2),
       (WITHIN, int64_t, spots, -ANYWHERE, ANYWHERE, count, 2), (OUT, double, out, count, 2)) {
    Table t;
    if (!open_table(&t, labels, n))
        return NO_MEMORY;
    for (index_t k = 0; k < count; k++, spots += 2, out += 2)
        usual_near(&t, spots[0], spots[1], values, 2, out);
    free(t.row);
    return 0;
}
