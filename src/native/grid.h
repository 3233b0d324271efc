/* Definitions shared by kernels of labelled grids: a table of the labels, and the prediction of corners from their
 * neighbours in it. */
#ifndef RCDN_GRID_H
#define RCDN_GRID_H

#include "kernel.h"
#include "solvers.h"

/* Neighbours up to REACH squares away; with fewer than ENOUGH of them, up to WIDEST. At most MOST_ROWS in all. */
#define REACH 2
#define WIDEST 3
#define ENOUGH 6
/* Margin of empty labels around those of the table, so that the window around any adjacent label lies inside. */
#define MARGIN (WIDEST + 1)
#define LARGEST ((int64_t)1 << 28)
/* Labels lie within ± this, so that their differences do not overflow. */
#define ANYWHERE ((index_t)1 << 60)

/* A grid's corners by label: row[(u - low_u) * height + v - low_v], -1 for none. Cells are in the order of labels. */
typedef struct {
    int64_t low_u, low_v;
    index_t width, height;
    int32_t *row;
} Table;

/* The cell of a label inside the table. */
INLINE index_t cell_of(const Table *t, const int64_t *label) {
    return (index_t)(label[0] - t->low_u) * t->height + (index_t)(label[1] - t->low_v);
}

/* A table of `labels` (n, 2), to be freed; 0 without memory, and if labels are extremely far apart. */
static inline int open_table(Table *t, const int64_t *labels, index_t n) {
    int64_t low[2] = {0, 0}, high[2] = {0, 0};
    for (index_t i = 0; i < n; i++)
        for (int k = 0; k < 2; k++) {
            const int64_t at = labels[2 * i + k];
            low[k] = i == 0 || at < low[k] ? at : low[k];
            high[k] = i == 0 || at > high[k] ? at : high[k];
        }
    t->row = NULL;
    if (high[0] - low[0] >= LARGEST || high[1] - low[1] >= LARGEST)
        return 0;
    t->low_u = low[0] - MARGIN;
    t->low_v = low[1] - MARGIN;
    t->width = (index_t)(high[0] - low[0]) + 2 * MARGIN + 1;
    t->height = (index_t)(high[1] - low[1]) + 2 * MARGIN + 1;
    if (t->width * t->height > LARGEST)
        return 0;
    t->row = malloc((size_t)(t->width * t->height) * sizeof *t->row);
    if (!t->row)
        return 0;
    memset(t->row, 0xff, (size_t)(t->width * t->height) * sizeof *t->row);
    for (index_t i = 0; i < n; i++)
        t->row[cell_of(t, labels + 2 * i)] = (int32_t)i;
    return 1;
}

/* Labelled corners around any label: their offsets and their rows. */
typedef struct {
    index_t count;
    double du[MOST_ROWS + 1], dv[MOST_ROWS + 1];
    int32_t row[MOST_ROWS + 1];
} Near;

/* Those up to `reach` squares away, without the one at the label itself. */
INLINE void look_around(const Table *t, int64_t u, int64_t v, int64_t reach, Near *near) {
    const int64_t i = u - t->low_u, j = v - t->low_v;
    const int64_t left = i < reach ? -i : -reach, right = i + reach >= t->width ? t->width - 1 - i : reach;
    const int64_t top = j < reach ? -j : -reach, low = j + reach >= t->height ? t->height - 1 - j : reach;
    index_t count = 0;
    for (int64_t d = left; d <= right; d++)
        for (int64_t e = top; e <= low; e++) {
            const int32_t row = t->row[(i + d) * t->height + j + e];
            near->du[count] = (double)d;
            near->dv[count] = (double)e;
            near->row[count] = row;
            count += row >= 0 && (d || e);
        }
    near->count = count;
}

/* The labelled corner at any label; -1 for none. */
INLINE int32_t corner_at(const Table *t, int64_t u, int64_t v) {
    const int64_t i = u - t->low_u, j = v - t->low_v;
    return i >= 0 && j >= 0 && i < t->width && j < t->height ? t->row[i * t->height + j] : -1;
}

INLINE index_t bits(unsigned set) {
    index_t count = 0;
    for (; set; set &= set - 1)
        count++;
    return count;
}

/* Predicted corner of a label, from its neighbours in the table with positions `xy`: out = x, y, du x, du y, dv x, dv
 * y. Weighted least squares: bilinear with four neighbours, quadratic along an axis with three distinct coordinates.
 * Returns the number of corners used, 0 if they do not span the plane. */
