/* `gcc -include avx_vnni.h`: a processor with AVX2 that says it has AVX-VNNI, whose one instruction that the kernels use
 * is emulated where it is refused (SIGILL). Linux, x86-64. */
#include <cpuid.h>
#include <signal.h>
#include <stdint.h>
#include <string.h>
#include <ucontext.h>

static inline int with_avx_vnni(unsigned leaf, unsigned sub, unsigned *a, unsigned *b, unsigned *c, unsigned *d) {
    const int found = __get_cpuid_count(leaf, sub, a, b, c, d);
    if (leaf == 7 && sub == 0) { /* no AVX-512, and leaves up to 1 */
        *a = 1;
        *b &= ~(unsigned)bit_AVX512F;
    }
    if (leaf == 7 && sub == 1)
        *a |= 1u << 4;
    return found || leaf == 7;
}
#define __get_cpuid_count with_avx_vnni

/* A register's halves, in what the kernel saves of the interrupted program (XSAVE's standard form). */
static inline void move_register(char *saved, int number, uint8_t value[32], int store) {
    char *const half[2] = {saved + 160 + 16 * number, saved + 576 + 16 * number};
    for (int k = 0; k < 2; k++)
        memcpy(store ? half[k] : (char *)value + 16 * k, store ? (char *)value + 16 * k : half[k], 16);
}

/* vpdpbusd of three registers: VEX.256.66.0F38.W0 50 /r. */
static void emulate(int signal_number, siginfo_t *information, void *context) {
    (void)information;
    mcontext_t *machine = &((ucontext_t *)context)->uc_mcontext;
    const uint8_t *code = (const uint8_t *)machine->gregs[REG_RIP];
    if (code[0] != 0xc4 || (code[1] & 0x1f) != 2 || (code[2] & 0x87) != 5 || code[3] != 0x50 || code[4] < 0xc0) {
        signal(signal_number, SIG_DFL); /* another instruction: refused again, for good */
        return;
    }
    char *saved = (char *)machine->fpregs;
    uint8_t sum[32], levels[32], weights[32];
    const int to = (code[4] >> 3 & 7) | (code[1] & 0x80 ? 0 : 8);
    move_register(saved, to, sum, 0);
    move_register(saved, ~(code[2] >> 3) & 15, levels, 0);
    move_register(saved, (code[4] & 7) | (code[1] & 0x20 ? 0 : 8), weights, 0);
    for (int k = 0; k < 8; k++) {
        int32_t lane;
        memcpy(&lane, sum + 4 * k, 4);
        for (int i = 4 * k; i < 4 * k + 4; i++)
            lane += (int32_t)levels[i] * (int8_t)weights[i];
        memcpy(sum + 4 * k, &lane, 4);
    }
    move_register(saved, to, sum, 1);
    saved[512] |= 6; /* XSTATE_BV: these registers count */
    machine->gregs[REG_RIP] += 5;
}

__attribute__((constructor)) static void listen_for_refusals(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_sigaction = emulate;
    action.sa_flags = SA_SIGINFO;
    sigaction(SIGILL, &action, NULL);
}
