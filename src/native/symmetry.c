/* Centres of point symmetry or antisymmetry; see rcdn.corners.symmetry. */
#include "kernel.h"
#include "lanes.h"
#include "solvers.h"

#define MARGIN 4   /* reach of the smoothing, px: a Gaussian of 1 px */
#define THIN 0.004 /* smallest ratio of the two eigenvalues of the normal matrix; below it the window shows an edge */
#define FAR 1e9    /* px, beyond the width of any image */

enum { LARGEST = 10000 }; /* radius of a disc, px */

static const float KERNEL[MARGIN + 1] = {0.39894346f, 0.24197145f, 0.05399112f, 0.00443186f, 0.00013383f};

/* One corner's surroundings. All arrays have rows of `stride`. `disc`: 1 for pixels of the disc before its centre, 0
 * elsewhere. */
typedef struct {
    index_t half, stride;
    float *raw, *across, *smooth, *level, *disc;
} Room;

/* Rows are processed in blocks of LANES pixels; surplus pixels are never used. */
INLINE index_t blocks(index_t columns) {
    return (columns + LANES - 1) / LANES;
}

/* The workspace's layout for discs of up to `half` px; returns its size in floats. */
INLINE index_t lay_out(Room *room, float *work, index_t half) {
    const index_t stride = blocks(2 * half + 4 + 2 * MARGIN) * LANES,
                  size = (2 * half + 6 + 2 * MARGIN) * stride + 2 * LANES;
    room->half = half;
    room->stride = stride;
    room->raw = work;
    room->across = work + size;
    room->smooth = work + 2 * size;
    room->level = work + 3 * size;
    room->disc = work + 4 * size;
    return 5 * size;
}

KERNEL(rcdn_symmetry_room, (INT, half, 0, LARGEST)) {
    Room room;
    return lay_out(&room, NULL, half);
}

/* Number of floats for the largest of `count` discs. */
static index_t room_for(const int64_t *half, index_t count) {
    Room room;
    index_t most = 0;
    for (index_t k = 0; k < count; k++)
        most = half[k] > most ? (index_t)half[k] : most;
    return lay_out(&room, NULL, most);
}

INLINE void draw_disc(Room *room) {
    const index_t half = room->half;
    for (index_t j = 0; j <= half; j++)
        for (index_t i = 0; i < room->stride; i++) {
            const int before = j < half ? i <= 2 * half : i < half;
            room->disc[j * room->stride + i] =
                before && (i - half) * (i - half) + (j - half) * (j - half) <= half * (half + 1);
        }
}

/* Smooth (2 half + 4)² pixels, the first of them at (x - half - 1, y - half - 1). */
INLINE void smooth(const Picture *p, const Room *room, index_t x, index_t y) {
    const index_t size = 2 * room->half + 4, side = size + 2 * MARGIN, stride = room->stride;
    const index_t wide = side + 1; /* `gather` has an odd size: its first row and column are surplus */
    gather(p, x, y, room->half + 2 + MARGIN, room->raw);
    for (index_t j = 0; j < size; j++)
        for (index_t b = 0; b < blocks(side) * LANES; b += LANES) {
            const float *from = room->raw + (j + MARGIN + 1) * wide + b + 1;
            float *to = room->across + j * stride + b;
            for (index_t i = 0; i < LANES; i++) {
                float sum = KERNEL[0] * from[i];
                for (index_t k = 1; k <= MARGIN; k++)
                    sum += KERNEL[k] * (from[i - k * wide] + from[i + k * wide]);
                to[i] = sum;
            }
        }
    for (index_t j = 0; j < size; j++)
        for (index_t b = 0; b < blocks(size) * LANES; b += LANES) {
            const float *from = room->across + j * stride + b + MARGIN;
            float *to = room->smooth + j * stride + b;
            for (index_t i = 0; i < LANES; i++) {
                float sum = KERNEL[0] * from[i];
                for (index_t k = 1; k <= MARGIN; k++)
                    sum += KERNEL[k] * (from[i - k] + from[i + k]);
                to[i] = sum;
            }
        }
}

/* Smoothed grey levels between the pixels: (2 half + 3)², the central one (fx, fy) to the right of and below the
 * central pixel. */
INLINE void shift(const Room *room, float fx, float fy) {
    const index_t size = 2 * room->half + 3, stride = room->stride;
    for (index_t j = 0; j < size; j++)
        for (index_t b = 0; b < blocks(size) * LANES; b += LANES) {
            const float *top = room->smooth + j * stride + b, *low = top + stride;
            float *to = room->level + j * stride + b;
            for (index_t i = 0; i < LANES; i++) {
                const float up = top[i] * (1 - fx) + top[i + 1] * fx, down = low[i] * (1 - fx) + low[i + 1] * fx;
                to[i] = up * (1 - fy) + down * fy;
            }
        }
}

/* A pixel and its image under a half turn: their difference, or (anti) their sum, for the level and (doubled) its
 * derivatives. */
INLINE void turned(const float *level, index_t stride, const float *other, int anti, float out[3]) {
    const float sign = anti ? 1.0f : -1.0f;
    out[0] = level[0] + sign * other[0];
    out[1] = level[1] - level[-1] + sign * (other[1] - other[-1]);
    out[2] = level[stride] - level[-stride] + sign * (other[stride] - other[-stride]);
}

/* Means of the even parts over the disc, which must not affect the estimate; `own`: the central pixel's even parts
 * without these means. */
