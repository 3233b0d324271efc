/* Cells of linked corners, and grids by flood fill over them, on lattices of squares and of triangles: see
 * boards/graph.py. */
#include "kernel.h"

#define MOST_SIDES 4 /* corners of a cell */

/* Whether a cell turns clockwise and its sides have similar lengths, of squares the opposite ones: none is `ratio`
 * times as long as another. `xy`: positions of all corners. */
static int is_regular(const double *xy, const int64_t *cell, index_t sides, double ratio) {
    double x[MOST_SIDES], y[MOST_SIDES], length[MOST_SIDES];
    for (index_t k = 0; k < sides; k++) {
        const double *from = xy + 2 * cell[k], *to = xy + 2 * cell[(k + 1) % sides];
        x[k] = to[0] - from[0], y[k] = to[1] - from[1];
        length[k] = sqrt(x[k] * x[k] + y[k] * y[k]);
    }
    for (index_t k = 0; k < sides; k++) {
        const index_t after = (k + 1) % sides;
        const double one = length[k], other = length[sides == 4 ? (k + 2) % 4 : after], low = one < other ? one : other,
                     high = one < other ? other : one;
        if (!(high < ratio * (low > 1e-9 ? low : 1e-9)))
            return 0;
        if ((sides == 4 || k == 0) && !(x[k] * y[after] - y[k] * x[after] > 0)) /* once is enough for a triangle */
            return 0;
    }
    return 1;
}

static int has(const int64_t *row, index_t size, int64_t corner) {
    for (index_t k = 0; k < size; k++)
        if (row[k] == corner)
            return 1;
    return 0;
}

static int same_corners(const int64_t *one, const int64_t *other, index_t sides) {
    for (index_t k = 0; k < sides; k++)
        if (!has(other, sides, one[k]))
            return 0;
    return 1;
}

/* The cells found so far: lists by their lowest corner. */
typedef struct {
    const double *xy;
    int64_t *first, *next, *cells;
    index_t sides, room, count;
    double ratio;
} Found;

static void add_cell(Found *f, const int64_t *cell) {
    const index_t sides = f->sides;
    if (!is_regular(f->xy, cell, sides, f->ratio))
        return;
    int64_t low = cell[0];
    for (index_t q = 1; q < sides; q++)
        low = cell[q] < low ? cell[q] : low;
    int64_t known = f->first[low];
    while (known >= 0 && !same_corners(f->cells + sides * known, cell, sides))
        known = f->next[known];
    if (known >= 0 || f->count == f->room)
        return;
    memcpy(f->cells + sides * f->count, cell, (size_t)sides * sizeof *cell);
    f->next[f->count] = f->first[low];
    f->first[low] = f->count++;
}

/* The triangle a, b, c, from its lowest corner on. */
static void add_triangle(Found *f, int64_t a, int64_t b, int64_t c) {
    const int64_t ring[5] = {a, b, c, a, b};
    add_cell(f, ring + (a < b ? (c < a ? 2 : 0) : (c < b ? 2 : 1)));
}

/* Cells (room, sides) of mutual links `neighbour` (n, slots), −1 for none, each once, clockwise, in the order of the
 * corner at which they are first found; returns their number. `ratio`: see `is_regular`. `first` (n,) and `next`
 * (room,) are buffers. At most 4 cells per link. */
KERNEL(rcdn_cells, (SIZE, n, neighbour, 0), (SIZE, slots, neighbour, 1), (SIZE, room, cells, 0),
       (SIZE, sides, cells, 1), (WHERE, (slots == 4 && sides == 4) || (slots == 6 && sides == 3)),
       (WITHIN, int64_t, neighbour, -1, n - 1, n, slots), (IN, double, xy, n, 2), (REAL, ratio),
       (OUT, int64_t, first, n), (OUT, int64_t, next, room), (OUT, int64_t, cells, room, sides)) {
    Found f = {xy, first, next, cells, sides, room, 0, ratio};
    for (index_t a = 0; a < n; a++)
        first[a] = -1;
    for (index_t a = 0; a < n; a++)
        for (index_t k = 0; k < slots; k++) {
            const int64_t b = neighbour[slots * a + k], d = neighbour[slots * a + (k + 1) % slots];
            if (b < 0 || d < 0)
                continue;
            if (sides == 3 && b != a && d != a && d != b && has(neighbour + slots * b, slots, d))
                add_triangle(&f, a, b, d);
            for (index_t m = 0; sides == 4 && m < slots; m++) {
                const int64_t c = neighbour[slots * b + m], quad[4] = {a, b, c, d};
                if (c >= 0 && c != a && has(neighbour + slots * d, slots, c))
                    add_cell(&f, quad);
            }
        }
    return f.count;
}

