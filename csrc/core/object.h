/* object.h - an object and its arrays, in one block of memory.
 *
 * A table, whose last line is zero, lists the pointers of the object that are to be set, and what
 * each points to; sizes and places follow from it. So an object is there whole or not at all, and
 * `free` releases it. */
#ifndef PMA_OBJECT_H
#define PMA_OBJECT_H

#include <stddef.h>

/* `count` elements of `size` bytes, at a pointer `at` bytes from where the object begins. */
typedef struct {
    size_t at, count, size;
} pma_array;

/* The line of a table for `count` elements at a pointer of an object of this type. */
#define PMA_ARRAY(type, pointer, count) \
    {offsetof(type, pointer), (count), sizeof *((type *)0)->pointer}

/* An object of this size with its arrays, all zero; NULL where memory does not suffice. The first
 * array begins a line of the cache. */
void *pma_object_create(size_t size, const pma_array *arrays);

/* The same for an object that is part of another: a block of its arrays alone, to be freed. */
void *pma_object_fill(void *object, const pma_array *arrays);

#endif
