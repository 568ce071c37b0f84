#include "subdomain/subdomain.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "algebra/lanes.h"
#include "algebra/lists.h"
#include "memory.h"
#include "object.h"
#include "subdomain/inside.h"
#include "subdomain/iterated_substep.h"

/* ---- checks --------------------------------------------------------------------------------- */

static pma_status check_operator(const pma_parts *parts, const pma_operator *op)
{
    if (parts->iterate)
        return PMA_OK; /* its factor is not read */
    if (op->factor.n != parts->n || op->factor.nb != parts->nb)
        return PMA_BAD_SIZE;
    return pma_factor_check(&op->factor);
}

static bool has_size(const pma_matrix *A, size_t n)
{
    return A->form == PMA_ZERO || A->n == n;
}

static pma_status check_sizes(const pma_parts *p)
{
    if (p->n == 0 || p->nb > p->n || p->substeps == 0 || p->substeps > PMA_MOST_SUBSTEPS)
        return PMA_BAD_SIZE;
    if (p->K.n != p->n || p->C.n != p->n || p->link.nb != p->nb)
        return PMA_BAD_SIZE;
    if ((p->deferred && !(p->mean && p->substeps == 1)) || (p->continues && !p->doubled))
        return PMA_BAD_SIZE;
    if (p->restoring.function && p->restoring.n != p->n)
        return PMA_BAD_SIZE;
    if ((p->has_internal && p->M.n != p->n) || (p->iterate && !p->has_internal))
        return PMA_BAD_SIZE;
    return has_size(&p->D_r, p->n) && has_size(&p->K_r, p->n) ? PMA_OK : PMA_BAD_SIZE;
}

static pma_status check_internal(const pma_parts *parts)
{
    const pma_iterate_parts *iterate = parts->iterate;
    if (parts->internal.count > 0 && parts->internal.n != parts->n)
        return PMA_BAD_SIZE;
    if (parts->has_internal)
        PMA_TRY(pma_matrix_check(&parts->M));
    return pma_internal_check(&parts->internal,
                              iterate ? (size_t)iterate->tangent.ptr[parts->n] : SIZE_MAX);
}

static pma_status check_mass(const pma_parts *parts)
{
    if (!parts->mean)
        return PMA_OK;
    if (parts->mass.n != parts->n || !(parts->has_responses || parts->has_internal))
        return PMA_BAD_SIZE;
    return pma_factor_check(&parts->mass);
}

/* Two stages under single steps alone, as they were derived. */
static pma_status check_stages(const pma_parts *p)
{
    const pma_step *first = &p->single.step, *second = &p->second;
    if (!p->staged)
        return PMA_OK;
    if (p->substeps % 2 != 0 || p->doubled || p->mean || p->has_responses || p->impulse.inverse)
        return PMA_BAD_SIZE;
    return second->h > 0.0 && second->al1 == first->al1 && second->al2 == first->al2 ? PMA_OK
                                                                                     : PMA_BAD_STEP;
}

static pma_status check_parts(const pma_parts *parts)
{
    PMA_TRY(check_sizes(parts));
    PMA_TRY(pma_matrix_check(&parts->K));
    PMA_TRY(pma_matrix_check(&parts->C));
    PMA_TRY(pma_restoring_check(&parts->restoring));
    PMA_TRY(pma_springs_check(&parts->springs, parts->n));
    PMA_TRY(check_internal(parts));
    PMA_TRY(pma_matrix_check(&parts->D_r));
    PMA_TRY(pma_matrix_check(&parts->K_r));
    PMA_TRY(pma_link_check(&parts->link));
    PMA_TRY(check_mass(parts));
    PMA_TRY(pma_impulse_check(&parts->impulse, parts->n, parts->nb));
    PMA_TRY(check_operator(parts, &parts->single));
    PMA_TRY(check_stages(parts));
    if (!parts->doubled)
        return PMA_OK;
    const double h = parts->single.step.h;
    if (parts->continues ? !(parts->twice.step.h > h) : parts->twice.step.h != 2.0 * h)
        return PMA_BAD_STEP;
    return check_operator(parts, &parts->twice);
}

