#include "member/unit_run.h"

#include <stdlib.h>
#include <string.h>

#include "algebra/lanes.h"
#include "member/cases.h"
#include "member/subdomain_struct.h"

struct pma_unit_run {
    pma_subdomain lanes; /* matrices and factors alone, for the response */
    pma_response *response;
    double *lam, *end, *mean; /* p each: unit multipliers; sums of L_b v, see the header */
};

pma_status pma_unit_run_create(const pma_subdomain *s, pma_unit_run **out)
{
    *out = NULL;
    pma_unit_run *r = calloc(1, sizeof *r);
    if (!r)
        return PMA_NO_MEMORY;
    r->lanes.parts = pma_parts_in_lanes(&s->parts);
    r->lanes.update = s->update;
    r->lam = calloc(3 * r->lanes.parts.link.p + 1, sizeof *r->lam);
    r->end = r->lam + r->lanes.parts.link.p;
    r->mean = r->end + r->lanes.parts.link.p;
    const pma_status status = r->lam ? pma_response_create(&r->lanes, &r->response) : PMA_NO_MEMORY;
    if (status == PMA_OK)
        *out = r;
    else
        pma_unit_run_destroy(r);
    return status;
}

void pma_unit_run_destroy(pma_unit_run *r)
{
    if (!r)
        return;
    pma_response_destroy(r->response);
    free(r->lam);
    free(r);
}

void pma_unit_run_begin(pma_unit_run *r, bool twice, size_t count, const int64_t *rows)
{
    memset(r->lam, 0, 3 * r->lanes.parts.link.p * sizeof *r->lam); /* all three */
    for (size_t l = 0; l < count; l++)
        r->lam[(size_t)rows[l] * PMA_LANES + l] = 1.0;
    pma_response_begin(r->response, twice, r->lam);
}

void pma_unit_run_step(pma_unit_run *r, size_t j)
{
    const pma_parts *p = &r->lanes.parts;
    const pma_state *x = pma_response_state(r->response);
    const double *v = pma_interface_of(&r->lanes, x->v), *u = pma_interface_of(&r->lanes, x->u);
    pma_response_step(r->response, j, r->lam);
    pma_link_gather(&p->link, 1.0 / (double)p->substeps, v, r->mean);
    if (j == p->substeps)
        pma_link_gather(&p->link, 1.0, p->mean ? u : v, r->end);
}

/* ---- results -------------------------------------------------------------------------------- */

double pma_unit_run_end(const pma_unit_run *r, size_t lane, int64_t row)
{
    return r->end[(size_t)row * PMA_LANES + lane];
}

double pma_unit_run_mean(const pma_unit_run *r, size_t lane, int64_t row)
{
    return r->mean[(size_t)row * PMA_LANES + lane];
}

void pma_unit_run_copy(const pma_unit_run *r, size_t lane, double *out)
{
    const double *u = pma_response_state(r->response)->u;
    for (size_t i = 0; i < 4 * r->lanes.parts.n / PMA_LANES; i++)
        out[i] = u[i * PMA_LANES + lane];
}

bool pma_unit_run_is_finite(const pma_unit_run *r)
{
    return pma_is_finite(4 * r->lanes.parts.n, pma_response_state(r->response)->u);
}
