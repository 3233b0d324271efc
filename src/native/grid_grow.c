/* Completion of a labelled grid: its colouring, and the corners that may be added to it. */
#include "elementary.h"
#include "grid.h"
#include "sampling.h"

/* Colour of a corner's side at rising angle from the direction (dx, dy), bright +1 or dark -1, and the angle to its
 * nearest axis. */
INLINE int side_colour(const double *axes, int64_t polarity, double dx, double dy, double *turn) {
    const double direction = angle_of(dy, dx);
    double turns[2];
    for (int k = 0; k < 2; k++) {
        const double rest = fmod(axes[k] - direction + PI / 2, PI);
        turns[k] = isfinite(axes[k]) ? fabs((rest < 0 ? rest + PI : rest) - PI / 2) : PI;
    }
    const int other = turns[1] < turns[0];
    *turn = turns[other];
    return (int)(other ? -polarity : polarity);
}

/* Votes for the colouring of a grid of corners with indices `members` (n) into `xy`: side colour of the u axis times
 * (-1)^(u + v), for corners with an axis within `far` of their step along u. `axes` and colours are known for the first
 * `known` corners. `votes` (1). */
KERNEL(rcdn_grid_sign, (SIZE, n, labels, 0), (SIZE, total, xy, 0), (SIZE, known, axes, 0),
       (WITHIN, int64_t, labels, -ANYWHERE, ANYWHERE, n, 2), (WITHIN, int64_t, members, 0, total - 1, n),
       (IN, double, xy, total, 2), (IN, double, axes, known, 2), (IN, int64_t, polarity, known), (REAL, far),
       (OUT, int64_t, votes, 1)) {
    Table t;
    if (!open_table(&t, labels, n))
        return NO_MEMORY;
    *votes = 0;
    for (index_t k = 0; k < n; k++) {
        const int32_t *row = t.row + cell_of(&t, labels + 2 * k);
        const int32_t ahead = row[t.height], behind = row[-t.height];
        if ((ahead < 0 && behind < 0) || members[k] >= known)
            continue;
        const double *to = xy + 2 * members[ahead >= 0 ? ahead : k], *from = xy + 2 * members[ahead >= 0 ? k : behind];
        double turn;
        const int64_t colour =
            side_colour(axes + 2 * members[k], polarity[members[k]], to[0] - from[0], to[1] - from[1], &turn);
        if (turn < far)
            *votes += (labels[2 * k] + labels[2 * k + 1]) & 1 ? -colour : colour;
    }
    free(t.row);
    return 0;
}

/* A growing grid: its labels (n, 2) and the indices of its corners (n); the open spots (count, 2), their predictions
 * (count, 6) and shorter steps (count). */
ARGUMENT_GROUP(Rim, (SIZE, n, labels, 0), (SIZE, count, spots, 0), (WITHIN, int64_t, labels, -ANYWHERE, ANYWHERE, n, 2),
               (IN, int64_t, members, n), (WITHIN, int64_t, spots, -ANYWHERE, ANYWHERE, count, 2),
               (IN, double, maps, count, 6), (IN, double, pitch, count))

/* The corners of an image as in `boards.graph.Field`; which of them are `free`, updated. */
ARGUMENT_GROUP(Corners, (SIZE, count, xy, 0), (IN, double, xy, count, 2), (IN, double, axes, count, 2),
               (IN, int64_t, polarity, count), (IN, double, contrast, count), (IN, double, response, count),
               (IN, double, fit, count), (IN, uint8_t, strong, count), (IN, uint8_t, refined, count),
               (OUT, uint8_t, free, count))

/* Conditions on new corners: response x fit at least `level`, at most `near` squares from the prediction, `near_weak`
 * if they are not strong, and none of the offers (u, v, corner) that were `refused` before. `sign`: the grid's
 * colouring; `far`: largest angle of the axes, radians; `least`, `least_weak`: least contrast of each third of an edge
 * to a neighbour, share of the neighbour's contrast. */
ARGUMENT_GROUP(Rules, (REAL, level), (INT, sign, -1, 1), (REAL, near), (REAL, near_weak), (REAL, far), (REAL, least),
               (REAL, least_weak), (SIZE, refusals, refused, 0), (IN, int64_t, refused, refusals, 3))

