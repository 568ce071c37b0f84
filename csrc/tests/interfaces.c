/* interfaces.c - see interfaces.h. */
#include "interfaces.h"

#include <assert.h>

#include "check.h"

/* A = R D Q^T with ones on the diagonals of R and Q, both by columns (F10) */
pma_interface make_unsymmetric_interface(unsymmetric_interface *x, size_t p, const double *A)
{
    assert(p >= 1 && p <= MOST_ROWS);
    double *R = x->values, *Q = x->values + p * p;
    x->inverse[0] = 1.0 / A[0];
    R[0] = Q[0] = 1.0;
    if (p == 2) {
        R[1] = A[2] / A[0];
        Q[1] = A[1] / A[0];
        R[3] = Q[3] = 1.0;
        x->inverse[1] = 1.0 / (A[3] - R[1] * A[1]);
    }
    const pma_factor factor = {
        .form = PMA_DENSE, .n = p, .nb = p, .inverse = x->inverse, .values = x->values, .Q = p * p};
    pma_interface_destroy(&x->interface);
    CHECK_STATUS(pma_interface_create(&factor, &x->interface), PMA_OK);
    return x->interface;
}
