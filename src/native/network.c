/* The cell network (docs/decisions/0002-cell-network.md), evaluated only in the requested cells and their receptive
 * fields.
 *
 * Layers are computed row by row through short ring buffers of rows, so that the input of a row is in the cache,
 * whatever the size of the image. The first layer is in floating point, the others in integer arithmetic (rows.h).
 * Every number is the same sum in the same order, whatever else is computed: results depend neither on the requested
 * cells nor on the number of threads.
 */
#include "contrast.h"
#include "kernel.h"
#include "rows.h"

#define CONVS 5   /* 3×3 convolutions from WIDE to WIDE channels at a quarter of the resolution */
#define NARROW 16 /* channels at half resolution, and outputs per cell */
#define FIRST 4   /* outputs of the first layer that are computed together: their sums stay in registers */
#define RING 4    /* rows of a layer that are kept */
#define SEEN 8    /* rows of the normalised image that are kept */

typedef float floats __attribute__((vector_size(4 * FLOATS)));
typedef int32_t ints __attribute__((vector_size(4 * FLOATS)));
typedef float sixteen __attribute__((vector_size(64))); /* with AVX-512 */
enum { PARTS = NARROW / FLOATS, STRIDED = 9 * NARROW * WIDE };

/* Weights as packed by `corners/cells.py`: those in floating point, and those of 8 bits. `scale` and `bias` turn sums
 * into the inputs of the next layer, and those of the last layer into the argument of the sigmoid. */
typedef struct {
    float first[25][NARROW], first_bias[NARROW];
    struct {
        float scale[WIDE], bias[WIDE];
    } conv[CONVS + 1];
    float last_scale[NARROW], last_bias[NARROW], last[WIDE][NARROW];
} Reals;

typedef struct {
    int8_t strided[9 * NARROW * WIDE], conv[CONVS][9 * WIDE * WIDE];
} Bytes;

enum { REALS = sizeof(Reals) / sizeof(float) };
_Static_assert(sizeof(Reals) == REALS * sizeof(float), "weights have no gaps");
CONSTANTS(network, CELL, GROUP, BEST)

/* Rows of a layer: the latest ones in a ring buffer, and the mask of the cells that are needed. */
typedef struct {
    index_t height, width, channels, ring;
    index_t done;        /* rows computed so far */
    uint8_t *rows;       /* (ring, width + SLACK, channels) */
    const uint8_t *mask; /* (height, width) */
} Layer;

/* The normalised image, padded at its border. */
typedef struct {
    index_t height, width, done;
    float *rows; /* (SEEN, width + SLACK) */
} Seen;

typedef struct {
    Contrast contrast;
    const Reals *reals;
    const Bytes *bytes;
    RowKernels kernels;
    const int16_t *pairs;   /* the weights of `bytes` in the same order, see `paired` */
    const int32_t *centres; /* (CONVS + 1, WIDE), see `centred` */
    Seen seen;
    Layer layer[CONVS + 2]; /* at half resolution; strided; the convolutions */
    int wide;               /* whether the processor has vectors of 16 numbers */
    uint8_t *need;          /* buffer for a mask of the first layer's width */
    index_t time;           /* steps of `advance` so far */
} Network;

/* Store inputs of the next layer, clamped to 0..255. */
INLINE void store_levels(uint8_t *p, const float x[NARROW]) {
    for (int k = 0; k < NARROW; k++) {
        const float least = x[k] > 0 ? x[k] : 0;
        p[k] = (uint8_t)(int32_t)((least < 255 ? least : 255) + 0.5f);
    }
}

/* One of two numbers, each where `first` has all bits or none. */
INLINE floats chosen(ints first, floats one, floats other) {
    return (floats)((first & (ints)one) | (~first & (ints)other));
}

/* 1 / (1 + exp(−x)), error below 1e-6. */
INLINE floats sigmoid(floats x) {
    const floats most = (floats){0} + 80;
    x = chosen(x > -most, x, -most);
    const floats t = chosen(x < most, x, most) * -1.44269504f;
    const ints whole = __builtin_convertvector(t, ints);
    const floats f = (t - __builtin_convertvector(whole, floats)) * 0.69314718f;
    const floats part =
        1 +
        f * (1 + f * (0.5f + f * (1 / 6.f + f * (1 / 24.f + f * (1 / 120.f + f * (1 / 720.f + f * (1 / 5040.f)))))));
    return 1 / (1 + part * (floats)((whole + 127) << 23));
}

INLINE uint8_t *row_of(const Layer *l, index_t y) {
    return l->rows + (y & (l->ring - 1)) * (l->width + SLACK) * l->channels;
}

INLINE float *seen_row(const Seen *s, index_t y) {
    return s->rows + (y & (SEEN - 1)) * (s->width + SLACK);
}