/* ---- as a member: what a coupler calls besides ---------------------------------------------- */

static pma_status prepare(void *self)
{
    pma_subdomain *s = self;
    return pma_levels_extend(&s->levels);
}

static size_t opened(const void *self)
{
    const pma_subdomain *s = self;
    return s->levels.opened;
}

static bool is_known(const void *self, const pma_substep *step)
{
    const pma_subdomain *s = self;
    return pma_load_covers(&s->load, step->number, step->number + 1) &&
           !pma_load_has(&s->load, PMA_LOAD_CALLED);
}

static void push(void *self, const double *lam)
{
    pma_subdomain *s = self;
    s->mean->is_pushed = true;
    pma_substep_accelerate(s, lam, s->mean->push);
}

/* ---- time levels ---------------------------------------------------------------------------- */

static void record(void *self, pma_recordable what, size_t j, const double *lam,
                   const pma_selection *selection, size_t row)
{
    pma_subdomain *s = self;
    if (what == PMA_MOTION) {
        pma_selection_write(selection, pma_levels_at(&s->levels, j), row);
    } else if (what == PMA_RESPONSE) {
        pma_selection_add(selection, &s->response->state, row);
    } else {
        pma_substep_accelerate(s, lam, s->mean->acceleration);
        pma_selection_accelerate(selection, s->mean->acceleration, row);
    }
}

static void commit(void *self)
{
    pma_subdomain *s = self;
    pma_levels_commit(&s->levels);
    if (s->is_observed)
        pma_observers_commit(s);
    if (s->iterate)
        pma_iterate_commit(s->iterate);
}

static void discard(void *self)
{
    pma_subdomain *s = self;
    if (s->mean)
        s->mean->open = NULL;
    pma_levels_discard(&s->levels);
    if (s->iterate)
        pma_iterate_discard(s->iterate);
}

/* (S3)  vf := v_b - al2 S^-1 L_b^T lam with the operator of the double step */
static void rebase(void *self, size_t j, const double *lam)
{
    pma_subdomain *s = self;
    const pma_operator *op = &s->parts.twice;
    const double *v_b = pma_interface_of(s, pma_levels_at(&s->levels, j)->v);
    pma_substep_store_free_velocity(s, op, v_b, lam, pma_levels_free_velocity(&s->levels, j));
}

/* ---- energy --------------------------------------------------------------------------------- */

static bool energy(const void *self, size_t j, double *out)
{
    const pma_subdomain *s = self;
    if (s->energy && out)
        pma_energy_at(s->energy, j, pma_levels_at(&s->levels, j), out);
    return s->energy;
}

static void hold_energy(void *self, bool twice, const double *lam)
{
    const pma_subdomain *s = self;
    if (s->energy)
        pma_energy_hold(s->energy, twice, lam);
}

static double kinetic(const void *self, size_t j)
{
    const pma_subdomain *s = self;
    return pma_matrix_square(&s->parts.M, pma_levels_at(&s->levels, j)->v, s->product);
}

/* ---- link response -------------------------------------------------------------------------- */

static void begin_response(void *self, bool twice, const double *dlam)
{
    const pma_subdomain *s = self;
    pma_response_begin(s->response, twice, dlam);
}

static void advance_response(void *self, size_t j, const double *lam, const double *dlam)
{
    pma_subdomain *s = self;
    pma_response_step(s->response, j, dlam);
    if (s->is_observed)
        pma_observers_respond(s, j, lam, dlam);
}

/* A subdomain that no constraint reaches does not respond. */
static pma_status add_response(void *self, const double *dlam)
{
    const pma_subdomain *s = self;
    const pma_state *x = pma_levels_at(&s->levels, s->parts.substeps);
    return s->parts.nb > 0 ? pma_response_add(s->response, dlam, x) : PMA_OK;
}

