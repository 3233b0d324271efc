/* The cell network (docs/decisions/0002-cell-network.md), evaluated only in the cells that are asked for and in what these see.
 *
 * Layers follow each other row by row through short rings of rows, so that what a row needs lies in the cache, whatever the size of the
 * picture. Every number is the same sum in the same order, whatever else is computed: results depend neither on what is asked for nor on the threads.
 */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("no-associative-math")
#endif
#include "rcdn.h"

#define CELL 4
#define CONVS 5   /* 3×3 convolutions from WIDE to WIDE channels at a quarter of the resolution */
#define NARROW 16 /* channels at half resolution, and outputs a cell */
#define WIDE 32
#define BEFORE 22 /* px that the network sees to the left of and above a cell */
#define HALF 12   /* px to either side of the window of local contrast */
#define FLOOR 6.0f
#define SLACK 8   /* cells that may be computed beyond the end of a row */
#define RING 4    /* rows of a layer that are kept; the first one keeps twice as many */

typedef float vec __attribute__((vector_size(4 * NARROW)));
typedef int32_t mask_t __attribute__((vector_size(4 * NARROW)));

/* Weights as `corners/cells.py` packs them. */
typedef struct {
    float first[25][NARROW], first_bias[NARROW];
    float second[9][NARROW][WIDE], second_bias[WIDE];
    struct {
        float weight[9][WIDE][WIDE], bias[WIDE];
    } conv[CONVS];
    float last[WIDE][NARROW], last_bias[NARROW];
} Weights;

/* A layer's rows: the latest in a ring, and which of its cells are needed. */
typedef struct {
    index_t height, width, channels, ring;
    index_t done;        /* rows computed so far */
    float *rows;         /* (ring, width + SLACK, channels) */
    const uint8_t *mask; /* (height, width) */
} Layer;

typedef struct {
    Picture picture;
    const Weights *weights;
    Layer seen;              /* the normalised picture, continued at its border */
    Layer layer[CONVS + 2];  /* at half resolution; strided; the convolutions */
    double *sum, *square;    /* over the 2 HALF + 1 rows around the next one, (width + 2 HALF) */
    double *part;            /* room for four rows more, and a mask */
    index_t summed;          /* the row whose sums these are, or −1 */
    index_t top;             /* row of the picture at which the rows of cells begin */
    index_t time;            /* steps of `advance` so far */
} Network;

INLINE vec load(const float *p) {
    vec v;
    memcpy(&v, p, sizeof v);
    return v;
}

INLINE void store(float *p, vec v) {
    memcpy(p, &v, sizeof v);
}

INLINE vec positive(vec v) {
    const vec zero = {0};
    return (vec)((mask_t)v & (mask_t)(v > zero));
}

INLINE index_t mirrored(index_t k, index_t n) {
    if (n == 1)
        return 0;
    while (k < 0 || k >= n)
        k = k < 0 ? -k : 2 * n - 2 - k;
    return k;
}

INLINE float *row_of(const Layer *l, index_t y) {
    return l->rows + (y & (l->ring - 1)) * (l->width + SLACK) * l->channels;
}

/* The next cells from `x` on that are needed: their begin, and the end in *end; `width` if there are none. */
INLINE index_t next_run(const uint8_t *mask, index_t x, index_t width, index_t *end) {
    const uint8_t *at = x < width ? memchr(mask + x, 1, (size_t)(width - x)) : NULL;
    if (!at)
        return width;
    const uint8_t *stop = memchr(at, 0, (size_t)(width - (at - mask)));
    *end = stop ? stop - mask : width;
    return at - mask;
}

/* Row `y` of the picture, continued by reflection, with HALF columns more on either side than is seen. Reals become whole 256ths, so that sums
 * are exact, and don't depend on where they begin. */
INLINE void continued(const Network *n, index_t y, double *out) {
    const Picture *p = &n->picture;
    const index_t start = -BEFORE - HALF, stop = n->seen.width + 2 * HALF + start, at = mirrored(n->top + y - BEFORE, p->height) * p->width;
    const index_t inner = stop < p->width ? stop : p->width;
    double *row = out - start; /* row[x] is the pixel at column x */
    if (p->real)
        for (index_t x = 0; x < inner; x++)
            row[x] = rint((double)((const float *)p->data)[at + x] * 256);
    else
        for (index_t x = 0; x < inner; x++)
            row[x] = ((const uint8_t *)p->data)[at + x];
    for (index_t x = start; x < 0; x++)
        row[x] = row[mirrored(x, p->width)];
    for (index_t x = inner; x < stop; x++)
        row[x] = row[mirrored(x, p->width)];
}

