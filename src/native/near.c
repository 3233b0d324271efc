/* Neighbours in the plane: points sorted into square cells, which are searched ring by ring. */
#include "kernel.h"

/* Coordinates from which on points do not extend the grid of cells: such points are assigned to border cells. */
#define AWAY 1e5
#define PER_CELL 2.0
/* Fewer queries than this are answered by testing all points. */
#define FEW 12

typedef struct {
    const double *points;
    double left, top, size;
    index_t columns, rows;
    /* points of a cell: order[first[cell]] .. order[first[cell + 1] - 1]; order NULL: one cell in input order */
    int32_t *first, *order;
} Cells;

static index_t along(double at, double low, double size, index_t count) {
    const double k = (at - low) / size;
    return k >= (double)count ? count - 1 : k > 0 ? (index_t)k : 0; /* 0 for NaN */
}

static index_t cell_of(const Cells *c, const double *at) {
    return along(at[1], c->top, c->size, c->rows) * c->columns + along(at[0], c->left, c->size, c->columns);
}

static int sorted_into_cells(Cells *c, const double *points, index_t n, index_t questions) {
    if (questions < FEW) {
        *c = (Cells){points, 0, 0, 1, 1, 1, calloc(2, sizeof *c->first), NULL};
        if (c->first)
            c->first[1] = (int32_t)n;
        return c->first != NULL;
    }
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    for (index_t i = 0; i < n; i++)
        for (int k = 0; k < 2; k++) {
            const double at = points[2 * i + k];
            if (fabs(at) < AWAY) {
                low[k] = fmin(low[k], at);
                high[k] = fmax(high[k], at);
            }
        }
    for (int k = 0; k < 2; k++)
        if (low[k] > high[k])
            low[k] = high[k] = 0;
    const double width = high[0] - low[0], height = high[1] - low[1];
    const double most = sqrt((double)n) + 1;
    c->points = points;
    c->left = low[0];
    c->top = low[1];
    c->size =
        fmax(fmax(sqrt(width * height * PER_CELL / (double)(n > 0 ? n : 1)), fmax(width, height) / (4 * most)), 1e-3);
    c->columns = (index_t)(width / c->size) + 1;
    c->rows = (index_t)(height / c->size) + 1;
    const index_t cells = c->columns * c->rows;
    c->first = calloc((size_t)cells + 2, sizeof *c->first);
    c->order = malloc(((size_t)n + 1) * sizeof *c->order);
    if (!c->first || !c->order) {
        free(c->first);
        free(c->order);
        return 0;
    }
    for (index_t i = 0; i < n; i++)
        c->first[cell_of(c, points + 2 * i) + 2]++;
    for (index_t k = 2; k < cells + 2; k++)
        c->first[k] += c->first[k - 1];
    for (index_t i = 0; i < n; i++)
        c->order[c->first[cell_of(c, points + 2 * i) + 1]++] = (int32_t)i;
    return 1;
}

static void forget(Cells *c) {
    free(c->first);
    free(c->order);
}

/* Insert a point into the `count` nearest so far, ordered by distance, then index. */
static void offer(double square, int64_t index, index_t count, double *distance, int64_t *nearest) {
    index_t k = count - 1;
    if (!(square < distance[k] || (square == distance[k] && index < nearest[k])))
        return;
    for (; k > 0 && (square < distance[k - 1] || (square == distance[k - 1] && index < nearest[k - 1])); k--) {
        distance[k] = distance[k - 1];
        nearest[k] = nearest[k - 1];
    }
    distance[k] = square;
    nearest[k] = index;
}

static void offer_row(const Cells *c, index_t row, index_t from, index_t to, const double *at, index_t count,
                      double *distance, int64_t *nearest) {
    if (row < 0 || row >= c->rows)
        return;
    from = from < 0 ? 0 : from;
    to = to >= c->columns ? c->columns - 1 : to;
    if (from > to)
        return;
    for (index_t k = c->first[row * c->columns + from]; k < c->first[row * c->columns + to + 1]; k++) {
        const index_t i = c->order ? c->order[k] : k;
        const double dx = c->points[2 * i] - at[0], dy = c->points[2 * i + 1] - at[1];
        offer(dx * dx + dy * dy, i, count, distance, nearest);
    }
}

