/* Rows of the cell network's 3×3 convolutions in integer arithmetic: unsigned 8-bit inputs, signed 8-bit weights,
 * 32-bit sums. Sums are exact, and therefore the same on every processor. */
#ifndef ROWS_H
#define ROWS_H

#include "rcdn.h"

#define WIDE 32 /* channels of a cell */
#define GROUP 4 /* channels that are multiplied together */
#define SLACK 8 /* cells that may be computed beyond the end of a row */

/* Instructions that may be used, if the processor has them: none of its own; its vectors; and its dot products of four
 * bytes (VNNI; SDOT). */
enum { PLAIN, VECTORS, BEST };

/* Weights of a convolution: (tap, group of inputs, output, input), as `pairs` (tap, pair of inputs, output, input), and
 * as `points` (see `transformed`);
 * `centre`: 128 × the sum of each output's weights, to be added where inputs have 128 subtracted; scale and bias
 * that turn sums into the next inputs. */
typedef struct {
    const int8_t *weight;
    const int16_t *pairs, *points;
    const int32_t *centre;
    const float *scale, *bias;
} Convolution;

/* Compute the marked cells of a row from three rows of the previous layer. */
typedef void RowKernel(const uint8_t *const from[3], const Convolution *c, const uint8_t *mask, index_t width,
                       uint8_t *out);

/* A row kernel made of the block function of one processor: `most` cells at a time or half of them, as many as the
 * registers hold the sums of; channels of the previous layer, stride. */
#define ROW_KERNEL(name, target, block, most, channels, stride)                                                     \
    target static void name(const uint8_t *const from[3], const Convolution *c, const uint8_t *mask, index_t width, \
                            uint8_t *out) {                                                                         \
        for (index_t x = 0, end; (x = next_run(mask, x, width, &end)) < width; x = end) {                           \
            for (; end - x > most / 2; x += most)                                                                   \
                block(from, c, channels, stride, x, most, out + x * WIDE);                                          \
            for (; x < end; x += most / 2)                                                                          \
                block(from, c, channels, stride, x, most / 2, out + x * WIDE);                                      \
        }                                                                                                           \
    }

/* A sum converted to an input of the next layer, rounded, 0..255. */
INLINE uint8_t rescaled(int32_t sum, float scale, float bias) {
    const float value = rintf((float)sum * scale + bias);
    return value > 0 ? value < 255 ? (uint8_t)value : 255 : 0;
}

INLINE void plain_block(const uint8_t *const from[3], const Convolution *c, const int channels, const int stride,
                        index_t x, const int count, uint8_t *out) {
    for (int k = 0; k < count; k++) {
        int32_t sum[WIDE] = {0};
        const int8_t *weight = c->weight;
        for (int j = 0; j < 3; j++)
            for (int i = 0; i < 3; i++)
                for (int g = 0; g < channels; g += GROUP, weight += GROUP * WIDE) {
                    const uint8_t *value = from[j] + (stride * (x + k) + i) * channels + g;
                    for (int o = 0; o < WIDE; o++)
                        sum[o] += value[0] * weight[4 * o] + value[1] * weight[4 * o + 1] +
                                  value[2] * weight[4 * o + 2] + value[3] * weight[4 * o + 3];
                }
        for (int o = 0; o < WIDE; o++)
            out[k * WIDE + o] = rescaled(sum[o], c->scale[o], c->bias[o]);
    }
}

ROW_KERNEL(plain_strided, , plain_block, 2, 16, 2)
ROW_KERNEL(plain_conv, , plain_block, 2, 32, 1)

/* Of Winograd's convolutions (rows_winograd.h): outputs of a tile, and the points at which they are multiplied. */
enum { TILE = 4, POINTS = TILE + 2, PAIRS = WIDE / 2, HALF_WIDE = WIDE / 2 };
enum { TRANSFORMED = POINTS * 3 * WIDE * WIDE }; /* weights of a convolution */

/* Weights (tap, pair of inputs, output, input) in the order (half of the outputs, point, row, pair of inputs, output,
 * input), times 24. */
INLINE void transformed(const int16_t *pairs, int16_t *restrict out) {
    const int row = PAIRS * WIDE, tap = 2 * row; /* of `out`, of `pairs` */
    for (int half = 0; half < 2; half++, out += POINTS * 3 * row)
        for (int j = 0; j < 3; j++)
            for (int pair = 0; pair < PAIRS; pair++) {
                const int16_t *w = pairs + 3 * j * tap + 2 * pair * WIDE + half * WIDE;
                int16_t *to = out + j * row + pair * WIDE;
                for (int k = 0; k < WIDE; k++) {
                    const int first = w[k], middle = w[tap + k], last = w[2 * tap + k];
                    const int even = first + last, far = first + 4 * last;
                    to[k] = (int16_t)(6 * first);
                    to[3 * row + k] = (int16_t)(-4 * (even + middle));
                    to[6 * row + k] = (int16_t)(-4 * (even - middle));
                    to[9 * row + k] = (int16_t)(far + 2 * middle);
                    to[12 * row + k] = (int16_t)(far - 2 * middle);
                    to[15 * row + k] = (int16_t)(24 * last);
                }
            }
}

#ifdef X86_LEVELS
#include "rows_x86.h"
#elif defined(ARM_LEVELS)
#include "rows_arm.h"
#endif

/* The rows of both kinds of convolution, and which form of the weights they read beside `weight`. */
typedef struct {
    RowKernel *strided, *conv;
    enum { NONE, PAIRED, CENTRED } form;
} RowKernels;

/* The kernels of this processor, with no more than the `instructions` named. */
static RowKernels row_kernels(int instructions) {
#ifdef X86_LEVELS
    if (instructions >= BEST && level_taken() >= VNNI_LEVEL)
        return (RowKernels){vnni_strided, vnni_conv, NONE};
#ifdef FOR_AVX_VNNI
    if (instructions >= BEST && level_taken() == AVX_VNNI_LEVEL)
        return (RowKernels){avx_vnni_strided, avx_vnni_conv, NONE};
#endif
    if (instructions >= VECTORS && level_taken() >= AVX2_LEVEL)
        return (RowKernels){avx2_strided, winograd_conv, PAIRED};
#elif defined(ARM_LEVELS)
    if (instructions >= BEST && level_taken() >= DOTPROD_LEVEL)
        return (RowKernels){dotprod_strided, dotprod_conv, CENTRED};
    if (instructions >= VECTORS)
        return (RowKernels){neon_strided, neon_conv, CENTRED};
#endif
    (void)instructions;
    return (RowKernels){plain_strided, plain_conv, NONE};
}

#endif
