/* store.h - memory of what is taken from a tree, released together. */
#ifndef PMA_STORE_H
#define PMA_STORE_H

#include <stddef.h>

/* The blocks; zeroed, an empty store. */
typedef struct {
    struct pma_block *last;
} pma_store;

/* A new block of `count` elements of `size` bytes, zeroed; NULL where memory does not suffice. */
void *pma_store_add(pma_store *store, size_t count, size_t size);

/* Frees all blocks; the store is empty again. */
void pma_store_release(pma_store *store);

#endif
