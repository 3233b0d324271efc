/* Rows of the cell network's 3×3 convolutions in integer arithmetic: unsigned 8-bit inputs, signed 8-bit weights,
 * 32-bit sums. Sums are exact, and therefore the same on every processor. */
#ifndef ROWS_H
#define ROWS_H

#include "rcdn.h"

#define WIDE 32 /* channels of a cell */
#define GROUP 4 /* channels that are multiplied together */
#define BEST 2  /* highest level of the processor's instructions that is used, if available: 2 VNNI, 1 AVX2, 0 any */
#define SLACK 8 /* cells that may be computed beyond the end of a row */
#define PAIRS 1 /* the level that multiplies pairs of inputs */
#define AVX2_CELLS 4 /* cells at a time: their sums stay in registers */

/* Weights of a convolution: (tap, group of inputs, output, input), and as `pairs` (tap, pair of inputs, output, input);
 * scale and bias that turn sums into the next inputs. */
typedef struct {
    const int8_t *weight;
    const int16_t *pairs;
    const float *scale, *bias;
} Convolution;

/* Compute the marked cells of a row from three rows of the previous layer. */
typedef void RowKernel(const uint8_t *const from[3], const Convolution *c, const uint8_t *mask, index_t width,
                       uint8_t *out);

/* A row kernel made of the block function of one processor: `count` cells at a time, channels of the previous layer,
 * stride. */
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

#ifdef X86_LEVELS
#include <immintrin.h>

/* 16 sums converted to inputs of the next layer, as `rescaled`. */
FOR_AVX2 INLINE void avx2_rescaled(__m256i low, __m256i high, const float *scale, const float *bias, uint8_t *out) {
    const __m256 a = _mm256_add_ps(_mm256_mul_ps(_mm256_cvtepi32_ps(low), _mm256_loadu_ps(scale)),
                                   _mm256_loadu_ps(bias)),
                 b = _mm256_add_ps(_mm256_mul_ps(_mm256_cvtepi32_ps(high), _mm256_loadu_ps(scale + 8)),
                                   _mm256_loadu_ps(bias + 8));
    const __m256i words =
        _mm256_permute4x64_epi64(_mm256_packs_epi32(_mm256_cvtps_epi32(a), _mm256_cvtps_epi32(b)), 0xd8);
    _mm_storeu_si128((__m128i *)out,
                     _mm_packus_epi16(_mm256_castsi256_si128(words), _mm256_extracti128_si256(words, 1)));
}

/* Inputs are widened to 16 bits and multiplied in pairs, so that no product overflows. */
FOR_AVX2 INLINE void avx2_block(const uint8_t *const from[3], const Convolution *c, const int channels,
                                const int stride, index_t x, const int count, uint8_t *out) {
    int16_t value[3][2 * AVX2_CELLS + 2][WIDE];
    for (int j = 0; j < 3; j++)
        for (int i = 0; i < stride * (count - 1) + 3; i++)
            for (int g = 0; g < channels; g += 16)
                _mm256_storeu_si256((__m256i *)(value[j][i] + g),
                                    _mm256_cvtepu8_epi16(
                                        _mm_loadu_si128((const __m128i *)(from[j] + (stride * x + i) * channels + g))));
    for (int o = 0; o < WIDE; o += 16) {
        __m256i low[AVX2_CELLS], high[AVX2_CELLS];
        for (int k = 0; k < count; k++)
            low[k] = high[k] = _mm256_setzero_si256();
        const int16_t *weight = c->pairs + 2 * o;
        for (int j = 0; j < 3; j++)
            for (int i = 0; i < 3; i++)
                for (int g = 0; g < channels; g += 2, weight += 2 * WIDE) {
                    const __m256i a = _mm256_loadu_si256((const __m256i *)weight),
                                  b = _mm256_loadu_si256((const __m256i *)(weight + 16));
                    for (int k = 0; k < count; k++) {
                        int32_t pair;
                        memcpy(&pair, value[j][stride * k + i] + g, sizeof pair);
                        const __m256i same = _mm256_set1_epi32(pair);
                        low[k] = _mm256_add_epi32(low[k], _mm256_madd_epi16(same, a));
                        high[k] = _mm256_add_epi32(high[k], _mm256_madd_epi16(same, b));
                    }
                }
        for (int k = 0; k < count; k++)
            avx2_rescaled(low[k], high[k], c->scale + o, c->bias + o, out + k * WIDE + o);
    }
}

