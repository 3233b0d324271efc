/* Definitions shared by all kernels: exported names, compilers and access to an image's pixels. */
#ifndef RCDN_H
#define RCDN_H

#if !defined(__GNUC__) && !defined(__clang__)
#error "rcdn's kernels are built with gcc or clang; no other compiler has been tried"
#endif

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "levels.h"

#define INLINE static inline __attribute__((always_inline))

typedef ptrdiff_t index_t;

/* side of a network cell, px of the image */
enum { CELL = 4 };

/* A grey image (height, width), 0..255: bytes, or float32 if `real`. */
typedef struct {
    const void *data;
    index_t height, width;
    int real;
} Picture;

INLINE float pixel(const Picture *p, index_t at) {
    return p->real ? ((const float *)p->data)[at] : (float)((const uint8_t *)p->data)[at];
}

INLINE index_t clamped(index_t k, index_t n) {
    return k < 0 ? 0 : k >= n ? n - 1 : k;
}

/* The window of (2 half + 1)² pixels around (x, y), which may extend beyond the image: the border is replicated. */
INLINE void gather(const Picture *p, index_t x, index_t y, index_t half, float *out) {
    const index_t side = 2 * half + 1;
    const int inside = x >= half && y >= half && x + half < p->width && y + half < p->height;
    for (index_t j = 0; j < side; j++) {
        const index_t row = clamped(y - half + j, p->height) * p->width;
        if (!inside)
            for (index_t i = 0; i < side; i++)
                *out++ = pixel(p, row + clamped(x - half + i, p->width));
        else if (p->real) {
            memcpy(out, (const float *)p->data + row + x - half, side * sizeof(float));
            out += side;
        } else {
            const uint8_t *from = (const uint8_t *)p->data + row + x - half;
            for (index_t i = 0; i < side; i++)
                out[i] = from[i];
            out += side;
        }
    }
}

INLINE double length_of(double x, double y) {
    return sqrt(x * x + y * y);
}

/* The index in 0 .. n − 1 that corresponds to k when the range is continued by reflection, without repeating its ends.
 * */
INLINE index_t mirrored(index_t k, index_t n) {
    if (n == 1)
        return 0;
    while (k < 0 || k >= n)
        k = k < 0 ? -k : 2 * n - 2 - k;
    return k;
}

/* The next run of marked cells from `x` on: returns its begin, and its end in *end; `width` if there is none. */
INLINE index_t next_run(const uint8_t *mask, index_t x, index_t width, index_t *end) {
    const uint8_t *at = x < width ? memchr(mask + x, 1, (size_t)(width - x)) : NULL;
    if (!at)
        return width;
    const uint8_t *stop = memchr(at, 0, (size_t)(width - (at - mask)));
    *end = stop ? stop - mask : width;
    return at - mask;
}

#endif
