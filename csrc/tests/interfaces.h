/* interfaces.h - interface problems of a few constraints whose matrices need not be symmetric. */
#ifndef PMA_TEST_INTERFACES_H
#define PMA_TEST_INTERFACES_H

#include <stddef.h>
#include <stdint.h>

#include "coupling/interface.h"

enum { MOST_ROWS = 2 };

/* Memory of the factors; not to be moved. */
typedef struct {
    double inverse[MOST_ROWS], L[MOST_ROWS], U[MOST_ROWS];
    int64_t below[MOST_ROWS + 1], above[MOST_ROWS + 1];
    int32_t lower[MOST_ROWS], upper[MOST_ROWS], places[MOST_ROWS];
    pma_interface S_mu;
} dense_lu;

/* What a coupler is given for A (p*p by rows), factored without row exchanges. */
pma_interface dense_lu_interface(dense_lu *lu, size_t p, const double *A);

#endif
