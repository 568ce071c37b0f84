/* branches.h - the nodes of a tree divided among workers: subtrees, and the trunk above them. */
#ifndef PMA_BRANCHES_H
#define PMA_BRANCHES_H

#include <stddef.h>

#include "algebra/tree.h"
#include "status.h"

/* Worker w has the subtrees of the nodes root[begin[w]]..root[begin[w+1]-1], ascending. The nodes
 * above all of them are the trunk, which one worker has to sweep while the others wait. */
typedef struct {
    size_t workers;
    size_t *root, *begin;
    size_t *trunk; /* trunk_count, ascending */
    size_t trunk_count;
    size_t trunk_entries;
} pma_branches;

/* The division with the least entries in the trunk and the fullest worker together. Nothing but
 * the time of a sweep depends on it. Allocates: PMA_NO_MEMORY. */
pma_status pma_branches_create(const pma_tree *T, size_t workers, pma_branches *out);
void pma_branches_destroy(pma_branches *b); /* a zeroed one is allowed */

#endif