/* Add (sign 1) or take away (−1) a row to the sums over rows. */
INLINE void count_row(Network *n, index_t y, double sign) {
    const index_t count = n->seen.width + 2 * HALF;
    continued(n, y, n->part);
    for (index_t x = 0; x < count; x++) {
        n->sum[x] += sign * n->part[x];
        n->square[x] += sign * n->part[x] * n->part[x];
    }
}

/* Sums over 2 HALF + 1 = 25 = 16 + 8 + 1 neighbours along a row. `room` as long as the row. In place. */
INLINE void sums_along(double *row, index_t count, double *room) {
    const index_t whole = count - 2 * HALF;
    for (index_t x = 0; x < count - 1; x++)
        room[x] = row[x] + row[x + 1];
    for (index_t x = 0; x < count - 3; x++)
        room[x] += room[x + 2];
    for (index_t x = 0; x < count - 7; x++)
        room[x] += room[x + 4]; /* sums of 8 */
    for (index_t x = 0; x < whole; x++)
        row[x] = room[x] + room[x + 8] + room[x + 16] + row[x + 24];
}

/* Local contrast normalisation of row `y` of the continued picture between columns `from` and `to`. */
INLINE void normalise(Network *n, index_t y, index_t from, index_t to) {
    const float unit = n->picture.real ? 1 / 256.f : 1;
    const index_t count = to - from + 2 * HALF, area = (2 * HALF + 1) * (2 * HALF + 1), width = n->seen.width + 2 * HALF;
    double *sum = n->part, *square = n->part + width, *room = n->part + 2 * width;
    memcpy(sum, n->sum + from, (size_t)count * sizeof *sum);
    memcpy(square, n->square + from, (size_t)count * sizeof *square);
    sums_along(sum, count, room);
    sums_along(square, count, room);
    const double *grey = n->part + 3 * width + from + HALF;
    float *out = row_of(&n->seen, y) + from;
    const double mean = unit / (double)area;
    for (index_t x = 0; x < to - from; x++) {
        const double spread = (double)area * square[x] - sum[x] * sum[x];
        const float deviation = sqrtf((float)(spread > 0 ? spread : 0)) * (float)mean;
        out[x] = ((float)grey[x] * unit - (float)(sum[x] * mean)) / (deviation + FLOOR);
    }
}

/* Make rows of the normalised picture up to `y`, as far as rows of the first layer need them. */
INLINE void see(Network *n, index_t y) {
    const Layer *first = &n->layer[0];
    uint8_t *need = (uint8_t *)(n->part + 4 * (n->seen.width + 2 * HALF));
    for (; n->seen.done <= y; n->seen.done++) {
        const index_t row = n->seen.done;
        const index_t from = row > 4 ? (row - 3) / 2 : 0, to = row / 2 < first->height ? row / 2 : first->height - 1;
        memset(need, 0, (size_t)first->width);
        for (index_t k = from; k <= to; k++)
            for (index_t x = 0; x < first->width; x++)
                need[x] |= first->mask[k * first->width + x];
        if (!memchr(need, 1, (size_t)first->width))
            continue;
        if (n->summed < 0 || row - n->summed > 2 * HALF) {
            memset(n->sum, 0, (size_t)(n->seen.width + 2 * HALF) * sizeof *n->sum);
            memset(n->square, 0, (size_t)(n->seen.width + 2 * HALF) * sizeof *n->square);
            for (index_t k = row - HALF; k <= row + HALF; k++)
                count_row(n, k, 1);
        } else
            for (index_t k = n->summed + 1; k <= row; k++) {
                count_row(n, k - HALF - 1, -1);
                count_row(n, k + HALF, 1);
            }
        n->summed = row;
        continued(n, row, n->part + 3 * (n->seen.width + 2 * HALF));
        for (index_t x = 0, end; (x = next_run(need, x, first->width, &end)) < first->width; x = end) {
            index_t later; /* gaps shorter than a window aren't worth a new start */
            for (index_t next; (next = next_run(need, end, first->width, &later)) < first->width && next - end < HALF;)
                end = later;
            const index_t stop = 2 * end + 3 + 2 * SLACK;
            normalise(n, row, 2 * x, stop < n->seen.width ? stop : n->seen.width);
        }
    }
}

/* `count` outputs of the first layer: 5×5 px, every second one. */
INLINE void first_block(const Network *n, index_t y, index_t x, const int count, float *out) {
    vec sum[8];
    for (int k = 0; k < count; k++)
        sum[k] = load(n->weights->first_bias);
    for (int j = 0; j < 5; j++) {
        const float *row = row_of(&n->seen, 2 * y + j) + 2 * x;
        for (int i = 0; i < 5; i++) {
            const vec weight = load(n->weights->first[5 * j + i]);
            for (int k = 0; k < count; k++)
                sum[k] += weight * row[2 * k + i];
        }
    }
    for (int k = 0; k < count; k++)
        store(out + k * NARROW, positive(sum[k]));
}

