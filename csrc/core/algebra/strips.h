/* strips.h - a sparse matrix in strips: rows that read the same columns, side by side.
 *
 * All dofs of a node are tied to the same dofs. Their rows share one list of columns and are dense
 * over it: 8 bytes an entry and a few for the list, and vector code. */
#ifndef PMA_STRIPS_H
#define PMA_STRIPS_H

#include <stddef.h>
#include <stdint.h>

#include "status.h"

/* Most rows of a strip: the dofs of a node of a shell. */
enum { PMA_STRIP_ROWS = 6 };

/* Bare arrays of the caller. Strip s has the rows first[s]..first[s+1]-1 and the columns
 * index[ptr[s]]..index[ptr[s+1]-1], a multiple of four: of the last four, one may come again, with
 * zeros. Four that follow one another come first; no others have their last three above their
 * first. The values begin at start[s] and are in the order in which a product reads them: four
 * columns of the first row, the same four of the second, and so on; then the next four columns. */
typedef struct {
    size_t count;         /* strips */
    const int64_t *first; /* count+1 */
    const int64_t *ptr;   /* count+1 */
    const int32_t *index; /* ptr[count] */
    const int64_t *start; /* count+1 */
    const double *values; /* start[count] */
} pma_strips;

/* PMA_BAD_INDEX unless the strips partition 0..n-1, none with too many rows, all columns lie in it
 * as it is said of fours, and the values have the sizes that follow. */
pma_status pma_strips_check(const pma_strips *S, size_t n);

/* How far from its row the furthest column is. */
size_t pma_strips_reach(const pma_strips *S);

/* Groups the rows of a matrix by rows, ptr (n+1) and index: a row joins the strip above it where
 * that takes fewer bytes. Returns how many strips there are.
 *
 * first (n+1): output, closed by n. columns (n): output, of each strip. mark (n): scratch */
size_t pma_strips_group(size_t n, const int64_t *ptr, const int32_t *index, int64_t *first,
                        int64_t *columns, int64_t *mark);

/* The lists and numbers of strips whose first, ptr and start are laid out; entries at the
 * same position are added up. index (ptr[count]), values (start[count]): output, values zeroed.
 * mark (n): scratch. */
void pma_strips_fill(const pma_strips *S, size_t n, const int64_t *ptr, const int32_t *index,
                     const double *entries, int64_t *mark, int32_t *strip_index,
                     double *strip_values);

/* The strip of a row. */
size_t pma_strips_at(const pma_strips *S, size_t row);

/* y -= A x for the rows begin..end-1 of y */
void pma_strips_subtract(const pma_strips *S, size_t begin, size_t end, const double *x, double *y);

#endif
