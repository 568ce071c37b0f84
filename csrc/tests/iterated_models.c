/* iterated_models.c - see iterated_models.h. */
#include "iterated_models.h"

#include <math.h>
#include <string.h>

#include "check.h"
#include "models.h"

bool has_inner(const model *m)
{
    for (size_t i = 0; i < m->count; i++) {
        if (m->subdomains[i].inner.used)
            return true;
    }
    return false;
}

const pma_schedule *schedule_of(const model *m)
{
    if (has_inner(m))
        return m->macro ? &pma_shooting_schedule : &pma_iterated_schedule;
    if (m->mean)
        return &pma_mean_schedule;
    return m->macro ? &pma_macro_schedule : &pma_fine_schedule;
}

/* Linear springs between dofs 0 and 1, and dof 1 and the ground. */
static const int32_t ENDS[2] = {0, 1}, OTHER_ENDS[2] = {1, -1};
static const double STIFF[2] = {0.5, 1.0}, NONE[2] = {0.0, 0.0};
static const pma_spring_set LINEAR_SPRINGS = {
    .law = PMA_CUBIC, .count = 2, .first = ENDS, .second = OTHER_ENDS, .parameters = {STIFF, NONE}};

void fill_inner(subdomain *x, bool used, const chain *chosen)
{
    inner *in = &x->inner;
    if (!used)
        return;
    *in = (inner){.used = true, .springs = chosen->sprung, .keeps = chosen->newton.reuse};
    if (chosen->nonlinear) {
        in->cubic = 2.0;
        in->ramp = 0.5;
        in->plastic = 4.0;
        in->yield = 0.25;
    } else if (chosen->sprung) {
        x->springs = (pma_springs){.count = 1, .sets = &LINEAR_SPRINGS, .total = 2};
        in->springs_K[0] = STIFF[0];
        in->springs_K[1] = in->springs_K[x->n] = -STIFF[0];
        in->springs_K[x->n + 1] = STIFF[0] + STIFF[1];
    }
}

static void sum_up(iteration_memory *it, const model *m, bool later)
{
    memset(it->constant[later], 0, sizeof it->constant[later]);
    memset(it->response[later], 0, sizeof it->response[later]);
    for (size_t i = 0; i < m->count; i++) {
        const subdomain *x = &m->subdomains[i];
        if (!x->inner.used || !x->implicit)
            add_interface(m, x, later, it->constant[later]);
        if (!x->inner.used)
            add_interface(m, x, later, it->response[later]);
    }
}

const pma_iteration_parts *describe_iteration(model *m)
{
    iteration_memory *it = &m->iteration;
    const size_t p = m->p;
    if (!has_inner(m))
        return NULL;
    sum_up(it, m, false);
    sum_up(it, m, true);
    for (size_t i = 0; i < p * p; i++)
        it->H_size[i] = fabs(m->H[0][i]);
    it->parts = (pma_iteration_parts){
        .newton = m->newton,
        .H = describe_full(&it->pattern, p, p),
        .start = it->constant[0],
        .later = it->constant[1],
        .response_start = {.form = PMA_DENSE, .n = p, .values = it->response[0]},
        .response = {.form = PMA_DENSE, .n = p, .values = it->response[1]},
        .H_size = {.form = PMA_DENSE, .n = p, .values = it->H_size},
    };
    return &it->parts;
}

void start_histories(model *m)
{
    for (size_t i = 0; i < m->count; i++) {
        subdomain *x = &m->subdomains[i];
        double r[MOST];
        if (x->inner.used)
            CHECK_STATUS(pma_subdomain_evaluate_restoring(x->core, 0.0, x->u0, x->v0, r), PMA_OK);
    }
}

/* ---- the present ----------------------------------------------------------------------------- */

static pma_coupler *coupler_of(const model *m)
{
    return m->coupler;
}

size_t copy_iteration(const model *m, double *out)
{
    size_t count = 0;
    for (size_t i = 0; i < m->count; i++) {
        const subdomain *x = &m->subdomains[i];
        pma_iterate *it = pma_subdomain_iterate(x->core);
        const double *history = pma_subdomain_present(x->core)->history;
        const double *springs = pma_subdomain_present(x->core)->springs;
        for (size_t k = 0; k < SPRING_FIELDS * x->springs.total; k++)
            out[count++] = springs[k];
        for (size_t k = 0; x->inner.used && k < HISTORY + (it ? 1 : 0); k++)
            out[count++] = history[k];
        if (it)
            out[count++] = pma_iterate_kept(it).scale;
    }
    const pma_state_array kept = present_array(coupler_of(m), "shooting");
    for (size_t k = 0; k < kept.count; k++)
        out[count++] = kept.values[k];
    return count;
}

void carry_over(const model *from, model *to)
{
    double g[CONSTRAINTS];
    memcpy(g, pma_coupler_prescribed(from->coupler), from->p * sizeof(double));
    pma_coupler_start(to->coupler, pma_coupler_step_count(from->coupler),
                      pma_coupler_multipliers(from->coupler), g);
    const pma_state_array kept = present_array(from->coupler, "shooting");
    const pma_state_array restored = present_array(to->coupler, "shooting");
    for (size_t k = 0; k < kept.count; k++)
        restored.values[k] = kept.values[k];
    for (size_t i = 0; i < from->count; i++) {
        const subdomain *x = &from->subdomains[i];
        (void)copy_levels(x->core, to->subdomains[i].core);
        const pma_iterate *it = pma_subdomain_iterate(x->core);
        if (it)
            CHECK_STATUS(pma_iterate_restore(pma_subdomain_iterate(to->subdomains[i].core),
                                             pma_iterate_kept(it)),
                         PMA_OK);
    }
}
