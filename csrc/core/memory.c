#include "memory.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* The room that a thread has entered, the one variable of the core that outlives a call: objects
 * are made by functions far below the one that knows of the room. */
#if defined(PMA_ONE_THREAD)
static pma_room *entered;
#else
static _Thread_local pma_room *entered;
#endif

/* SIZE_MAX where it is too large. */
static size_t rounded(size_t bytes)
{
    const size_t unit = sizeof(max_align_t);
    return bytes > SIZE_MAX - unit ? SIZE_MAX : (bytes + unit - 1) / unit * unit;
}

static void *take(pma_room *room, size_t bytes)
{
    const size_t whole = rounded(bytes);
    if (whole > room->left)
        return NULL;
    char *const block = room->at;
    room->at += whole;
    room->left -= whole;
    room->used += whole;
    return memset(block, 0, whole);
}

void *pma_memory_allocate(size_t count, size_t size)
{
    if (size > 0 && count > SIZE_MAX / size)
        return NULL;
    if (entered && entered->at)
        return take(entered, count * size);
    void *block = calloc(count, size);
    if (entered && block)
        entered->used += rounded(count * size);
    return block;
}

void pma_memory_release(void *block)
{
    if (!(entered && entered->at))
        free(block);
}

void pma_memory_enter(pma_room *room)
{
    entered = room;
}
