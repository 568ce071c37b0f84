/* Loaded before the C library by campaign_memory.py: lets one allocation of the extension fail.
 *
 * An allocation belongs to the extension if one of the innermost callers is in it: a call of its
 * own, or one of the functions of Python and NumPy that it calls. */
#define _GNU_SOURCE
#include <errno.h>
#include <execinfo.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>

enum { CALLERS = 7 };

extern void *__libc_malloc(size_t);
extern void *__libc_calloc(size_t, size_t);
extern void *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);

static atomic_long left; /* allocations until the one that fails; 0: none fails */
static atomic_long seen;
static _Thread_local bool inside;

static const char *first, *end;             /* where the extension is in memory */
static const char *apart_first, *apart_end; /* and a library that it calls, whose own do not fail */

void failing_allocations_of(const char *begin, const char *behind)
{
    first = begin;
    end = behind;
}

void failing_allocations_apart(const char *begin, const char *behind)
{
    apart_first = begin;
    apart_end = behind;
}

/* Fail the k-th allocation from now on; 0 lets all succeed. Returns how many there were. */
long failing_allocations_arm(long k)
{
    void *callers[CALLERS];
    backtrace(callers, CALLERS); /* loads what it needs */
    const long count = atomic_exchange(&seen, 0);
    atomic_store(&left, k);
    return count;
}

static bool is_of_extension(void)
{
    void *callers[CALLERS];
    const int count = backtrace(callers, CALLERS);
    bool found = false;
    for (int i = 2; i < count && !found; i++) {
        const char *caller = callers[i];
        if (caller >= apart_first && caller < apart_end)
            return false;
        found = caller >= first && caller < end;
    }
    return found;
}

static bool fails(void)
{
    if (inside || atomic_load(&left) == 0)
        return false;
    inside = true;
    bool now = false;
    if (is_of_extension()) {
        atomic_fetch_add(&seen, 1);
        now = atomic_fetch_sub(&left, 1) == 1;
        if (now)
            atomic_store(&left, -1); /* counts on, and fails no other */
    }
    inside = false;
    if (now)
        errno = ENOMEM; /* the C library asserts it where it makes the stack of a thread */
    return now;
}

void *malloc(size_t size)
{
    return fails() ? NULL : __libc_malloc(size);
}

void *calloc(size_t count, size_t size)
{
    return fails() ? NULL : __libc_calloc(count, size);
}

void *realloc(void *old, size_t size)
{
    return fails() ? NULL : __libc_realloc(old, size);
}

void *aligned_alloc(size_t alignment, size_t size)
{
    return fails() ? NULL : __libc_memalign(alignment, size);
}

int posix_memalign(void **out, size_t alignment, size_t size)
{
    *out = fails() ? NULL : __libc_memalign(alignment, size);
    return *out ? 0 : 12;
}