/* The state at the end is bitwise identical, whether inner time levels are wanted or not: where the
 * response is stored, its substeps are repeated for the record and the energies alone. */
static size_t repeats(const void *self, bool recorded)
{
    const pma_subdomain *s = self;
    const bool tied = s->parts.nb > 0;
    if (s->energy || (tied && (s->balance || !pma_response_is_stored(s->response))))
        return s->parts.substeps;
    return tied && recorded ? s->parts.substeps - 1 : 0;
}

/* ---- the table ------------------------------------------------------------------------------ */

/* What this one does: steps that are iterated are begun and finished instead. */
static pma_member_table table_of(const pma_subdomain *s)
{
    pma_member_table table = {.opened = opened,
                              .values = pma_substep_values,
                              .record = record,
                              .commit = commit,
                              .discard = discard,
                              .energy = energy,
                              .hold_energy = s->parts.mean ? hold_energy : NULL,
                              .push = s->parts.mean ? push : NULL,
                              .kinetic = s->parts.has_internal ? kinetic : NULL};
    if (s->iterate)
        return table;
    table.advance = pma_substep_advance;
    table.prepare = prepare;
    table.is_known = is_known;
    table.rebase = rebase;
    if (s->parts.has_responses) {
        table.begin_response = begin_response;
        table.advance_response = advance_response;
        table.add_response = add_response;
        table.repeats = repeats;
    }
    return table;
}

/* A function of the caller's takes at least as long as reading this many entries, so that a coupler
 * looks whether to stop after each call of a slow one; a spring reads and writes about as many. */
enum { CALL_ENTRIES = 20000, SPRING_ENTRIES = 16 };

static size_t entries_of(const pma_parts *p)
{
    const size_t call = p->restoring.function || p->internal.count > 0 ? CALL_ENTRIES : 0;
    const size_t springs = SPRING_ENTRIES * p->springs.total;
    return call + springs + 2 * pma_factor_entries(&p->single.factor) + pma_matrix_entries(&p->K) +
           pma_matrix_entries(&p->C) + pma_matrix_entries(&p->D_r) + 12 * p->n;
}

static pma_evaluation forces_of(const pma_parts *p)
{
    bool by_caller = p->restoring.function && p->restoring.by_caller;
    for (size_t i = 0; i < p->internal.count; i++)
        by_caller = by_caller || p->internal.forces[i].by_caller;
    if (!p->restoring.function && p->internal.count == 0)
        return PMA_NO_FORCES;
    return by_caller ? PMA_BY_CALLER : PMA_BY_ANY;
}

pma_member pma_subdomain_member(pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    pma_member member = {.table = &s->table,
                         .self = s,
                         .link = &p->link,
                         .substeps = p->substeps,
                         .h = p->staged ? 0.5 * (p->single.step.h + p->second.h) : p->single.step.h,
                         .staged = p->staged,
                         .entries = entries_of(p),
                         .divides = s->division && !s->iterate,
                         .doubling = pma_doubling_of(p->doubled, p->continues),
                         .forces = forces_of(p),
                         .deferred = p->deferred,
                         .has_internal = p->has_internal,
                         .impulse =
                             p->impulse.inverse && !s->iterate ? &pma_impulse_operations : NULL};
    if (s->iterate)
        member.iterated = pma_iterated_substep_member(s->iterate);
    return member;
}

/* ---- making --------------------------------------------------------------------------------- */

/* Of the springs and the restoring function, of a time level. */
size_t pma_parts_memory(const pma_parts *parts)
{
    return pma_springs_numbers(&parts->springs) + parts->restoring.memory;
}

/* Counts among what a time level remembers: of springs, of functions after them, and the number of
 * corrections after the histories. */
