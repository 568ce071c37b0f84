#include "algebra/lanes.h"

/* ---- as forms ------------------------------------------------------------------------------- */

pma_matrix pma_lanes_matrix(const pma_matrix *each)
{
    const pma_form form = each->form == PMA_ZERO ? PMA_ZERO : PMA_IN_LANES;
    return (pma_matrix){.form = form, .n = each->n * PMA_LANES, .each = each};
}

pma_link pma_lanes_link(const pma_link *each)
{
    return (pma_link){.p = each->p * PMA_LANES, .nb = each->nb * PMA_LANES, .each = each};
}

pma_factor pma_lanes_factor(const pma_factor *each)
{
    return (pma_factor){
        .form = PMA_IN_LANES, .n = each->n * PMA_LANES, .nb = each->nb * PMA_LANES, .each = each};
}

/* ---- apart ---------------------------------------------------------------------------------- */

void pma_lanes_split(size_t n, const double *x, size_t count, double *const *out)
{
    for (size_t i = 0; i < n; i++) {
        for (size_t l = 0; l < count; l++)
            out[l][i] = x[i * PMA_LANES + l];
    }
}
