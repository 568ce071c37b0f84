#include "subdomain/cases.h"

#include <stdlib.h>
#include <string.h>

#include "algebra/lanes.h"
#include "object.h"
#include "subdomain/inside.h"

bool pma_cases_are_possible(const pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    return !p->restoring.function && p->internal.count == 0 && !p->has_internal;
}

/* ---- springs -------------------------------------------------------------------------------- */

static size_t parameters_of(const pma_springs *springs)
{
    size_t count = 0;
    for (size_t s = 0; s < springs->count; s++)
        count += springs->sets[s].count * pma_spring_parameters(&springs->sets[s]);
    return count;
}

static int32_t dof_in_lane(int32_t dof, size_t lane)
{
    return dof < 0 ? dof : (int32_t)((size_t)dof * PMA_LANES + lane);
}

/* Spring i of lane l is number i * PMA_LANES + l of its set. */
static void spread_set(const pma_spring_set *each, pma_spring_set *set, int32_t *dofs,
                       double *numbers)
{
    const size_t count = each->count * PMA_LANES;
    int32_t *first = dofs, *second = dofs + count;
    *set = (pma_spring_set){.law = each->law,
                            .count = count,
                            .elements = each->elements,
                            .first = first,
                            .second = second};
    for (size_t k = 0; k < count; k++) {
        first[k] = dof_in_lane(each->first[k / PMA_LANES], k % PMA_LANES);
        second[k] = dof_in_lane(each->second[k / PMA_LANES], k % PMA_LANES);
    }
    for (size_t q = 0; q < pma_spring_parameters(each); q++, numbers += count) {
        for (size_t k = 0; k < count; k++)
            numbers[k] = each->parameters[q][k / PMA_LANES];
        set->parameters[q] = numbers;
    }
}

/* The springs of all lanes, in one block that the subdomain will own. */
static pma_status spread_springs(const pma_springs *each, pma_springs *out, void **block)
{
    const size_t numbers = parameters_of(each) * PMA_LANES, dofs = 2 * each->total * PMA_LANES;
    *out = (pma_springs){.count = each->count, .total = each->total * PMA_LANES, .in_lanes = true};
    *block = malloc(each->count * sizeof(pma_spring_set) + numbers * sizeof(double) +
                    dofs * sizeof(int32_t) + 1);
    if (!*block)
        return PMA_NO_MEMORY;
    pma_spring_set *sets = *block;
    double *parameters = (double *)(sets + each->count);
    int32_t *ends = (int32_t *)(parameters + numbers);
    for (size_t s = 0; s < each->count; s++) {
        const size_t count = each->sets[s].count * PMA_LANES;
        spread_set(&each->sets[s], &sets[s], ends, parameters);
        ends += 2 * count;
        parameters += count * pma_spring_parameters(&each->sets[s]);
    }
    out->sets = sets;
    return PMA_OK;
}

/* ---- making --------------------------------------------------------------------------------- */

static pma_operator operator_in_lanes(const pma_operator *each)
{
    return (pma_operator){.step = each->step, .factor = pma_factor_in_lanes(&each->factor)};
}

static pma_parts parts_in_lanes(const pma_parts *each)
{
    pma_parts parts = *each;
    parts.n *= PMA_LANES;
    parts.nb *= PMA_LANES;
    parts.K = pma_matrix_in_lanes(&each->K);
    parts.C = pma_matrix_in_lanes(&each->C);
    parts.D_r = pma_matrix_in_lanes(&each->D_r);
    parts.K_r = pma_matrix_in_lanes(&each->K_r);
    parts.single = operator_in_lanes(&each->single);
    if (each->doubled)
        parts.twice = operator_in_lanes(&each->twice);
    if (each->mean)
        parts.mass = pma_factor_in_lanes(&each->mass);
    parts.link = pma_link_in_lanes(&each->link);
    return parts;
}

