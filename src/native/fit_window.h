/* The pixels around one corner of a board that are used for its fit, with their board coordinates. See
 * rcdn/precision/window.py. */
#ifndef RCDN_FIT_WINDOW_H
#define RCDN_FIT_WINDOW_H

#include "lanes.h"
#include "lattice.h"

#include <float.h>

enum {
    MOST = 3968, /* pixels of a corner: a window of 60 by 60 px at most holds 3721 */
    ROW = 128,   /* longest row of a window */
    PIXELS = MOST + ROW + LANES,
};

/* A window in the corner's affine frame: `slope` (2, 2) squares per px; half extents and bands, squares; centre and
 * half size of the box, px; every `thin`-th pixel of it is used; the centre of its extents, squares. As doubles, in
 * this order. */
enum { SLOPE = 0, REACH = 4, BAND = 6, CENTRE = 8, BOX = 10, THIN = 12, MIDDLE = 13, FRAME = 15 };

/* `count` pixels, padded with zeros and `mask` 0 to a multiple of LANES. `x`, `y`: px from the centre; `u`, `v`:
 * squares; `gu`, `gv`: lengths of their gradients, squares per px; `iu`, `iv`: 1 / (√2 gu), 1 / (√2 gv). */
typedef struct {
    float x[PIXELS], y[PIXELS], value[PIXELS], mask[PIXELS], u[PIXELS], v[PIXELS], gu[PIXELS], gv[PIXELS], iu[PIXELS],
        iv[PIXELS];
    index_t count, padded;
} Window;

/* px, beyond any image */
#define AWAY 1e9

/* Whether `frames` (n, FRAME) describe windows that fit into their buffers. */
static inline int are_frames(const double *frames, index_t n) {
    for (const double *f = frames; f < frames + FRAME * n; f += FRAME) {
        for (int k = 0; k < FRAME; k++)
            if (!(fabs(f[k]) <= DBL_MAX))
                return 0;
        if (fabs(f[CENTRE]) > AWAY || fabs(f[CENTRE + 1]) > AWAY || !(f[THIN] >= 1) || f[THIN] > AWAY)
            return 0;
        for (int k = 0; k < 2; k++)
            if (!(f[BOX + k] >= 0) || f[BOX + k] > ROW / 2 - 1)
                return 0;
    }
    return 1;
}

typedef struct {
    index_t first, last;
} Run;

/* The x in the run `within` with |x / p + q| <= r. */
INLINE Run strip(double p, double q, double r, Run within) {
    const double one = (-r - q) * p, two = (r - q) * p, low = ceil(one < two ? one : two),
                 high = floor(one < two ? two : one);
    const double first = (double)within.first, last = (double)within.last;
    const Run out = {(index_t)(low > first ? low < last + 1 ? low : last + 1 : first),
                     (index_t)(high < last ? high > first - 1 ? high : first - 1 : last)};
    return out;
}

/* Append every `thin`-th pixel of a run of the row y, with a phase that changes from row to row. */
INLINE void window_run(const Picture *p, Run run, index_t y, const double *f, Window *w) {
    const index_t thin = (index_t)f[THIN], at = ((index_t)f[CENTRE + 1] + y) * p->width + (index_t)f[CENTRE];
    const index_t phase = thin > 1 ? (run.first + (thin + 1) / 2 * y) % thin : 0,
                  first = run.first + (phase > 0 ? thin - phase : -phase);
    const index_t many = first > run.last ? 0 : thin > 1 ? (run.last - first) / thin + 1 : run.last - first + 1;
    float *x = w->x + w->count, *value = w->value + w->count;
    for (index_t i = 0; i < many; i++) {
        x[i] = (float)(first + i * thin);
        w->y[w->count + i] = (float)y;
    }
    if (p->real)
        for (index_t i = 0; i < many; i++)
            value[i] = ((const float *)p->data)[at + first + i * thin];
    else if (thin > 1)
        for (index_t i = 0; i < many; i++)
            value[i] = ((const uint8_t *)p->data)[at + first + i * thin];
    else
        for (index_t i = 0; i < many; i++)
            value[i] = ((const uint8_t *)p->data)[at + first + i];
    w->count += many;
}

/* The pixels of a window: those of the image within reach of the corner and near one of its edges, which form a cross
 * of two bands. */
