/* Weighted residuals of corners, and their normal equations, summed frame by frame. See rcdn.calibration.solver. */
#include "kernel.h"

#include <float.h>

/* Unknowns of a frame: a small motion of its board */
enum { POSE = 6 };

/* Multiply a row of derivatives by a factor; 0 where they aren't finite. */
INLINE void weigh(double *row, index_t width, double factor) {
    for (index_t k = 0; k < width; k++) {
        const double value = row[k] * factor;
        row[k] = fabs(value) <= DBL_MAX ? value : 0;
    }
}

/* Multiply residuals gaps (count, 2) and their derivatives by_frame (count, 2, POSE) and shared (count, 2, width) by the
 * corners' weights; 0 for corners whose weighted residual isn't below `far`, which a camera can't see. Where `soft`, the
 * scale of the loss soft_l1, isn't 0, also by the root of its weight, for each axis. */
FAST_KERNEL(rcdn_weighted, (SIZE, count, gaps, 0), (IN, double, weight, count), (REAL, far), (REAL, soft),
            (OUT, double, gaps, count, 2), (OUT, double, by_frame, count, 2, POSE), (SIZE, width, shared, 2),
            (OUT, double, shared, count, 2, width)) {
    for (index_t n = 0; n < count; n++) {
        double *gap = gaps + 2 * n;
        const double x = gap[0] * weight[n], y = gap[1] * weight[n];
        const int seen = fabs(x) < far && fabs(y) < far;
        gap[0] = seen ? x : 0;
        gap[1] = seen ? y : 0;
        for (int axis = 0; axis < 2; axis++) {
            const double share = soft > 0 ? gap[axis] / soft : 0, calm = 1 / sqrt(sqrt(1 + share * share)),
                         factor = seen ? weight[n] * calm : 0;
            gap[axis] *= calm;
            weigh(by_frame + (2 * n + axis) * POSE, POSE, factor);
            weigh(shared + (2 * n + axis) * width, width, factor);
        }
    }
    return 0;
}

/* Of the corners of each of `frames` frames, sums of products of their derivatives by_frame (count, 2, POSE) with
 * themselves and with `shared` (count, 2, width), side by side in blocks (frames, POSE, POSE + width), and with gaps
 * (count, 2) in pull (frames, POSE). */
FAST_KERNEL(rcdn_normal_blocks, (SIZE, count, gaps, 0), (SIZE, frames, pull, 0),
            (WITHIN, int64_t, frame, 0, frames - 1, count), (IN, double, gaps, count, 2),
            (IN, double, by_frame, count, 2, POSE), (SIZE, width, shared, 2), (IN, double, shared, count, 2, width),
            (OUT, double, blocks, frames, POSE, POSE + width), (OUT, double, pull, frames, POSE)) {
    memset(blocks, 0, (size_t)(frames * POSE * (POSE + width)) * sizeof *blocks);
    memset(pull, 0, (size_t)(frames * POSE) * sizeof *pull);
    for (index_t n = 0; n < 2 * count; n++) {
        const double *own = by_frame + n * POSE, *other = shared + n * width;
        const index_t f = frame[n / 2];
        for (int a = 0; a < POSE; a++) {
            double *restrict row = blocks + (f * POSE + a) * (POSE + width);
            const double s = own[a];
            for (int b = 0; b < POSE; b++)
                row[b] += s * own[b];
            for (index_t k = 0; k < width; k++)
                row[POSE + k] += s * other[k];
            pull[f * POSE + a] += s * gaps[n];
        }
    }
    return 0;
}
