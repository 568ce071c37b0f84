#include "allocations.h"

#include <stdatomic.h>

static atomic_size_t counted;

#if defined(__SANITIZE_ADDRESS__)
#define COUNTS_ALLOCATIONS 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define COUNTS_ALLOCATIONS 1
#endif
#endif

#ifdef COUNTS_ALLOCATIONS
/* as <sanitizer/allocator_interface.h> has it, which not every compiler brings along */
int __sanitizer_install_malloc_and_free_hooks(void (*malloced)(const volatile void *, size_t),
                                              void (*freed)(const volatile void *));

static void count_allocation(const volatile void *memory, size_t size)
{
    (void)memory;
    (void)size;
    atomic_fetch_add(&counted, 1);
}

static void ignore_free(const volatile void *memory)
{
    (void)memory;
}

bool count_allocations(void)
{
    static bool counts = false;
    counts = counts || __sanitizer_install_malloc_and_free_hooks(count_allocation, ignore_free) > 0;
    return counts;
}
#else
bool count_allocations(void)
{
    return false;
}
#endif

size_t allocations_counted(void)
{
    return atomic_load(&counted);
}
