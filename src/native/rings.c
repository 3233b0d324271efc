/* Grey levels on rings around corners, and the two edge directions estimated from them; see
 * rcdn.corners.orientation. */
#include "elementary.h"
#include "lanes.h"
#include "maths.h"
#include "sampling.h"
#include "solvers.h"

enum { DIRECTIONS = 48, TURN = 2 * DIRECTIONS, RINGS = 3, SAMPLES = RINGS * DIRECTIONS };
CONSTANTS(rings, DIRECTIONS, RINGS)

#define MIN_FIT 0.2 /* share of the rings' variance below which there are no axes; an ideal L-junction has 1/3 */
#define START_BLUR 0.587786664902119  /* log of the initial guess of s = sqrt 2 * blur: 1.8 px */
#define LEAST_BLUR -0.916290731874155 /* its limits: 0.4 and 20 px */
#define MOST_BLUR 2.99573227355399
#define BELIEF 100.0 /* weight of the prior of log s, in samples: it decides where noise hides the blur */
#define DAMPING 1e-3 /* share of the trace of the normal matrix */
#define ITERATIONS 5
#define LONGEST_STEP 0.2 /* largest step of an axis, radians, and of log s */
#define MOST_TURN 0.5    /* largest angle between an axis before and after the fit, radians */
#define DONE 0.002       /* radians; shorter steps end the fit */
#define CLOSEST 0.05     /* smallest angle between the two axes, radians */

/* Cosine and sine of the directions; all tables are passed by the caller. */
typedef struct {
    const float *cosine, *sine;
} Directions;

/* Bilinear grey levels `out` (rings, TURN) on up to RINGS rings around `centre`; the border is replicated. */
INLINE void ring_levels(const Picture *p, const double centre[2], const double *radius, int rings, Directions d,
                        Places *w, float *out) {
    const Spot s = spot_at(p, centre[0], centre[1]);
    const float x = (float)(centre[0] - s.x), y = (float)(centre[1] - s.y);
    for (int ring = 0; ring < rings; ring++) {
        const float r = (float)radius[ring];
        for (int k = 0; k < TURN; k++) {
            w->x[ring * TURN + k] = x + r * d.cosine[k];
            w->y[ring * TURN + k] = y + r * d.sine[k];
        }
    }
    grey_levels(&s, w, rings * TURN, out);
}

/* Grey levels (count, rings, TURN) on rings of `radius` (count, rings) px around `xy` (count, 2). */
FAST_KERNEL(rcdn_sample_rings, (PICTURE, p), (SIZE, count, radius, 0), (SIZE, rings, radius, 1),
            (IN, double, xy, count, 2), (IN, double, radius, count, rings), (IN, float, directions, 2, TURN),
            (OUT, float, out, count, rings, TURN)) {
    const Directions d = {directions, directions + TURN};
    Places w;
    for (index_t k = 0; k < count * rings; k++)
        ring_levels(&p, xy + 2 * (k / rings), radius + k, 1, d, &w, out + k * TURN);
    return 0;
}

/* The two sectors that explain most of a ring's variance: from direction a to b, and the rest of the half turn. */
typedef struct {
    int a, b;
    double contrast, fit;
} Sectors;

/* The boundaries a < b, the first of equal ones, with the largest variance between the two sectors: sums from a to b
 * are differences of cumulative sums of the centred `signal`. `gain` (2 DIRECTIONS): the entry DIRECTIONS + g is the
 * factor from the square of a sum of g to that variance; 0 up to DIRECTIONS. */
INLINE int best_pair(const float *running, const float *gain) {
    float best[LANES] = {0}, top = 0;
    int32_t at[LANES] = {0}, found = 1;
    for (int32_t a = 0; a < DIRECTIONS - 1; a++)
        for (int32_t from = a / LANES * LANES; from < DIRECTIONS; from += LANES)
            for (int32_t lane = 0; lane < LANES; lane++) {
                const float sum = running[from + lane] - running[a];
                const float value = sum * sum * gain[DIRECTIONS + from + lane - a];
                const int more = value > best[lane];
                best[lane] = more ? value : best[lane];
                at[lane] = more ? a * DIRECTIONS + from + lane : at[lane];
            }
    for (int lane = 0; lane < LANES; lane++)
        if (best[lane] > top || (best[lane] == top && top > 0 && at[lane] < found)) {
            top = best[lane];
            found = at[lane];
        }
    return found;
}

