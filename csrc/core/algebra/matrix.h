/* matrix.h - a matrix that is only ever multiplied with a vector. */
#ifndef PMA_MATRIX_H
#define PMA_MATRIX_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/strips.h"
#include "status.h"

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

/* The furthest entry from the diagonal: row i reads x up to i + reach. */
size_t pma_matrix_reach(const pma_matrix *A);

/* y -= A x, both of length n and not overlapping. Does not allocate. */
void pma_matrix_subtract(const pma_matrix *A, const double *x, double *y);

/* the same for the rows begin..end-1 of y alone */
void pma_matrix_subtract_rows(const pma_matrix *A, size_t begin, size_t end, const double *x,
                              double *y);

/* no inf and no NaN among n numbers */
bool pma_is_finite(size_t n, const double *x);

/* ---- in another order ------------------------------------------------------------------------ */

/* B with B_kl = A_ij, i = order[k] and j = order[l]; ascending in each row, whatever A is.
 *
 * A by rows: ptr (n+1), index and values (ptr[n]). order (n): a permutation, and position (n) its
 * inverse. B_ptr (n+1), B_index, B_values (ptr[n]): output. Does not allocate. */
void pma_matrix_permute(size_t n, const int64_t *ptr, const int32_t *index, const double *values,
                        const int64_t *order, const int32_t *position, int64_t *B_ptr,
                        int32_t *B_index, double *B_values);

/* The entries of one row in ascending order of their indices, which differ. */
void pma_matrix_sort_row(int64_t count, int32_t *index, double *values);

#endif
