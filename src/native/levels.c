/* The processor's instruction set, by CPUID or as the operating system says: the compilers' own tables of processors are
 * missing, or empty, with some C libraries. */
#include "levels.h"

#include <stdlib.h>
#include <string.h>

#ifdef X86_LEVELS
#include <cpuid.h>

/* Whether all these bits are set. */
static int has(unsigned flags, unsigned bits) {
    return (flags & bits) == bits;
}

/* The registers that the operating system saves at a context switch: XCR0. */
static unsigned kept(void) {
    unsigned low, high;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return low;
}

const char *const level_names[] = {"baseline", "avx2", "avxvnni", "avx512", "vnni", NULL};

/* AVX2 with dot products of bytes, which processors with and without AVX-512 may have. */
static int has_avx_vnni(void) {
#ifdef FOR_AVX_VNNI
    enum { AVX_VNNI = 1 << 4 };
    unsigned a, b, c, d;
    return __get_cpuid_count(7, 0, &a, &b, &c, &d) && a >= 1 && __get_cpuid_count(7, 1, &a, &b, &c, &d) &&
           has(a, AVX_VNNI);
#else
    return 0;
#endif
}

/* The level of this processor, no higher than `limit`. */
static int processor_level(int limit) {
    enum { SSE_AND_AVX = 0x6, AND_AVX512 = 0xe6 };
    unsigned a, b, c, d, more, extended;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !has(c, bit_OSXSAVE | bit_AVX | bit_FMA | bit_F16C | bit_MOVBE) ||
        !has(kept(), SSE_AND_AVX))
        return BASELINE;
    if (!__get_cpuid(0x80000001, &a, &b, &extended, &d) || !has(extended, bit_LZCNT) ||
        !__get_cpuid_count(7, 0, &a, &b, &more, &d) || !has(b, bit_AVX2 | bit_BMI | bit_BMI2) || limit < AVX2_LEVEL)
        return BASELINE;
    if (limit >= AVX512_LEVEL && has(b, bit_AVX512F | bit_AVX512BW | bit_AVX512CD | bit_AVX512DQ | bit_AVX512VL) &&
        has(kept(), AND_AVX512))
        return limit >= VNNI_LEVEL && has(more, bit_AVX512VNNI) ? VNNI_LEVEL : AVX512_LEVEL;
    return limit >= AVX_VNNI_LEVEL && has_avx_vnni() ? AVX_VNNI_LEVEL : AVX2_LEVEL;
}
#elif defined(ARM_LEVELS)
#ifdef __linux__
#include <sys/auxv.h>
#endif

const char *const level_names[] = {"baseline", "dotprod", NULL};

static int processor_level(int limit) {
#ifdef __ARM_FEATURE_DOTPROD /* the compiler takes it for granted, as Apple's does */
    const int found = DOTPROD_LEVEL;
#elif defined(__linux__)
    enum { ASIMDDP = 1 << 20 };
    const int found = getauxval(AT_HWCAP) & ASIMDDP ? DOTPROD_LEVEL : BASELINE;
#else
    const int found = BASELINE;
#endif
    return found < limit ? found : limit;
}
#else
const char *const level_names[] = {"baseline", NULL};

static int processor_level(int limit) {
    return limit;
}
#endif

static int taken = BASELINE; /* set once, while the module is loaded */

int level_taken(void) {
    return taken;
}

const char *find_level(void) {
    const char *most = getenv("RCDN_LEVEL");
    int limit = sizeof level_names / sizeof *level_names - 2;
    if (most && *most)
        while (strcmp(level_names[limit], most))
            if (--limit < BASELINE)
                return NULL;
    taken = processor_level(limit);
    return level_names[taken];
}