INLINE Sectors sectors(const float signal[TURN], const float *gain) {
    float folded[DIRECTIONS], running[DIRECTIONS], mean = 0, same = 0, odd = 0, sum = 0;
    for (int k = 0; k < DIRECTIONS; k++) {
        folded[k] = 0.5f * (signal[k] + signal[k + DIRECTIONS]);
        mean += folded[k];
    }
    mean /= DIRECTIONS;
    for (int k = 0; k < DIRECTIONS; k++) {
        const float gap = signal[k] - signal[k + DIRECTIONS];
        folded[k] -= mean;
        same += folded[k] * folded[k];
        odd += gap * gap;
    }
    for (int k = 0; k < DIRECTIONS; k++) {
        running[k] = sum;
        sum += folded[k];
    }
    const int pair = best_pair(running, gain);
    Sectors s = {pair / DIRECTIONS, pair % DIRECTIONS, 0, 0};
    const double total = running[s.b] - running[s.a], energy = same + 0.25 * odd, wide = s.b - s.a,
                 rest = DIRECTIONS - wide;
    s.contrast = total * DIRECTIONS / (wide * rest);
    s.fit = energy > 0 ? total * total * DIRECTIONS / (wide * rest * energy) : 0;
    return s;
}

/* Samples of a corner with their mean removed, and the radius of each. */
typedef struct {
    float level[SAMPLES], radius[SAMPLES];
} Samples;

/* Squared residuals, normal matrix (upper triangle, row by row) and right-hand side of the model at a state: a, b, log
 * s. */
typedef struct {
    double energy, normal[6], pull[3];
} Equations;

/* The model's shape at every sample and, with `slopes`, its derivatives by a, b and log s. */
INLINE void model(const Samples *s, Directions d, const double state[3], int slopes, float column[4][SAMPLES]) {
    double cos_a, sin_a, cos_b, sin_b;
    cosine_sine(state[0], &cos_a, &sin_a);
    cosine_sine(state[1], &cos_b, &sin_b);
    const float shrink = (float)exponential(-state[2]), ca = (float)cos_a, sa = (float)sin_a, cb = (float)cos_b,
                sb = (float)sin_b;
    const float bell = -1.12837917f; /* -2 / sqrt pi */
    for (int ring = 0; ring < RINGS; ring++)
        for (int k = 0; k < DIRECTIONS; k++) {
            const int n = ring * DIRECTIONS + k;
            const float r = s->radius[n] * shrink;
            const float p = r * (d.sine[k] * ca - d.cosine[k] * sa), q = r * (d.sine[k] * cb - d.cosine[k] * sb);
            const float one = erf_near(p), other = erf_near(q);
            column[0][n] = one * other;
            if (slopes) {
                const float by_p = bell * other * bell_near(p), by_q = bell * one * bell_near(q);
                column[1][n] = by_p * r * (d.cosine[k] * ca + d.sine[k] * sa);
                column[2][n] = by_q * r * (d.cosine[k] * cb + d.sine[k] * sb);
                column[3][n] = by_p * p + by_q * q;
            }
        }
}

INLINE double total(const float *a) {
    float sum[LANES] = {0};
    for (int n = 0; n < SAMPLES; n += LANES)
        for (int k = 0; k < LANES; k++)
            sum[k] += a[n + k];
    return lane_sum(sum);
}

INLINE double product(const float *a, const float *b) {
    float sum[LANES] = {0};
    for (int n = 0; n < SAMPLES; n += LANES)
        for (int k = 0; k < LANES; k++)
            sum[k] += a[n + k] * b[n + k];
    return lane_sum(sum);
}

/* Squared residuals of the model after level and contrast, its two linear parameters, have been eliminated. */
INLINE double energy_at(const Samples *s, Directions d, const double state[3]) {
    float column[4][SAMPLES];
    model(s, d, state, 0, column);
    const float *shape = column[0];
    const double sum = total(shape), cross = product(shape, s->level),
                 rest = product(shape, shape) - sum * sum / SAMPLES;
    return product(s->level, s->level) - cross * cross / (rest > 1e-9 ? rest : 1e-9);
}

/* Level and contrast are eliminated: the part that they explain is projected out of data and derivatives (variable
 * projection, Kaufman's approximation), by elimination in the table of all products of shape f, derivatives u, v, w,
 * data g and one. */
INLINE Equations equations_at(const Samples *s, Directions d, const double state[3]) {
    float column[4][SAMPLES];
    double sum[4], data[4], table[4][4]; /* the data have no mean */
    model(s, d, state, 1, column);
    for (int i = 0; i < 4; i++) {
        sum[i] = total(column[i]);
        data[i] = product(column[i], s->level);
        for (int j = 0; j <= i; j++)
            table[j][i] = product(column[j], column[i]) - sum[j] * sum[i] / SAMPLES;
    }
    const double own = table[0][0] > 1e-9 ? table[0][0] : 1e-9, scale = data[0] / own;
    Equations e;
    e.energy = product(s->level, s->level) - data[0] * scale;
    for (int i = 1, at = 0; i < 4; i++) {
        const double share = table[0][i] / own;
        e.pull[i - 1] = (data[i] - share * data[0]) * scale;
        for (int j = i; j < 4; j++)
            e.normal[at++] = (table[i][j] - share * table[0][j]) * scale * scale;
    }
    return e;
}

