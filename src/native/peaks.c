/* Peaks of a response map: the adaptive threshold, the candidates, and those that survive suppression. */
#include "kernel.h"

/* Sum and number of the responses (height, width) above `level`, in the marked `cells` (⌈height / 4⌉, ⌈width / 4⌉). */
FAST_KERNEL(rcdn_above, (SIZE, height, response, 0), (SIZE, width, response, 1), (IN, float, response, height, width),
            (IN, uint8_t, cells, (height + CELL - 1) / CELL, (width + CELL - 1) / CELL), (REAL, level),
            (OUT, double, sum, 1)) {
    const index_t across = (width + CELL - 1) / CELL;
    const float least = (float)level;
    double total = 0;
    index_t count = 0;
    for (index_t y = 0; y < height; y++) {
        const uint8_t *mask = cells + y / CELL * across;
        const float *row = response + y * width;
        for (index_t i = 0, end; (i = next_run(mask, i, across, &end)) < across; i = end) {
            const index_t stop = CELL * end < width ? CELL * end : width;
            for (index_t x = CELL * i; x < stop; x++)
                if (row[x] > least) {
                    total += row[x];
                    count++;
                }
        }
    }
    *sum = total;
    return count;
}

/* Whether none of the eight neighbours of (x, y) is greater. */
static int is_peak(const float *response, index_t height, index_t width, index_t x, index_t y) {
    const float own = response[y * width + x];
    for (index_t j = y > 0 ? y - 1 : 0; j <= y + 1 && j < height; j++)
        for (index_t i = x > 0 ? x - 1 : 0; i <= x + 1 && i < width; i++)
            if (response[j * width + i] > own)
                return 0;
    return 1;
}

/* number of pixels of a row that are compared together, since few exceed the threshold */
enum { TOGETHER = 32 };

INLINE int any_over(const float *row, index_t from, index_t to, float least) {
    int any = 0;
    for (index_t x = from; x < to; x++)
        any |= row[x] >= least;
    return any;
}

/* Pixels of at least `threshold`, with `peaks` only those that no neighbour exceeds, in the marked cells: x, y row by
 * row, at most `room` of them. Returns their number. NaN never counts. */
FAST_KERNEL(rcdn_candidates, (SIZE, height, response, 0), (SIZE, width, response, 1), (SIZE, room, xy, 0),
            (IN, float, response, height, width),
            (IN, uint8_t, cells, (height + CELL - 1) / CELL, (width + CELL - 1) / CELL), (REAL, threshold),
            (INT, peaks, 0, 1), (OUT, int64_t, xy, room, 2)) {
    const index_t across = (width + CELL - 1) / CELL;
    const float least = (float)threshold;
    index_t count = 0;
    for (index_t y = 0; y < height; y++) {
        const uint8_t *mask = cells + y / CELL * across;
        for (index_t i = 0, end; (i = next_run(mask, i, across, &end)) < across; i = end) {
            const index_t stop = CELL * end < width ? CELL * end : width;
            for (index_t x = CELL * i, last; x < stop; x = last) {
                last = stop - x < TOGETHER ? stop : x + TOGETHER;
                if (!any_over(response + y * width, x, last, least))
                    continue;
                for (; x < last; x++)
                    if (response[y * width + x] >= least && (!peaks || is_peak(response, height, width, x, y))) {
                        if (count < room) {
                            xy[2 * count] = x;
                            xy[2 * count + 1] = y;
                        }
                        count++;
                    }
            }
        }
    }
    return count;
}

static int all_inside(const int64_t *xy, index_t count, index_t height, index_t width) {
    for (index_t k = 0; k < count; k++)
        if (xy[2 * k] < 0 || xy[2 * k] >= width || xy[2 * k + 1] < 0 || xy[2 * k + 1] >= height)
            return 0;
    return 1;
}

/* Greedy suppression: `keep` marks which of `count` pixels xy, the strongest first, survive. A survivor suppresses all
 * pixels at offsets where the `stencil` (side, side), centred on it, is set. */
KERNEL(rcdn_suppress, (SIZE, count, xy, 0), (SIZE, side, stencil, 0), (IN, int64_t, xy, count, 2),
       (INT, height, 0, FURTHEST), (INT, width, 0, FURTHEST), (WHERE, all_inside(xy, count, height, width)),
       (IN, uint8_t, stencil, side, side), (OUT, uint8_t, keep, count)) {
    const index_t stride = width + side;
    uint8_t *gone = calloc((size_t)(height + side) * (size_t)stride, 1);
    if (!gone)
        return NO_MEMORY;
    for (index_t k = 0; k < count; k++) {
        uint8_t *window = gone + xy[2 * k + 1] * stride + xy[2 * k];
        keep[k] = !window[side / 2 * stride + side / 2];
        if (!keep[k])
            continue;
        for (index_t j = 0; j < side; j++)
            for (index_t i = 0; i < side; i++)
                window[j * stride + i] |= stencil[j * side + i];
    }
    free(gone);
    return 0;
}
