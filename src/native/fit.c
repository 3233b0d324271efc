/* The parametric fit of corners of a board, each separately. See rcdn/precision/fit.py. */
#include "fit_model.h"
#include "solvers.h"

CONSTANTS(fit, COUNT, BLUR, BLEED, MEAN, CONTRAST, FRAME, REACH, MIDDLE, CENTRE, THIN, MOST, EDGES, CELLS, PARTS, SIDES)

/* Blocks of a window: pixels are at most 2 · ROW / 2 px from their mean, and those of one half are mirrored to the
 * other. */
enum { BLOCKS = (ROW + 2) * (2 * ROW + 3) };

/* bytes; arrays aligned to this are read one cache line at a time */
enum { ALIGNED = 64 };

typedef struct {
    Rows rows;
    float lever[2][PIXELS];
    Window window;
    Shade shade;
    int32_t at[PIXELS];
    float block[2][BLOCKS][4];
} Room;

/* Least variance of grey levels (which are integers); number of parameters that the pixels of one corner determine
 * effectively. */
#define ROUNDING 0.08
#define FREEDOM 8
/* Residuals beyond the larger of (noise, × contrast) have no weight. */
#define OUTLIER_NOISE 6.0
#define OUTLIER_CONTRAST 0.15
/* Logarithms of blurs of 0.25 and 20 px */
#define SHARPEST -1.38629436111989062
#define SOFTEST 2.99573227355399099

/* px, sides of blocks */
#define SMALLEST 1.0
#define LARGEST 8.0

static const double STEP[COUNT] = {0.1, 0.1,      0.1,      0.1,      0.1,      0.1,      0.4,     0.4,
                                   0.3, INFINITY, INFINITY, INFINITY, INFINITY, INFINITY, INFINITY};

INLINE double clip(double x, double low, double high) {
    return x < low ? low : x > high ? high : x;
}

/* One pass over the pixels at `state`: the rows, if `slopes` is set, and the sums over them. */
INLINE Sums look(Room *room, const double *state, double noise, int robust, const float *next, int others, int printed,
                 int slopes) {
    const double by_noise = OUTLIER_NOISE * sqrt(noise), by_contrast = OUTLIER_CONTRAST * fabs(state[CONTRAST]);
    const float limit = robust ? (float)(by_noise > by_contrast ? by_noise : by_contrast) : INFINITY;
    const Window *w = &room->window;
    if (printed)
        return slopes ? model_rows(w, state, limit, next, others, 1, 1, &room->shade, room->rows)
                      : model_rows(w, state, limit, next, others, 1, 0, &room->shade, room->rows);
    if (!slopes)
        return model_rows(w, state, limit, next, others, 0, 0, NULL, room->rows);
    return others ? model_rows(w, state, limit, next, 1, 0, 1, NULL, room->rows)
                  : model_rows(w, state, limit, next, 0, 0, 1, NULL, room->rows);
}

/* The inverse normal matrix `m` of the rows under a prior, and the Gauss–Newton step of the parameters. */
INLINE void solve(Room *room, Sums sums, const double *state, const double *mean, const double *tie, double noise,
                  double m[ROWS][ROWS], double *step) {
    const index_t loose = room->window.count - FREEDOM;
    const double stiff = clip(sums.square / (double)(loose > 1 ? loose : 1), ROUNDING, 4 * noise);
    double pull[COUNT];
    products(room->rows, room->window.padded, m);
    for (int k = 0; k < COUNT; k++) {
        pull[k] = m[k][RESIDUAL] + stiff * tie[k] * (mean[k] - state[k]);
        m[k][k] += stiff * tie[k] + 1e-6;
        m[k][RESIDUAL] = 0;
    }
    invert_definite(COUNT, ROWS, m[0]);
    for (int k = 0; k < COUNT; k++) {
        step[k] = 0;
        for (int j = 0; j < COUNT; j++)
            step[k] += m[k][j] * pull[j];
    }
}

/* Gradient, squares per px, across the narrower side of a window's square. */
INLINE double steepest(const double *frame) {
    const double u = length_of(frame[SLOPE], frame[SLOPE + 1]), v = length_of(frame[SLOPE + 2], frame[SLOPE + 3]);
    return u > v ? u : v;
}

/* The block of each pixel to `room->at`, and the number of blocks. Pixels of one half of the window are mirrored to the
 * other. */
