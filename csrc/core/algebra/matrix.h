/* matrix.h - a matrix that is only ever multiplied with a vector. */
#ifndef PMA_MATRIX_H
#define PMA_MATRIX_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "status.h"

/* A sparse matrix in strips: rows that read the same columns, side by side. All dofs of a node are
 * tied to the same dofs. Their rows share one list of columns and are dense over it: 8 bytes an
 * entry and a few for the list, and vector code. */

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

/* The forms of a matrix and of a factor. */
typedef enum {
    PMA_ZERO,
    PMA_DIAGONAL,
    PMA_BAND,
    PMA_DENSE,
    PMA_SPARSE,
    PMA_STRIPS,  /* matrices alone */
    PMA_PANELS,  /* factors alone */
    PMA_IN_LANES /* the same matrix or factor in every lane, see lanes.h */
} pma_form;

/* Arrays of the caller, which have to outlive it. */
typedef struct pma_matrix {
    pma_form form;
    size_t n;
    const double *values;          /* diagonal: n; dense: n*n by columns; sparse: ptr[n];
                                      band: (width+1)*n, A_i,i+d at values[d*n + i] */
    const int64_t *ptr;            /* sparse: n+1 starts of the rows, else NULL */
    const int32_t *index;          /* sparse: column of each entry, else NULL */
    size_t width;                  /* band: diagonals above the main one, below n */
    size_t below;                  /* band: where those below it begin in values, A_i+d,i at
                                      below + d*n + i; 0 of a symmetric matrix */
    pma_strips strips;             /* strips: see there */
    const struct pma_matrix *each; /* in lanes: the matrix of each */
} pma_matrix;

/* PMA_BAD_INDEX unless every row and column index lies in the matrix, PMA_BAD_SIZE for a band
 * wider than it. */
pma_status pma_matrix_check(const pma_matrix *A);

/* Entries read by one product. */
size_t pma_matrix_entries(const pma_matrix *A);

/* y -= A x, both of length n and not overlapping. Does not allocate. */
void pma_matrix_subtract(const pma_matrix *A, const double *x, double *y);

/* the same for the rows begin..end-1 of y alone */
void pma_matrix_subtract_rows(const pma_matrix *A, size_t begin, size_t end, const double *x,
                              double *y);

/* y := A x, but for the sign of its zeros */
void pma_matrix_multiply(const pma_matrix *A, const double *x, double *y);

/* x . A x; product (n): scratch */
double pma_matrix_square(const pma_matrix *A, const double *x, double *product);

/* The matrix that does the same in every lane (lanes.h), of PMA_LANES times its size: ranges of
 * rows begin and end with whole unknowns. `each` has to outlive it. */
pma_matrix pma_matrix_in_lanes(const pma_matrix *each);

/* no inf and no NaN among n numbers */
bool pma_is_finite(size_t n, const double *x);

/* ---- strips --------------------------------------------------------------------------------- */

/* PMA_BAD_INDEX unless the strips partition 0..n-1, none with too many rows, all columns lie in it
 * as it is said of fours, and the values have the sizes that follow. */
pma_status pma_strips_check(const pma_strips *S, size_t n);

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

/* ---- in another order ------------------------------------------------------------------------ */

/* B with B_kl = A_ij, i = order[k] and j = order[l]; ascending in each row, whatever A is.
 *
 * A by rows: ptr (n+1), index and values (ptr[n]). order (n): a permutation, and position (n) its
 * inverse. B_ptr (n+1), B_index, B_values (ptr[n]): output. Does not allocate. */
void pma_matrix_permute(size_t n, const int64_t *ptr, const int32_t *index, const double *values,
                        const int64_t *order, const int32_t *position, int64_t *B_ptr,
                        int32_t *B_index, double *B_values);

#endif
