/* Drop-only validation of a labelled grid. */
#include "grid.h"

/* A value with the index of its corner. */
typedef struct {
    double value;
    index_t of;
} Ranked;

typedef struct {
    Table table;
    const int64_t *labels;
    const double *xy, *quality, *contrast;
    index_t n, left; /* number of corners, and of those that have not been removed */
    double *excess;
    Ranked *ranked;
    int32_t *stack, *heap, *place; /* misfits, the worst on top; a corner's position among them, -1 for none */
    index_t misfits;
    /* whether a corner has not been removed; whether its neighbours have changed since its excess was computed */
    uint8_t *there, *stale;
} Grid;

typedef struct {
    double residual, residual_loose, least_quality, least_share;
} Limits;

INLINE void drop(Grid *g, index_t k) {
    int32_t *row = g->table.row + cell_of(&g->table, g->labels + 2 * k);
    *row = -1;
    g->there[k] = 0;
    g->left--;
    for (index_t d = -WIDEST; d <= WIDEST; d++)
        for (index_t e = -WIDEST; e <= WIDEST; e++)
            if (row[d * g->table.height + e] >= 0)
                g->stale[row[d * g->table.height + e]] = 1;
}

/* Whether corner `a` is a worse misfit than `b`; of equal ones, that with the smaller label. */
INLINE int worse(const Grid *g, int32_t a, int32_t b) {
    const int64_t *one = g->labels + 2 * (index_t)a, *other = g->labels + 2 * (index_t)b;
    if (g->excess[a] != g->excess[b])
        return g->excess[a] > g->excess[b];
    return one[0] < other[0] || (one[0] == other[0] && one[1] < other[1]);
}

/* Insert corner `k` into the heap at its proper position, starting from `at`. */
static void sift(Grid *g, index_t at, int32_t k) {
    for (index_t up; at > 0 && worse(g, k, g->heap[up = (at - 1) / 2]); at = up)
        g->place[g->heap[at] = g->heap[up]] = (int32_t)at;
    for (index_t down; (down = 2 * at + 1) < g->misfits; at = down) {
        down += down + 1 < g->misfits && worse(g, g->heap[down + 1], g->heap[down]);
        if (!worse(g, g->heap[down], k))
            break;
        g->place[g->heap[at] = g->heap[down]] = (int32_t)at;
    }
    g->place[g->heap[at] = k] = (int32_t)at;
}

/* Remove a corner from the heap, or insert it, according to its excess. */
static void judge(Grid *g, int32_t k) {
    const index_t at = g->place[k];
    if (g->there[k] && g->excess[k] > 1)
        sift(g, at >= 0 ? at : g->misfits++, k);
    else if (at >= 0) {
        const int32_t last = g->heap[--g->misfits];
        g->place[k] = -1;
        if (last != k)
            sift(g, at, last);
    }
}

/* Update a corner's excess over the allowed distance from its prediction. */
INLINE void look_at(Grid *g, index_t k, const Limits *limits) {
    if (g->there[k] && g->stale[k]) {
        g->stale[k] = 0;
        g->excess[k] =
            excess_of(&g->table, g->xy, g->labels + 2 * k, g->xy + 2 * k, limits->residual, limits->residual_loose);
    }
    judge(g, (int32_t)k);
}

/* Remove corners too far from their neighbours' prediction, worst first, of equal ones that with the smallest label. */
INLINE void drop_misfits(Grid *g, const Limits *limits) {
    for (index_t k = 0; k < g->n; k++)
        look_at(g, k, limits);
    while (g->misfits) {
        const index_t worst = g->heap[0];
        const int32_t *row = g->table.row + cell_of(&g->table, g->labels + 2 * worst);
        drop(g, worst);
        judge(g, (int32_t)worst);
        for (index_t d = -WIDEST; d <= WIDEST; d++)
            for (index_t e = -WIDEST; e <= WIDEST; e++)
                if (row[d * g->table.height + e] >= 0)
                    look_at(g, row[d * g->table.height + e], limits);
    }
}

/* Whether there is a direction without a further corner within WIDEST squares (holes do not count). */
INLINE int outermost(const Table *t, const int64_t *label) {
    const int32_t *row = t->row + cell_of(t, label);
    int left = 0, right = 0, up = 0, down = 0;
    for (index_t k = 1; k <= WIDEST; k++) {
        left |= row[-k * t->height] >= 0;
        right |= row[k * t->height] >= 0;
        up |= row[-k] >= 0;
        down |= row[k] >= 0;
    }
    return !(left && right && up && down);
}

static int by_value(const void *a, const void *b) {
    const double one = ((const Ranked *)a)->value, other = ((const Ranked *)b)->value;
    return (one > other) - (one < other);
}

/* Median quality of the remaining corners; `ranked` (n) has all corners by rising quality. */
static double median_quality(const Grid *g) {
    const index_t low = (g->left - 1) / 2, high = g->left / 2;
    double sum = 0;
    for (index_t k = 0, count = 0; k < g->n && count <= high; k++)
        if (g->there[g->ranked[k].of]) {
            sum += (count == low) * g->ranked[k].value + (count == high) * g->ranked[k].value;
            count++;
        }
    return sum / 2;
}

/* Remove poor corners on the rim. A corner inside the grid is confirmed by its neighbours; one on the rim must be an
 * X-corner by its own evidence: quality relative to the grid's median, times its contrast relative to its neighbours'.
 * */
