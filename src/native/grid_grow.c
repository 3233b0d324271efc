/* Completion of a labelled grid: its colouring, and the corners that might go on with it. */
#include "grid.h"

#define HALF_TURN 3.14159265358979323846

/* Colour of a corner's side at rising angle from the direction (dx, dy), bright +1 or dark -1, and the turn from its nearest axis. */
INLINE int side_colour(const double *axes, int64_t polarity, double dx, double dy, double *turn) {
    const double direction = atan2(dy, dx);
    double turns[2];
    for (int k = 0; k < 2; k++) {
        const double rest = fmod(axes[k] - direction + HALF_TURN / 2, HALF_TURN);
        turns[k] = isfinite(axes[k]) ? fabs((rest < 0 ? rest + HALF_TURN : rest) - HALF_TURN / 2) : HALF_TURN;
    }
    const int other = turns[1] < turns[0];
    *turn = turns[other];
    return (int)(other ? -polarity : polarity);
}

/* Votes for a grid's colouring, out[0]: side colour of the u axis times (-1)^(u + v), of the corners whose axes (n, 2) lie within `far` of
 * their step along u. 0, or -1 without memory. */
EXPORT index_t rcdn_grid_sign(const int64_t *labels, const double *xy, const double *axes, const int64_t *polarity, index_t n, double far, int64_t *out) {
    Table t;
    if (!open_table(&t, labels, n))
        return -1;
    *out = 0;
    for (index_t k = 0; k < n; k++) {
        const int32_t *row = t.row + cell_of(&t, labels + 2 * k);
        const int32_t ahead = row[t.height], behind = row[-t.height];
        if (ahead < 0 && behind < 0)
            continue;
        const double *to = xy + 2 * (ahead >= 0 ? ahead : k), *from = xy + 2 * (ahead >= 0 ? k : behind);
        double turn;
        const int colour = side_colour(axes + 2 * k, polarity[k], to[0] - from[0], to[1] - from[1], &turn);
        if (turn < far)
            *out += (labels[2 * k] + labels[2 * k + 1]) & 1 ? -colour : colour;
    }
    free(t.row);
    return 0;
}

/* Corners (total, 2) that might take the empty `spots` (count, 2) with predictions `guess` (count, 6) and steps `pitch`, as far as `room` lets: `offers`, the spot's
 * row and the corner; `gap`, from the prediction, in squares, up to `near` (`near_weak` of a corner that isn't `strong`); `fits`: do the corner's
 * axes and colours fit the predicted steps? `beside` (total, 4): rows of the labelled corners at (1, 0), (0, 1), (-1, 0), (0, -1) from the spot.
 * `usable` (total): which corners there are. Returns how many, or -1 without memory. */
EXPORT index_t rcdn_grid_offers(const int64_t *labels, index_t n, const int64_t *spots, const double *guess, const double *pitch, index_t count, const double *xy, const double *axes, const int64_t *polarity, const uint8_t *usable, const uint8_t *strong, index_t corners, index_t sign, double near, double near_weak, double far, int64_t *offers, double *gap, uint8_t *fits, int64_t *beside, index_t room) {
    Table t;
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    if (!open_table(&t, labels, n))
        return -1;
    for (index_t k = 0; k < count; k++) {
        const double *g = guess + 6 * k;
        for (int i = 0; i < 2; i++) {
            low[i] = fmin(low[i], g[i] - near * pitch[k]);
            high[i] = fmax(high[i], g[i] + near * pitch[k]);
        }
    }
    index_t total = 0;
    for (index_t c = 0; c < corners; c++) {
        const double x = xy[2 * c], y = xy[2 * c + 1];
        if (!usable[c] || !(x >= low[0] && x <= high[0] && y >= low[1] && y <= high[1]))
            continue;
        for (index_t k = 0; k < count; k++) {
            const double *g = guess + 6 * k, dx = x - g[0], dy = y - g[1];
            const double distance = sqrt(dx * dx + dy * dy);
            if (!(distance <= near * pitch[k]) || !(strong[c] || distance / pitch[k] < near_weak))
                continue;
            if (total < room) {
                const int64_t u = spots[2 * k], v = spots[2 * k + 1];
                const int colour = (u + v) & 1 ? (int)-sign : (int)sign;
                double turn_u, turn_v;
                const int own_u = side_colour(axes + 2 * c, polarity[c], g[2], g[3], &turn_u);
                const int own_v = side_colour(axes + 2 * c, polarity[c], g[4], g[5], &turn_v);
                offers[2 * total] = k;
                offers[2 * total + 1] = c;
                gap[total] = distance / pitch[k];
                fits[total] = own_u == colour && own_v == -colour && turn_u < far && turn_v < far;
                beside[4 * total] = corner_at(&t, u + 1, v);
                beside[4 * total + 1] = corner_at(&t, u, v + 1);
                beside[4 * total + 2] = corner_at(&t, u - 1, v);
                beside[4 * total + 3] = corner_at(&t, u, v - 1);
            }
            total++;
        }
    }
    free(t.row);
    return total;
}
