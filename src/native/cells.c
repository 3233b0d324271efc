/* Cells of four linked corners, and grids by flood fill over them: see boards/graph.py. */
#include "kernel.h"

/* Whether the quadrilateral turns clockwise at each corner and its opposite sides have similar lengths. `xy`: positions
 * of all corners. */
static int is_regular(const double *xy, const int64_t *quad) {
    double x[4], y[4], length[4];
    for (int k = 0; k < 4; k++) {
        const double *from = xy + 2 * quad[k], *to = xy + 2 * quad[(k + 1) % 4];
        x[k] = to[0] - from[0], y[k] = to[1] - from[1];
        length[k] = sqrt(x[k] * x[k] + y[k] * y[k]);
    }
    for (int k = 0; k < 4; k++) {
        const double one = length[k % 2], other = length[k % 2 + 2], low = one < other ? one : other,
                     high = one < other ? other : one;
        const int after = (k + 1) % 4;
        if (!(x[k] * y[after] - y[k] * x[after] > 0) || !(high < 2.5 * (low > 1e-9 ? low : 1e-9)))
            return 0;
    }
    return 1;
}

static int has(const int64_t *row, int64_t corner) {
    return row[0] == corner || row[1] == corner || row[2] == corner || row[3] == corner;
}

static int same_corners(const int64_t *one, const int64_t *other) {
    return has(other, one[0]) && has(other, one[1]) && has(other, one[2]) && has(other, one[3]);
}

/* Cells `quads` (room, 4) of mutual links `neighbour` (n, 4), −1 for none, each once, in the order of the corner at
 * which they are first found; returns their number. `first` (n,) and `next` (room,) are buffers: lists of the cells
 * found so far by their lowest corner. At most 4 cells per link. */
KERNEL(rcdn_quads, (SIZE, n, neighbour, 0), (SIZE, room, next, 0), (WITHIN, int64_t, neighbour, -1, n - 1, n, 4),
       (IN, double, xy, n, 2), (OUT, int64_t, first, n), (OUT, int64_t, next, room), (OUT, int64_t, quads, room, 4)) {
    index_t count = 0;
    for (index_t a = 0; a < n; a++)
        first[a] = -1;
    for (index_t a = 0; a < n; a++)
        for (int k = 0; k < 4; k++) {
            const int64_t b = neighbour[4 * a + k], d = neighbour[4 * a + (k + 1) % 4];
            for (int m = 0; b >= 0 && d >= 0 && m < 4; m++) {
                const int64_t c = neighbour[4 * b + m], quad[4] = {a, b, c, d};
                if (c < 0 || c == a || !has(neighbour + 4 * d, c) || !is_regular(xy, quad))
                    continue;
                int64_t low = a;
                for (int q = 1; q < 4; q++)
                    low = quad[q] < low ? quad[q] : low;
                int64_t known = first[low];
                while (known >= 0 && !same_corners(quads + 4 * known, quad))
                    known = next[known];
                if (known >= 0 || count == room)
                    continue;
                memcpy(quads + 4 * count, quad, sizeof quad);
                next[count] = first[low];
                first[low] = count++;
            }
        }
    return count;
}

/* ---- flood fill */

/* State of the flood fill. A corner's label and a label's corner are valid only for the grid `grid`; `slots`, a power
 * of two, is the size of the hash table of labels. */