INLINE index_t blocks(Room *room, float side) {
    const Window *w = &room->window;
    const index_t n = w->padded;
    const float count = w->count > 1 ? (float)w->count : 1, share = 1 / side;
    float x0 = 0, y0 = 0, far_x = 0, far_y = 0;
    for (index_t i = 0; i < n; i++) {
        x0 += w->x[i];
        y0 += w->y[i];
    }
    x0 /= count;
    y0 /= count;
    for (index_t i = 0; i < n; i++) {
        const float x = fabsf(w->x[i] - x0) * share, y = fabsf(w->y[i] - y0) * share;
        far_x = x > far_x ? x : far_x;
        far_y = y > far_y ? y : far_y;
    }
    const int32_t reach_x = (int32_t)(far_x + 0.5f) + 1, reach_y = (int32_t)(far_y + 0.5f) + 1, span = 2 * reach_x + 1;
    for (index_t i = 0; i < n; i++) {
        const float x = (w->x[i] - x0) * share, y = (w->y[i] - y0) * share;
        const int32_t at = (int32_t)rintf(y) * span + (int32_t)rintf(x);
        room->at[i] = at < 0 ? -at : at;
    }
    return (index_t)span * reach_y + reach_x + 1;
}

/* Sums over blocks of pixels: `scores` (2), the squared influence on the position, and its expectation for white noise
 * of variance 1. The latter allows for the fact that the fit makes the influences of all blocks sum to zero. `m`:
 * inverse normal matrix. `side` of a block, px. */
INLINE void block_scores(Room *room, double m[ROWS][ROWS], float side, double *scores) {
    const index_t size = blocks(room, side), n = room->window.padded;
    float unit[2][COUNT];
    for (int j = 0; j < 2 * COUNT; j++)
        unit[j / COUNT][j % COUNT] = (float)m[j / COUNT][j % COUNT];
    INDEPENDENT
    for (index_t i = 0; i < n; i++) {
        float one = 0, two = 0;
        for (int k = 0; k < COUNT; k++) {
            one += unit[0][k] * room->rows[k][i];
            two += unit[1][k] * room->rows[k][i];
        }
        room->lever[0][i] = one;
        room->lever[1][i] = two;
    }
    for (int half = 0; half < 2; half++)
        memset(room->block[half], 0, (size_t)size * sizeof(room->block[0][0]));
    for (index_t i = 0; i < n; i++) { /* alternately into two halves, so that consecutive sums are independent */
        float *to = room->block[i % 2][room->at[i]];
        const float one = room->lever[0][i], two = room->lever[1][i], off = room->rows[RESIDUAL][i];
        to[0] += one * one;
        to[1] += two * two;
        to[2] += one * off;
        to[3] += two * off;
    }
    double sum[2] = {0, 0}, even[2] = {0, 0}, pull = 0;
    for (index_t b = 0; b < size; b++)
        for (int k = 0; k < 2; k++) {
            const double share = room->block[0][b][k] + room->block[1][b][k],
                         by = room->block[0][b][2 + k] + room->block[1][b][2 + k];
            sum[k] += share;
            even[k] += share * share;
            pull += by * by;
        }
    scores[0] = pull;
    scores[1] = 0;
    for (int k = 0; k < 2; k++)
        scores[1] += sum[k] - even[k] / (sum[k] > 1e-12 ? sum[k] : 1e-12);
}

/* Settings of the fit: `noise`, variance of the residuals of the board; number of `steps`; `robust`: outlier pixels
 * lose their weight; `board`: next corners have edges, too; `tell`: whether `own`, `unit` and, unless `share` is 0,
 * `scores` are computed. */
ARGUMENT_GROUP(Settings, (REAL, noise), (INT, steps, 0, 100), (INT, robust, 0, 1), (INT, board, 0, 1),
               (INT, tell, 0, 1), (REAL, share), (WHERE, fabs(share) <= DBL_MAX))

/* Results of the fit: `variance` (n) of the residuals with weights; `kept` (n), mean weight; inverse normal matrices:
 * diagonals `own` (n, COUNT), and `unit` (n, 2, 2) of the shift; `scores` (n, 2) of blocks with sides of `share` of a
 * square's. */
ARGUMENT_GROUP(Found, (SIZE, n, variance, 0), (OUT, double, variance, n), (OUT, double, kept, n),
               (OUT, double, own, n, COUNT), (OUT, double, unit, n, 2, 2), (OUT, double, scores, n, 2))

