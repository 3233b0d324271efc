/* Rows of the cell network on x86-64: with AVX2, and with the dot products of four bytes of VNNI, in vectors of 32 and
 * of 64 bytes. */
#ifndef RCDN_ROWS_X86_H
#define RCDN_ROWS_X86_H

#include <immintrin.h>

#include "rows.h"

enum { AVX2_CELLS = 4, AVX_VNNI_CELLS = 6, VNNI_CELLS = 8 };

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

/* sum += more, without moves between registers, which gcc adds. */
#define ADD_TO(sum, more) __asm__("vpaddd %1, %0, %0" : "+x"(sum) : "x"(more))

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
                        ADD_TO(low[k], _mm256_madd_epi16(same, a));
                        ADD_TO(high[k], _mm256_madd_epi16(same, b));
                    }
                }
        for (int k = 0; k < count; k++)
            avx2_rescaled(low[k], high[k], c->scale + o, c->bias + o, out + k * WIDE + o);
    }
}

ROW_KERNEL(avx2_strided, FOR_AVX2, avx2_block, AVX2_CELLS, 16, 2)
#include "rows_winograd.h"

/* sum += products of bytes, four at a time: as the intrinsics, for which gcc adds moves of the sums between registers.
 * AVX-512 and AVX-VNNI encode the same instruction in two ways. */
#define ADD_PRODUCTS(sum, levels, weights) __asm__("vpdpbusd %2, %1, %0" : "+v"(sum) : "v"(levels), "v"(weights))
#define ADD_PRODUCTS_VEX(sum, levels, weights) \
    __asm__("%{vex%} vpdpbusd %2, %1, %0" : "+x"(sum) : "x"(levels), "x"(weights))

/* Four bytes of memory, eight times over: as the intrinsic, for which gcc takes the way through other registers. */
#define REPEAT(four, bytes) __asm__("vpbroadcastd %1, %0" : "=x"(four) : "m"(*(const uint8_t(*)[4])(bytes)))

#ifdef FOR_AVX_VNNI
FOR_AVX_VNNI INLINE void avx_vnni_block(const uint8_t *const from[3], const Convolution *c, const int channels,
                                        const int stride, index_t x, const int count, uint8_t *out) {
    for (int o = 0; o < WIDE; o += 16) {
        __m256i low[AVX_VNNI_CELLS], high[AVX_VNNI_CELLS];
        for (int k = 0; k < count; k++)
            low[k] = high[k] = _mm256_setzero_si256();
        const int8_t *weight = c->weight + GROUP * o;
        for (int j = 0; j < 3; j++) {
            const uint8_t *row = from[j] + stride * x * channels;
            for (int i = 0; i < 3; i++)
                for (int g = 0; g < channels; g += GROUP, weight += GROUP * WIDE) {
                    const __m256i a = _mm256_loadu_si256((const __m256i *)weight),
                                  b = _mm256_loadu_si256((const __m256i *)(weight + 32));
                    for (int k = 0; k < count; k++) {
                        __m256i same;
                        REPEAT(same, row + (stride * k + i) * channels + g);
                        ADD_PRODUCTS_VEX(low[k], same, a);
                        ADD_PRODUCTS_VEX(high[k], same, b);
                    }
                }
        }
        for (int k = 0; k < count; k++)
            avx2_rescaled(low[k], high[k], c->scale + o, c->bias + o, out + k * WIDE + o);
    }
}

ROW_KERNEL(avx_vnni_strided, FOR_AVX_VNNI, avx_vnni_block, AVX_VNNI_CELLS, 16, 2)
ROW_KERNEL(avx_vnni_conv, FOR_AVX_VNNI, avx_vnni_block, AVX_VNNI_CELLS, 32, 1)
#endif

FOR_VNNI INLINE __m128i vnni_rescaled(__m512i sum, const float *scale, const float *bias) {
    const __m512 value =
        _mm512_add_ps(_mm512_mul_ps(_mm512_cvtepi32_ps(sum), _mm512_loadu_ps(scale)), _mm512_loadu_ps(bias));
    return _mm512_cvtusepi32_epi8(_mm512_max_epi32(_mm512_cvtps_epi32(value), _mm512_setzero_si512()));
}

FOR_VNNI INLINE void vnni_block(const uint8_t *const from[3], const Convolution *c, const int channels,
                                const int stride, index_t x, const int count, uint8_t *out) {
    __m512i low[VNNI_CELLS], high[VNNI_CELLS];
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

ROW_KERNEL(vnni_strided, FOR_VNNI, vnni_block, VNNI_CELLS, 16, 2)
ROW_KERNEL(vnni_conv, FOR_VNNI, vnni_block, VNNI_CELLS, 32, 1)

#endif
