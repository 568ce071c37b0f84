/* interfaces.h - interface problems of a few constraints whose matrices need not be symmetric. */
#ifndef PMA_TEST_INTERFACES_H
#define PMA_TEST_INTERFACES_H

#include <stddef.h>

#include "solve/interface.h"

enum { MOST_ROWS = 2 };

/* Memory of the factors; not to be moved. */
typedef struct {
    double inverse[MOST_ROWS], values[2 * MOST_ROWS * MOST_ROWS]; /* of R and Q */
    pma_interface interface;
} unsymmetric_interface;

/* What a coupler is given for A (p*p by rows), factored without row exchanges. */
pma_interface make_unsymmetric_interface(unsymmetric_interface *x, size_t p, const double *A);

#endif
