#include "allocations.h"

#include <stdatomic.h>
#include <stdlib.h>

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

/* ---- failures ------------------------------------------------------------------------------- */

static atomic_size_t left; /* allocations until the one that fails; 0: none fails */
static atomic_bool has_failed;

bool allocation_has_failed(void)
{
    return atomic_load(&has_failed);
}

#ifdef WRAPPED_ALLOCATORS
/* as the linker names the allocators, and what is called in their place */
void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *old, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *old, size_t size);

static bool fails(void)
{
    if (atomic_load(&left) == 0 || atomic_fetch_sub(&left, 1) > 1)
        return false;
    atomic_store(&has_failed, true);
    return true;
}

void *__wrap_malloc(size_t size)
{
    return fails() ? NULL : __real_malloc(size);
}

void *__wrap_calloc(size_t count, size_t size)
{
    return fails() ? NULL : __real_calloc(count, size);
}

void *__wrap_realloc(void *old, size_t size)
{
    return fails() ? NULL : __real_realloc(old, size);
}

bool fail_allocation(size_t k)
{
    atomic_store(&has_failed, false);
    atomic_store(&left, k);
    return true;
}
#else
bool fail_allocation(size_t k)
{
    atomic_store(&left, k);
    return false;
}
#endif