/* Lower bound of the distance of anything outside the `ring` cells around (column, row); INFINITY if there is nothing.
 * */
static double beyond(const Cells *c, const double *at, index_t column, index_t row, index_t ring) {
    double out = INFINITY;
    if (column - ring > 0)
        out = fmin(out, at[0] - (c->left + (double)(column - ring) * c->size));
    if (column + ring < c->columns - 1)
        out = fmin(out, c->left + (double)(column + ring + 1) * c->size - at[0]);
    if (row - ring > 0)
        out = fmin(out, at[1] - (c->top + (double)(row - ring) * c->size));
    if (row + ring < c->rows - 1)
        out = fmin(out, c->top + (double)(row + ring + 1) * c->size - at[1]);
    return fmax(out, 0);
}

/* The `count` points nearest to each of `at` (m): distances, and indices; inf and n where there are fewer. */
KERNEL(rcdn_nearest, (SIZE, n, points, 0), (SIZE, m, at, 0), (SIZE, count, distance, 1), (WHERE, count > 0),
       (IN, double, points, n, 2), (IN, double, at, m, 2), (OUT, double, distance, m, count),
       (OUT, int64_t, nearest, m, count)) {
    Cells cells;
    if (!sorted_into_cells(&cells, points, n, m))
        return NO_MEMORY;
    for (index_t j = 0; j < m; j++, at += 2, distance += count, nearest += count) {
        for (index_t k = 0; k < count; k++) {
            distance[k] = INFINITY;
            nearest[k] = n;
        }
        const index_t column = along(at[0], cells.left, cells.size, cells.columns);
        const index_t row = along(at[1], cells.top, cells.size, cells.rows);
        for (index_t ring = 0;; ring++) {
            if (ring == 0)
                offer_row(&cells, row, column, column, at, count, distance, nearest);
            else {
                offer_row(&cells, row - ring, column - ring, column + ring, at, count, distance, nearest);
                offer_row(&cells, row + ring, column - ring, column + ring, at, count, distance, nearest);
                for (index_t k = row - ring + 1; k < row + ring; k++) {
                    offer_row(&cells, k, column - ring, column - ring, at, count, distance, nearest);
                    offer_row(&cells, k, column + ring, column + ring, at, count, distance, nearest);
                }
            }
            const double rest = beyond(&cells, at, column, row, ring);
            if (rest == INFINITY || rest * rest > distance[count - 1])
                break;
        }
        for (index_t k = 0; k < count; k++)
            distance[k] = sqrt(distance[k]);
    }
    forget(&cells);
    return 0;
}

/* All points within reach[j] of at[j], ordered by j, then index; at most `room` are stored. Returns their number. */
KERNEL(rcdn_within, (SIZE, n, points, 0), (SIZE, m, at, 0), (SIZE, room, row_out, 0), (IN, double, points, n, 2),
       (IN, double, at, m, 2), (IN, double, reach, m), (OUT, int64_t, row_out, room), (OUT, int64_t, index_out, room)) {
    Cells cells;
    if (!sorted_into_cells(&cells, points, n, m))
        return NO_MEMORY;
    index_t total = 0;
    for (index_t j = 0; j < m; j++, at += 2) {
        const index_t start = total;
        const index_t left = along(at[0] - reach[j], cells.left, cells.size, cells.columns);
        const index_t right = along(at[0] + reach[j], cells.left, cells.size, cells.columns);
        const index_t top = along(at[1] - reach[j], cells.top, cells.size, cells.rows);
        const index_t low = along(at[1] + reach[j], cells.top, cells.size, cells.rows);
        for (index_t row = top; row <= low; row++)
            for (index_t k = cells.first[row * cells.columns + left]; k < cells.first[row * cells.columns + right + 1];
                 k++) {
                const index_t i = cells.order ? cells.order[k] : k;
                const double dx = points[2 * i] - at[0], dy = points[2 * i + 1] - at[1];
                if (!(dx * dx + dy * dy <= reach[j] * reach[j]))
                    continue;
                if (total < room) {
                    index_t spot = total;
                    for (; spot > start && index_out[spot - 1] > i; spot--)
                        index_out[spot] = index_out[spot - 1];
                    index_out[spot] = i;
                    row_out[total] = j;
                }
                total++;
            }
    }
    forget(&cells);
    return total;
}