static void find_counts(pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    const size_t springs = pma_springs_tables(&p->springs);
    pma_springs_counts(&p->springs, s->counts);
    for (size_t k = 0; k < p->restoring.tables; k++) {
        s->counts[springs + k] = p->restoring.counts[k];
        s->counts[springs + k].first += pma_springs_numbers(&p->springs);
    }
    s->levels.tables = springs + p->restoring.tables;
    s->levels.counts = s->counts;
    s->counts[s->levels.tables] =
        (pma_state_counts){p->internal.history, s->iterate ? 1 : 0, PMA_MOST_COUNTED};
}

static pma_status lay_out(pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    const size_t tables = pma_springs_tables(&p->springs) + p->restoring.tables;
    const size_t n = p->n, nb = p->nb, history = p->internal.history;
    const size_t scratch = pma_parts_scratch(p), given = p->restoring.function ? 2 * n : 0;
    const pma_array arrays[] = {PMA_ARRAY(pma_subdomain, vs, s->extrapolates ? n : 0),
                                PMA_ARRAY(pma_subdomain, product, p->has_internal ? n : 0),
                                PMA_ARRAY(pma_subdomain, closing, nb),
                                PMA_ARRAY(pma_subdomain, link, nb),
                                PMA_ARRAY(pma_subdomain, work, scratch),
                                PMA_ARRAY(pma_subdomain, link_work, scratch),
                                PMA_ARRAY(pma_subdomain, remembered, p->restoring.memory),
                                PMA_ARRAY(pma_subdomain, evaluated.values, 2 * given),
                                PMA_ARRAY(pma_subdomain, evaluated.first, given),
                                PMA_ARRAY(pma_subdomain, counts, tables + 1),
                                {0}};
    s->levels = (pma_levels){.n = n,
                             .nb = nb,
                             .springs = pma_parts_memory(p),
                             .history = history + (s->iterate ? 1 : 0),
                             .substeps = p->substeps,
                             .doubled = p->doubled};
    PMA_TRY(pma_levels_create(&s->levels));
    s->block = pma_object_fill(s, arrays);
    if (!s->block)
        return PMA_NO_MEMORY;
    find_counts(s);
    return PMA_OK;
}

static pma_status create_internal(const pma_parts *p, pma_internal_forces **out)
{
    const size_t history = p->internal.history;
    const pma_array arrays[] = {
        PMA_ARRAY(pma_internal_forces, force, p->n + pma_internal_scratch(&p->internal)),
        PMA_ARRAY(pma_internal_forces, history, history),
        {0}};
    *out = pma_object_create(sizeof **out, arrays);
    for (size_t i = 0; *out && i < history; i++)
        (*out)->history[i] = p->internal.initial[i];
    return *out ? PMA_OK : PMA_NO_MEMORY;
}

static pma_status create_mean(const pma_parts *p, pma_mean **out)
{
    const pma_array arrays[] = {
        PMA_ARRAY(pma_mean, push, p->n), PMA_ARRAY(pma_mean, acceleration, p->n), {0}};
    *out = pma_object_create(sizeof **out, arrays);
    return *out ? PMA_OK : PMA_NO_MEMORY;
}

static pma_status create_features(pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    if (p->internal.count > 0)
        PMA_TRY(create_internal(p, &s->internal));
    if (p->mean)
        PMA_TRY(create_mean(p, &s->mean));
    if (p->impulse.inverse)
        PMA_TRY(pma_impulse_create(p, &s->impulse));
    return p->has_responses ? pma_response_create(s, &s->response) : PMA_OK;
}

/* Whatever sweeps the factor of a step sweeps that of the last tangent. */
static pma_status create_iterate(pma_subdomain *s, const pma_iterate_parts *parts)
{
    PMA_TRY(pma_iterate_create(s, parts, &s->iterate));
    s->parts.iterate = pma_iterate_get_parts(s->iterate);
    s->parts.single.factor = s->parts.twice.factor = *pma_iterate_factor(s->iterate);
    return PMA_OK;
}

