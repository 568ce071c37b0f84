#include "describe/store.h"

#include <stdint.h>

#include "memory.h"

typedef struct pma_block {
    struct pma_block *before;
    max_align_t data[];
} pma_block;

void *pma_store_add(pma_store *store, size_t count, size_t size)
{
    if (size > 0 && count > (SIZE_MAX - sizeof(pma_block)) / size)
        return NULL;
    pma_block *block = pma_memory_allocate(1, sizeof *block + count * size);
    if (!block)
        return NULL;
    block->before = store->last;
    store->last = block;
    return block->data;
}

void pma_store_release(pma_store *store)
{
    while (store->last) {
        pma_block *block = store->last;
        store->last = block->before;
        pma_memory_release(block);
    }
}
