#include "forces/restoring.h"

#include <assert.h>
#include <string.h>

pma_status pma_restoring_check(const pma_restoring *restoring)
{
    for (size_t i = 0; restoring->function && i < restoring->n; i++) {
        if (restoring->order[i] < 0 || (size_t)restoring->order[i] >= restoring->n)
            return PMA_BAD_INDEX;
    }
    return PMA_OK;
}

void pma_restoring_accelerate(const pma_restoring *restoring, const double *w, double ahead)
{
    pma_cell *cell = restoring->cell;
    if (!cell || !cell->a)
        return;
    cell->ahead = w ? ahead : 0.0;
    for (size_t i = 0; i < restoring->n; i++)
        cell->a[restoring->order[i]] = w ? w[i] : 0.0;
}

pma_status pma_restoring_subtract(const pma_restoring *restoring, double t, const double *u,
                                  const double *v, const double *from, double *to, double *y,
                                  int *code)
{
    assert(restoring->function && restoring->work);
    const size_t n = restoring->n;
    const int64_t *order = restoring->order;
    double *own_u = restoring->work, *own_v = own_u + n, *r = own_v + n;
    for (size_t i = 0; i < n; i++) {
        own_u[order[i]] = u[i];
        own_v[order[i]] = v[i];
    }
    memset(r, 0, n * sizeof(double));
    if (restoring->memory > 0) {
        if (to != from)
            memcpy(to, from, restoring->memory * sizeof(double));
        restoring->cell->memory = to;
        restoring->cell->refused = false;
    }
    *code = restoring->function(t, (intptr_t)n, own_u, own_v, r, restoring->user);
    if (*code != 0)
        return restoring->memory > 0 && restoring->cell->refused ? PMA_LIMITED
                                                                 : PMA_RESTORING_FAILED;
    for (size_t i = 0; i < n; i++)
        y[i] -= r[order[i]];
    return PMA_OK;
}

const double *pma_restoring_last(const pma_restoring *restoring)
{
    return restoring->work + 2 * restoring->n;
}

double pma_restoring_force(const pma_restoring *restoring, size_t i)
{
    const int64_t k = restoring->order[i];
    return pma_restoring_last(restoring)[k] + (restoring->load ? restoring->load[k] : 0.0);
}
