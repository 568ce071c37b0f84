/* load.h - the external force F(t) of a subdomain, evaluated at the end of a step only. */
#ifndef PMA_LOAD_H
#define PMA_LOAD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "status.h"

typedef enum {
    PMA_LOAD_NONE,
    PMA_LOAD_CONSTANT,
    PMA_LOAD_SAMPLED,
    PMA_LOAD_TABLE,
    PMA_LOAD_CALLED
} pma_load_kind;

/* f (n) := F(t), in the user's order of dofs; f arrives zeroed. Other than 0: stop the run. */
typedef int (*pma_force_function)(double t, intptr_t n, double *f, void *user);

/* Bare arrays of the caller, who keeps them alive. */
typedef struct {
    pma_load_kind kind;
    size_t n;
    const double *values; /* constant: n; sampled: samples x k by rows; table: rows x n by rows */
    const double *shape;  /* sampled: k vectors of length n, or NULL: k = n and the unit matrix */
    size_t samples, k;
    double dt;            /* sampled: time between two samples, the first at t = 0 */
    bool hold;            /* sampled: keep the last sample after the end, else zero */
    int64_t first;        /* table: the own step whose load is row 0, own steps counted from 0 */
    size_t rows;
    pma_force_function function; /* called */
    void *user;
    const int64_t *order; /* called: n, the user's dof at each place, each in 0..n-1 */
    double *work;         /* called: n, the last answer */
} pma_load;

/* Asks a called load for F(t), of any other nothing. PMA_FORCE_FAILED when the function returns
 * other than 0, which goes to *code. */
pma_status pma_load_ask(const pma_load *load, double t, int *code);

/* g (n) += F(t), where t ends the own step `step`; of a called load what it was last asked for.
 * Does not allocate. */
void pma_load_add(const pma_load *load, double t, int64_t step, double *g);

/* the same for the rows begin..end-1 of g alone */
void pma_load_add_rows(const pma_load *load, double t, int64_t step, size_t begin, size_t end,
                       double *g);

#endif
