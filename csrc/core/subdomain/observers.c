/* observers.c - what watches the substeps of a subdomain and changes none: the energy, whose works
 * are summed up, and the balance of forces that are evaluated. */
#include <math.h>
#include <string.h>

#include "algebra/lanes.h"
#include "memory.h"
#include "subdomain/inside.h"

/* ---- balance -------------------------------------------------------------------------------- */

static pma_status watch(pma_subdomain *s, const pma_balance_parts *parts)
{
    pma_balance *balance;
    PMA_TRY(pma_balance_create(parts, &balance));
    pma_balance_destroy(s->balance);
    s->balance = balance;
    s->is_observed = true;
    pma_subdomain_watch_again(s);
    return PMA_OK;
}

/* Of a motion that changes its sign with each step, where a is a share of w                (B15) */
static pma_step_limits limits_of(const pma_step *c)
{
    const double kept = 1.0 + c->a_a;
    const double share = fabs(kept) > 1e-9 ? (c->a_w1 - c->a_w) / kept : 1.0;
    const double v = -0.5 * (c->v_a * share + c->v_w - c->al2);
    const double u = -0.5 * (c->h * v + c->u_a * share + c->u_w - c->al1);
    return (pma_step_limits){
        .h = c->h, .al1 = c->al1, .stiff = c->al1 - u, .inert = u, .damp = c->h + v};
}

pma_status pma_subdomain_watch(pma_subdomain *s, pma_matrix M, pma_matrix K_r, bool is_explicit)
{
    const pma_parts *p = &s->parts;
    const pma_matrix none = {.form = PMA_ZERO, .n = p->n};
    const bool follows = !p->doubled; /* vs is that of the level before */
    const bool responds = p->has_responses && p->nb > 0;
    const bool bends = s->iterate && p->internal.count > 0;
    const bool springs = s->iterate && !p->iterate->springs && p->springs.total > 0;
    const pma_balance_parts parts = {
        .n = p->n,
        .lanes = 1,
        .substeps = p->substeps,
        .has_responses = responds,
        .corrects = K_r.form != PMA_ZERO,
        .is_passive = p->restoring.function || (!s->iterate && p->internal.count > 0),
        .estimates = p->restoring.function && !p->has_responses && K_r.form != PMA_ZERO,
        .is_pushed = p->mean,
        .doubled = p->doubled,
        .is_explicit = is_explicit,
        .has_functions = p->restoring.function || (!s->iterate && p->internal.count > 0) || springs,
        .has_rates = p->restoring.function && !s->iterate,
        .single = limits_of(&p->single.step),
        .twice = limits_of(p->doubled ? &p->twice.step : &p->single.step),
        .M = M,
        .K = p->K,
        .K_r = responds ? p->K_r : K_r,
        .D_r = follows ? p->D_r : none,
        .springs = &p->springs,
        .iterates = s->iterate != NULL,
        .iterates_springs = s->iterate && p->iterate->springs,
        .ptr = bends ? p->iterate->tangent.ptr : NULL,
        .index = bends ? p->iterate->tangent.index : NULL};
    return watch(s, &parts);
}

pma_status pma_subdomain_watch_lanes(pma_subdomain *s, const pma_subdomain *each)
{
    if (!each->balance)
        return PMA_OK;
    const pma_balance_parts *of = pma_balance_get_parts(each->balance);
    pma_balance_parts parts = *of;
    parts.n = s->parts.n;
    parts.lanes = PMA_LANES;
    parts.M = pma_matrix_in_lanes(&of->M);
    parts.K = s->parts.K;
    parts.K_r = pma_matrix_in_lanes(&of->K_r);
    parts.D_r = pma_matrix_in_lanes(&of->D_r);
    parts.springs = &s->parts.springs;
    return watch(s, &parts);
}

void pma_subdomain_watch_again(pma_subdomain *s)
{
    s->evaluated.number[0] = s->evaluated.number[1] = PMA_NO_SUBSTEP;
    if (s->balance)
        pma_balance_begin(s->balance);
    if (s->rig)
        pma_rig_begin(s->rig, NULL);
}

const pma_balance *pma_subdomain_balance(const pma_subdomain *s)
{
    return s->balance;
}

/* ---- energy --------------------------------------------------------------------------------- */

/* f of the internal functions, as evaluated last; NULL if there are none */
static double *internal_force_of(const pma_subdomain *s)
{
    if (!s->internal)
        return NULL;
    return s->iterate ? pma_iterate_force(s->iterate) : s->internal->force;
}

static double *potential_of(const pma_subdomain *s)
{
    return pma_internal_has_potential(&s->parts.internal) ? &s->internal->potential : NULL;
}

static pma_status evaluate_potential(pma_subdomain *s, const double *u)
{
    pma_internal_forces *f = s->internal;
    return f ? pma_internal_potential(&s->parts.internal, u, &f->potential, f->force + s->parts.n,
                                      &s->code)
             : PMA_OK;
}