/* A corner offered to a spot: its distance from the prediction, squares; the spot; the corner. */
typedef struct {
    double gap;
    int64_t offer[3];
} Offer;

/* Offers by distance, spot and corner. */
static int by_distance(const void *a, const void *b) {
    const Offer *one = a, *other = b;
    if (one->gap != other->gap)
        return one->gap < other->gap ? -1 : 1;
    for (int k = 0; k < 3; k++)
        if (one->offer[k] != other->offer[k])
            return one->offer[k] < other->offer[k] ? -1 : 1;
    return 0;
}

/* A list that grows. */
typedef struct {
    Offer *items;
    index_t count, room;
} Offers;

static int append(Offers *list, double gap, const int64_t *spot, index_t corner) {
    if (list->count == list->room) {
        const index_t room = 2 * list->room + 64;
        Offer *items = realloc(list->items, (size_t)room * sizeof *items);
        if (!items)
            return 0;
        list->items = items;
        list->room = room;
    }
    list->items[list->count++] = (Offer){gap, {spot[0], spot[1], corner}};
    return 1;
}

/* Whether a corner may be added, by its own properties. */
INLINE int usable(const Corners *all, index_t c, double level) {
    return all->free[c] && (all->refined[c] || all->strong[c]) && all->response[c] * all->fit[c] >= level;
}

/* Offers refused before, (count, 3) u, v, corner, by a hash table of rows: `slot` (slots), a power of two, -1 for none.
 * */
typedef struct {
    const int64_t *refused;
    int32_t *slot;
    index_t slots;
} Refused;

static int32_t *slot_of(const Refused *r, int64_t u, int64_t v, int64_t corner) {
    uint64_t hash = ((uint64_t)u * 0x9E3779B97F4A7C15u) ^ ((uint64_t)v * 0xC2B2AE3D27D4EB4Fu) ^
                    ((uint64_t)corner * 0x165667B19E3779F9u);
    hash ^= hash >> 29;
    for (;; hash++) {
        int32_t *slot = r->slot + (hash & (uint64_t)(r->slots - 1));
        if (*slot < 0)
            return slot;
        const int64_t *known = r->refused + 3 * (index_t)*slot;
        if (known[0] == u && known[1] == v && known[2] == corner)
            return slot;
    }
}

static int open_refused(Refused *r, const int64_t *refused, index_t count) {
    r->refused = refused;
    for (r->slots = 16; r->slots < 2 * count;)
        r->slots *= 2;
    r->slot = malloc((size_t)r->slots * sizeof *r->slot);
    if (!r->slot)
        return 0;
    memset(r->slot, 0xff, (size_t)r->slots * sizeof *r->slot);
    for (index_t k = 0; k < count; k++)
        *slot_of(r, refused[3 * k], refused[3 * k + 1], refused[3 * k + 2]) = (int32_t)k;
    return 1;
}

/* Predicted spots sorted into square cells, none smaller than the largest distance of a corner from its prediction: a
 * corner's spots are in its own cell or in one of the eight around it. */
typedef struct {
    double left, top, size;
    index_t columns, rows;
    int32_t *first, *order; /* first[cell] .. first[cell + 1] in order */
} SpotCells;

/* Number of cells along an extent of `sizes` cell sizes, at most n + 2; one if it is not a number. */
INLINE index_t cells_along(double sizes, index_t n) {
    return sizes > 0 ? (index_t)fmin(sizes, (double)n + 1) + 1 : 1;
}

INLINE index_t cell_at(double at, double low, double size, index_t count) {
    const double k = (at - low) / size;
    return k >= (double)count ? count - 1 : k > 0 ? (index_t)k : 0;
}

