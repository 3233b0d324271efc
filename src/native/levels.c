/* The processor's instruction set, by CPUID: the compilers' own tables of processors are missing, or empty, with some C
 * libraries. */
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

static int processor_level(void) {
    enum { SSE_AND_AVX = 0x6, AND_AVX512 = 0xe6 };
    unsigned a, b, c, d, more, extended;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !has(c, bit_OSXSAVE | bit_AVX | bit_FMA | bit_F16C | bit_MOVBE) ||
        !has(kept(), SSE_AND_AVX))
        return BASELINE;
    if (!__get_cpuid(0x80000001, &a, &b, &extended, &d) || !has(extended, bit_LZCNT) ||
        !__get_cpuid_count(7, 0, &a, &b, &more, &d) || !has(b, bit_AVX2 | bit_BMI | bit_BMI2))
        return BASELINE;
    if (!has(b, bit_AVX512F | bit_AVX512BW | bit_AVX512CD | bit_AVX512DQ | bit_AVX512VL) || !has(kept(), AND_AVX512))
        return AVX2_LEVEL;
    return has(more, bit_AVX512VNNI) ? VNNI_LEVEL : AVX512_LEVEL;
}
#else
static int processor_level(void) {
    return BASELINE;
}
#endif

static const char *const names[] = {"baseline", "avx2", "avx512", "vnni"};
static int taken = BASELINE; /* set once, while the module is loaded */

int level_taken(void) {
    return taken;
}

const char *find_level(void) {
    const char *most = getenv("RCDN_LEVEL");
    int limit = VNNI_LEVEL;
    if (most && *most)
        while (strcmp(names[limit], most))
            if (--limit < BASELINE)
                return NULL;
    const int found = processor_level();
    taken = found < limit ? found : limit;
    return names[taken];
}
