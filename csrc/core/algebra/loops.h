/* loops.h - vectors in lanes: matrices, factors and links of short rows, for each kind of
 * processor.
 *
 * What kernel.h has for panels, strips and dense matrices; bitwise the same on all processors, and
 * in every lane what one vector gets. Sizes and rows are those of one lane. */
#ifndef PMA_LOOPS_H
#define PMA_LOOPS_H

#include <stddef.h>

#include "algebra/factor.h"
#include "algebra/link.h"
#include "algebra/matrix.h"

typedef struct {
    /* y -= A x for the rows begin..end-1: diagonal, band or sparse */
    void (*subtract)(const pma_matrix *A, size_t begin, size_t end, const double *x, double *y);
    /* Forward through the columns first..last-1, and backward: band or sparse; x[0] is unknown
     * `first`. */
    void (*eliminate)(const pma_factor *f, size_t first, size_t last, double *x);
    void (*substitute)(const pma_factor *f, size_t first, size_t last, double *x);
    /* x_j /= D_j for the columns first..last-1 */
    void (*scale)(const pma_factor *f, size_t first, size_t last, double *x);
    /* xb (nb) += L_b^T lam, lam (p), and jump (p) += scale L_b xb */
    void (*add)(const pma_link *L, const double *lam, double *xb);
    void (*gather)(const pma_link *L, double scale, const double *xb, double *jump);
} pma_loops;

const pma_loops *pma_loops_best(void);
const pma_loops *pma_loops_plain(void);

/* ---- by any form; x (n) has n * PMA_LANES numbers, `work` as many times the scratch ---------- */

/* y (n) -= A x                                                           pma_matrix_subtract */
void pma_loops_subtract(const pma_matrix *A, const double *x, double *y);
void pma_loops_subtract_rows(const pma_matrix *A, size_t begin, size_t end, const double *x,
                             double *y);

/* Forward through the columns first..last-1 of a factor whose interface is last, and backward; x[0]
 * is unknown `first`. */
void pma_loops_eliminate(const pma_factor *f, size_t first, size_t last, double *x, double *work);
void pma_loops_substitute(const pma_factor *f, size_t first, size_t last, double *x, double *work);

/* xb (nb) += L_b^T lam, lam (p)                                                  pma_link_add */
void pma_loops_add(const pma_link *L, const double *lam, double *xb);

/* jump (p) += scale L_b xb                                                    pma_link_gather */
void pma_loops_gather(const pma_link *L, double scale, const double *xb, double *jump);

#endif
