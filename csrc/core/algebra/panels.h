/* panels.h - a sparse factor R D Q^T in supernodal panels: its numbers, and the sweeps over it.
 *
 * The columns of a supernode have the same pattern below the last of them, so that they are stored
 * as one dense panel: 8 bytes an entry, no index, and vector code. */
#ifndef PMA_PANELS_H
#define PMA_PANELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "status.h"

/* Bare arrays of the caller. Supernode s has the columns first[s]..first[s+1]-1 and, below them,
 * the rows row_ptr[s]..row_ptr[s+1]-1; its panel holds all these rows by columns. */
typedef struct {
    size_t count;           /* supernodes */
    const int64_t *first;   /* count+1 */
    const int64_t *row_ptr; /* count+1 */
    const int32_t *rows;    /* row_ptr[count], ascending in each supernode */
    const int64_t *start;   /* count+1: where each panel begins in values */
    double *values;         /* start[count]: R */
    size_t Q; /* where the panels of Q begin in values, laid out like those of R; 0: Q is R, for a
                 symmetric matrix */
} pma_panels;

static inline size_t pma_panels_width(const pma_panels *p, size_t s)
{
    return (size_t)(p->first[s + 1] - p->first[s]);
}

static inline size_t pma_panels_rows(const pma_panels *p, size_t s)
{
    return (size_t)(p->row_ptr[s + 1] - p->row_ptr[s]);
}

/* Rows of the whole panel: the distance between two of its columns. */
static inline size_t pma_panels_height(const pma_panels *p, size_t s)
{
    return pma_panels_width(p, s) + pma_panels_rows(p, s);
}

/* PMA_BAD_INDEX unless the supernodes partition 0..n-1, break at n - nb, and all rows ascend,
 * lie below their columns, and panels have the sizes that follow. */
pma_status pma_panels_check(const pma_panels *p, size_t n, size_t nb);

/* PMA_BAD_INDEX unless owner (n) has the supernode of each column; of panels that were checked. */
pma_status pma_panels_check_owners(const pma_panels *p, size_t n, const int64_t *owner);

/* Rows of the tallest panel: the scratch of a sweep. */
size_t pma_panels_most_height(const pma_panels *p);

/* Sweeps of one vector, or of PMA_LANES side by side (kernel.h): `lanes` is 1 or PMA_LANES, and
 * every size counts numbers of one of them.
 *
 * Supernodes of the columns from..to-1; x[0] is unknown `from`. work: most_height. */
void pma_panels_eliminate(const pma_panels *p, size_t lanes, size_t from, size_t to, double *x,
                          double *work);
void pma_panels_substitute(const pma_panels *p, const double *inverse, size_t lanes, size_t from,
                           size_t to, double *x, double *work);

#endif
