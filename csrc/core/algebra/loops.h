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

#endif
