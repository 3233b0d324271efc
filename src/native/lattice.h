/* The local map of one corner of a board, from pixels to squares relative to the corner, as stored by
 * `rcdn.precision.lattice.Lattice`. */
#ifndef RCDN_LATTICE_H
#define RCDN_LATTICE_H

#include "kernel.h"

enum { TERMS = 6 };

/* The maps of all corners of a board. */
ARGUMENT_GROUP(Maps, (SIZE, corners, origin, 0), (IN, double, flat, 3, 3), (IN, double, origin, corners, 2),
               (IN, double, terms, corners, TERMS, 2))

/* `flat` (3, 3): pixels to rectified squares; `origin` (2): the rectified corner; `terms` (6, 2): coefficients of 1, s,
 * t, s², st, t². */
typedef struct {
    const double *flat, *origin, *terms;
} Map;

INLINE Map map_of(const Maps *maps, index_t k) {
    const Map m = {maps->flat, maps->origin + 2 * k, maps->terms + 2 * TERMS * k};
    return m;
}

/* Position `uv` of the pixel (x, y), squares from the corner, and its Jacobian `slopes` (2, 2), squares per pixel. */
INLINE void map_pixel(const Map *m, double x, double y, double uv[2], double slopes[4]) {
    const double *H = m->flat;
    const double depth = 1 / (H[6] * x + H[7] * y + H[8]);
    const double a = (H[0] * x + H[1] * y + H[2]) * depth, b = (H[3] * x + H[4] * y + H[5]) * depth;
    const double s = a - m->origin[0], t = b - m->origin[1];
    for (int k = 0; k < 2; k++) {
        const double *c = m->terms + k;
        const double by_s = c[2] + 2 * c[6] * s + c[8] * t, by_t = c[4] + c[8] * s + 2 * c[10] * t;
        uv[k] = c[0] + 0.5 * (s * (c[2] + by_s) + t * (c[4] + by_t));
        for (int axis = 0; axis < 2; axis++)
            slopes[2 * k + axis] =
                depth * (by_s * (H[axis] - a * H[6 + axis]) + by_t * (H[3 + axis] - b * H[6 + axis]));
    }
}

#endif