static int open_spot_cells(SpotCells *p, const Rim *rim, double near, const double *low, const double *high) {
    double reach = 0;
    for (index_t k = 0; k < rim->count; k++)
        reach = fmax(reach, near * rim->pitch[k]);
    const double width = fmax(high[0] - low[0], 0), height = fmax(high[1] - low[1], 0), n = (double)rim->count + 1;
    p->left = low[0];
    p->top = low[1];
    p->size = fmax(fmax(reach, sqrt(width * height / n)), fmax(fmax(width, height) / n, 1e-3));
    p->columns = cells_along(width / p->size, rim->count);
    p->rows = cells_along(height / p->size, rim->count);
    const index_t cells = p->columns * p->rows;
    p->first = calloc((size_t)cells + 2, sizeof *p->first);
    p->order = malloc(((size_t)rim->count + 1) * sizeof *p->order);
    if (!p->first || !p->order)
        return 0;
    for (int pass = 0; pass < 2; pass++) { /* count, then sort */
        for (index_t k = 0; k < rim->count; k++) {
            const index_t row = cell_at(rim->maps[6 * k + 1], p->top, p->size, p->rows);
            const index_t cell = row * p->columns + cell_at(rim->maps[6 * k], p->left, p->size, p->columns);
            if (pass)
                p->order[p->first[cell + 1]++] = (int32_t)k;
            else
                p->first[cell + 2]++;
        }
        for (index_t k = 2; k < cells + 2 && !pass; k++)
            p->first[k] += p->first[k - 1];
    }
    return 1;
}

/* Whether a corner's axes and colours fit the predicted steps. */
static int fits_steps(const Corners *all, index_t corner, const double *map, int colour, double far) {
    double turn_u, turn_v;
    const int u = side_colour(all->axes + 2 * corner, all->polarity[corner], map[2], map[3], &turn_u);
    const int v = side_colour(all->axes + 2 * corner, all->polarity[corner], map[4], map[5], &turn_v);
    return u == colour && v == -colour && turn_u < far && turn_v < far;
}

/* The edges between a corner and the labelled neighbours of its spot: contrast of each third of an edge, and the
 * neighbour's contrast, negative where the side at rising angle is the dark one. */
typedef struct {
    int count;
    double shown[4][3], level[4];
} Edges;

/* Whether the edges are visible: one is enough for a strong corner whose axes and colours fit the board's, if no other
 * contradicts it; otherwise all must be visible, and at least two of them where these do not fit. */
INLINE int are_visible(const Edges *edges, int fits, int strong, const Rules *rules) {
    int one = 0, plain = 1, all = 1;
    for (int k = 0; k < edges->count; k++) {
        const double a = edges->shown[k][0] / edges->level[k], b = edges->shown[k][1] / edges->level[k],
                     c = edges->shown[k][2] / edges->level[k];
        const double weakest = fmin(fmin(a, b), c);
        one |= weakest > rules->least;
        all &= weakest > rules->least_weak;
        plain &= a + b + c > 0;
    }
    return fits && strong ? one && plain : all && edges->count >= (fits ? 1 : 2);
}

/* Whether the edges from a corner to the labelled neighbours of its spot are visible, at some distance from them or
 * close to them, beside the rim that a marker leaves of a square. */
INLINE int is_seen(const Picture *p, const Table *t, const Rim *rim, const Corners *all, const Rules *rules,
                   index_t corner, index_t spot, Places *places) {
    const int64_t ways[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}}, *at = rim->spots + 2 * spot;
    const double *from = all->xy + 2 * corner, *to[4];
    const int colour = (at[0] + at[1]) & 1 ? (int)-rules->sign : (int)rules->sign;
    const int fits = fits_steps(all, corner, rim->maps + 6 * spot, colour, rules->far);
    Edges edges = {0};
    for (int way = 0; way < 4; way++) {
        const int32_t row = corner_at(t, at[0] + ways[way][0], at[1] + ways[way][1]);
        if (row < 0)
            continue;
        const int64_t other = rim->members[row];
        to[edges.count] = all->xy + 2 * other;
        edges.level[edges.count] = (way & 1 ? -colour : colour) * fmax(all->contrast[other], 1e-6);
        sides_differ(p, from, to[edges.count], 0, places, edges.shown[edges.count]);
        edges.count++;
    }
    if (are_visible(&edges, fits, all->strong[corner], rules))
        return 1;
    for (int k = 0; k < edges.count; k++) {
        double close[3];
        sides_differ(p, from, to[k], 1, places, close);
        for (int third = 0; third < 3; third++)
            if (edges.level[k] < 0 ? close[third] < edges.shown[k][third] : close[third] > edges.shown[k][third])
                edges.shown[k][third] = close[third];
    }
    return are_visible(&edges, fits, all->strong[corner], rules);
}