pma_status pma_cases_create(pma_subdomain *of, pma_subdomain **out)
{
    pma_parts parts = parts_in_lanes(&of->parts);
    void *block;
    *out = NULL;
    /* positions in lanes have to fit into those of springs and records */
    if (!pma_cases_are_possible(of) || parts.n > INT32_MAX)
        return PMA_BAD_SIZE;
    pma_status status = spread_springs(&of->parts.springs, &parts.springs, &block);
    if (status == PMA_OK)
        status = pma_subdomain_create(&parts, out);
    if (status != PMA_OK) {
        free(block);
        return status;
    }
    (*out)->spread = block;
    if (of->response)
        (*out)->response->units = of->response->units;
    return pma_subdomain_watch_lanes(*out, of);
}

/* ---- unit responses, PMA_LANES constraints in one pass -------------------------------------- */

struct pma_unit_response {
    pma_subdomain lanes; /* matrices and factors alone, for the response */
    pma_response *response;
    double *lam, *end, *mean; /* p each: unit multipliers; sums of L_b v, see the header */
};

pma_status pma_unit_response_create(const pma_subdomain *s, pma_unit_response **out)
{
    const size_t p = s->parts.link.p * PMA_LANES;
    const pma_array arrays[] = {PMA_ARRAY(pma_unit_response, lam, p),
                                PMA_ARRAY(pma_unit_response, end, p),
                                PMA_ARRAY(pma_unit_response, mean, p),
                                {0}};
    pma_unit_response *r = *out = pma_object_create(sizeof *r, arrays);
    if (!r)
        return PMA_NO_MEMORY;
    r->lanes.parts = parts_in_lanes(&s->parts);
    r->lanes.update = s->update;
    const pma_status status = pma_response_create(&r->lanes, &r->response);
    if (status != PMA_OK) {
        free(r);
        *out = NULL;
    }
    return status;
}

void pma_unit_response_destroy(pma_unit_response *r)
{
    if (r)
        pma_response_destroy(r->response);
    free(r);
}

void pma_unit_response_begin(pma_unit_response *r, bool twice, size_t count, const int64_t *rows)
{
    const size_t bytes = r->lanes.parts.link.p * sizeof *r->lam;
    memset(r->lam, 0, bytes);
    memset(r->end, 0, bytes);
    memset(r->mean, 0, bytes);
    for (size_t l = 0; l < count; l++)
        r->lam[(size_t)rows[l] * PMA_LANES + l] = 1.0;
    pma_response_begin(r->response, twice, r->lam);
}

void pma_unit_response_step(pma_unit_response *r, size_t j)
{
    const pma_parts *p = &r->lanes.parts;
    const pma_state *x = &r->response->state;
    const double *v = pma_interface_of(&r->lanes, x->v), *u = pma_interface_of(&r->lanes, x->u);
    pma_response_step(r->response, j, r->lam);
    pma_link_gather(&p->link, 1.0 / (double)p->substeps, v, r->mean);
    if (j == p->substeps)
        pma_link_gather(&p->link, 1.0, p->mean ? u : v, r->end);
}

/* ---- results -------------------------------------------------------------------------------- */

double pma_unit_response_end(const pma_unit_response *r, size_t lane, int64_t row)
{
    return r->end[(size_t)row * PMA_LANES + lane];
}

double pma_unit_response_mean(const pma_unit_response *r, size_t lane, int64_t row)
{
    return r->mean[(size_t)row * PMA_LANES + lane];
}

void pma_unit_response_copy(const pma_unit_response *r, size_t lane, double *out)
{
    const double *u = r->response->state.u;
    for (size_t i = 0; i < 4 * r->lanes.parts.n / PMA_LANES; i++)
        out[i] = u[i * PMA_LANES + lane];
}

bool pma_unit_response_is_finite(const pma_unit_response *r)
{
    return pma_is_finite(4 * r->lanes.parts.n, r->response->state.u);
}