/* ---- flood fill */

/* State of the flood fill. A corner's label and a label's corner are valid only for the grid `grid`; `slots`, a power
 * of two, is the size of the hash table of labels. `steps` (ways, 2): changes of a label by a step, by rising angle;
 * `turn`: number of steps by which one side of a cell turns to the next. */
typedef struct {
    int64_t u, v, grid;
} Label;
typedef struct {
    int64_t u, v, corner, grid;
} Held;
_Static_assert(sizeof(Label) == 3 * sizeof(int64_t) && sizeof(Held) == 4 * sizeof(int64_t), "they are rows of arrays");
typedef struct {
    const int64_t *steps;
    index_t ways, sides, turn;
    Label *where; /* (corners,) */
    Held *held;   /* (slots,) */
    int64_t *out; /* (room, 3) u, v, corner */
    index_t slots, count;
    int64_t grid;
} Grids;

/* The entry of a label in the table: its own, or a free one. */
static Held *place_of(const Grids *g, int64_t u, int64_t v) {
    uint64_t hash = ((uint64_t)u * 0x9E3779B97F4A7C15u) ^ ((uint64_t)v * 0xC2B2AE3D27D4EB4Fu);
    hash ^= hash >> 29;
    for (;; hash++) {
        Held *h = g->held + (hash & (uint64_t)(g->slots - 1));
        if (h->grid != g->grid || (h->u == u && h->v == v))
            return h;
    }
}

/* Label the corners of a cell with `uv` (sides, 2), unless that contradicts their labels or the corners that have these
 * labels. */
static int labelled(Grids *g, const int64_t *cell, int64_t uv[MOST_SIDES][2]) {
    for (index_t k = 0; k < g->sides; k++) {
        const Label *own = g->where + cell[k];
        const Held *h = place_of(g, uv[k][0], uv[k][1]);
        if ((own->grid == g->grid && (own->u != uv[k][0] || own->v != uv[k][1])) ||
            (h->grid == g->grid && h->corner != cell[k]))
            return 0;
    }
    for (index_t k = 0; k < g->sides; k++) {
        Held *h = place_of(g, uv[k][0], uv[k][1]);
        if (h->grid == g->grid)
            continue;
        *h = (Held){uv[k][0], uv[k][1], cell[k], g->grid};
        g->where[cell[k]] = (Label){uv[k][0], uv[k][1], g->grid};
        int64_t *out = g->out + 3 * g->count++;
        out[0] = uv[k][0], out[1] = uv[k][1], out[2] = cell[k];
    }
    return 1;
}

/* Labels of a cell's corners from that of corner k and the step `way` to the next one. */
static void walk(const Grids *g, index_t k, int64_t u, int64_t v, index_t way, int64_t uv[MOST_SIDES][2]) {
    for (index_t n = 0; n < g->sides; n++) {
        const int64_t *step = g->steps + 2 * ((way + n * g->turn) % g->ways);
        uv[(k + n) % g->sides][0] = u, uv[(k + n) % g->sides][1] = v;
        u += step[0], v += step[1];
    }
}

/* Labels of a cell's corners from two adjacent ones that are known: all cells have the same orientation, so that two
 * are enough. Returns the step from corner 0 to corner 1, −1 if there are none. */
static index_t spots_of(const Grids *g, const int64_t *cell, int64_t uv[MOST_SIDES][2]) {
    for (index_t k = 0; k < g->sides; k++) {
        const Label *a = g->where + cell[k], *b = g->where + cell[(k + 1) % g->sides];
        if (a->grid != g->grid || b->grid != g->grid)
            continue;
        for (index_t way = 0; way < g->ways; way++)
            if (b->u - a->u == g->steps[2 * way] && b->v - a->v == g->steps[2 * way + 1]) {
                walk(g, k, a->u, a->v, way, uv);
                return (way + (g->sides - k) * g->turn) % g->ways;
            }
        return -1;
    }
    return -1;
}

/* A heap of ranks, the lowest on top. */
static void push(int64_t *heap, index_t *size, int64_t rank) {
    index_t k = (*size)++;
    for (; k > 0 && heap[(k - 1) / 2] > rank; k = (k - 1) / 2)
        heap[k] = heap[(k - 1) / 2];
    heap[k] = rank;
}

static int64_t pop(int64_t *heap, index_t *size) {
    const int64_t top = heap[0], last = heap[--*size];
    index_t k = 0;
    for (index_t child; (child = 2 * k + 1) < *size; k = child) {
        child += child + 1 < *size && heap[child + 1] < heap[child];
        if (heap[child] >= last)
            break;
        heap[k] = heap[child];
    }
    heap[k] = last;
    return top;
}

