/* Bilinear grey levels at many positions close to each other. Positions are floats relative to an integer pixel nearby,
 * so that they are accurate to 1e-5 px in any image; arithmetic is vectorised over whole arrays, and only the loading
 * of pixels is not. */
#ifndef RCDN_SAMPLING_H
#define RCDN_SAMPLING_H

#include "kernel.h"

/* An image with its origin moved to the pixel (x, y); positions are clamped to `low`..`high` on each axis, which
 * replicates the border. */
typedef struct {
    const Picture *picture;
    index_t at;
    double x, y;
    float low_x, high_x, low_y, high_y;
} Spot;

/* NaN is clamped to `low`. */
INLINE double limited(double value, double low, double high) {
    value = value > low ? value : low;
    return value < high ? value : high;
}

INLINE Spot spot_at(const Picture *p, double x, double y) {
    Spot s;
    const index_t i = (index_t)limited(x, 0, (double)(p->width - 1)),
                  j = (index_t)limited(y, 0, (double)(p->height - 1));
    s.picture = p;
    s.at = j * p->width + i;
    s.x = (double)i, s.y = (double)j;
    s.low_x = (float)-i, s.high_x = (float)(p->width - 1 - i);
    s.low_y = (float)-j, s.high_y = (float)(p->height - 1 - j);
    return s;
}

/* Buffers for one pass over up to `MOST` positions. */
enum { MOST = 576 };
typedef struct {
    float x[MOST], y[MOST];
    int64_t from[MOST]; /* the first of the four pixels around each position */
    union {
        uint8_t bytes[4 * MOST];
        float reals[4 * MOST];
    } pixels; /* two of the row above the positions, then two of the row below */
} Places;

/* Only the loading of pixels is done position by position. */
#define INTERPOLATE(TYPE, HELD)                                                                         \
    do {                                                                                                \
        const TYPE *from = (const TYPE *)s->picture->data + s->at;                                      \
        TYPE *above = HELD, *below = HELD + 2 * MOST;                                                   \
        for (index_t k = 0; k < count; k++) {                                                           \
            const TYPE *two = from + w->from[k];                                                        \
            memcpy(above + 2 * k, two, 2 * sizeof(TYPE));                                               \
            memcpy(below + 2 * k, two + width, 2 * sizeof(TYPE));                                       \
        }                                                                                               \
        for (index_t k = 0; k < count; k++) {                                                           \
            const float a = above[2 * k], b = above[2 * k + 1], c = below[2 * k], d = below[2 * k + 1]; \
            const float top = a + w->x[k] * (b - a), low = c + w->x[k] * (d - c);                       \
            out[k] = top + w->y[k] * (low - top);                                                       \
        }                                                                                               \
    } while (0)

/* Grey levels `out` (count,) at the positions w->x, w->y (count,) relative to `s`, which are overwritten. For an image
 * under 2 × 2 px: 0. */
INLINE void grey_levels(const Spot *s, Places *w, index_t count, float *out) {
    const index_t width = s->picture->width;
    const float last_x = s->high_x - 1, last_y = s->high_y - 1; /* the last pixels that have a successor */
    if (width < 2 || s->picture->height < 2) {
        memset(out, 0, (size_t)count * sizeof(float));
        return;
    }
    for (index_t k = 0; k < count; k++) {
        float x = w->x[k], y = w->y[k];
        x = x > s->low_x ? x : s->low_x, y = y > s->low_y ? y : s->low_y;
        x = x < s->high_x ? x : s->high_x, y = y < s->high_y ? y : s->high_y;
        float i = floorf(x), j = floorf(y);
        i = i < last_x ? i : last_x, j = j < last_y ? j : last_y;
        w->from[k] = (int64_t)(int32_t)j * width + (int32_t)i;
        w->x[k] = x - i, w->y[k] = y - j;
    }
    if (s->picture->real)
        INTERPOLATE(float, w->pixels.reals);
    else
        INTERPOLATE(uint8_t, w->pixels.bytes);
}

/* Contrast between the two sides of a link, the mean difference in each third of its length: see boards/edges.py,
 * `edge_contrast`. 9 positions along the link without 0.15 of it at both ends, where blur mixes all four squares; on
 * both sides at 0.08, 0.14 and 0.2 of its length, clamped to 1..5 px, or `close` to it at 0.015, 0.03 and 0.045, clamped
 * to 1..2.5 px. */
enum { ALONG = 9, ACROSS = 3, AROUND = 2 * ACROSS * ALONG };
INLINE void sides_differ(const Picture *p, const double *start, const double *end, int close, Places *w, double *out) {
    static const double both[2][ACROSS] = {{0.08, 0.14, 0.2}, {0.015, 0.03, 0.045}}, skip = 0.15;
    const double *across = both[close];
    const Spot s = spot_at(p, start[0], start[1]);
    const double dx = end[0] - start[0], dy = end[1] - start[1], size = sqrt(dx * dx + dy * dy),
                 length = size > 1e-9 ? size : 1e-9;
    float value[AROUND];
    index_t k = 0;
    for (int a = 0; a < ACROSS; a++) {
        const double reach = limited(length * across[a], 1, close ? 2.5 : 5) / length, side_x = -dy * reach,
                     side_y = dx * reach;
        for (int n = 0; n < ALONG; n++, k += 2) {
            const double t = skip + (1 - 2 * skip) / (ALONG - 1) * n, x = start[0] - s.x + t * dx,
                         y = start[1] - s.y + t * dy;
            w->x[k] = (float)(x + side_x), w->y[k] = (float)(y + side_y);
            w->x[k + 1] = (float)(x - side_x), w->y[k + 1] = (float)(y - side_y);
        }
    }
    grey_levels(&s, w, AROUND, value);
    for (int third = 0; third < 3; third++) {
        float sum = 0;
        for (int a = 0; a < ACROSS; a++)
            for (int n = 0; n < ALONG / 3; n++) {
                const int at = 2 * (a * ALONG + third * (ALONG / 3) + n);
                sum += value[at] - value[at + 1];
            }
        out[third] = (double)sum / (ACROSS * (ALONG / 3));
    }
}

#endif
