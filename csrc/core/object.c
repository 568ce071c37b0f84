#include "object.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Bytes of a line of the cache; every array begins at a multiple of a word. */
enum { LINE = 64, WORD = 8 };

/* SIZE_MAX for arrays that are too large together. */
static size_t bytes_of(const pma_array *arrays)
{
    size_t bytes = 0;
    for (; arrays->size > 0; arrays++) {
        if (bytes > SIZE_MAX / 2 || arrays->count > SIZE_MAX / 4 / arrays->size)
            return SIZE_MAX;
        bytes += (arrays->count * arrays->size + WORD - 1) / WORD * WORD;
    }
    return bytes;
}

static void place(void *object, const pma_array *arrays, char *next)
{
    next += (LINE - (uintptr_t)next % LINE) % LINE;
    for (; arrays->size > 0; arrays++) {
        memcpy((char *)object + arrays->at, (const void *)&next, sizeof next);
        next += (arrays->count * arrays->size + WORD - 1) / WORD * WORD;
    }
}

void *pma_object_create(size_t size, const pma_array *arrays)
{
    const size_t bytes = bytes_of(arrays);
    char *object = bytes < SIZE_MAX ? calloc(1, size + LINE + bytes) : NULL;
    if (object)
        place(object, arrays, object + size);
    return object;
}

void *pma_object_fill(void *object, const pma_array *arrays)
{
    const size_t bytes = bytes_of(arrays);
    void *block = bytes < SIZE_MAX ? calloc(1, LINE + bytes) : NULL;
    if (block)
        place(object, arrays, block);
    return block;
}