/* `count` outputs of a 3×3 convolution to WIDE channels, of every `stride`-th cell of `from`. */
INLINE void wide_block(const Layer *from, const float *weight, const float *bias, const int channels, const int stride, index_t y, index_t x, const int count, float *out) {
    vec low[8], high[8];
    for (int k = 0; k < count; k++) {
        low[k] = load(bias);
        high[k] = load(bias + NARROW);
    }
    for (int j = 0; j < 3; j++) {
        const float *row = row_of(from, stride * y + j) + stride * x * channels;
        for (int i = 0; i < 3; i++)
            for (int c = 0; c < channels; c++, weight += WIDE) {
                const vec one = load(weight), two = load(weight + NARROW);
                for (int k = 0; k < count; k++) {
                    const float value = row[(stride * k + i) * channels + c];
                    low[k] += one * value;
                    high[k] += two * value;
                }
            }
    }
    for (int k = 0; k < count; k++) {
        store(out + k * WIDE, positive(low[k]));
        store(out + k * WIDE + NARROW, positive(high[k]));
    }
}

INLINE void first_row(Network *n, index_t y) {
    Layer *l = &n->layer[0];
    const uint8_t *mask = l->mask + y * l->width;
    float *out = row_of(l, y);
    if (!memchr(mask, 1, (size_t)l->width))
        return;
    see(n, 2 * y + 4);
    for (index_t x = 0, end; (x = next_run(mask, x, l->width, &end)) < l->width; x = end)
        for (; x < end; x += 8)
            first_block(n, y, x, 8, out + x * NARROW);
}

#define WIDE_ROW(count_, channels_, stride_) \
    for (; x < end && (count_ == 4 || end - x > 4); x += count_) \
        wide_block(from, weight, bias, channels_, stride_, y, x, count_, out + x * WIDE);

INLINE void wide_row(const Layer *from, Layer *to, const float *weight, const float *bias, const int channels, const int stride, index_t y) {
    const uint8_t *mask = to->mask + y * to->width;
    float *out = row_of(to, y);
    for (index_t x = 0, end; (x = next_run(mask, x, to->width, &end)) < to->width; x = end) {
        WIDE_ROW(8, channels, stride)
        WIDE_ROW(4, channels, stride)
    }
}

INLINE float sigmoid(float x) {
    const float t = fminf(fmaxf(-x, -80), 80) * 1.44269504f;
    const float whole = rintf(t), f = (t - whole) * 0.69314718f;
    const float part = 1 + f * (1 + f * (0.5f + f * (1 / 6.f + f * (1 / 24.f + f * (1 / 120.f + f * (1 / 720.f))))));
    const int32_t bits = ((int32_t)whole + 127) << 23;
    float scale;
    memcpy(&scale, &bits, sizeof scale);
    return 1 / (1 + part * scale);
}

/* Write the outputs of one row of cells into the response (height, width) of the picture. */
INLINE void last_row(const Network *n, const uint8_t *mask, index_t width, index_t y, float *response) {
    const float *row = row_of(&n->layer[CONVS + 1], y);
    for (index_t x = 0; x < width; x++) {
        if (!mask[x])
            continue;
        vec sum = load(n->weights->last_bias);
        for (int c = 0; c < WIDE; c++)
            sum += load(n->weights->last[c]) * row[x * WIDE + c];
        float out[NARROW];
        store(out, sum);
        for (int k = 0; k < NARROW; k++)
            out[k] = sigmoid(out[k]);
        for (index_t j = 0; j < CELL && n->top + CELL * y + j < n->picture.height; j++)
            for (index_t i = 0; i < CELL && CELL * x + i < n->picture.width; i++)
                response[(n->top + CELL * y + j) * n->picture.width + CELL * x + i] = out[CELL * j + i];
    }
}

/* Compute the rows of all layers that row `y` of the last one needs: at each step one row of every layer, two behind the one before it,
 * so that no ring runs over. */
INLINE void advance(Network *n, index_t y) {
    for (; n->time <= y + 2 * CONVS; n->time++) {
        for (; n->layer[0].done <= 2 * n->time + 2; n->layer[0].done++)
            first_row(n, n->layer[0].done);
        wide_row(&n->layer[0], &n->layer[1], &n->weights->second[0][0][0], n->weights->second_bias, NARROW, 2, n->time);
        for (int k = 0; k < CONVS && n->time >= 2 * (k + 1); k++)
            wide_row(&n->layer[k + 1], &n->layer[k + 2], &n->weights->conv[k].weight[0][0][0], n->weights->conv[k].bias, WIDE, 1, n->time - 2 * (k + 1));
    }
}

