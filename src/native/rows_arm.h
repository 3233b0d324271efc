/* Rows of the cell network on 64-bit ARM: with NEON, which every such processor has, and with its dot products of four
 * bytes. Both multiply signed bytes only: 128 is subtracted from the inputs, and `centre` adds to each sum what that
 * takes away. */
#ifndef RCDN_ROWS_ARM_H
#define RCDN_ROWS_ARM_H

#include <arm_neon.h>

#include "rows.h"

enum { NEON_CELLS = 2, DOTPROD_CELLS = 4 };

/* Four sums converted to inputs of the next layer, as `rescaled`. */
INLINE uint16x4_t neon_rescaled(int32x4_t sum, const int32_t *centre, const float *scale, const float *bias) {
    const float32x4_t whole = vcvtq_f32_s32(vaddq_s32(sum, vld1q_s32(centre)));
    return vqmovun_s32(vcvtnq_s32_f32(vaddq_f32(vmulq_f32(whole, vld1q_f32(scale)), vld1q_f32(bias))));
}

/* The sums of 16 outputs from `o` on of a cell, converted and stored. */
INLINE void neon_store(const int32x4_t sum[4], const Convolution *c, int o, uint8_t *out) {
    uint16x4_t levels[4];
    for (int q = 0; q < 4; q++)
        levels[q] = neon_rescaled(sum[q], c->centre + o + 4 * q, c->scale + o + 4 * q, c->bias + o + 4 * q);
    vst1q_u8(out + o, vcombine_u8(vqmovn_u16(vcombine_u16(levels[0], levels[1])),
                                  vqmovn_u16(vcombine_u16(levels[2], levels[3]))));
}

/* Four inputs, 128 subtracted, four times over. */
INLINE int8x16_t neon_inputs(const uint8_t *from) {
    uint32_t value;
    memcpy(&value, from, sizeof value);
    return vreinterpretq_s8_u32(vdupq_n_u32(value ^ 0x80808080u));
}

/* Two groups of inputs at a time: two products of -128..127 and -127..127 are less than 2^15. */
INLINE void neon_block(const uint8_t *const from[3], const Convolution *c, const int channels, const int stride,
                       index_t x, const int count, uint8_t *out) {
    for (int o = 0; o < WIDE; o += 16) {
        int32x4_t sum[NEON_CELLS][8]; /* of pairs of inputs */
        for (int k = 0; k < count; k++)
            for (int q = 0; q < 8; q++)
                sum[k][q] = vdupq_n_s32(0);
        const int8_t *weight = c->weight + GROUP * o;
        for (int j = 0; j < 3; j++)
            for (int i = 0; i < 3; i++)
                for (int g = 0; g < channels; g += 2 * GROUP, weight += 2 * GROUP * WIDE) {
                    int8x16_t first[NEON_CELLS], second[NEON_CELLS];
                    for (int k = 0; k < count; k++) {
                        const uint8_t *at = from[j] + (stride * (x + k) + i) * channels + g;
                        first[k] = neon_inputs(at);
                        second[k] = neon_inputs(at + GROUP);
                    }
                    for (int q = 0; q < 4; q++) {
                        const int8x16_t a = vld1q_s8(weight + 16 * q), b = vld1q_s8(weight + GROUP * WIDE + 16 * q);
                        for (int k = 0; k < count; k++) {
                            const int16x8_t low = vmlal_s8(vmull_s8(vget_low_s8(a), vget_low_s8(first[k])),
                                                           vget_low_s8(b), vget_low_s8(second[k])),
                                            high = vmlal_high_s8(vmull_high_s8(a, first[k]), b, second[k]);
                            sum[k][2 * q] = vpadalq_s16(sum[k][2 * q], low);
                            sum[k][2 * q + 1] = vpadalq_s16(sum[k][2 * q + 1], high);
                        }
                    }
                }
        for (int k = 0; k < count; k++) {
            int32x4_t whole[4];
            for (int q = 0; q < 4; q++)
                whole[q] = vpaddq_s32(sum[k][2 * q], sum[k][2 * q + 1]);
            neon_store(whole, c, o, out + k * WIDE);
        }
    }
}

ROW_KERNEL(neon_strided, , neon_block, NEON_CELLS, 16, 2)
ROW_KERNEL(neon_conv, , neon_block, NEON_CELLS, 32, 1)

/* sum += products of the bytes of four outputs with those of group `lane` of the inputs: as vdotq_laneq_s32, which
 * compilers have only for files, or functions, of newer processors. The assembler is told of the instruction where the
 * compiler's options don't. */
#ifdef __ARM_FEATURE_DOTPROD
#define ADMIT_DOTPROD ""
#else
#define ADMIT_DOTPROD ".arch armv8.2-a+dotprod\n\t"
#endif
#define ADD_DOT(sum, weights, inputs, lane) \
    __asm__(ADMIT_DOTPROD "sdot %0.4s, %1.16b, %2.4b[" #lane "]" : "+w"(sum) : "w"(weights), "w"(inputs))

INLINE void dotprod_block(const uint8_t *const from[3], const Convolution *c, const int channels, const int stride,
                          index_t x, const int count, uint8_t *out) {
    for (int o = 0; o < WIDE; o += 16) {
        int32x4_t sum[DOTPROD_CELLS][4];
        for (int k = 0; k < count; k++)
            for (int q = 0; q < 4; q++)
                sum[k][q] = vdupq_n_s32(0);
        const int8_t *weight = c->weight + GROUP * o;
        for (int j = 0; j < 3; j++)
            for (int i = 0; i < 3; i++)
                for (int g = 0; g < channels; g += 4 * GROUP) {
                    int8x16_t value[DOTPROD_CELLS];
                    for (int k = 0; k < count; k++)
                        value[k] = vreinterpretq_s8_u8(
                            veorq_u8(vld1q_u8(from[j] + (stride * (x + k) + i) * channels + g), vdupq_n_u8(0x80)));
#define ONE_GROUP(lane)                                \
    for (int q = 0; q < 4; q++) {                      \
        const int8x16_t a = vld1q_s8(weight + 16 * q); \
        for (int k = 0; k < count; k++)                \
            ADD_DOT(sum[k][q], a, value[k], lane);     \
    }                                                  \
    weight += GROUP * WIDE;
                    ONE_GROUP(0)
                    ONE_GROUP(1)
                    ONE_GROUP(2)
                    ONE_GROUP(3)
#undef ONE_GROUP
                }
        for (int k = 0; k < count; k++)
            neon_store(sum[k], c, o, out + k * WIDE);
    }
}

ROW_KERNEL(dotprod_strided, , dotprod_block, DOTPROD_CELLS, 16, 2)
ROW_KERNEL(dotprod_conv, , dotprod_block, DOTPROD_CELLS, 32, 1)

#endif
