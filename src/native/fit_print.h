/* The print around the crossing edges of a corner (markers, circles, bits of tags), blurred like the image. See
 * rcdn/precision/surroundings.py. */
#ifndef RCDN_FIT_PRINT_H
#define RCDN_FIT_PRINT_H

#include "fit_window.h"
#include "maths.h"

/* largest number of edges of a shape along an axis, and of shapes and next corners around a corner */
enum { EDGES = 12, CELLS = EDGES + 1, PARTS = 4, SIDES = 4 };

/* beyond so many √2 blurs, erf is 1 */
#define UNFELT 3.4f
/* derivative of erf at 0 */
#define PEAK 1.1283792f

/* The print around n corners, or none (n = 0: a plain checkerboard). A shape is piecewise constant: `edge` (shapes, 2,
 * EDGES) has its edges, ascending, squares from its centre, along u and along v, padded with infinity; `value` (shapes,
 * CELLS, CELLS) its values before, between and behind them, 0 outside. Corner k has up to PARTS of the shapes, `which`
 * (n, PARTS), -1 for none, with their centres `at` (n, PARTS, 2) squares from the corner; their contribution is × the
 * corner's `sign` (n), in contrasts. `next` (n, SIDES): squares to the next edges towards -u, +u, -v, +v. */
ARGUMENT_GROUP(Print, (SIZE, shapes, edge, 0), (IN, double, edge, shapes, 2, EDGES),
               (IN, double, value, shapes, CELLS, CELLS), (SIZE, n, sign, 0),
               (WITHIN, int32_t, which, -1, shapes - 1, n, PARTS), (IN, double, at, n, PARTS, 2), (IN, double, sign, n),
               (IN, double, next, n, SIDES))

/* The print at the pixels of a window, in contrasts, and its derivatives by u, v and the logs of the blurs along u and
 * v. */
typedef struct {
    float all[5][PIXELS];
} Shade;

/* One shape relative to a corner: its edges, squares from the corner, and its values. */
typedef struct {
    float u[EDGES], v[EDGES];
    const double *value;
    int count_u, count_v;
} Part;

/* LANES pixels, squares from the corner, with the sharpness of edges there; ranges along u and v of edges that have an
 * effect on them. */
typedef struct {
    float u[LANES], v[LANES], scale_u[LANES], scale_v[LANES], feel_u[2], feel_v[2];
} Batch;

/* Edges of a part: those before `first` are complete steps, those from `last` on have no effect yet. */
typedef struct {
    int first, last;
} Span;

INLINE int moved_edges(const double *from, double by, float *to) {
    int count = 0;
    for (int k = 0; k < EDGES && isfinite(from[k]); k++)
        to[count++] = (float)(from[k] + by);
    return count;
}

/* The shapes around corner k; returns their number. */
INLINE int parts_of(const Print *print, index_t k, Part *parts) {
    int count = 0;
    for (index_t j = PARTS * k; j < PARTS * (k + 1); j++) {
        const index_t s = print->which[j];
        if (s < 0)
            continue;
        Part *part = parts + count++;
        part->count_u = moved_edges(print->edge + 2 * EDGES * s, print->at[2 * j], part->u);
        part->count_v = moved_edges(print->edge + 2 * EDGES * s + EDGES, print->at[2 * j + 1], part->v);
        part->value = print->value + CELLS * CELLS * s;
    }
    return count;
}

INLINE Span span_of(const float *edge, int count, const float feel[2]) {
    Span out = {0, 0};
    for (int k = 0; k < count; k++) {
        out.first += edge[k] < feel[0];
        out.last += edge[k] < feel[1];
    }
    return out;
}

/* The mixed difference of the values over the edges a0..a1 along u and b0..b1 along v. */
INLINE float mixed_difference(const Part *part, int a0, int a1, int b0, int b1) {
    const double *from = part->value + CELLS * a0, *to = part->value + CELLS * a1;
    return (float)(to[b1] - to[b0] - from[b1] + from[b0]);
}

/* Along one axis, for LANES pixels `at` with `scale`: 1 + erf of an edge, and its derivatives by the position and by
 * the log of the blur. */
INLINE void step_at(const float *restrict at, const float *restrict scale, float edge, const int slopes,
                    float step[restrict 3][LANES]) {
    for (index_t lane = 0; lane < LANES; lane++) {
        const float z = (at[lane] - edge) * scale[lane];
        step[0][lane] = 1 + erf_near(z);
        if (slopes) {
            const float peak = PEAK * bell_near(z);
            step[1][lane] = peak * scale[lane];
            step[2][lane] = -peak * z;
        }
    }
}