INLINE void drop_poor_rim(Grid *g, const Limits *limits) {
    while (g->left) {
        index_t poor = 0;
        const double median = fmax(median_quality(g), 1e-9);
        for (index_t k = 0; k < g->n; k++) {
            const int64_t *label = g->labels + 2 * k;
            /* skip corners that pass even with the least share */
            if (!g->there[k] || !(g->quality[k] / median * limits->least_share < limits->least_quality) ||
                !outermost(&g->table, label))
                continue;
            double usual, share = 1;
            usual_near(&g->table, label[0], label[1], g->contrast, 1, &usual);
            if (!isnan(usual))
                share = fmin(fmax(g->contrast[k] / fmax(usual, 1e-9), limits->least_share), 1);
            if (g->quality[k] / median * share < limits->least_quality)
                g->stack[poor++] = (int32_t)k;
        }
        for (index_t k = 0; k < poor; k++)
            drop(g, g->stack[k]);
        if (!poor)
            return;
    }
}

/* Remove corners that belong to no complete cell. */
INLINE void drop_loose(Grid *g) {
    const index_t down = 1, right = g->table.height;
    index_t loose = 1;
    while (loose) {
        loose = 0;
        for (index_t k = 0; k < g->n; k++) {
            if (!g->there[k])
                continue;
            const int32_t *row = g->table.row + cell_of(&g->table, g->labels + 2 * k);
            int whole = 0;
            for (int way = 0; way < 4 && !whole; way++) {
                const index_t d = way & 1 ? right : -right, e = way & 2 ? down : -down;
                whole = row[d] >= 0 && row[e] >= 0 && row[d + e] >= 0;
            }
            if (!whole) {
                drop(g, k);
                loose++;
            }
        }
    }
}

/* Index of the connected component of each corner (n), -1 for removed ones: the largest component is 0; of equal ones,
 * that with the smallest label comes first. Returns their number. */
static index_t split(Grid *g, int64_t *part) {
    const index_t ways[4] = {1, -1, g->table.height, -g->table.height};
    index_t count = 0;
    for (index_t k = 0; k < g->n; k++)
        part[k] = -1;
    for (index_t cell = 0; cell < g->table.width * g->table.height; cell++) { /* in the order of labels */
        const int32_t first = g->table.row[cell];
        if (first < 0 || part[first] >= 0)
            continue;
        index_t depth = 1, size = 0;
        g->stack[0] = first;
        part[first] = count;
        while (depth) {
            const int32_t k = g->stack[--depth];
            const int32_t *row = g->table.row + cell_of(&g->table, g->labels + 2 * k);
            size++;
            for (int way = 0; way < 4; way++) {
                const int32_t next = row[ways[way]];
                if (next >= 0 && part[next] < 0) {
                    part[next] = count;
                    g->stack[depth++] = next;
                }
            }
        }
        g->ranked[count] = (Ranked){-(double)size * (double)(g->n + 1) + (double)count, count}; /* ties: the first */
        count++;
    }
    if (count < 2)
        return count;
    int32_t *place = g->stack; /* there are no more components than corners */
    qsort(g->ranked, (size_t)count, sizeof *g->ranked, by_value);
    for (index_t a = 0; a < count; a++)
        place[g->ranked[a].of] = (int32_t)a;
    for (index_t k = 0; k < g->n; k++)
        part[k] = part[k] < 0 ? -1 : place[part[k]];
    return count;
}

static int with_room(Grid *g) {
    const size_t n = (size_t)g->n + 1;
    char *room = malloc(n * (sizeof(double) + sizeof(Ranked) + 3 * sizeof(int32_t) + 2));
    g->excess = (double *)room;
    if (!room)
        return 0;
    g->ranked = (Ranked *)(g->excess + n);
    g->stack = (int32_t *)(g->ranked + n);
    g->heap = g->stack + n;
    g->place = g->heap + n;
    g->there = (uint8_t *)(g->place + n);
    g->stale = g->there + n;
    memset(g->there, 1, n);
    memset(g->stale, 1, n);
    memset(g->place, 0xff, n * sizeof *g->place);
    for (index_t k = 0; k < g->n; k++)
        g->ranked[k] = (Ranked){g->quality[k], k};
    qsort(g->ranked, (size_t)g->n, sizeof *g->ranked, by_value);
    return 1;
}

/* Prune a grid of corners `labels`, `xy` (n, 2) of `quality` and `contrast` (n): misfits are removed, worst first, then
 * rim corners that are hardly X-corners, then corners in no complete cell, until nothing changes. `part` (n): as from
 * `split`. Returns the number of components. */
KERNEL(rcdn_grid_prune, (SIZE, n, labels, 0), (WITHIN, int64_t, labels, -ANYWHERE, ANYWHERE, n, 2),
       (IN, double, xy, n, 2), (IN, double, quality, n), (IN, double, contrast, n), (REAL, residual),
       (REAL, residual_loose), (REAL, least_quality), (REAL, least_share), (OUT, int64_t, part, n)) {
    Grid g = {.labels = labels, .xy = xy, .quality = quality, .contrast = contrast, .n = n, .left = n};
    const Limits limits = {residual, residual_loose, least_quality, least_share};
    if (!with_room(&g) || !open_table(&g.table, labels, n)) {
        free(g.excess);
        return NO_MEMORY;
    }
    for (index_t before = -1; before != g.left;) {
        before = g.left;
        drop_misfits(&g, &limits);
        drop_poor_rim(&g, &limits);
        drop_loose(&g);
    }
    const index_t count = split(&g, part);
    free(g.table.row);
    free(g.excess);
    return count;
}