/* The Gauss–Newton step of a, b and log s: damped, with the prior of the blur. */
INLINE void model_step(const Equations *e, const double state[3], double change[3]) {
    const double *m = e->normal, belief = BELIEF * e->energy / SAMPLES, damp = DAMPING * (m[0] + m[3] + m[5]) + 1e-9;
    const double a = m[0] + damp, b = m[1], c = m[2], d = m[3] + damp, f = m[4], g = m[5] + damp + belief;
    const double u = e->pull[0], v = e->pull[1], w = e->pull[2] - belief * (state[2] - START_BLUR);
    solve_three(a, b, c, d, f, g, u, v, w, change);
    for (int i = 0; i < 3; i++)
        change[i] = change[i] < -LONGEST_STEP ? -LONGEST_STEP : change[i] > LONGEST_STEP ? LONGEST_STEP : change[i];
}

/* Refine `axes` by fitting the model to the samples; they are unchanged if the residuals grow or the fit diverges. */
INLINE void fit_axes(const Samples *s, Directions d, double axes[2]) {
    double state[3] = {axes[0], axes[1], START_BLUR}, change[3], first = 0;
    for (int k = 0; k < ITERATIONS; k++) {
        const Equations e = equations_at(s, d, state);
        first = k ? first : e.energy;
        model_step(&e, state, change);
        for (int i = 0; i < 3; i++)
            state[i] += change[i];
        state[2] = state[2] < LEAST_BLUR ? LEAST_BLUR : state[2] > MOST_BLUR ? MOST_BLUR : state[2];
        if (!(fabs(change[0]) > DONE || fabs(change[1]) > DONE))
            break;
    }
    const double gap = state[1] - state[0];
    if (energy_at(s, d, state) <= first && gap > CLOSEST && gap < PI - CLOSEST &&
        fabs(state[0] - axes[0]) < MOST_TURN && fabs(state[1] - axes[1]) < MOST_TURN)
        memcpy(axes, state, 2 * sizeof(double));
}

INLINE void take_out_mean(Samples *s) {
    const float mean = (float)(total(s->level) / SAMPLES);
    for (int n = 0; n < SAMPLES; n++)
        s->level[n] -= mean;
}

/* Means of opposite directions on the rings. */
INLINE Samples folded(const float level[RINGS * TURN], const double radius[RINGS]) {
    Samples s;
    for (int ring = 0; ring < RINGS; ring++)
        for (int k = 0; k < DIRECTIONS; k++) {
            s.level[ring * DIRECTIONS + k] = 0.5f * (level[ring * TURN + k] + level[ring * TURN + DIRECTIONS + k]);
            s.radius[ring * DIRECTIONS + k] = (float)radius[ring];
        }
    take_out_mean(&s);
    return s;
}

/* Axes in [0, pi), ascending, and the properties of the rings; see `rcdn.corners.orientation.axes`. */
FAST_KERNEL(rcdn_axes, (PICTURE, p), (SIZE, count, xy, 0), (IN, double, xy, count, 2), (IN, double, radius, count),
            (IN, uint8_t, careful, count), (REAL, least), (IN, float, directions, 2, TURN), (IN, float, gain, TURN),
            (OUT, double, axes, count, 2), (OUT, double, contrast, count), (OUT, int8_t, polarity, count),
            (OUT, double, fit, count)) {
    const Directions d = {directions, directions + TURN};
    float level[RINGS * TURN], signal[TURN];
    Places w;
    for (index_t n = 0; n < count; n++) {
        const double rings[RINGS] = {0.8 * radius[n], radius[n], 1.2 * radius[n]}; /* on smaller ones, blur dominates */
        double *own = axes + 2 * n;
        ring_levels(&p, xy + 2 * n, rings, RINGS, d, &w, level);
        for (int k = 0; k < TURN; k++)
            signal[k] = (level[k] + level[TURN + k] + level[2 * TURN + k]) / RINGS;
        const Sectors seen = sectors(signal, gain);
        const int ok = seen.fit >= MIN_FIT && fabs(seen.contrast) >= least;
        contrast[n] = fabs(seen.contrast);
        fit[n] = seen.fit < 1 ? seen.fit : 1;
        polarity[n] = 0;
        own[0] = own[1] = NAN;
        if (!ok)
            continue;
        double found[2] = {(seen.a - 0.5) * (PI / DIRECTIONS), (seen.b - 0.5) * (PI / DIRECTIONS)};
        if (careful[n]) {
            const Samples s = folded(level, rings);
            fit_axes(&s, d, found);
        }
        for (int i = 0; i < 2; i++)
            found[i] -= PI * floor(found[i] / PI);
        const int swapped = found[0] > found[1];
        own[0] = found[swapped];
        own[1] = found[!swapped];
        polarity[n] = (int8_t)((seen.contrast > 0) != swapped ? 1 : -1);
    }
    return 0;
}