INLINE void joined(const uint8_t *restrict mask, index_t width, uint8_t *restrict into) {
    for (index_t x = 0; x < width; x++)
        into[x] |= mask[x];
}

/* Compute rows of the normalised image up to `y`, where rows of the first layer need them. */
INLINE void see(Network *n, index_t y) {
    const Layer *first = &n->layer[0];
    uint8_t *need = n->need;
    for (; n->seen.done <= y; n->seen.done++) {
        const index_t row = n->seen.done;
        const index_t from = row > 4 ? (row - 3) / 2 : 0, to = row / 2 < first->height ? row / 2 : first->height - 1;
        memset(need, 0, (size_t)first->width);
        for (index_t k = from; k <= to; k++)
            joined(first->mask + k * first->width, first->width, need);
        if (!memchr(need, 1, (size_t)first->width))
            continue;
        for (index_t x = 0, end; (x = next_run(need, x, first->width, &end)) < first->width; x = end) {
            index_t later; /* bridging gaps shorter than a window is cheaper than a new start */
            for (index_t next; (next = next_run(need, end, first->width, &later)) < first->width && next - end < HALF;)
                end = later;
            const index_t stop = 2 * end + 3 + 2 * SLACK;
            normalise(&n->contrast, row, 2 * x, stop < n->seen.width ? stop : n->seen.width,
                      seen_row(&n->seen, row) + 2 * x);
        }
    }
}

/* FIRST outputs of the first layer: 5×5 px, stride 2. */
#define FIRST_BLOCK(name, vec)                                                       \
    INLINE void name(const Network *n, index_t y, index_t x, uint8_t *out) {         \
        const int parts = NARROW * sizeof(float) / sizeof(vec);                      \
        float sums[FIRST][NARROW];                                                   \
        for (int part = 0; part < parts; part++) {                                   \
            const index_t at = part * (index_t)(sizeof(vec) / sizeof(float));        \
            vec sum[FIRST], weight;                                                  \
            for (int k = 0; k < FIRST; k++)                                          \
                memcpy(sum + k, n->reals->first_bias + at, sizeof(vec));             \
            for (int j = 0; j < 5; j++) {                                            \
                const float *row = seen_row(&n->seen, 2 * y + j) + 2 * x;            \
                for (int i = 0; i < 5; i++) {                                        \
                    memcpy(&weight, n->reals->first[5 * j + i] + at, sizeof weight); \
                    for (int k = 0; k < FIRST; k++)                                  \
                        sum[k] += weight * row[2 * k + i];                           \
                }                                                                    \
            }                                                                        \
            for (int k = 0; k < FIRST; k++)                                          \
                memcpy(sums[k] + at, sum + k, sizeof(vec));                          \
        }                                                                            \
        for (int k = 0; k < FIRST; k++)                                              \
            store_levels(out + k * NARROW, sums[k]);                                 \
    }
FIRST_BLOCK(first_block, floats)
FIRST_BLOCK(wide_first_block, sixteen)

INLINE void first_row(Network *n, index_t y) {
    Layer *l = &n->layer[0];
    const uint8_t *mask = l->mask + y * l->width;
    uint8_t *out = row_of(l, y);
    if (!memchr(mask, 1, (size_t)l->width))
        return;
    see(n, 2 * y + 4);
    for (index_t x = 0, end; (x = next_run(mask, x, l->width, &end)) < l->width; x = end)
        for (; x < end; x += FIRST)
            if (n->wide)
                wide_first_block(n, y, x, out + x * NARROW);
            else
                first_block(n, y, x, out + x * NARROW);
}

/* Row `y` of layer `k` + 1 from the previous layer; `stride` is 2 for the first of them. */
static void wide_row(Network *n, int k, int stride, index_t y) {
    const Layer *from = &n->layer[k];
    Layer *to = &n->layer[k + 1];
    const Convolution c = {k ? n->bytes->conv[k - 1] : n->bytes->strided,
                           n->pairs,
                           n->pairs + STRIDED + (k ? k - 1 : 0) * TRANSFORMED,
                           n->centres + k * WIDE,
                           n->reals->conv[k].scale,
                           n->reals->conv[k].bias};
    const uint8_t *const rows[3] = {row_of(from, stride * y), row_of(from, stride * y + 1),
                                    row_of(from, stride * y + 2)};
    (k ? n->kernels.conv : n->kernels.strided)(rows, &c, to->mask + y * to->width, to->width, row_of(to, y));
}

