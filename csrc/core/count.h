/* count.h - a number of 64 bits that one thread writes and another reads.
 *
 * Without threads it is a plain one: processors of 32 bits have no instruction for it. */
#ifndef PMA_COUNT_H
#define PMA_COUNT_H

#include <stdint.h>

#if defined(PMA_ONE_THREAD)
typedef int64_t pma_count;

static inline int64_t pma_count_get(const pma_count *count)
{
    return *count;
}

static inline void pma_count_set(pma_count *count, int64_t number)
{
    *count = number;
}
#else
#include <stdatomic.h>

typedef atomic_int_least64_t pma_count;

/* What the other thread has written before the number is seen with it. */
static inline int64_t pma_count_get(const pma_count *count)
{
    return atomic_load_explicit(count, memory_order_acquire);
}

static inline void pma_count_set(pma_count *count, int64_t number)
{
    atomic_store_explicit(count, number, memory_order_release);
}
#endif

#endif