/* Masks: a cell of a layer is needed where the 3×3 of the next one begins up to two cells before it. */
INLINE void needed_by(const uint8_t *next, index_t height, index_t width, uint8_t *mask) {
    const index_t wide = width + 2;
    memset(mask, 0, (size_t)((height + 2) * wide));
    for (index_t y = 0; y < height; y++) {
        const uint8_t *from = next + y * width;
        if (!memchr(from, 1, (size_t)width))
            continue;
        for (int k = 0; k < 3; k++)
            for (index_t x = 0; x < width; x++)
                mask[y * wide + x + k] |= from[x];
    }
    for (index_t y = height + 1; y >= 0; y--) /* from below, so that rows are not yet spread themselves */
        for (int k = 1; k < 3; k++)
            if (y - k >= 0)
                for (index_t x = 0; x < wide; x++)
                    mask[y * wide + x] |= mask[(y - k) * wide + x];
}

INLINE void needed_by_strided(const uint8_t *next, index_t height, index_t width, uint8_t *mask) {
    const index_t wide = 2 * width + 1;
    memset(mask, 0, (size_t)((2 * height + 1) * wide));
    for (index_t y = 0; y < height; y++)
        for (index_t x = 0; x < width; x++)
            if (next[y * width + x])
                for (int k = 0; k < 3; k++)
                    memset(mask + (2 * y + k) * wide + 2 * x, 1, 3);
}

/* Bytes that hold all rings, sums and masks for so many rows of cells. */
static size_t room_for(index_t across, index_t rows) {
    const index_t last = across + 2 * CONVS, first = 2 * last + 1, seen = 2 * first + 3;
    const index_t floats = RING * (CONVS + 1) * (last + SLACK) * WIDE + 2 * RING * (first + SLACK) * NARROW + 2 * RING * (seen + SLACK) + 8 * SLACK;
    const index_t doubles = 6 * (seen + 2 * HALF), masks = (CONVS + 1) * last * (rows + 2 * CONVS) + first * (2 * (rows + 2 * CONVS) + 1) + first;
    return (size_t)(8 * doubles + 4 * floats + masks) + 64 * 32;
}

INLINE void *taken(char **room, index_t bytes) {
    void *out = *room;
    *room += (bytes + 63) / 64 * 64;
    return out;
}

/* The response in the cells of the rows `first` .. `first + rows` of `cells` (down, across) that are marked. `response` (height, width) is
 * left as it is elsewhere. 0, or −1 without memory. */
FAST EXPORT index_t rcdn_network(const void *data, index_t height, index_t width, int real, const float *weights, const uint8_t *cells, index_t first, index_t rows, float *response) {
    const index_t across = (width + CELL - 1) / CELL;
    char *memory = malloc(room_for(across, rows)), *room = memory;
    if (!memory)
        return -1;
    room += 64 - (uintptr_t)room % 64;
    Network n = {{data, height, width, real}, (const Weights *)weights, {0}, {{0}}, NULL, NULL, NULL, -1, CELL * first, 0};
    index_t h = rows, w = across;
    cells += first * across;
    const uint8_t *mask = cells;
    for (int k = CONVS + 1; k >= 0; k--) {
        Layer *l = &n.layer[k];
        *l = (Layer){h, w, k ? WIDE : NARROW, k ? RING : 2 * RING, 0, NULL, mask};
        l->rows = taken(&room, l->ring * (w + SLACK) * l->channels * 4);
        memset(l->rows, 0, (size_t)(l->ring * (w + SLACK) * l->channels) * 4);
        if (k == 0)
            break;
        uint8_t *before = taken(&room, k == 1 ? (2 * h + 1) * (2 * w + 1) : (h + 2) * (w + 2));
        if (k == 1)
            needed_by_strided(mask, h, w, before);
        else
            needed_by(mask, h, w, before);
        mask = before;
        h = k == 1 ? 2 * h + 1 : h + 2;
        w = k == 1 ? 2 * w + 1 : w + 2;
    }
    n.seen = (Layer){2 * h + 3, 2 * w + 3, 1, 2 * RING, 0, NULL, NULL};
    const index_t wide = n.seen.width + 2 * HALF, ring = n.seen.ring * (n.seen.width + SLACK) + 4 * SLACK;
    n.seen.rows = taken(&room, ring * 4);
    memset(n.seen.rows, 0, (size_t)ring * 4);
    n.sum = taken(&room, wide * 8);
    n.square = taken(&room, wide * 8);
    n.part = taken(&room, 4 * wide * 8 + w);
    for (index_t y = 0; y < rows; y++) {
        if (!memchr(cells + y * across, 1, (size_t)across))
            continue;
        advance(&n, y);
        last_row(&n, cells + y * across, across, y, response);
    }
    free(memory);
    return 0;
}