INLINE void window_pixels(const Picture *p, const double *f, Window *w) {
    const index_t cx = (index_t)f[CENTRE], cy = (index_t)f[CENTRE + 1], half_x = (index_t)f[BOX],
                  half_y = (index_t)f[BOX + 1];
    const index_t top = cy > half_y ? -half_y : -cy, low = cy + half_y < p->height ? half_y : p->height - 1 - cy;
    const Run row = {cx > half_x ? -half_x : -cx, cx + half_x < p->width ? half_x : p->width - 1 - cx};
    const double by_u = 1 / (fabs(f[0]) > 1e-9 ? f[0] : 1e-9), by_v = 1 / (fabs(f[2]) > 1e-9 ? f[2] : 1e-9);
    w->count = 0;
    for (index_t y = top; y <= low && w->count < MOST; y++) {
        const double u = f[1] * (double)y, v = f[3] * (double)y;
        const Run inside = strip(by_v, v - f[MIDDLE + 1], f[REACH + 1], strip(by_u, u - f[MIDDLE], f[REACH], row));
        Run a = strip(by_u, u, f[BAND], inside), b = strip(by_v, v, f[BAND + 1], inside);
        if (a.first > b.first) {
            const Run swap = a;
            a = b;
            b = swap;
        }
        b.first = b.first > a.last ? b.first : a.last + 1;
        window_run(p, a, y, f, w);
        window_run(p, b, y, f, w);
    }
    w->padded = (w->count + LANES - 1) / LANES * LANES;
    for (index_t i = 0; i < w->count; i++)
        w->mask[i] = 1;
    for (index_t i = w->count; i < w->padded; i++)
        w->x[i] = w->y[i] = w->value[i] = w->mask[i] = 0;
}

/* The pixels' board coordinates. Relative to the corner, no large numbers are subtracted from each other: single
 * precision is enough. */
INLINE void window_coordinates(const Map *m, const double *f, Window *w) {
    const double *H = m->flat, cx = f[CENTRE], cy = f[CENTRE + 1];
    double side[6]; /* first two rows of the homography relative to the corner */
    for (int k = 0; k < 6; k++)
        side[k] = H[k] - m->origin[k / 3] * H[6 + k % 3];
    const float depth0 = (float)(H[6] * cx + H[7] * cy + H[8]), depth_x = (float)H[6], depth_y = (float)H[7];
    const float s0 = (float)(side[0] * cx + side[1] * cy + side[2]), s_x = (float)side[0], s_y = (float)side[1];
    const float t0 = (float)(side[3] * cx + side[4] * cy + side[5]), t_x = (float)side[3], t_y = (float)side[4];
    float c[2 * TERMS];
    for (int k = 0; k < 2 * TERMS; k++)
        c[k] = (float)m->terms[k];
    for (index_t i = 0; i < w->padded; i++) {
        const float x = w->x[i], y = w->y[i];
        const float depth = 1 / (depth0 + depth_x * x + depth_y * y);
        const float s = (s0 + s_x * x + s_y * y) * depth, t = (t0 + t_x * x + t_y * y) * depth;
        const float ss = s_x - s * depth_x, st = s_y - s * depth_y, ts = t_x - t * depth_x, tt = t_y - t * depth_y;
        const float u_s = c[2] + 2 * c[6] * s + c[8] * t, u_t = c[4] + c[8] * s + 2 * c[10] * t;
        const float v_s = c[3] + 2 * c[7] * s + c[9] * t, v_t = c[5] + c[9] * s + 2 * c[11] * t;
        const float ux = u_s * ss + u_t * ts, uy = u_s * st + u_t * tt, vx = v_s * ss + v_t * ts,
                    vy = v_s * st + v_t * tt;
        w->u[i] = c[0] + 0.5f * (s * (c[2] + u_s) + t * (c[4] + u_t));
        w->v[i] = c[1] + 0.5f * (s * (c[3] + v_s) + t * (c[5] + v_t));
        w->gu[i] = sqrtf(ux * ux + uy * uy) * fabsf(depth);
        w->gv[i] = sqrtf(vx * vx + vy * vy) * fabsf(depth);
        w->iu[i] = 0.70710678f / w->gu[i];
        w->iv[i] = 0.70710678f / w->gv[i];
    }
}

#endif