typedef struct {
    int64_t u, v, grid;
} Label;
typedef struct {
    int64_t u, v, corner, grid;
} Held;
_Static_assert(sizeof(Label) == 3 * sizeof(int64_t) && sizeof(Held) == 4 * sizeof(int64_t), "they are rows of arrays");
typedef struct {
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

/* Label the corners of a cell with `uv` (4, 2), unless that contradicts their labels or the corners that have these
 * labels. */
static int labelled(Grids *g, const int64_t *quad, int64_t uv[4][2]) {
    for (int k = 0; k < 4; k++) {
        const Label *own = g->where + quad[k];
        const Held *h = place_of(g, uv[k][0], uv[k][1]);
        if ((own->grid == g->grid && (own->u != uv[k][0] || own->v != uv[k][1])) ||
            (h->grid == g->grid && h->corner != quad[k]))
            return 0;
    }
    for (int k = 0; k < 4; k++) {
        Held *h = place_of(g, uv[k][0], uv[k][1]);
        if (h->grid == g->grid)
            continue;
        *h = (Held){uv[k][0], uv[k][1], quad[k], g->grid};
        g->where[quad[k]] = (Label){uv[k][0], uv[k][1], g->grid};
        int64_t *out = g->out + 3 * g->count++;
        out[0] = uv[k][0], out[1] = uv[k][1], out[2] = quad[k];
    }
    return 1;
}

/* Labels of a cell's corners from two adjacent ones that are known: all cells have the same orientation, so that two
 * are enough. */
static int spots_of(const Grids *g, const int64_t *quad, int64_t uv[4][2]) {
    for (int k = 0; k < 4; k++) {
        const Label *a = g->where + quad[k], *b = g->where + quad[(k + 1) % 4];
        if (a->grid != g->grid || b->grid != g->grid)
            continue;
        const int64_t du = b->u - a->u, dv = b->v - a->v;
        if (du * du + dv * dv != 1)
            return 0;
        const int64_t out[4][2] = {{a->u, a->v}, {b->u, b->v}, {b->u - dv, b->v + du}, {a->u - dv, a->v + du}};
        for (int n = 0; n < 4; n++)
            memcpy(uv[(n + k) % 4], out[n], sizeof out[n]);
        return 1;
    }
    return 0;
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

static int share_edge(const int64_t *one, const int64_t *other) {
    for (int k = 0; k < 4; k++)
        for (int m = 0; m < 4; m++) {
            const int64_t a = one[k], b = one[(k + 1) % 4], c = other[m], d = other[(m + 1) % 4];
            if ((a == c && b == d) || (a == d && b == c))
                return 1;
        }
    return 0;
}

/* Grids of `cells` (count, 4), in order of falling confidence, among corners numbered below `n`: `out` (4 count, 3) u,
 * v, corner, grid by grid, and the start of each, `begin` (count + 1,). Returns their number. Buffers: `used`, `heap`
 * (count,); `first` (n + 2,), `at_corner` (4 count,): the cells at each corner; `where` (n, 3); `held` (slots, 4),
 * `slots` a power of two. */
KERNEL(rcdn_label, (SIZE, count, cells, 0), (SIZE, n, where, 0), (SIZE, slots, held, 0),
       (WHERE, slots > 4 * count && (slots & (slots - 1)) == 0), (WITHIN, int64_t, cells, 0, n - 1, count, 4),
       (OUT, uint8_t, used, count), (OUT, int64_t, heap, count), (OUT, int64_t, first, n + 2),
       (OUT, int64_t, at_corner, 4 * count), (OUT, int64_t, where, n, 3), (OUT, int64_t, held, slots, 4),
       (OUT, int64_t, begin, count + 1), (OUT, int64_t, out, 4 * count, 3)) {
    static const int64_t square[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    Grids g = {(Label *)where, (Held *)held, out, slots, 0, -1};
    memset(used, 0, (size_t)count);
    memset(where, 0xff, (size_t)n * sizeof(Label)); /* grid −1: no grid */
    memset(held, 0xff, (size_t)slots * sizeof(Held));
    memset(first, 0, (size_t)(n + 2) * sizeof *first);
    for (index_t k = 0; k < 4 * count; k++)
        first[cells[k] + 2]++;
    for (index_t k = 2; k < n + 2; k++)
        first[k] += first[k - 1];
    for (index_t k = 0; k < 4 * count; k++)
        at_corner[first[cells[k] + 1]++] = k / 4;
    for (index_t seed = 0; seed < count; seed++) {
        index_t size = 0;
        if (used[seed])
            continue;
        begin[++g.grid] = g.count;
        used[seed] = 1;
        push(heap, &size, seed);
        while (size) {
            const int64_t *cell = cells + 4 * pop(heap, &size);
            int64_t uv[4][2];
            if (cell == cells + 4 * seed)
                memcpy(uv, square, sizeof uv);
            else if (!spots_of(&g, cell, uv))
                continue;
            if (!labelled(&g, cell, uv))
                continue;
            for (int k = 0; k < 4; k++)
                for (int64_t m = first[cell[k]]; m < first[cell[k] + 1]; m++) {
                    const int64_t other = at_corner[m];
                    if (used[other] || !share_edge(cell, cells + 4 * other))
                        continue;
                    used[other] = 1; /* each cell is tried in one grid only */
                    push(heap, &size, other);
                }
        }
    }
    begin[g.grid + 1] = g.count;
    return g.grid + 1;
}
