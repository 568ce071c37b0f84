#include "object.h"

#include <stdint.h>
#include <string.h>

#include "memory.h"

/* Bytes of a line of the cache; every array begins at a multiple of a word. */
enum { LINE = 64, WORD = 8 };

/* Where a sanitizer looks on, between arrays is memory that nobody may use. */
#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/asan_interface.h>

enum { GAP = 64 };

static void forbid(char *gap)
{
    ASAN_POISON_MEMORY_REGION(gap, GAP);
}
#else
enum { GAP = 0 };

static void forbid(char *gap)
{
    (void)gap;
}
#endif

static size_t rounded(const pma_array *array)
{
    return (array->count * array->size + WORD - 1) / WORD * WORD;
}

/* SIZE_MAX for arrays that are too large together. */
static size_t bytes_of(const pma_array *arrays)
{
    size_t bytes = 0;
    for (; arrays->size > 0; arrays++) {
        if (bytes > SIZE_MAX / 2 || arrays->count > SIZE_MAX / 4 / arrays->size)
            return SIZE_MAX;
        bytes += rounded(arrays) + GAP;
    }
    return bytes;
}

static void place(void *object, const pma_array *arrays, char *next)
{
    next += (LINE - (uintptr_t)next % LINE) % LINE;
    for (; arrays->size > 0; arrays++) {
        memcpy((char *)object + arrays->at, (const void *)&next, sizeof next);
        next += rounded(arrays) + GAP;
        forbid(next - GAP);
    }
}

void *pma_object_create(size_t size, const pma_array *arrays)
{
    const size_t bytes = bytes_of(arrays);
    char *object = bytes < SIZE_MAX ? pma_memory_allocate(1, size + LINE + bytes) : NULL;
    if (object)
        place(object, arrays, object + size);
    return object;
}

void *pma_object_fill(void *object, const pma_array *arrays)
{
    const size_t bytes = bytes_of(arrays);
    void *block = bytes < SIZE_MAX ? pma_memory_allocate(1, LINE + bytes) : NULL;
    if (block)
        place(object, arrays, block);
    return block;
}