/* Whether a cell lies beyond the side from corner a to b of another one. Squares may also run along it the same way. */
static int is_beyond(const int64_t *cell, index_t sides, int64_t a, int64_t b) {
    for (index_t m = 0; m < sides; m++) {
        const int64_t c = cell[m], d = cell[(m + 1) % sides];
        if ((a == d && b == c) || (sides == 4 && a == c && b == d))
            return 1;
    }
    return 0;
}

/* Grids of `cells` (count, sides), in order of falling confidence, among corners numbered below `n`: `out` (sides
 * count, 3) u, v, corner, grid by grid, and of each, `begin` (count + 1, 2), its start and the colour of its first
 * cell. Returns their number.
 *
 * `steps`: see `Grids`. `colour` (count,): 0 for squares, whose colours the links have checked; those of triangles must
 * alternate. A square is tried in one grid only; a triangle until it is labelled, and of several that lie beyond a side
 * the last by `number` (count,). Buffers: `used` (count,), `heap` (sides count + 1,); `first` (n + 2,), `at_corner`
 * (sides count,): the cells at each corner; `where` (n, 3); `held` (slots, 4), `slots` a power of two. */
KERNEL(rcdn_label, (SIZE, count, cells, 0), (SIZE, sides, cells, 1), (SIZE, ways, steps, 0), (SIZE, n, where, 0),
       (SIZE, slots, held, 0), (WHERE, (ways == 4 && sides == 4) || (ways == 6 && sides == 3)),
       (WHERE, slots > sides * count && (slots & (slots - 1)) == 0), (WITHIN, int64_t, cells, 0, n - 1, count, sides),
       (WITHIN, int64_t, colour, -1, 1, count), (IN, int64_t, number, count), (WITHIN, int64_t, steps, -1, 1, ways, 2),
       (OUT, uint8_t, used, count), (OUT, int64_t, heap, sides *count + 1), (OUT, int64_t, first, n + 2),
       (OUT, int64_t, at_corner, sides *count), (OUT, int64_t, where, n, 3), (OUT, int64_t, held, slots, 4),
       (OUT, int64_t, begin, count + 1, 2), (OUT, int64_t, out, sides *count, 3)) {
    Grids g = {steps, ways, sides, ways / sides, (Label *)where, (Held *)held, out, slots, 0, -1};
    const int once = sides == 4;
    memset(used, 0, (size_t)count);
    memset(where, 0xff, (size_t)n * sizeof(Label)); /* grid −1: no grid */
    memset(held, 0xff, (size_t)slots * sizeof(Held));
    memset(first, 0, (size_t)(n + 2) * sizeof *first);
    for (index_t k = 0; k < sides * count; k++)
        first[cells[k] + 2]++;
    for (index_t k = 2; k < n + 2; k++)
        first[k] += first[k - 1];
    for (index_t k = 0; k < sides * count; k++)
        at_corner[first[cells[k] + 1]++] = k / sides;
    for (index_t seed = 0; seed < count; seed++) {
        index_t size = 0;
        if (used[seed])
            continue;
        begin[2 * ++g.grid] = g.count;
        begin[2 * g.grid + 1] = colour[seed];
        used[seed] = (uint8_t)once;
        push(heap, &size, seed);
        while (size) {
            const int64_t own = pop(heap, &size), *cell = cells + sides * own;
            int64_t uv[MOST_SIDES][2];
            index_t way = 0;
            if (!once && used[own])
                continue;
            if (g.count == begin[2 * g.grid])
                walk(&g, 0, 0, 0, 0, uv);
            else
                way = spots_of(&g, cell, uv);
            if (way < 0 || colour[own] != (way & 1 ? -colour[seed] : colour[seed]) || !labelled(&g, cell, uv))
                continue;
            used[own] = 1;
            for (index_t k = 0; k < sides; k++) {
                const int64_t a = cell[k], b = cell[(k + 1) % sides];
                int64_t last = -1;
                for (int64_t m = first[a]; m < first[a + 1]; m++) {
                    const int64_t other = at_corner[m];
                    if ((once && used[other]) || !is_beyond(cells + sides * other, sides, a, b))
                        continue;
                    if (once) {
                        used[other] = 1;
                        push(heap, &size, other);
                    } else if (last < 0 || number[other] > number[last])
                        last = other;
                }
                if (last >= 0 && !used[last])
                    push(heap, &size, last);
            }
        }
    }
    begin[2 * (g.grid + 1)] = g.count;
    begin[2 * (g.grid + 1) + 1] = 0;
    return g.grid + 1;
}
