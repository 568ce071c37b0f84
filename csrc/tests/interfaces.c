/* interfaces.c - see interfaces.h. */
#include "interfaces.h"

#include <assert.h>

#include "check.h"

pma_interface dense_lu_interface(dense_lu *lu, size_t p, const double *A)
{
    assert(p >= 1 && p <= MOST_ROWS);
    lu->inverse[0] = 1.0 / A[0];
    lu->places[1] = 1;
    if (p == 2) {
        lu->L[0] = A[2] * lu->inverse[0];
        lu->U[0] = A[1];
        lu->inverse[1] = 1.0 / (A[3] - lu->L[0] * A[1]);
        lu->lower[0] = 1;
        lu->upper[0] = 0;
        lu->below[1] = lu->below[2] = lu->above[2] = 1;
    }
    const pma_lu factors = {.n = p,
                            .p = p,
                            .inverse = lu->inverse,
                            .below = lu->below,
                            .lower = lu->lower,
                            .L = lu->L,
                            .above = lu->above,
                            .upper = lu->upper,
                            .U = lu->U,
                            .row = lu->places,
                            .column = lu->places};
    pma_interface_destroy(&lu->S_mu);
    CHECK_STATUS(pma_interface_create_lu(&factors, &lu->S_mu), PMA_OK);
    return lu->S_mu;
}
