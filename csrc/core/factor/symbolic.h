/* symbolic.h - the structure of a factor, known before its numbers.
 *
 * Patterns are those of a symmetric matrix of size n by rows, in elimination order: ptr (n+1) and
 * index, every index in 0..n-1. Nothing here allocates but the agenda, and what qsort may take. */
#ifndef PMA_SYMBOLIC_H
#define PMA_SYMBOLIC_H

#include <stddef.h>
#include <stdint.h>

#include "algebra/panels.h"
#include "status.h"

/* Widest supernode: its panel and an update to it stay within the private caches. */
enum { PMA_WIDEST = 256 };

/* ---- the graph of groups of unknowns -------------------------------------------------------- */

/* Groups a and b have an entry where two of their unknowns have one and a is not b; the entries of
 * a group are all of a list, each once. The pattern need not be symmetric here.
 *
 * group (n): in 0..groups-1. start (groups+1), members (n), mark (groups): scratch. list_ptr
 * (groups+1), list (ptr[n] at most): output. */
void pma_symbolic_merge(size_t n, const int64_t *ptr, const int32_t *index, size_t groups,
                        const int32_t *group, int64_t *start, int32_t *members, int64_t *mark,
                        int64_t *list_ptr, int32_t *list);

/* The same entries by columns: ascending in each list. out_ptr (n+1), out (ptr[n]): output. */
void pma_symbolic_transpose(size_t n, const int64_t *ptr, const int32_t *index, int64_t *out_ptr,
                            int32_t *out);

/* The entries of two patterns, each ascending in its lists, together: ptr (n+1) and, unless NULL,
 * index (ptr[n]) are output. */
void pma_symbolic_unite(size_t n, const int64_t *a_ptr, const int32_t *a, const int64_t *b_ptr,
                        const int32_t *b, int64_t *ptr, int32_t *index);

/* ---- the factor ----------------------------------------------------------------------------- */

/* Entries of R below the diagonal, column by column, and the elimination tree.
 *
 * parent (n): output, the next column that a column is an update to, -1 for a root. count (n):
 * output, at most n - 1 - j in column j whatever the pattern is. scratch: 4 n. Takes time in
 * proportion to the entries of the pattern. */
void pma_symbolic_count(size_t n, const int64_t *ptr, const int32_t *index, int64_t *parent,
                        int64_t *scratch, int64_t *count);

/* An order with the same fill in which every subtree of the interior is contiguous and the child
 * with the longest column comes next to its parent; the last nb keep their positions.
 *
 * order (n): output, column at each position. scratch: 2 n. */
void pma_symbolic_postorder(size_t n, size_t nb, const int64_t *parent, const int64_t *count,
                            int64_t *scratch, int64_t *order);

/* Columns in postorder gathered to supernodes: same pattern, or nearly so where a few zeros are
 * cheaper than an index; none across the border to the last nb columns.
 *
 * first (n+1): output, the first column of each supernode, closed by n. zeros (n): scratch.
 * Returns how many there are. */
size_t pma_symbolic_supernodes(size_t n, size_t nb, const int64_t *parent, const int64_t *count,
                               int64_t *zeros, int64_t *first);

/* Where the rows and the panel of each supernode begin, in 64 bits: a factor of 70 000 dense
 * columns has more entries than 32 bits count.
 *
 * first (supernodes+1), count (n): input. row_ptr, start (supernodes+1): output; row_ptr[s+1] -
 * row_ptr[s] is the count of its last column. */
void pma_symbolic_lay_out(size_t supernodes, const int64_t *first, const int64_t *count,
                          int64_t *row_ptr, int64_t *start);

/* The rows below the diagonal block of each supernode, ascending.
 *
 * row_ptr (supernodes+1): input. rows: output. owner (n): output, the supernode of each column.
 * mark (n), child, next (supernodes): scratch. PMA_BAD_INDEX when the rows are not as many as
 * counted: the pattern is not symmetric. */
pma_status pma_symbolic_rows(size_t n, const int64_t *ptr, const int32_t *index, size_t supernodes,
                             const int64_t *first, const int64_t *row_ptr, int64_t *owner,
                             int64_t *mark, int64_t *child, int64_t *next, int32_t *rows);

/* ---- what has to be done to make a factor in panels, and in what order ----------------------- */

/* A supernode is updated by all its descendants that have one of its columns among their rows. A
 * task is a range of supernodes: a subtree of the elimination tree, or one supernode above. Tasks
 * are listed by what is still to be done after them on the way to the root, the most first. So a
 * task comes after all tasks that it needs, and several workers that take one after the other never
 * all wait. */
typedef struct {
    size_t *update; /* count+1 of the panels: where the updates of each supernode begin */
    size_t *source; /* update[count]: the supernodes they come from, ascending */
    size_t *row;    /* update[count]: the first of the source's rows that is a column */
    size_t tasks;
    size_t *first, *last; /* tasks: supernodes of each */
} pma_agenda;

/* Panels that were checked, with the supernode of each column; for one worker each tree is one
 * task. Allocates: PMA_NO_MEMORY; *out is empty then. */
pma_status pma_agenda_create(const pma_panels *p, const int64_t *owner, size_t workers,
                             pma_agenda *out);
void pma_agenda_destroy(pma_agenda *a); /* an empty one is allowed */

#endif