/* The print around corner k at its current state. */
INLINE void print_around(const Print *print, index_t k, const double *state, const Window *w, Shade *shade) {
    float p[BLUR];
    for (int j = 0; j < BLUR; j++)
        p[j] = (float)state[j];
    print_pixels(print, k, p, (float)exponential(-state[BLUR]), (float)exponential(-state[BLUR + 1]), 1, w, shade);
}

/* Advance a state by `step`, and update the print accordingly. */
INLINE void advance(Room *room, double *state, const double *step, int printed) {
    const double before[2] = {state[BLUR], state[BLUR + 1]};
    float change[BLUR + 2];
    for (int j = 0; j < COUNT; j++)
        state[j] += clip(step[j], -STEP[j], STEP[j]);
    for (int j = BLUR; j < BLUR + 2; j++)
        state[j] = clip(state[j], SHARPEST, SOFTEST);
    if (!printed)
        return;
    for (int j = 0; j < BLUR; j++)
        change[j] = (float)clip(step[j], -STEP[j], STEP[j]);
    for (int j = 0; j < 2; j++)
        change[BLUR + j] = (float)(state[BLUR + j] - before[j]);
    shift_print(&room->window, change, &room->shade);
}

/* Fit n corners. `frames` (n, FRAME) define their pixels, the maps their board coordinates. `state` (n, COUNT) is
 * updated, under a prior of mean `mean` (n, COUNT) and inverse variances `tie` (n, COUNT). */
FAST_KERNEL(rcdn_fit, (PICTURE, picture), (GROUP, Maps, maps), (LET, n, maps.corners), (GROUP, Print, print),
            (WHERE, print.n == 0 || print.n == n), (IN, double, frames, n, FRAME), (WHERE, are_frames(frames, n)),
            (OUT, double, state, n, COUNT), (IN, double, mean, n, COUNT), (IN, double, tie, n, COUNT),
            (GROUP, Settings, settings), (GROUP, Found, found), (WHERE, found.n == n)) {
    const double noise = settings.noise, share = settings.share;
    const index_t steps = settings.steps, robust = settings.robust, board = settings.board, tell = settings.tell;
    double *variance = found.variance, *kept = found.kept, *own = found.own, *unit = found.unit, *scores = found.scores;
    void *memory = malloc(sizeof(Room) + ALIGNED);
    if (!memory)
        return NO_MEMORY;
    Room *room = (Room *)(((uintptr_t)memory + ALIGNED - 1) / ALIGNED * ALIGNED);
    for (index_t k = 0; k < n; k++) {
        const Map map = map_of(&maps, k);
        const double *frame = frames + FRAME * k;
        double *p = state + COUNT * k, m[ROWS][ROWS], step[COUNT];
        window_pixels(&picture, frame, &room->window);
        window_coordinates(&map, frame, &room->window);
        float next[SIDES];
        for (int j = 0; j < SIDES; j++)
            next[j] = print.n ? (float)print.next[SIDES * k + j] : 1;
        if (print.n)
            print_around(&print, k, p, &room->window, &room->shade);
        const int others = board && crowded(&room->window, p, next);
        Sums sums = {0, 0, 0};
        for (index_t s = 0; s <= steps; s++) {
            const int slopes = s < steps || tell;
            sums = look(room, p, noise, (int)robust, next, others, print.n > 0, slopes);
            if (!slopes)
                break;
            solve(room, sums, p, mean + COUNT * k, tie + COUNT * k, noise, m, step);
            if (s < steps)
                advance(room, p, step, print.n > 0);
        }
        const double loose = sums.weight - FREEDOM > 1 ? sums.weight - FREEDOM : 1;
        variance[k] = sums.heavy / loose > ROUNDING ? sums.heavy / loose : ROUNDING;
        kept[k] = sums.weight / (double)(room->window.count > 1 ? room->window.count : 1);
        if (!tell)
            continue;
        for (int j = 0; j < COUNT; j++)
            own[COUNT * k + j] = m[j][j];
        for (int j = 0; j < 4; j++)
            unit[4 * k + j] = m[j / 2][j % 2];
        if (share > 0)
            block_scores(room, m, (float)clip(share / steepest(frame), SMALLEST, LARGEST), scores + 2 * k);
    }
    free(memory);
    return 0;
}
