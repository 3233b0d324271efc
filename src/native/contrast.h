/* Local contrast normalisation, row by row: (I − mean) / (standard deviation + FLOOR) over (2 HALF + 1)² px, of a picture continued by reflection. */
#ifndef CONTRAST_H
#define CONTRAST_H

#include "rcdn.h"

#define HALF 12 /* px to either side of the window */
#define SIDE (2 * HALF + 1)
#define FLOOR 6.0f
#define COLUMNS 128 /* a block, whose sums slide down together, and only to where they are asked for */
#define BEFORE 22   /* px that are seen above and to the left of the picture */

/* What slides down a picture. Columns and rows are those that are seen: BEFORE less in the picture, whose row `top` is where they begin. */
typedef struct {
    Picture picture;
    index_t top, width;
    index_t *summed;       /* for each block of columns, the row around which its sums are, or −1 */
    void *sum, *square;    /* of each column over SIDE rows, from column −HALF to `width` + HALF */
    void *out, *in, *room; /* room for rows */
} Contrast;

/* Sums are of whole numbers, and exact, so that it doesn't matter where they begin: of bytes less 128 in float (all under 2^24), of reals in 256ths
 * in double. */
#define NUMBER float
#define OF(name) name##_of_bytes
#define LEVEL(at) ((float)((const uint8_t *)c->picture.data)[at] - 128)
#define UNIT 1
#include "contrast_rows.h"

#define NUMBER double
#define OF(name) name##_of_reals
#define LEVEL(at) rint((double)((const float *)c->picture.data)[at] * 256)
#define UNIT (1 / 256.f)
#include "contrast_rows.h"

/* Columns `from` .. `to` of the normalised row `y`. Rows are asked for from top to bottom. */
INLINE void normalise(Contrast *c, index_t y, index_t from, index_t to, float *out) {
    if (c->picture.real)
        normalise_of_reals(c, y, from, to, out);
    else
        normalise_of_bytes(c, y, from, to, out);
}

#endif
