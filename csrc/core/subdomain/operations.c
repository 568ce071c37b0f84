/* operations.c - those of member.h, as a subdomain does them. */
#include "subdomain/inside.h"
#include "subdomain/iterated_substep.h"

/* ---- a substep ------------------------------------------------------------------------------ */

/* Several workers; or a free run, in whose only substep the multipliers are held (M6), and where
 * there are several the velocities at its end are those of the last one */
__attribute__((noinline)) static pma_status
advance_otherwise(pma_subdomain *s, const pma_substep *closed, const pma_substep *opened,
                  const double *lam, const pma_workers *workers)
{
    if (workers)
        return closed ? pma_division_close(s, closed, lam, workers)
                      : pma_division_open(s, opened, workers);
    if (s->parts.mean)
        return s->parts.deferred ? pma_substep_open(s, opened) : pma_substep_open_apart(s, opened);
    if (s->parts.substeps > 1)
        return pma_substep_open_apart(s, opened);
    PMA_TRY(pma_substep_open(s, opened));
    pma_substep_hold(s, opened, lam);
    return PMA_OK;
}

static pma_status advance(void *self, const pma_substep *closed, const pma_substep *opened,
                          const double *lam, const pma_workers *workers)
{
    if (!workers && closed)
        return pma_substep_close(self, closed, lam);
    if (!workers && !opened->is_free_run)
        return pma_substep_open(self, opened);
    return advance_otherwise(self, closed, opened, lam, workers);
}

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

/* ---- values on the interface ---------------------------------------------------------------- */

/* u_b at a time level; of an open step ut_b + al1 wf_b with wf_b = (vf_b - vt_b) / al2, in
 * s->link */
static const double *displacement(const pma_subdomain *s, size_t j)
{
    const pma_state *x = pma_levels_at(&s->levels, j);
    const double *u = pma_interface_of(s, x->u), *v = pma_interface_of(s, x->v);
    const double *vf = pma_levels_free_velocity(&s->levels, j);
    if (j == 0 || !s->mean || !s->mean->open)
        return u;
    const pma_step *c = &s->mean->open->step;
    for (size_t i = 0; i < s->parts.nb; i++)
        s->link[i] = u[i] + c->al1 / c->al2 * (vf[i] - v[i]);
    return s->link;
}

static const double *link_velocity(pma_subdomain *s, bool twice, const double *lam)
{
    const pma_operator *op = pma_operator_of(s, twice);
    pma_substep_solve_link(s, op, lam);
    for (size_t i = 0; i < s->parts.nb; i++)
        s->link[i] *= op->step.al2;
    return s->link;
}

__attribute__((noinline)) static const double *
other_values(pma_subdomain *s, pma_interface_kind kind, size_t j, bool twice, const double *lam)
{
    if (kind == PMA_VELOCITY)
        return pma_interface_of(s, pma_levels_at(&s->levels, j)->v);
    if (kind == PMA_DISPLACEMENT)
        return displacement(s, j);
    return link_velocity(s, twice, lam);
}

/* Free velocities are wanted in every fine step. */
static const double *values(void *self, pma_interface_kind kind, size_t j, bool twice,
                            const double *lam)
{
    const pma_subdomain *s = self;
    if (kind == PMA_FREE_VELOCITY || kind == PMA_BEGINNING_VELOCITY)
        return pma_levels_free_velocity(&s->levels, j);
    return other_values(self, kind, j, twice, lam);
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
pma_member_table pma_subdomain_table(const pma_subdomain *s)
{
    pma_member_table table = {.opened = opened,
                              .values = values,
                              .record = record,
                              .commit = commit,
                              .discard = discard,
                              .energy = energy,
                              .hold_energy = s->parts.mean ? hold_energy : NULL,
                              .push = s->parts.mean ? push : NULL,
                              .kinetic = s->parts.has_internal ? kinetic : NULL};
    if (s->iterate)
        return table;
    table.advance = advance;
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
