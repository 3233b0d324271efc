/* Sums in a fixed order on every processor. The compiler may not reorder sums (setup.py), so that a plain loop adds one
 * number after another and cannot be vectorised. Long sums are therefore split into LANES partial sums, each of every
 * LANES-th number, which are added pairwise at the end: an inner loop over the lanes becomes vector code of any width
 * with the same bits. */
#ifndef RCDN_LANES_H
#define RCDN_LANES_H

#include "rcdn.h"

enum { LANES = 16 };

INLINE float lane_sum(const float lanes[LANES]) {
    float eight[8], four[4];
    for (int k = 0; k < 8; k++)
        eight[k] = lanes[k] + lanes[k + 8];
    for (int k = 0; k < 4; k++)
        four[k] = eight[k] + eight[k + 4];
    return (four[0] + four[2]) + (four[1] + four[3]);
}

#endif