INLINE void level_out(const Room *room, index_t first, index_t last, index_t middle, float mean[3], float own[3]) {
    float r[LANES] = {0}, gx[LANES] = {0}, gy[LANES] = {0}, weights[LANES] = {0};
    for (index_t b = 0; b < blocks(middle) * LANES; b += LANES)
        for (index_t i = 0; i < LANES; i++) {
            const index_t k = b + i;
            float t[3];
            turned(room->level + first + k, room->stride, room->level + last - k, 1, t);
            r[i] += room->disc[k] * t[0];
            gx[i] += room->disc[k] * t[1];
            gy[i] += room->disc[k] * t[2];
            weights[i] += room->disc[k];
        }
    turned(room->level + first + middle, room->stride, room->level + last - middle, 1, own);
    const float sums[3] = {lane_sum(r), lane_sum(gx), lane_sum(gy)}, weight = lane_sum(weights);
    for (int i = 0; i < 3; i++) {
        mean[i] = (2 * sums[i] + own[i]) / (2 * weight + 1);
        own[i] -= mean[i];
    }
}

/* The Gauss–Newton step from the centre of the window to the centre of symmetry; returns 0 if the window has no edges,
 * or edges of one direction only. A half turn exchanges the pixels before the centre with those after it: half of them
 * are sufficient. */
INLINE int symmetry_step(const Room *room, int anti, double step[2]) {
    const index_t first = room->stride + 1, middle = room->half * (room->stride + 1), last = first + 2 * middle;
    float xx[LANES] = {0}, xy[LANES] = {0}, yy[LANES] = {0}, xr[LANES] = {0}, yr[LANES] = {0}, mean[3] = {0, 0, 0},
          own[3] = {0, 0, 0};
    if (anti)
        level_out(room, first, last, middle, mean, own);
    for (index_t begin = 0; begin < blocks(middle) * LANES; begin += LANES)
        for (index_t i = 0; i < LANES; i++) {
            const index_t k = begin + i;
            float t[3];
            turned(room->level + first + k, room->stride, room->level + last - k, anti, t);
            const float weight = room->disc[k], r = t[0] - mean[0], gx = weight * (t[1] - mean[1]),
                        gy = weight * (t[2] - mean[2]);
            xx[i] += gx * gx;
            xy[i] += gx * gy;
            yy[i] += gy * gy;
            xr[i] += gx * r;
            yr[i] += gy * r;
        }
    const double a = 2.0 * lane_sum(xx) + own[1] * own[1], b = 2.0 * lane_sum(xy) + own[1] * own[2],
                 c = 2.0 * lane_sum(yy) + own[2] * own[2];
    const double u = 2.0 * lane_sum(xr) + own[1] * own[0], v = 2.0 * lane_sum(yr) + own[2] * own[0];
    /* twice: the derivatives are differences over two pixels */
    return solve_two(a, b, b, c, -2 * u, -2 * v, step) > THIN * (a + c) * (a + c);
}

/* The centre of symmetry near (x, y); 0 if there is none. The image is smoothed again only when the centre moves to
 * another pixel. */
INLINE int symmetry_centre(const Picture *p, const Room *room, double at[2], index_t repeats, double done, int anti) {
    double step[2];
    index_t x = 0, y = 0;
    for (index_t k = 0; k < repeats; k++) {
        const index_t i = (index_t)floor(at[0]), j = (index_t)floor(at[1]);
        if (k == 0 || i != x || j != y)
            smooth(p, room, x = i, y = j);
        shift(room, (float)(at[0] - (double)i), (float)(at[1] - (double)j));
        if (!symmetry_step(room, anti, step))
            return 0;
        for (int axis = 0; axis < 2; axis++) {
            step[axis] = step[axis] < -1 ? -1 : step[axis] > 1 ? 1 : step[axis];
            at[axis] += step[axis];
        }
        if (fabs(step[0]) <= done && fabs(step[1]) <= done)
            return 1;
    }
    return 0;
}

/* Centres of symmetry (anti: antisymmetry) `out` (count, 2) px near `start` (count, 2) over discs of `half` (count,)
 * px; NaN where there is none. `work`: zeros, of the size returned by `rcdn_symmetry_room` for the largest disc. */
FAST_KERNEL(rcdn_symmetry_centre, (PICTURE, p), (SIZE, count, start, 0), (IN, double, start, count, 2),
            (WITHIN, int64_t, half, 0, LARGEST, count), (INT, repeats, 0, 1000), (REAL, done), (INT, anti, 0, 1),
            (ROOM, float, work, room_for(half, count)), (OUT, double, out, count, 2)) {
    Room room = {-1, 0, NULL, NULL, NULL, NULL, NULL};
    for (index_t n = 0; n < count; n++) {
        const double *from = start + 2 * n, reach = half[n] > 2 ? 0.5 * (double)half[n] : 1;
        double *at = out + 2 * n;
        if (room.half != (index_t)half[n]) {
            lay_out(&room, work, (index_t)half[n]);
            draw_disc(&room);
        }
        memcpy(at, from, 2 * sizeof(double));
        const int known = fabs(at[0]) < FAR && fabs(at[1]) < FAR;
        const int found = known && (anti ? symmetry_centre(&p, &room, at, repeats, done, 1)
                                         : symmetry_centre(&p, &room, at, repeats, done, 0));
        if (!found || fabs(at[0] - from[0]) > reach || fabs(at[1] - from[1]) > reach)
            at[0] = at[1] = NAN;
    }
    return 0;
}
