/* Local contrast normalisation, row by row: (I − mean) / (standard deviation + FLOOR) over (2 HALF + 1)² px, of an
 * image continued by reflection. */
#ifndef CONTRAST_H
#define CONTRAST_H

#include "rcdn.h"

#define HALF 12 /* px to either side of the window */
#define SIDE (2 * HALF + 1)
#define FLOOR 6.0f
#define COLUMNS 128 /* width of a block of columns whose sums are updated together, and only where they are needed */
#define BEFORE 22   /* px of padding above and to the left of the image */

/* Running sums that slide down an image. Columns and rows are those of the padded image, BEFORE more than in the image;
 * its first row is `top`. */
typedef struct {
    Picture picture;
    index_t top, width;
    index_t *summed;       /* for each block of columns, the row on which its sums are centred, or −1 */
    void *sum, *square;    /* sums of each column over SIDE rows, from column −HALF to `width` + HALF */
    void *out, *in, *room; /* buffers for rows */
} Contrast;

/* Sums are of integers, and exact, so that they do not depend on where they begin: bytes less 128 in float (all below
 * 2^24), reals in units of 1/256 in double. */
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

/* Columns `from` .. `to` of the normalised row `y`. Rows must be requested from top to bottom. */
INLINE void normalise(Contrast *c, index_t y, index_t from, index_t to, float *out) {
    if (c->picture.real)
        normalise_of_reals(c, y, from, to, out);
    else
        normalise_of_bytes(c, y, from, to, out);
}

#endif
