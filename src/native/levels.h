/* Levels of a processor's instruction set. A kernel is compiled for each of them, and the best available one is used:
 * all give the same bits. */
#ifndef RCDN_LEVELS_H
#define RCDN_LEVELS_H

enum { BASELINE };

/* The level for kernels: that of this processor, limited to what RCDN_LEVEL names. BASELINE before `find_level`. */
int level_taken(void);

/* Determine the level. Returns its name, or NULL if the environment variable RCDN_LEVEL is none of them. Must be called
 * once, before any kernel. */
const char *find_level(void);

/* The names of all levels of this kind of processor, then NULL. */
extern const char *const level_names[];

/* x86-64, compiled by gcc or clang; on Windows only by clang, since gcc does not align the stack there as AVX requires.
 * ONE_LEVEL: for tests. */
#if defined(__x86_64__) && !defined(ONE_LEVEL) && (defined(__clang__) || !defined(_WIN32))
#define X86_LEVELS 1
enum { AVX2_LEVEL = BASELINE + 1, AVX_VNNI_LEVEL, AVX512_LEVEL, VNNI_LEVEL };
#define V3 "avx2,bmi,bmi2,f16c,fma,lzcnt,movbe"
#define V4 V3 ",avx512f,avx512bw,avx512cd,avx512dq,avx512vl"
#define FOR_AVX2 __attribute__((target(V3)))
#define FOR_AVX512 __attribute__((target(V4)))
#define FOR_VNNI __attribute__((target(V4 ",avx512vnni")))
#if __clang_major__ >= 13 || (!defined(__clang__) && __GNUC__ >= 11)
#define FOR_AVX_VNNI __attribute__((target(V3 ",avxvnni")))
#endif
#endif

/* 64-bit ARM, whose baseline has vectors. */
#if defined(__aarch64__) && defined(__ARM_NEON) && !defined(__AARCH64EB__) && !defined(ONE_LEVEL)
#define ARM_LEVELS 1
enum { DOTPROD_LEVEL = BASELINE + 1 };
#endif

/* Floats of a vector at most levels: gcc takes one apart, number by number, that is longer than the processor's. */
#ifdef ARM_LEVELS
enum { FLOATS = 4 };
#else
enum { FLOATS = 8 };
#endif

#endif