/* The outputs of a cell from its channels. Sums of integers under 2^24 are exact in any order. */
INLINE void last_cell(const Reals *r, const uint8_t channels[WIDE], float out[NARROW]) {
    floats sum[2][PARTS] = {{{0}}};
    for (int k = 0; k < WIDE; k += 2)
        for (int odd = 0; odd < 2; odd++)
            for (int part = 0; part < PARTS; part++) {
                floats weight;
                memcpy(&weight, r->last[k + odd] + FLOATS * part, sizeof weight);
                sum[odd][part] += weight * (float)channels[k + odd];
            }
    for (int part = 0; part < PARTS; part++) {
        floats scale, bias;
        memcpy(&scale, r->last_scale + FLOATS * part, sizeof scale);
        memcpy(&bias, r->last_bias + FLOATS * part, sizeof bias);
        const floats value = sigmoid((sum[0][part] + sum[1][part]) * scale + bias);
        memcpy(out + FLOATS * part, &value, sizeof value);
    }
}

/* Write the outputs of one row of cells into the response (height, width) of the image. */
INLINE void last_row(const Network *n, const uint8_t *mask, index_t width, index_t y, float *response) {
    const uint8_t *row = row_of(&n->layer[CONVS + 1], y);
    for (index_t x = 0; x < width; x++) {
        if (!mask[x])
            continue;
        float out[NARROW];
        last_cell(n->reals, row + x * WIDE, out);
        for (index_t j = 0; j < CELL && n->contrast.top + CELL * y + j < n->contrast.picture.height; j++)
            for (index_t i = 0; i < CELL && CELL * x + i < n->contrast.picture.width; i++)
                response[(n->contrast.top + CELL * y + j) * n->contrast.picture.width + CELL * x + i] =
                    out[CELL * j + i];
    }
}

/* Compute the rows of all layers that row `y` of the last one needs: at each step one row of every layer, two behind
 * the previous layer, so that no ring buffer overflows. */
INLINE void advance(Network *n, index_t y) {
    for (; n->time <= y + 2 * CONVS; n->time++) {
        for (; n->layer[0].done <= 2 * n->time + 2; n->layer[0].done++)
            first_row(n, n->layer[0].done);
        wide_row(n, 0, 2, n->time);
        for (int k = 1; k <= CONVS && n->time >= 2 * k; k++)
            wide_row(n, k, 1, n->time - 2 * k);
    }
}

/* Masks: a cell of a layer is needed if it is in the 3×3 window of a needed cell of the next layer. */
INLINE void needed_by(const uint8_t *next, index_t height, index_t width, uint8_t *mask) {
    const index_t wide = width + 2;
    memset(mask, 0, (size_t)((height + 2) * wide));
    for (index_t y = 0; y < height; y++) {
        const uint8_t *from = next + y * width;
        if (!memchr(from, 1, (size_t)width))
            continue;
        for (int k = 0; k < 3; k++)
            joined(from, width, mask + y * wide + k);
    }
    for (index_t y = height + 1; y >= 0; y--) /* from below, so that the rows read here are not yet dilated */
        for (int k = 1; k < 3; k++)
            if (y - k >= 0)
                joined(mask + (y - k) * wide, wide, mask + y * wide);
}

INLINE void needed_by_strided(const uint8_t *next, index_t height, index_t width, uint8_t *mask) {
    const index_t wide = 2 * width + 1;
    memset(mask, 0, (size_t)((2 * height + 1) * wide));
    for (index_t y = 0; y < height; y++) {
        uint8_t *row = mask + (2 * y + 1) * wide;
        for (index_t x = 0, end; (x = next_run(next + y * width, x, width, &end)) < width; x = end)
            memset(row + 2 * x, 1, (size_t)(2 * (end - x) + 1));
        joined(row, wide, row - wide);
        memcpy(row + wide, row, (size_t)wide);
    }
}

/* Weights (group of inputs, output, input) in the order (pair of inputs, output, input), `count` in all. */
INLINE void paired(const int8_t *weight, index_t count, int16_t *out) {
    for (index_t k = 0; k < count; k += GROUP * WIDE)
        for (int pair = 0; pair < GROUP; pair += 2)
            for (int o = 0; o < WIDE; o++, out += 2)
                for (int i = 0; i < 2; i++)
                    out[i] = weight[k + GROUP * o + pair + i];
}

/* 128 × the sum of each output's weights (group of inputs, output, input), of which there are `count`. */
INLINE void centred(const int8_t *weight, index_t count, int32_t out[WIDE]) {
    memset(out, 0, WIDE * sizeof *out);
    for (index_t k = 0; k < count; k++)
        out[k / GROUP % WIDE] += 128 * weight[k];
}

