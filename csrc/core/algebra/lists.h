/* lists.h - lists of numbers: in order, in range, and where a number is in them. */
#ifndef PMA_LISTS_H
#define PMA_LISTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

static inline size_t pma_least(size_t a, size_t b)
{
    return a < b ? a : b;
}

static inline size_t pma_most(size_t a, size_t b)
{
    return a > b ? a : b;
}

/* For qsort, of int32_t. */
static inline int pma_ascending(const void *a, const void *b)
{
    const int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
    return (x > y) - (x < y);
}

/* Starts of n lists, ptr (n+1): do they begin with 0 and never fall? */
static inline bool pma_are_starts(size_t n, const int64_t *ptr)
{
    bool rises = ptr[0] == 0;
    for (size_t i = 0; i < n; i++)
        rises = rises && ptr[i] <= ptr[i + 1];
    return rises;
}

/* Are all in 0..n-1? */
static inline bool pma_are_within(size_t n, int64_t count, const int32_t *index)
{
    for (int64_t k = 0; k < count; k++) {
        if (index[k] < 0 || (size_t)index[k] >= n)
            return false;
    }
    return true;
}

/* Of an ascending list, the first place in low..high-1 that is not below `value`, or high. */
static inline int64_t pma_position_of(const int32_t *list, int64_t low, int64_t high, size_t value)
{
    while (low < high) {
        const int64_t middle = low + (high - low) / 2;
        if ((size_t)list[middle] < value)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* The same of ascending starts, or `count`. */
static inline size_t pma_start_of(const int64_t *starts, size_t count, size_t value)
{
    size_t low = 0, high = count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if ((size_t)starts[middle] < value)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

#endif