INLINE index_t predicted(const Table *t, const double *xy, int64_t u, int64_t v, double *out) {
    Near near;
    look_around(t, u, v, REACH, &near);
    if (near.count < ENOUGH)
        look_around(t, u, v, WIDEST, &near);
    const index_t n = near.count;
    unsigned columns = 0, rows = 0;
    for (index_t i = 0; i < n; i++) {
        columns |= 1u << ((int)near.du[i] + WIDEST);
        rows |= 1u << ((int)near.dv[i] + WIDEST);
    }
    const index_t across = bits(columns), down = bits(rows);
    if (n < 3 || across < 2 || down < 2)
        return 0;
    const index_t uv = n >= 4 ? 3 : 0, uu = n >= 6 && across >= 3 ? uv + 1 : 0,
                  vv = n >= 7 && down >= 3 ? (uu ? uu : uv) + 1 : 0;
    const index_t terms = vv ? vv + 1 : uu ? uu + 1 : uv ? uv + 1 : 3;
    Columns a;
    for (index_t i = 0; i < n; i++) {
        const double d = near.du[i], e = near.dv[i], weight = 1 / (1 + d * d + e * e);
        a[0][i] = weight;
        a[1][i] = weight * d;
        a[2][i] = weight * e;
        if (uv)
            a[uv][i] = weight * d * e;
        if (uu)
            a[uu][i] = weight * d * d;
        if (vv)
            a[vv][i] = weight * e * e;
        a[MOST_TERMS][i] = weight * xy[2 * near.row[i]];
        a[MOST_TERMS + 1][i] = weight * xy[2 * near.row[i] + 1];
    }
    double r[MOST_TERMS][MOST_TERMS + RIGHT_SIDES], x[RIGHT_SIDES][MOST_TERMS];
    index_t order[MOST_TERMS];
    const index_t rank = orthogonal(a, n, terms, r, order);
    if (rank < 3)
        return 0;
    if (rank < terms)
        smallest(r, order, terms, rank, x);
    else
        for (int side = 0; side < RIGHT_SIDES; side++)
            substitute(r, order, terms, side, x[side]);
    for (int k = 0; k < 3; k++) {
        out[2 * k] = x[0][k];
        out[2 * k + 1] = x[1][k];
    }
    return isnan(out[0]) ? 0 : n;
}

/* The shorter step of a prediction. */
INLINE double pitch_of(const double *guess) {
    return sqrt(fmin(guess[2] * guess[2] + guess[3] * guess[3], guess[4] * guess[4] + guess[5] * guess[5]));
}

/* Distance of a labelled corner from its neighbours' prediction, as a share of the allowed distance: `tight` of the
 * shorter step between neighbours, `loose` elsewhere; 2 without a prediction. */
INLINE double excess_of(const Table *t, const double *xy, const int64_t *label, const double *own, double tight,
                        double loose) {
    double g[6];
    const int64_t u = label[0], v = label[1];
    if (!predicted(t, xy, u, v, g))
        return 2;
    const int between = (corner_at(t, u - 1, v) >= 0 && corner_at(t, u + 1, v) >= 0) ||
                        (corner_at(t, u, v - 1) >= 0 && corner_at(t, u, v + 1) >= 0);
    const double dx = own[0] - g[0], dy = own[1] - g[1];
    return sqrt(dx * dx + dy * dy) / ((between ? tight : loose) * fmax(pitch_of(g), 1e-9));
}

/* Median, for each of `width` columns, of the values (n, width) of the corners within REACH of a label; NaN if there is
 * none. */
INLINE void usual_near(const Table *t, int64_t u, int64_t v, const double *values, index_t width, double *out) {
    Near near;
    look_around(t, u, v, REACH, &near);
    for (index_t k = 0; k < width; k++) {
        double ranked[MOST_ROWS];
        ranked[0] = NAN;
        for (index_t i = 0; i < near.count; i++) {
            const double value = values[near.row[i] * width + k];
            index_t spot = i;
            for (; spot > 0 && ranked[spot - 1] > value; spot--)
                ranked[spot] = ranked[spot - 1];
            ranked[spot] = value;
        }
        out[k] = (ranked[(near.count - (near.count > 0)) / 2] + ranked[near.count / 2]) / 2;
    }
}

#endif
