/* The model of a corner's surroundings, and its derivatives by the parameters. See rcdn/precision/model.py for both. */
#ifndef RCDN_FIT_MODEL_H
#define RCDN_FIT_MODEL_H

#include "elementary.h"
#include "fit_print.h"
#include "maths.h"

enum { BLUR = 6, BLEED = 8, MEAN = 9, CONTRAST = 10, COUNT = 15, RESIDUAL = 15, ROWS = 16 };

/* distance from an edge, blurs, beyond which it has no effect: erf is 1 to 1e-4 */
#define FELT 4.0f
#define WHITE 255.0f

/* For each pixel: its derivatives by the COUNT parameters, then its residual, all × the root of its weight. */
typedef float Rows[ROWS][PIXELS];

/* Sums over the pixels: of squared residuals without and with weights, and of the weights. */
typedef struct {
    double square, heavy, weight;
} Sums;

/* Whether the edges of the `next` (SIDES) corners, squares away, have an effect inside the window. */
INLINE int crowded(const Window *w, const double *state, const float *next) {
    const float blur_u = FELT * (float)exponential(state[BLUR]), blur_v = FELT * (float)exponential(state[BLUR + 1]);
    int felt = 0;
    for (index_t i = 0; i < w->count; i++)
        felt |= (next[0] + w->u[i] < blur_u * w->gu[i]) | (next[1] - w->u[i] < blur_u * w->gu[i]) |
                (next[2] + w->v[i] < blur_v * w->gv[i]) | (next[3] - w->v[i] < blur_v * w->gv[i]);
    return felt;
}

/* Subtract the edge of a next corner, `z` blurs away, from a wave, and add its derivative by log blur. */
INLINE void next_edge(float z, float *wave, float *by_blur) {
    *wave -= erf_near(z);
    *by_blur += PEAK * bell_near(z) * z;
}

/* Rows and sums at `state`. Residuals beyond `limit` have no weight (Tukey's). `others`: with the edges of the `next`
 * (SIDES) corners; `printed`: with the surrounding print, `shade`; `slopes`: with derivatives; without them, only the
 * sums are computed. Levels are clipped to the sensor's range, and have no derivatives beyond it. A blurred square wave
 * has its own edge where own + push = 0, and those of the next corners where the pixel's squares ± next - push = 0:
 * bleed moves consecutive edges in opposite directions. */