ROW_KERNEL(avx2_strided, FOR_AVX2, avx2_block, AVX2_CELLS, 16, 2)
ROW_KERNEL(avx2_conv, FOR_AVX2, avx2_block, AVX2_CELLS, 32, 1)

/* sum += products of bytes, four at a time: as _mm512_dpbusd_epi32, for which gcc adds moves of the sums between
 * registers. */
#define ADD_PRODUCTS(sum, levels, weights) __asm__("vpdpbusd %2, %1, %0" : "+v"(sum) : "v"(levels), "v"(weights))

FOR_VNNI INLINE __m128i vnni_rescaled(__m512i sum, const float *scale, const float *bias) {
    const __m512 value =
        _mm512_add_ps(_mm512_mul_ps(_mm512_cvtepi32_ps(sum), _mm512_loadu_ps(scale)), _mm512_loadu_ps(bias));
    return _mm512_cvtusepi32_epi8(_mm512_max_epi32(_mm512_cvtps_epi32(value), _mm512_setzero_si512()));
}

FOR_VNNI INLINE void vnni_block(const uint8_t *const from[3], const Convolution *c, const int channels,
                                const int stride, index_t x, const int count, uint8_t *out) {
    __m512i low[8], high[8];
    for (int k = 0; k < count; k++)
        low[k] = high[k] = _mm512_setzero_si512();
    const int8_t *weight = c->weight;
    for (int j = 0; j < 3; j++) {
        const uint8_t *row = from[j] + stride * x * channels;
        for (int i = 0; i < 3; i++)
            for (int g = 0; g < channels; g += GROUP, weight += GROUP * WIDE) {
                const __m512i a = _mm512_loadu_si512(weight), b = _mm512_loadu_si512(weight + 64);
                for (int k = 0; k < count; k++) {
                    int32_t value;
                    memcpy(&value, row + (stride * k + i) * channels + g, sizeof value);
                    const __m512i same = _mm512_set1_epi32(value);
                    ADD_PRODUCTS(low[k], same, a);
                    ADD_PRODUCTS(high[k], same, b);
                }
            }
    }
    for (int k = 0; k < count; k++) {
        _mm_storeu_si128((__m128i *)(out + k * WIDE), vnni_rescaled(low[k], c->scale, c->bias));
        _mm_storeu_si128((__m128i *)(out + k * WIDE + 16), vnni_rescaled(high[k], c->scale + 16, c->bias + 16));
    }
}

ROW_KERNEL(vnni_strided, FOR_VNNI, vnni_block, 8, 16, 2)
ROW_KERNEL(vnni_conv, FOR_VNNI, vnni_block, 8, 32, 1)
#endif

/* The kernels of this processor: for the strided convolution, and for the others. `level`: upper limit, 2: VNNI, 1:
 * AVX2, 0: plain C. */
static int row_kernels(int level, RowKernel **strided, RowKernel **conv) {
    *strided = plain_strided;
    *conv = plain_conv;
#ifdef X86_LEVELS
    if (level >= 2 && level_taken() >= VNNI_LEVEL) {
        *strided = vnni_strided;
        *conv = vnni_conv;
        return 2;
    }
    if (level >= 1 && level_taken() >= AVX2_LEVEL) {
        *strided = avx2_strided;
        *conv = avx2_conv;
        return PAIRS;
    }
#else
    (void)level;
#endif
    return 0;
}

#endif