static pma_status fill(pma_subdomain *s, const pma_parts *parts)
{
    s->parts = *parts;
    s->update = pma_update_best();
    s->extrapolates = parts->restoring.function || parts->lagged || parts->D_r.form != PMA_ZERO ||
                      (parts->internal.count > 0 && !parts->iterate) ||
                      pma_springs_have_rates(&parts->springs);
    s->evaluates = s->extrapolates || parts->springs.total > 0;
    s->load = (pma_load){.kind = PMA_LOAD_NONE, .n = parts->n};
    if (parts->iterate)
        PMA_TRY(create_iterate(s, parts->iterate));
    s->second = (pma_operator){.step = parts->second, .factor = s->parts.single.factor};
    PMA_TRY(pma_substep_divide(s));
    s->table = table_of(s);
    PMA_TRY(lay_out(s));
    return create_features(s);
}

pma_status pma_subdomain_create(const pma_parts *parts, pma_subdomain **out)
{
    *out = NULL;
    PMA_TRY(check_parts(parts));
    pma_subdomain *s = pma_memory_allocate(1, sizeof *s);
    if (!s)
        return PMA_NO_MEMORY;
    const pma_status status = fill(s, parts);
    if (status == PMA_OK)
        *out = s;
    else
        pma_subdomain_destroy(s);
    return status;
}

void pma_subdomain_destroy(pma_subdomain *s)
{
    if (!s)
        return;
    pma_energy_destroy(s->energy);
    pma_balance_destroy(s->balance);
    pma_rig_destroy(s->rig);
    pma_response_destroy(s->response);
    pma_iterate_destroy(s->iterate);
    pma_levels_destroy(&s->levels);
    pma_memory_release(s->division);
    pma_memory_release(s->internal);
    pma_memory_release(s->mean);
    pma_memory_release(s->impulse);
    pma_memory_release(s->block);
    pma_memory_release(s->spread);
    pma_memory_release(s);
}

const pma_parts *pma_subdomain_parts(const pma_subdomain *s)
{
    return &s->parts;
}

void pma_subdomain_set_load(pma_subdomain *s, pma_load load)
{
    assert(load.n == s->parts.n);
    s->load = load;
    pma_levels_discard(&s->levels);
}

const pma_load *pma_subdomain_load(const pma_subdomain *s)
{
    return &s->load;
}

void pma_subdomain_push(pma_subdomain *s, const double *lam, double *y)
{
    pma_substep_accelerate(s, lam, y);
}

pma_response *pma_subdomain_response(pma_subdomain *s)
{
    return s->response;
}

/* ---- what set-up evaluates ------------------------------------------------------------------ */

int pma_subdomain_code(const pma_subdomain *s)
{
    return s->code;
}

pma_status pma_subdomain_force(pma_subdomain *s, double t, double *F)
{
    const pma_status status = pma_load_evaluate(&s->load, t, &s->code);
    memset(F, 0, s->parts.n * sizeof(double));
    if (status == PMA_OK)
        pma_load_add_called(&s->load, F);
    return status;
}

/* r += f(t, u, v; q) with the histories of the start; the next start takes what they become, and
 * the balance, if there is one, f with its stiffness */
static pma_status add_initial_forces(pma_subdomain *s, double t, const double *u, const double *v,
                                     double *r)
{
    const pma_internal *internal = &s->parts.internal;
    const bool bends = s->balance && s->iterate;
    const size_t entries = bends ? pma_iterate_entries(s->iterate) : 0;
    if (internal->count == 0)
        return PMA_OK;
    assert(s->parts.n > 0);
    double *f = pma_memory_allocate(s->parts.n + 2 * entries, sizeof *f);
    if (!f)
        return PMA_NO_MEMORY;
    double *K = f + s->parts.n;
    const pma_internal_point at = {.t = t, .u = u, .v = v, .q = internal->initial};
    const pma_internal_values out = {.f = f,
                                     .q1 = s->internal->history,
                                     .al1 = 1.0,
                                     .tangent = bends ? K + entries : NULL,
                                     .stiffness = bends ? K : NULL};
    const pma_status status =
        pma_internal_evaluate(internal, &at, &out, s->internal->force + s->parts.n, &s->code);
    for (size_t i = 0; i < s->parts.n && status == PMA_OK; i++)
        r[i] += f[i];
    if (s->balance && status == PMA_OK) {
        const pma_first_forces *first = pma_balance_first(s->balance);
        memcpy(first->iterated, f, s->parts.n * sizeof *f);
        memcpy(first->stiffness, K, entries * sizeof *f);
    }
    pma_memory_release(f);
    return status;
}

