/* memory.h - where all objects of the core are: in memory of the C library, or in a room.
 *
 * A room is a block of the caller's in which one thread makes objects, for systems without
 * allocation. While the thread has entered it, memory is taken from its front and never given back:
 * what is in a room is released with it, and none of it is destroyed. */
#ifndef PMA_MEMORY_H
#define PMA_MEMORY_H

#include <stddef.h>

typedef struct {
    char
        *at; /* the front, at a multiple of max_align_t; NULL: memory of the C library is counted */
    size_t left; /* bytes behind it */
    size_t used; /* before it */
} pma_room;

/* `count` elements of `size` bytes, zeroed; NULL where memory does not suffice. */
void *pma_memory_allocate(size_t count, size_t size);

void pma_memory_release(void *block);

/* From here on this thread takes memory from the room, or counts what it takes; NULL: no longer. */
void pma_memory_enter(pma_room *room);

#endif