INLINE Sums model_rows(const Window *w, const double *state, float limit, const float *next, const int others,
                       const int printed, const int slopes, const Shade *shade, Rows rows) {
    float p[COUNT];
    for (int k = 0; k < COUNT; k++)
        p[k] = (float)state[k];
    const float sharp_u = (float)exponential(-state[BLUR]), sharp_v = (float)exponential(-state[BLUR + 1]);
    const float contrast = fabsf(p[CONTRAST]), bleed = p[CONTRAST] > 0 ? p[BLEED] : p[CONTRAST] < 0 ? -p[BLEED] : 0;
    const float strict = 1 / limit;
    const index_t n = w->padded;
    float square[LANES] = {0}, heavy[LANES] = {0}, total[LANES] = {0};
    for (index_t first = 0; first < n; first += LANES)
        INDEPENDENT
    for (index_t lane = 0; lane < LANES; lane++) {
        const index_t i = first + lane;
        const float u = w->u[i], v = w->v[i], uu = u * u, vv = v * v;
        const float scale_u = sharp_u * w->iu[i], scale_v = sharp_v * w->iv[i];
        const float own_u = u - p[0] - p[2] * v - p[4] * vv, own_v = v - p[1] - p[3] * u - p[5] * uu;
        const float side_u = erf_near(own_v * scale_v) * w->gu[i], side_v = erf_near(own_u * scale_u) * w->gv[i];
        const float push_u = bleed * side_u, push_v = bleed * side_v;
        const float z_u = (own_u + push_u) * scale_u, z_v = (own_v + push_v) * scale_v;
        const float bell_u = PEAK * bell_near(z_u), bell_v = PEAK * bell_near(z_v);
        float wave_u = erf_near(z_u), wave_v = erf_near(z_v), soft_u = -bell_u * z_u, soft_v = -bell_v * z_v;
        if (others) {
            next_edge((u - next[1] - push_u) * scale_u, &wave_u, &soft_u);
            next_edge((u + next[0] - push_u) * scale_u, &wave_u, &soft_u);
            next_edge((v - next[3] - push_v) * scale_v, &wave_v, &soft_v);
            next_edge((v + next[2] - push_v) * scale_v, &wave_v, &soft_v);
        }
        const float waves = wave_u * wave_v, shape = printed ? waves + shade->all[0][i] : waves;
        const float amplitude = p[CONTRAST] + p[13] * u + p[14] * v;
        const float value = p[MEAN] + p[11] * u + p[12] * v + amplitude * shape;
        const float seen = value < 0 ? 0 : value > WHITE ? WHITE : value;
        const float off = w->value[i] - seen, share = off * strict, left = 1 - share * share;
        const float root = w->mask[i] * (left > 0 ? left : 0), live = ((value > 0) & (value < WHITE)) ? root : 0;
        square[lane] += off * off * w->mask[i];
        heavy[lane] += off * off * root * root;
        total[lane] += root * root;
        if (!slopes)
            continue;
        const float by_u = bell_u * scale_u * wave_v, by_v = bell_v * scale_v * wave_u;
        const float slope_u = printed ? by_u + shade->all[1][i] : by_u,
                    slope_v = printed ? by_v + shade->all[2][i] : by_v;
        const float blur_u = amplitude * soft_u * wave_v, blur_v = amplitude * wave_u * soft_v;
        const float move_u = -amplitude * slope_u * live, move_v = -amplitude * slope_v * live;
        rows[0][i] = move_u;
        rows[1][i] = move_v;
        rows[2][i] = move_u * v;
        rows[3][i] = move_v * u;
        rows[4][i] = move_u * vv;
        rows[5][i] = move_v * uu;
        rows[6][i] = (printed ? blur_u + amplitude * shade->all[3][i] : blur_u) * live;
        rows[7][i] = (printed ? blur_v + amplitude * shade->all[4][i] : blur_v) * live;
        rows[8][i] = contrast * (by_u * side_u + by_v * side_v) * live;
        rows[9][i] = live;
        rows[10][i] = shape * live;
        rows[11][i] = u * live;
        rows[12][i] = v * live;
        rows[13][i] = u * shape * live;
        rows[14][i] = v * shape * live;
        rows[15][i] = off * root;
    }
    const Sums out = {lane_sum(square), lane_sum(heavy), lane_sum(total)};
    return out;
}

/* Products of two rows with two others, summed over n pixels, on both sides of the diagonal of a matrix (ROWS, ROWS).
 * */
INLINE void products_2x2(const float *a, const float *b, index_t n, double *out, double *mirror) {
    float s[4][LANES] = {{0}};
    for (index_t i = 0; i < n; i += LANES)
        for (index_t lane = 0; lane < LANES; lane++) {
            const float a0 = a[i + lane], a1 = a[PIXELS + i + lane], b0 = b[i + lane], b1 = b[PIXELS + i + lane];
            s[0][lane] += a0 * b0;
            s[1][lane] += a0 * b1;
            s[2][lane] += a1 * b0;
            s[3][lane] += a1 * b1;
        }
    for (int k = 0; k < 4; k++)
        out[k / 2 * ROWS + k % 2] = mirror[k % 2 * ROWS + k / 2] = lane_sum(s[k]);
}

/* The products of all rows with each other, summed over the pixels. */
INLINE void products(Rows rows, index_t n, double out[ROWS][ROWS]) {
    for (int a = 0; a < ROWS; a += 2)
        for (int b = a; b < ROWS; b += 2)
            products_2x2(rows[a], rows[b], n, &out[a][b], &out[b][a]);
}

#endif
