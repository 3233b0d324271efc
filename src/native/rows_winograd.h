/* Rows of the cell network's 3×3 convolutions with AVX2 and fewer products: Winograd's F(4, 3) along a row (A. Lavin,
 * S. Gray: Fast algorithms for convolutional neural networks, CVPR 2016), four outputs by six products instead of
 * twelve.
 *
 * Its fractions are whole numbers once weights are multiplied by 24, and sums, multiples of 24, are divided exactly. All
 * intermediate results are taken modulo 2^32, of which the outputs themselves need 28 bits: these are the sums of the
 * other levels, and don't depend on the inputs that cancel. */
#ifndef ROWS_WINOGRAD_H
#define ROWS_WINOGRAD_H

#include <immintrin.h>

#include "rows.h"

enum { MOST = 4 }; /* tiles whose sums the registers hold */

/* The points of a tile's six inputs, 16 channels each. */
FOR_AVX2 INLINE void tile_points(const uint8_t *from, int16_t *out, const index_t step) {
    __m256i d[POINTS];
    for (int i = 0; i < POINTS; i++)
        d[i] = _mm256_cvtepu8_epi16(_mm_loadu_si128((const __m128i *)(from + i * WIDE)));
    const __m256i twice1 = _mm256_slli_epi16(_mm256_sub_epi16(d[3], d[1]), 1), near = _mm256_sub_epi16(d[4], d[2]),
                  four1 = _mm256_slli_epi16(d[1], 2), four2 = _mm256_slli_epi16(d[2], 2),
                  odd = _mm256_sub_epi16(d[3], four1), even = _mm256_sub_epi16(d[4], four2);
    const __m256i points[POINTS] = {
        _mm256_add_epi16(_mm256_sub_epi16(_mm256_slli_epi16(d[0], 2), four2), near),
        _mm256_add_epi16(even, odd),
        _mm256_sub_epi16(even, odd),
        _mm256_add_epi16(near, twice1),
        _mm256_sub_epi16(near, twice1),
        _mm256_sub_epi16(_mm256_sub_epi16(four1, _mm256_slli_epi16(d[3], 2)), _mm256_sub_epi16(d[3], d[5])),
    };
    for (int p = 0; p < POINTS; p++)
        _mm256_store_si256((__m256i *)(out + p * step), points[p]);
}

/* A multiple of 24, divided by it: by 8, then times the inverse of 3 modulo 2^32. */
FOR_AVX2 INLINE __m256i divided(__m256i multiple) {
    return _mm256_mullo_epi32(_mm256_srai_epi32(multiple, 3), _mm256_set1_epi32((int32_t)0xaaaaaaab));
}

/* Eight outputs of a tile's four cells from their sums at the six points, `step` apart. */
FOR_AVX2 INLINE void tile_outputs(const int32_t *sums, const index_t step, __m256i out[TILE]) {
    __m256i m[POINTS];
    for (int p = 0; p < POINTS; p++)
        m[p] = _mm256_load_si256((const __m256i *)(sums + p * step));
    const __m256i both1 = _mm256_add_epi32(m[1], m[2]), apart1 = _mm256_sub_epi32(m[1], m[2]),
                  both2 = _mm256_add_epi32(m[3], m[4]), apart2 = _mm256_sub_epi32(m[3], m[4]);
    out[0] = divided(_mm256_add_epi32(m[0], _mm256_add_epi32(both1, both2)));
    out[1] = divided(_mm256_add_epi32(apart1, _mm256_slli_epi32(apart2, 1)));
    out[2] = divided(_mm256_add_epi32(both1, _mm256_slli_epi32(both2, 2)));
    out[3] = divided(_mm256_add_epi32(m[5], _mm256_add_epi32(apart1, _mm256_slli_epi32(apart2, 3))));
}

/* `tiles` tiles, MOST at a time: as many as the registers hold the sums of. */
FOR_AVX2 INLINE void winograd_block(const uint8_t *const from[3], const Convolution *c, index_t x, const int tiles,
                                    uint8_t *out) {
    _Alignas(32) int16_t value[3][POINTS][2 * MOST][WIDE];
    _Alignas(32) int32_t sums[POINTS][2 * MOST][HALF_WIDE];
    const int some = tiles < MOST ? tiles : MOST;
    for (int j = 0; j < 3; j++)
        for (int t = 0; t < tiles; t++)
            for (int g = 0; g < WIDE; g += 16)
                tile_points(from[j] + (x + TILE * t) * WIDE + g, value[j][0][t] + g, sizeof value[0][0] / 2);
    for (int o = 0; o < WIDE; o += HALF_WIDE) {
        for (int p = 0; p < POINTS; p++)
            for (int first = 0; first < tiles; first += some) {
                const int16_t *weight = c->points + (o / HALF_WIDE * POINTS + p) * 3 * PAIRS * WIDE;
                __m256i low[MOST], high[MOST];
                for (int t = 0; t < some; t++)
                    low[t] = high[t] = _mm256_setzero_si256();
                for (int j = 0; j < 3; j++)
                    for (int g = 0; g < WIDE; g += 2, weight += WIDE) {
                        const __m256i a = _mm256_load_si256((const __m256i *)weight),
                                      b = _mm256_load_si256((const __m256i *)(weight + HALF_WIDE));
                        for (int t = 0; t < some; t++) {
                            int32_t pair;
                            memcpy(&pair, value[j][p][first + t] + g, sizeof pair);
                            const __m256i same = _mm256_set1_epi32(pair);
                            ADD_TO(low[t], _mm256_madd_epi16(same, a));
                            ADD_TO(high[t], _mm256_madd_epi16(same, b));
                        }
                    }
                for (int t = 0; t < some; t++) {
                    _mm256_store_si256((__m256i *)sums[p][first + t], low[t]);
                    _mm256_store_si256((__m256i *)(sums[p][first + t] + 8), high[t]);
                }
            }
        for (int t = 0; t < tiles; t++) {
            __m256i low[TILE], high[TILE];
            tile_outputs(sums[0][t], sizeof sums[0] / 4, low);
            tile_outputs(sums[0][t] + 8, sizeof sums[0] / 4, high);
            for (int k = 0; k < TILE; k++)
                avx2_rescaled(low[k], high[k], c->scale + o, c->bias + o, out + (TILE * t + k) * WIDE + o);
        }
    }
}

FOR_AVX2 static void winograd_conv(const uint8_t *const from[3], const Convolution *c, const uint8_t *mask,
                                   index_t width, uint8_t *out) {
    for (index_t x = 0, end; (x = next_run(mask, x, width, &end)) < width; x = end) {
        for (; end - x > 6 * TILE; x += 8 * TILE)
            winograd_block(from, c, x, 8, out + x * WIDE);
        for (; end - x > 2 * TILE; x += 4 * TILE)
            winograd_block(from, c, x, 4, out + x * WIDE);
        for (; end - x > TILE; x += 2 * TILE)
            winograd_block(from, c, x, 2, out + x * WIDE);
        for (; x < end; x += TILE)
            winograd_block(from, c, x, 1, out + x * WIDE);
    }
}

#endif
