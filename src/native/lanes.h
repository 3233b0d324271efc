/* Sums in one order, whatever the processor. The compiler may not change the order of sums (setup.py), so a plain loop adds number after number,
 * which no vector unit can speed up. Long sums are LANES running sums instead, each of every LANES-th number, which are added by halves at the end:
 * an inner loop over the lanes becomes vector code of any width, with the same bits. */
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