/* Add the print of a part to `out`: its value, and with `slopes` its derivatives by u, v and the logs of both blurs. */
INLINE void add_part(const Part *restrict part, const Batch *restrict batch, const int slopes,
                     float out[restrict 5][LANES]) {
    const Span u = span_of(part->u, part->count_u, batch->feel_u), v = span_of(part->v, part->count_v, batch->feel_v);
    if (!u.last || !v.last || u.first == part->count_u || v.first == part->count_v)
        return;
    float down[EDGES][3][LANES], across[3][LANES];
    for (int b = v.first; b < v.last; b++)
        step_at(batch->v, batch->scale_v, part->v[b], slopes, down[b]);
    for (int a = u.first - (u.first > 0); a < u.last; a++) {
        const int done = a < u.first, from = done ? 0 : a; /* complete steps are combined into one */
        const float base = 2 * mixed_difference(part, from, a + 1, 0, v.first);
        float sum[3][LANES] = {{0}};
        for (index_t lane = 0; lane < LANES; lane++)
            sum[0][lane] = base;
        for (int b = v.first; b < v.last; b++) {
            const float jump = mixed_difference(part, from, a + 1, b, b + 1);
            for (int j = 0; j < (slopes ? 3 : 1); j++)
                for (index_t lane = 0; lane < LANES; lane++)
                    sum[j][lane] += jump * down[b][j][lane];
        }
        if (!done)
            step_at(batch->u, batch->scale_u, part->u[a], slopes, across);
        for (index_t lane = 0; lane < LANES; lane++) {
            const float step = done ? 2 : across[0][lane];
            out[0][lane] += sum[0][lane] * step;
            if (slopes) {
                out[2][lane] += sum[1][lane] * step;
                out[4][lane] += sum[2][lane] * step;
            }
            if (slopes && !done) {
                out[1][lane] += sum[0][lane] * across[1][lane];
                out[3][lane] += sum[0][lane] * across[2][lane];
            }
        }
    }
}

/* Range of the positions of edges that have an effect on pixels `at` whose sharpness is `scale`. */
INLINE void feelers(const float *at, const float *scale, float feel[2]) {
    float low = at[0], high = at[0], least = scale[0];
    for (index_t lane = 1; lane < LANES; lane++) {
        low = at[lane] < low ? at[lane] : low;
        high = at[lane] > high ? at[lane] : high;
        least = scale[lane] < least ? scale[lane] : least;
    }
    feel[0] = low - UNFELT / least;
    feel[1] = high + UNFELT / least;
}

/* The print around corner k at the pixels of its window, in contrasts, to `out`. `p` (6): shift, turns and curvatures
 * of the edges; `sharp_u`, `sharp_v`: 1 / their blurs; `slopes`: whether derivatives are computed, too. */
INLINE void print_pixels(const Print *print, index_t k, const float *p, float sharp_u, float sharp_v, const int slopes,
                         const Window *w, Shade *restrict out) {
    Part parts[PARTS];
    const int count = parts_of(print, k, parts);
    const float sign = 0.25f * (float)print->sign[k];
    for (index_t first = 0; first < w->padded; first += LANES) {
        Batch batch;
        float sum[5][LANES] = {{0}};
        for (index_t lane = 0; lane < LANES; lane++) {
            const index_t i = first + lane;
            const float u = w->u[i], v = w->v[i];
            batch.u[lane] = u - p[0] - p[2] * v - p[4] * v * v;
            batch.v[lane] = v - p[1] - p[3] * u - p[5] * u * u;
            batch.scale_u[lane] = sharp_u * w->iu[i];
            batch.scale_v[lane] = sharp_v * w->iv[i];
        }
        feelers(batch.u, batch.scale_u, batch.feel_u);
        feelers(batch.v, batch.scale_v, batch.feel_v);
        for (int j = 0; j < count; j++)
            add_part(parts + j, &batch, slopes, sum);
        for (int j = 0; j < (slopes ? 5 : 1); j++)
            for (index_t lane = 0; lane < LANES; lane++)
                out->all[j][first + lane] = sign * sum[j][lane];
    }
}

/* Update the print to first order for small changes (8) of shift, turns, curvatures and log blurs. */
INLINE void shift_print(const Window *w, const float *change, Shade *restrict shade) {
    INDEPENDENT
    for (index_t i = 0; i < w->padded; i++) {
        const float u = w->u[i], v = w->v[i];
        shade->all[0][i] += shade->all[3][i] * change[6] + shade->all[4][i] * change[7] -
                            shade->all[1][i] * (change[0] + change[2] * v + change[4] * v * v) -
                            shade->all[2][i] * (change[1] + change[3] * u + change[5] * u * u);
    }
}

#endif
