/* tree.h - the elimination tree of a factor in panels, in nodes that fit in a cache.
 *
 * In an elimination tree the neighbours of a column are among its descendants and its ancestors. A
 * node of the tree here has at most some entries, or is one supernode: a subtree, or siblings
 * together; above these, supernodes of which each is the parent of the one before. What the columns
 * of a node and of its descendants subtract from rows above it is summed up in an update of the
 * node, which its parent adds, its children in their order. So the sums do not depend on the order
 * in which nodes are swept, nor on who sweeps them. */
#ifndef PMA_TREE_H
#define PMA_TREE_H

#include <stddef.h>
#include <stdint.h>

#include "algebra/panels.h"
#include "status.h"

/* Entries of a subtree: half of a private cache of 512 kB. */
enum { PMA_SUBTREE = 32768 };

#define PMA_NO_NODE SIZE_MAX

/* Nodes have ascending columns and are in postorder. The unknowns of the border, nb
 * of them, are no node but, with the number `count`, the parent of all roots. */
typedef struct {
    size_t count;
    size_t *column;   /* count+1: a node has the columns column[t]..column[t+1]-1 */
    size_t *parent;   /* count+1 */
    size_t *child;    /* count+1: the first one, or PMA_NO_NODE */
    size_t *sibling;  /* count+1: the next child of the same parent, or PMA_NO_NODE */
    size_t *entries;  /* count+1: of the columns of each node */
    size_t *update;   /* count+1: where the update of each node begins, one number a row */
    int32_t *row;     /* update[count]: those rows, ascending */
    int32_t *into;    /* update[count]: where they are in the front of the parent, which has its
                         columns and then its rows */
    int32_t *rows;    /* of all supernodes: place in the front of the node + its first column */
    size_t most_rows; /* of a front */
    size_t height;    /* of the tallest panel */
} pma_tree;

/* The tree of panels that were checked. Allocates: PMA_NO_MEMORY; *out is NULL where there would be
 * fewer than two nodes. */
pma_status pma_tree_create(const pma_panels *p, size_t n, size_t nb, size_t entries,
                           pma_tree **out);
void pma_tree_destroy(pma_tree *T); /* NULL is allowed */

/* Doubles of scratch: of one thread, and the updates, which all threads share. */
size_t pma_tree_front(const pma_tree *T);
size_t pma_tree_updates(const pma_tree *T);

/* Forward through the columns of a node, whose children were swept; backward, when its parent was.
 * `lanes` vectors side by side as in panels.h; x[0] is unknown 0. front, updates: scratch. */
void pma_tree_eliminate(const pma_tree *T, const pma_panels *p, size_t node, size_t lanes,
                        double *x, double *front, double *updates);
void pma_tree_substitute(const pma_tree *T, const pma_panels *p, const double *inverse, size_t node,
                         size_t lanes, double *x, double *front);

/* The updates of all roots, added to the border of x. */
void pma_tree_add_to_border(const pma_tree *T, size_t lanes, const double *updates, double *x);

/* ---- the nodes divided among workers: subtrees, and the trunk above them --------------------- */

/* Worker w has the subtrees of the nodes root[begin[w]]..root[begin[w+1]-1], ascending. The nodes
 * above all of them are the trunk, which one worker has to sweep while the others wait. */
typedef struct {
    size_t workers;
    size_t *root, *begin;
    size_t *trunk; /* trunk_count, ascending */
    size_t trunk_count;
    size_t trunk_entries;
    void *block;
} pma_branches;

/* The division with the least entries in the trunk and the fullest worker together. Nothing but
 * the time of a sweep depends on it. Allocates: PMA_NO_MEMORY. */
pma_status pma_branches_create(const pma_tree *T, size_t workers, pma_branches *out);
void pma_branches_destroy(pma_branches *b); /* a zeroed one is allowed */

#endif