pma_status pma_subdomain_evaluate_restoring(pma_subdomain *s, double t, const double *u,
                                            const double *v, double *r)
{
    const pma_parts *p = &s->parts;
    pma_status status = PMA_OK;
    memset(r, 0, p->n * sizeof(double));
    PMA_TRY(pma_springs_subtract_first(&p->springs, u, v, r));
    memset(s->remembered, 0, p->restoring.memory * sizeof(double));
    if (s->rig)
        pma_rig_command_first(s->rig);
    pma_restoring_accelerate(&p->restoring, NULL, 0.0);
    if (p->restoring.function)
        status = pma_restoring_subtract(&p->restoring, t, u, v, s->remembered, s->remembered, r,
                                        &s->code);
    for (size_t i = 0; i < p->n; i++)
        r[i] = 0.0 - r[i]; /* no negative zeros */
    if (p->restoring.function)
        pma_substep_take_functions(s, s->evaluated.first);
    if (s->balance && p->restoring.function)
        memcpy(pma_balance_first(s->balance)->once, s->evaluated.first, p->n * sizeof(double));
    if (status == PMA_OK && s->rig)
        status = pma_rig_reply_first(s->rig, t, u, v);
    return status == PMA_OK ? add_initial_forces(s, t, u, v, r) : status;
}

pma_iterate *pma_subdomain_iterate(pma_subdomain *s)
{
    return s->iterate;
}

/* ---- the present ---------------------------------------------------------------------------- */

const pma_state *pma_subdomain_present(const pma_subdomain *s)
{
    return &s->levels.present;
}

void pma_subdomain_start(pma_subdomain *s, const double *u, const double *v, const double *w,
                         const double *lam)
{
    const size_t bytes = s->parts.n * sizeof(double);
    const pma_state *x = &s->levels.present;
    memset(x->springs, 0, pma_springs_numbers(&s->parts.springs) * sizeof(double));
    pma_springs_subtract(&s->parts.springs, u, v, x->springs, x->springs, x->a); /* a is scratch */
    memcpy(x->u, u, bytes);
    memcpy(x->v, v, bytes);
    memcpy(x->w, w, bytes);
    memcpy(x->a, w, bytes);
    memcpy(x->springs + pma_springs_numbers(&s->parts.springs), s->remembered,
           s->parts.restoring.memory * sizeof(double));
    if (s->internal)
        memcpy(x->history, s->internal->history, s->parts.internal.history * sizeof(double));
    pma_levels_discard(&s->levels);
    pma_subdomain_watch_again(s);
    pma_subdomain_set_functions(s, 0, s->evaluated.first);
    if (s->balance)
        pma_balance_start(s->balance, x);
    if (s->rig)
        pma_rig_begin(s->rig, v);
    if (s->iterate) {
        x->history[s->parts.internal.history] = 0.0; /* corrections */
        pma_iterate_restore(s->iterate, (pma_kept_iteration){.scale = 0.0});
        memcpy(s->levels.vf_present, pma_interface_of(s, x->v), s->parts.nb * sizeof(double));
        return; /* the first substep makes it (N13) */
    }
    pma_substep_store_free_velocity(s, &s->parts.single, pma_interface_of(s, x->v), lam,
                                    s->levels.vf_present); /* (S2) */
}

void pma_subdomain_rebase(pma_subdomain *s, bool twice, const double *lam)
{
    const double *v_b = pma_interface_of(s, s->levels.present.v);
    pma_levels_discard(&s->levels);
    if (!s->iterate)
        pma_substep_store_free_velocity(s, pma_operator_of(s, twice), v_b, lam,
                                        s->levels.vf_present);
}

