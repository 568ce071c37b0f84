/* denormals.h - numbers below 2.2e-308 are zero while a thread is in the core.
 *
 * A motion that decays arrives at denormal numbers and remains there, since their rounding is as
 * large as they are; a processor takes up to a hundred times as long for an operation on one. So
 * operands and results that are denormal become zero (DAZ and FTZ of x86, FZ of ARM), in every
 * thread alike: results do not depend on which thread has computed them. Other processors are left
 * as they are. */
#ifndef PMA_DENORMALS_H
#define PMA_DENORMALS_H

/* The mode of a thread: the two flags alone, not those of exceptions. */
typedef struct {
    unsigned flags;
} pma_denormals;

#if defined(__x86_64__) && defined(__SSE2__)

enum { PMA_DENORMALS_FLUSHED = 0x8040 };

static inline unsigned pma_denormals_register(void)
{
    return __builtin_ia32_stmxcsr();
}

static inline void pma_denormals_write(unsigned value)
{
    __builtin_ia32_ldmxcsr(value);
}

#elif defined(__aarch64__)

enum { PMA_DENORMALS_FLUSHED = 1 << 24 };

static inline unsigned pma_denormals_register(void)
{
    unsigned long value;
    __asm__ volatile("mrs %0, fpcr" : "=r"(value));
    return (unsigned)value;
}

static inline void pma_denormals_write(unsigned value)
{
    __asm__ volatile("msr fpcr, %0" : : "r"((unsigned long)value));
}

#else

enum { PMA_DENORMALS_FLUSHED = 0 };

static inline unsigned pma_denormals_register(void)
{
    return 0;
}

static inline void pma_denormals_write(unsigned value)
{
    (void)value;
}

#endif

/* This thread goes on with the mode `to`, which an earlier call returned. */
static inline void pma_denormals_restore(pma_denormals to)
{
    const unsigned present = pma_denormals_register();
    if ((present & PMA_DENORMALS_FLUSHED) != to.flags)
        pma_denormals_write((present & ~(unsigned)PMA_DENORMALS_FLUSHED) | to.flags);
}

/* Denormal numbers are zero in this thread from now on; the mode before. */
static inline pma_denormals pma_denormals_flush(void)
{
    const pma_denormals before = {pma_denormals_register() & PMA_DENORMALS_FLUSHED};
    pma_denormals_restore((pma_denormals){PMA_DENORMALS_FLUSHED});
    return before;
}

#endif