/* Number of bytes for all ring buffers, sums and masks of so many rows of cells. */
static size_t room_for(index_t across, index_t rows) {
    const index_t last = across + 2 * CONVS, first = 2 * last + 1, seen = 2 * first + 3;
    const index_t bytes = RING * (CONVS + 1) * (last + SLACK) * WIDE + RING * (first + SLACK) * NARROW,
                  floats = SEEN * (seen + SLACK) + 8 * SLACK;
    const index_t doubles = 6 * (seen + 2 * HALF),
                  masks = (CONVS + 1) * last * (rows + 2 * CONVS) + first * (2 * (rows + 2 * CONVS) + 1) + first;
    return (size_t)(8 * doubles + 4 * floats + bytes + masks) + sizeof(int16_t) * (STRIDED + CONVS * TRANSFORMED) +
           sizeof(int32_t) * (CONVS + 1) * WIDE + 64 * 32;
}

INLINE void *taken(char **room, index_t bytes) {
    void *out = *room;
    *room += (bytes + 63) / 64 * 64;
    return out;
}

/* The response in the marked cells of the rows `first` .. `first + rows` of `cells` (down, across). `response` (height,
 * width) is unchanged elsewhere. */
FAST_KERNEL(rcdn_network, (PICTURE, p), (LET, down, (p.height + CELL - 1) / CELL),
            (LET, across, (p.width + CELL - 1) / CELL), (IN, float, reals, REALS), (IN, int8_t, bytes, sizeof(Bytes)),
            (INT, instructions, 0, BEST), (IN, uint8_t, cells, down, across), (INT, first, 0, down - 1),
            (INT, rows, 1, down - first), (OUT, float, response, p.height, p.width)) {
    char *memory = malloc(room_for(across, rows)), *room = memory;
    if (!memory)
        return NO_MEMORY;
    room += 64 - (uintptr_t)room % 64;
    Network n = {
        .contrast = {.picture = p, .top = CELL * first}, .reals = (const Reals *)reals, .bytes = (const Bytes *)bytes};
#ifdef X86_LEVELS
    n.wide = level_taken() >= AVX512_LEVEL;
#endif
    n.kernels = row_kernels((int)instructions);
    int16_t *pairs = taken(&room, sizeof(int16_t) * (STRIDED + CONVS * TRANSFORMED));
    int32_t *centres = taken(&room, sizeof(int32_t) * (CONVS + 1) * WIDE);
    n.pairs = pairs;
    n.centres = centres;
    if (n.kernels.form == PAIRED) {
        paired(n.bytes->strided, STRIDED, pairs);
        for (int k = 0; k < CONVS; k++) {
            int16_t conv[9 * WIDE * WIDE];
            paired(n.bytes->conv[k], sizeof n.bytes->conv[k], conv);
            transformed(conv, pairs + STRIDED + k * TRANSFORMED);
        }
    }
    for (int k = 0; k <= CONVS && n.kernels.form == CENTRED; k++)
        centred(k ? n.bytes->conv[k - 1] : n.bytes->strided, 9 * WIDE * (k ? WIDE : NARROW), centres + k * WIDE);
    index_t h = rows, w = across;
    cells += first * across;
    const uint8_t *mask = cells;
    for (int k = CONVS + 1; k >= 0; k--) {
        Layer *l = &n.layer[k];
        *l = (Layer){h, w, k ? WIDE : NARROW, RING, 0, NULL, mask};
        l->rows = taken(&room, l->ring * (w + SLACK) * l->channels);
        memset(l->rows, 0, (size_t)(l->ring * (w + SLACK) * l->channels));
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
    n.seen = (Seen){2 * h + 3, 2 * w + 3, 0, NULL};
    const index_t wide = (n.seen.width + 2 * HALF) * (index_t)(p.real ? sizeof(double) : sizeof(float)),
                  ring = SEEN * (n.seen.width + SLACK) + 4 * SLACK;
    n.seen.rows = taken(&room, ring * 4);
    memset(n.seen.rows, 0, (size_t)ring * 4);
    void **const row[] = {&n.contrast.sum, &n.contrast.square, &n.contrast.out, &n.contrast.in, &n.contrast.room};
    for (int k = 0; k < 5; k++)
        *row[k] = taken(&room, wide);
    n.need = taken(&room, w);
    n.contrast.width = n.seen.width;
    const index_t blocks = (n.seen.width + 2 * HALF + COLUMNS - 1) / COLUMNS;
    n.contrast.summed = taken(&room, blocks * (index_t)sizeof(index_t));
    for (index_t k = 0; k < blocks; k++)
        n.contrast.summed[k] = -1;
    for (index_t y = 0; y < rows; y++) {
        if (!memchr(cells + y * across, 1, (size_t)across))
            continue;
        advance(&n, y);
        last_row(&n, cells + y * across, across, y, response);
    }
    free(memory);
    return 0;
}
