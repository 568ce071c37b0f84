/* load.h - the external force F(t) of a subdomain, evaluated at the end of a step only. */
#ifndef PMA_LOAD_H
#define PMA_LOAD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef enum { PMA_LOAD_NONE, PMA_LOAD_CONSTANT, PMA_LOAD_SAMPLED, PMA_LOAD_TABLE } pma_load_kind;

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
} pma_load;

/* g (n) += F(t), where t ends the own step `step`. Does not allocate. */
void pma_load_add(const pma_load *load, double t, int64_t step, double *g);

#endif
