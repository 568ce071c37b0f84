/* processors.h - a function compiled twice: for any processor, and for those with AVX2.
 *
 * AVX2 alone: with fused multiply-adds the digits would depend on the processor. On processors of
 * other kinds, or with PMA_PLAIN, both are the same. */
#ifndef PMA_PROCESSORS_H
#define PMA_PROCESSORS_H

#include <stdbool.h>

#if defined(__x86_64__) && !defined(PMA_PLAIN)
#define PMA_AVX2 __attribute__((target("avx2")))
static inline bool pma_has_avx2(void)
{
    return __builtin_cpu_supports("avx2");
}
#else
#define PMA_AVX2
static inline bool pma_has_avx2(void)
{
    return false;
}
#endif

/* name_plain and name_avx2, of this type, with these parameters and this body */
#define PMA_COMPILED(type, name, parameters, ...)                                                \
    static type name##_plain parameters{__VA_ARGS__} PMA_AVX2 static type name##_avx2 parameters \
    {                                                                                            \
        __VA_ARGS__                                                                              \
    }

#endif
