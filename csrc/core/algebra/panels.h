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

/* The two BLAS routines of the numeric part, as Fortran has them. */
typedef struct {
    void (*dgemm)(char *, char *, int *, int *, int *, double *, double *, int *, double *, int *,
                  double *, double *, int *);
    void (*dtrsm)(char *, char *, char *, char *, int *, int *, double *, double *, int *, double *,
                  int *);
} pma_blas;

/* PMA_BAD_INDEX unless the supernodes partition 0..n-1, break at n - nb, and all rows ascend,
 * lie below their columns, and panels have the sizes that follow. */
pma_status pma_panels_check(const pma_panels *p, size_t n, size_t nb);

/* Rows of the tallest panel: the scratch of a sweep. */
size_t pma_panels_most_height(const pma_panels *p);

/* Doubles of scratch that the numeric part needs. */
size_t pma_panels_update_size(const pma_panels *p);

/* A matrix by rows, whose symmetric pattern the panels were made for. If its values are not
 * symmetric, the entries of a row ascend. */
typedef struct {
    size_t n;
    const int64_t *ptr;
    const int32_t *index;
    const double *values;
    double lost;   /* a pivot must be above this part of its diagonal entry */
    double growth; /* unsymmetric: most that R_ij D_j Q_ij may be, relative to A_ii */
} pma_panels_input;

/* R, Q and the reciprocals of D; pivots are on the diagonal.
 *
 * Symmetric (p->Q is 0): pivots are positive. Otherwise they have any sign, and what is subtracted
 * from a diagonal entry is bounded by `growth`: A is factored without a loss of digits.    (F11)
 * owner (n): the supernode of each column. inverse (n): output. update (pma_panels_update_size),
 * integers (3 count + n, n more if unsymmetric): scratch. PMA_NOT_DEFINITE with the column in
 * *column, PMA_BAD_INDEX for an entry outside the pattern or across from none, PMA_STOPPED when
 * stop, called between supernodes, returns true. */
pma_status pma_panels_factor(pma_panels *p, const pma_panels_input *input, const int64_t *owner,
                             const pma_blas *blas, double *inverse, double *update,
                             int64_t *integers, size_t *column, bool (*stop)(void *ctx), void *ctx);

/* Sweeps of one vector, or of PMA_LANES side by side (kernel.h): `lanes` is 1 or PMA_LANES, and
 * every size counts numbers of one of them.
 *
 * Supernodes of the columns from..to-1; x[0] is unknown `from`. work: most_height. */
void pma_panels_eliminate(const pma_panels *p, size_t lanes, size_t from, size_t to, double *x,
                          double *work);
void pma_panels_substitute(const pma_panels *p, const double *inverse, size_t lanes, size_t from,
                           size_t to, double *x, double *work);

/* `count` supernodes in ascending order; x[0] is unknown 0. work: most_height. */
void pma_panels_eliminate_these(const pma_panels *p, const int64_t *supernodes, size_t count,
                                size_t lanes, double *x, double *work);
void pma_panels_substitute_these(const pma_panels *p, const double *inverse,
                                 const int64_t *supernodes, size_t count, size_t lanes, double *x,
                                 double *work);

#endif