pma_status pma_subdomain_evaluate_present(pma_subdomain *s, double t)
{
    const pma_internal *internal = &s->parts.internal;
    const pma_state *x = &s->levels.present;
    double *f = internal_force_of(s);
    if (!f)
        return PMA_OK;
    double *after = pma_memory_allocate(internal->history + 1, sizeof *after); /* not taken over */
    if (!after)
        return PMA_NO_MEMORY;
    memset(f, 0, s->parts.n * sizeof *f);
    const pma_internal_point at = {.t = t, .u = x->u, .v = x->v, .q = x->history};
    const pma_internal_values out = {.f = f, .q1 = after};
    pma_status status =
        pma_internal_evaluate(internal, &at, &out, s->internal->force + s->parts.n, &s->code);
    pma_memory_release(after);
    return status == PMA_OK ? evaluate_potential(s, x->u) : status;
}

/* Works are summed up anew. */
static pma_status replace_energy(pma_subdomain *s, pma_matrix M, pma_matrix skew)
{
    pma_energy *energy;
    const pma_energy_parts parts = {.n = s->parts.n,
                                    .nb = s->parts.nb,
                                    .substeps = s->parts.substeps,
                                    .has_responses = s->parts.has_responses,
                                    .doubled = s->parts.doubled,
                                    .implicit = s->parts.single.step.al1 > 0.0,
                                    .M = M,
                                    .skew = skew,
                                    .K = s->parts.K,
                                    .C = s->parts.C,
                                    .link = s->parts.link,
                                    .load = &s->load,
                                    .restoring = &s->parts.restoring,
                                    .internal = internal_force_of(s),
                                    .potential = potential_of(s),
                                    .springs = &s->parts.springs};
    PMA_TRY(pma_energy_create(&parts, &energy));
    pma_subdomain_end_energy(s);
    s->energy = energy;
    s->is_observed = true;
    return PMA_OK;
}

pma_status pma_subdomain_begin_energy(pma_subdomain *s, pma_matrix M, pma_matrix skew,
                                      const double *load, const double *lam,
                                      const double *functions)
{
    PMA_TRY(replace_energy(s, M, skew));
    pma_energy_begin(s->energy, &s->levels.present, load, lam, functions);
    return PMA_OK;
}

pma_energy *pma_subdomain_energy(const pma_subdomain *s)
{
    return s->energy;
}

pma_status pma_subdomain_follow_energy(pma_subdomain *s, const pma_subdomain *from)
{
    if (!from->energy)
        return PMA_OK;
    const pma_energy_parts *of = pma_energy_get_parts(from->energy);
    PMA_TRY(replace_energy(s, of->M, of->skew));
    pma_energy_follow(s->energy, from->energy);
    return PMA_OK;
}

void pma_subdomain_end_energy(pma_subdomain *s)
{
    if (!s)
        return;
    pma_energy_destroy(s->energy);
    s->energy = NULL;
    s->is_observed = s->balance != NULL;
}

/* ---- hooks of a step ----------------------------------------------------------------------- */

pma_status pma_observers_open(const pma_subdomain *s)
{
    return s->balance && pma_balance_is_broken(s->balance) ? PMA_UNBOUNDED : PMA_OK;
}

void pma_observers_evaluate(pma_subdomain *s, const pma_substep *step, const pma_state *to)
{
    if (!s->balance)
        return;
    s->watched = pma_balance_open(s->balance, step->number, to->u);
    memcpy(s->watched.r, to->w, s->parts.n * sizeof(double));
}

/* total (n) := what has been subtracted since y was r, and r the same without loads that depend on
 * the motion */
void pma_observers_evaluated(const pma_subdomain *s, const pma_state *to)
{
    const pma_evaluated_forces *f = &s->watched;
    const double *y = to->w;
    const pma_restoring *restoring = &s->parts.restoring;
    const size_t n = s->parts.n;
    double *r = f->r;
    if (!s->balance)
        return;
#pragma omp simd
    for (size_t i = 0; i < n; i++)
        r[i] -= y[i];
    if (f->total)
        memcpy(f->total, r, n * sizeof(double));
    if (f->vs)
        memcpy(f->vs, s->vs, n * sizeof(double));
    for (size_t i = 0; restoring->function && restoring->load && i < n; i++)
        r[i] += restoring->load[restoring->order[i]];
}

static pma_status sum_up(pma_subdomain *s, const pma_substep *step, const double *lam)
{
    if (!s->energy)
        return PMA_OK;
    const pma_state *x = pma_levels_at(&s->levels, step->j + 1);
    if ((step->j + 1) % s->parts.substeps == 0) /* energies are those of macro time levels */
        PMA_TRY(evaluate_potential(s, x->u));
    if (step->is_free_run)
        pma_energy_close_free(s->energy, step, x);
    else
        pma_energy_close(s->energy, step, x, lam);
    return PMA_OK;
}

pma_status pma_observers_close(pma_subdomain *s, const pma_substep *step, const double *lam)
{
    if (s->balance)
        pma_balance_close(s->balance, step, pma_levels_at(&s->levels, step->j + 1));
    return sum_up(s, step, lam);
}

void pma_observers_respond(const pma_subdomain *s, size_t j, const double *lam, const double *dlam)
{
    const pma_response *r = s->response;
    if (s->energy)
        pma_energy_advance_response(s->energy, j, r->twice, &r->state, lam, dlam);
    if (s->balance && s->parts.nb > 0)
        pma_balance_advance_response(s->balance, j, r->twice, &r->state);
}

void pma_observers_commit(pma_subdomain *s)
{
    if (s->balance)
        pma_balance_commit(s->balance, &s->levels.present);
    if (s->energy)
        pma_energy_commit(s->energy);
}