size_t pma_subdomain_arrays(pma_subdomain *s, pma_state_array out[PMA_LEVEL_ARRAYS])
{
    pma_levels_discard(&s->levels);
    return pma_levels_arrays(&s->levels, out);
}

size_t pma_subdomain_kept(const pma_subdomain *s, pma_state_array out[PMA_LEVEL_ARRAYS])
{
    return pma_levels_arrays(&s->levels, out);
}

/* ---- what functions gave ------------------------------------------------------------------- */

const double *pma_subdomain_functions(const pma_subdomain *s, int64_t steps)
{
    const int64_t number = steps * (int64_t)s->parts.substeps - 1;
    const size_t slot = pma_evaluated_slot(s, number);
    const bool is_known = s->parts.restoring.function && s->evaluated.number[slot] == number;
    return is_known ? s->evaluated.values + slot * 2 * s->parts.n : NULL;
}

void pma_subdomain_set_functions(pma_subdomain *s, int64_t steps, const double *functions)
{
    const int64_t number = steps * (int64_t)s->parts.substeps - 1;
    const size_t slot = pma_evaluated_slot(s, number), n = s->parts.n;
    if (!s->parts.restoring.function)
        return;
    s->evaluated.number[slot] = number;
    memcpy(s->evaluated.values + slot * 2 * n, functions, 2 * n * sizeof(double));
}

/* ---- the command of a substep that is not open yet, for loops outside ----------------------- */

void pma_subdomain_command(const pma_subdomain *s, const pma_substep *step, size_t i, double *c)
{
    const pma_operator *op = pma_operator_at(s, step);
    const pma_state *x = pma_levels_origin(&s->levels, step);
    const pma_state from = {.u = x->u + i, .v = x->v + i, .w = x->w + i, .a = x->a + i};
    double numbers[4];
    const pma_state to = {.u = numbers, .v = numbers + 1, .w = numbers + 2, .a = numbers + 3};
    s->update->predict(&op->step, 0, 1, &from, &to);
    c[0] = numbers[0];
    c[1] = x->v[i] + op->step.h * x->w[i];
    c[2] = x->w[i];
}

/* The functions, on a copy of what they remember; y (n) is scratch. */
static pma_status ask(const pma_subdomain *s, const pma_substep *step, const double *u,
                      const double *v, double *y, double *memory)
{
    const pma_restoring *restoring = &s->parts.restoring;
    const size_t springs = pma_springs_numbers(&s->parts.springs);
    const pma_state *last = pma_levels_at(&s->levels, step->j);
    int code;
    pma_restoring_accelerate(restoring, pma_levels_origin(&s->levels, step)->w,
                             step->twice ? 2.0 : 1.0);
    const pma_status status = pma_restoring_subtract(restoring, step->t1, u, v,
                                                     last->springs + springs, memory, y, &code);
    return status == PMA_LIMITED ? status : PMA_OK;
}

pma_status pma_subdomain_admit(const pma_subdomain *s, const pma_substep *step, double *u,
                               double *v)
{
    const size_t n = s->parts.n;
    const pma_operator *op = pma_operator_at(s, step);
    const pma_state *from = pma_levels_origin(&s->levels, step);
    const pma_state to = {.u = u, .v = u + n, .w = u + 2 * n, .a = u + 3 * n};
    s->update->predict(&op->step, 0, n, from, &to);
    pma_substep_extrapolate(op->step.h, n, from, v);
    if (s->rig && !pma_rig_admits(s->rig, step, u, v))
        return PMA_LIMITED;
    const pma_status status =
        s->parts.restoring.memory > 0 ? ask(s, step, u, v, to.w, u + 4 * n) : PMA_OK;
    if (s->rig)
        pma_rig_command_first(s->rig); /* no substep is open */
    return status;
}