/* Give the accepted offers to their spots, nearest to the prediction first; each spot and each corner once. */
static index_t give_out(Offers *accepted, const Table *t, uint8_t *open, int64_t *added) {
    index_t count = 0;
    if (accepted->count)
        qsort(accepted->items, (size_t)accepted->count, sizeof *accepted->items, by_distance);
    for (index_t k = 0; k < accepted->count; k++) {
        const int64_t *offer = accepted->items[k].offer;
        int32_t *row = t->row + cell_of(t, offer);
        if (*row >= 0 || !open[offer[2]])
            continue;
        *row = 0;
        open[offer[2]] = 0;
        memcpy(added + 3 * count++, offer, 3 * sizeof *offer);
    }
    return count;
}

/* A round of growth: corners that fill one of the open spots each, `added` (at most the number of spots, 3): u, v and
 * index of the corner; and offers whose edges are not visible, `refused`, the same, of which only as many are stored as
 * fit. Nothing is added if not all fit. `counts` (1): the number of those added. Returns the number of those refused.
 */
FAST_KERNEL(rcdn_grid_round, (PICTURE, p), (GROUP, Rim, rim), (GROUP, Corners, all), (GROUP, Rules, rules),
            (WHERE, outlier_int64_t(rim.members, rim.n, 0, all.count - 1) == rim.n), (SIZE, room, refused, 0),
            (OUT, int64_t, added, rim.count, 3), (OUT, int64_t, refused, room, 3), (OUT, int64_t, counts, 1)) {
    const index_t count = rim.count;
    const double *maps = rim.maps, *pitch = rim.pitch, *xy = all.xy, near = rules.near;
    Table t;
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    if (!open_table(&t, rim.labels, rim.n))
        return NO_MEMORY;
    for (index_t k = 0; k < count; k++)
        for (int i = 0; i < 2; i++) {
            low[i] = fmin(low[i], maps[6 * k + i] - near * pitch[k]);
            high[i] = fmax(high[i], maps[6 * k + i] + near * pitch[k]);
        }
    index_t refusals = 0;
    Offers accepted = {0};
    Refused known = {0};
    SpotCells spots = {0};
    Places places;
    int able = !(count > 0 && low[0] <= high[0]) ||
               (open_refused(&known, rules.refused, rules.refusals) && open_spot_cells(&spots, &rim, near, low, high));
    for (index_t c = 0; spots.order && able && c < all.count; c++) {
        const double x = xy[2 * c], y = xy[2 * c + 1];
        if (!(x >= low[0] && x <= high[0] && y >= low[1] && y <= high[1]) || !usable(&all, c, rules.level))
            continue;
        const index_t column = cell_at(x, spots.left, spots.size, spots.columns),
                      row = cell_at(y, spots.top, spots.size, spots.rows);
        const index_t right = column + 1 < spots.columns ? column + 1 : column,
                      down = row + 1 < spots.rows ? row + 1 : row;
        for (index_t line = row > 0 ? row - 1 : 0; line <= down; line++) {
            const int32_t *from = spots.first + line * spots.columns + (column > 0 ? column - 1 : 0),
                          *to = spots.first + line * spots.columns + right + 1;
            for (index_t i = *from; i < *to && able; i++) {
                const index_t k = spots.order[i];
                const double dx = x - maps[6 * k], dy = y - maps[6 * k + 1], reach = near * pitch[k],
                             square = dx * dx + dy * dy;
                if (!(square <= reach * reach))
                    continue;
                const double distance = sqrt(square) / pitch[k];
                const int64_t *spot = rim.spots + 2 * k;
                if ((!all.strong[c] && !(distance < rules.near_weak)) || *slot_of(&known, spot[0], spot[1], c) >= 0)
                    continue;
                if (is_seen(&p, &t, &rim, &all, &rules, c, k, &places))
                    able = append(&accepted, distance, spot, c);
                else {
                    if (refusals < room)
                        memcpy(refused + 3 * refusals, (int64_t[3]){spot[0], spot[1], c}, 3 * sizeof *refused);
                    refusals++;
                }
            }
        }
    }
    *counts = able && refusals <= room ? give_out(&accepted, &t, all.free, added) : 0;
    free(t.row);
    free(known.slot);
    free(spots.first);
    free(spots.order);
    free(accepted.items);
    return able ? refusals : NO_MEMORY;
}
