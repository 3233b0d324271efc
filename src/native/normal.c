/* Weighted residuals of corners, and their normal equations, summed frame by frame. See rcdn.calibration.solver. */
#include "kernel.h"
#include "solvers.h"

#include <float.h>

/* POSE: unknowns of a frame, a small motion of its board; LARGEST: rows of matrices that are inverted here */
enum { POSE = 6, LARGEST = 32 };
CONSTANTS(normal, LARGEST)

/* Multiply a row of derivatives by a factor; 0 where they aren't finite. */
INLINE void weigh(double *row, index_t width, double factor) {
    for (index_t k = 0; k < width; k++) {
        const double value = row[k] * factor;
        row[k] = fabs(value) <= DBL_MAX ? value : 0;
    }
}

/* The residual of a corner times its weight, out (2). Returns whether it is below `far`: a camera can't see others. */
INLINE int weighted_gap(const double *gap, double weight, double far, double *out) {
    out[0] = gap[0] * weight;
    out[1] = gap[1] * weight;
    return fabs(out[0]) < far && fabs(out[1]) < far;
}

/* Multiply residuals gaps (count, 2) and their derivatives by_frame (count, 2, POSE) and shared (count, 2, width) by the
 * corners' weights; 0 for corners whose weighted residual isn't below `far`, which a camera can't see. Where `soft`, the
 * scale of the loss soft_l1, isn't 0, also by the root of its weight, for each axis. */
FAST_KERNEL(rcdn_weighted, (SIZE, count, gaps, 0), (IN, double, weight, count), (REAL, far), (REAL, soft),
            (OUT, double, gaps, count, 2), (OUT, double, by_frame, count, 2, POSE), (SIZE, width, shared, 2),
            (OUT, double, shared, count, 2, width)) {
    for (index_t n = 0; n < count; n++) {
        double *gap = gaps + 2 * n;
        const int seen = weighted_gap(gap, weight[n], far, gap);
        gap[0] = seen ? gap[0] : 0;
        gap[1] = seen ? gap[1] : 0;
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

/* The cost out (1) of residuals gaps (count, 2): the sum of the squares of these times the corners' weights, or, where
 * `soft` isn't 0, of the loss soft_l1 of that scale for each axis. If either residual of a corner isn't below `far`,
 * both count as `behind`. Corners without weight do not count. */
KERNEL(rcdn_cost, (SIZE, count, gaps, 0), (IN, double, gaps, count, 2), (IN, double, weight, count), (REAL, far),
       (REAL, behind), (REAL, soft), (OUT, double, out, 1)) {
    double total = 0;
    for (index_t n = 0; n < count; n++) {
        double gap[2];
        const int seen = weighted_gap(gaps + 2 * n, weight[n], far, gap);
        for (int axis = 0; axis < 2 && weight[n] > 0; axis++) {
            const double value = seen ? gap[axis] : behind, share = soft > 0 ? value / soft : 0;
            total += soft > 0 ? 2 * soft * soft * (sqrt(1 + share * share) - 1) : value * value;
        }
    }
    out[0] = total;
    return 0;
}

/* Add the sums of one frame, room (POSE, POSE + width), to its rows of blocks (POSE, across): those of parameters to
 * their `columns` after the frame's own. Then clear them. */
INLINE void flush_frame(double *room, const int64_t *columns, index_t width, double *blocks, index_t across) {
    for (int a = 0; a < POSE; a++) {
        const double *sums = room + a * (POSE + width);
        for (int b = 0; b < POSE; b++)
            blocks[a * across + b] += sums[b];
        for (index_t k = 0; k < width; k++)
            blocks[a * across + POSE + columns[k]] += sums[POSE + k];
    }
    memset(room, 0, (size_t)(POSE * (POSE + width)) * sizeof *room);
}

/* Add, of the corners of each of `frames` frames, sums of products of their derivatives by_frame (count, 2, POSE): with
 * themselves, and with the derivatives `shared` (count, 2, width) by parameters with the numbers `columns` (width), side
 * by side to blocks (frames, POSE, across); with gaps (count, 2) to pull (frames, POSE). */
FAST_KERNEL(rcdn_normal_blocks, (SIZE, count, gaps, 0), (SIZE, frames, pull, 0), (SIZE, across, blocks, 2),
            (WITHIN, int64_t, frame, 0, frames - 1, count), (IN, double, gaps, count, 2),
            (IN, double, by_frame, count, 2, POSE), (SIZE, width, shared, 2), (IN, double, shared, count, 2, width),
            (WITHIN, int64_t, columns, 0, across - POSE - 1, width), (ROOM, double, room, POSE *(POSE + width)),
            (OUT, double, blocks, frames, POSE, across), (OUT, double, pull, frames, POSE), (WHERE, across >= POSE)) {
    memset(room, 0, (size_t)(POSE * (POSE + width)) * sizeof *room);
    for (index_t n = 0; n < 2 * count; n++) {
        const double *own = by_frame + n * POSE, *other = shared + n * width;
        const index_t f = frame[n / 2];
        for (int a = 0; a < POSE; a++) {
            double *restrict row = room + a * (POSE + width);
            const double s = own[a];
            for (int b = 0; b < POSE; b++)
                row[b] += s * own[b];
            for (index_t k = 0; k < width; k++)
                row[POSE + k] += s * other[k];
            pull[f * POSE + a] += s * gaps[n];
        }
        if (n + 1 == 2 * count || frame[(n + 1) / 2] != f)
            flush_frame(room, columns, width, blocks + f * POSE * across, across);
    }
    return 0;
}

/* Upper triangular out (count, n, n): for each symmetric block (n, n) the factor of its inverse, whose product with its
 * transpose that is. Diagonals are at least `least` × `whole` (count, n), those before other unknowns were eliminated;
 * parameters whose `whole` is 0 get zeros. Returns the number of the first block that isn't positive definite, or the
 * trace of whose inverse exceeds `most` when its diagonal is made 1; `count` if there is none. */
KERNEL(rcdn_inverse_factors, (SIZE, count, blocks, 0), (SIZE, n, blocks, 1), (IN, double, blocks, count, n, n),
       (IN, double, whole, count, n), (REAL, least), (REAL, most), (OUT, double, out, count, n, n),
       (WHERE, n <= LARGEST)) {
    for (index_t f = 0; f < count; f++) {
        const double *block = blocks + f * n * n, *before = whole + f * n;
        double m[LARGEST * LARGEST], unit[LARGEST], *to = out + f * n * n;
        for (index_t k = 0; k < n; k++) {
            const double own = block[k * n + k], floor = least * before[k];
            if (!(before[k] >= 0))
                return f;
            unit[k] = floor > 0 ? sqrt(own > floor ? own : floor) : 0;
        }
        for (index_t k = 0; k < n; k++)
            for (index_t j = 0; j <= k; j++) {
                const double both = (block[k * n + j] + block[j * n + k]) / 2;
                m[k * LARGEST + j] = unit[k] * unit[j] != 0 ? both / (unit[k] * unit[j]) : j == k;
            }
        if (!factorise(n, LARGEST, m) || !(invert_lower(n, LARGEST, m) < most))
            return f;
        for (index_t k = 0; k < n; k++)
            for (index_t j = 0; j < n; j++)
                to[k * n + j] = j >= k && unit[k] * unit[j] != 0 ? m[j * LARGEST + k] / unit[k] : 0;
    }
    return count;
}
