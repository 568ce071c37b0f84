/* table.c - the operations of member.h, as a subdomain does them. */
#include <math.h>
#include <string.h>

#include "member/inside.h"

/* ---- a substep ------------------------------------------------------------------------------ */

static pma_status open_substep(void *self, const pma_substep *step)
{
    return pma_substep_open(self, step);
}

static pma_status close_substep(void *self, const pma_substep *step, const double *lam)
{
    return pma_substep_close(self, step, lam);
}

static size_t opened(const void *self)
{
    const pma_subdomain *s = self;
    return s->levels.opened;
}

/* ---- values on the interface ---------------------------------------------------------------- */

static void compliance(void *self, bool twice, const double *lam, double *sum)
{
    pma_subdomain *s = self;
    const pma_operator *op = pma_operator_of(s, twice);
    pma_substep_solve_link(s, op, lam);
    pma_link_gather(&s->parts.link, op->step.al2, s->link, sum);
}

static void add_free_velocity(const pma_subdomain *s, size_t j, double scale, double *sum)
{
    pma_link_gather(&s->parts.link, scale, pma_levels_free_velocity(&s->levels, j), sum);
}

static void free_velocity(const void *self, size_t j, double theta, double scale, double *sum)
{
    if (theta < 1.0)
        add_free_velocity(self, j, scale * (1.0 - theta), sum);
    add_free_velocity(self, j + 1, scale * theta, sum);
}

static void velocity(const void *self, size_t j, double *sum)
{
    const pma_subdomain *s = self;
    const pma_state *x = pma_levels_at(&s->levels, j);
    pma_link_gather(&s->parts.link, 1.0, pma_interface_of(s, x->v), sum);
}

/* u_b at a time level; of an open step ut_b + al1 wf_b with wf_b = (vf_b - vt_b) / al2, in s->link */
static const double *interface_displacement(const pma_subdomain *s, size_t j)
{
    const pma_state *x = pma_levels_at(&s->levels, j);
    const double *u = pma_interface_of(s, x->u), *v = pma_interface_of(s, x->v);
    const double *vf = pma_levels_free_velocity(&s->levels, j);
    if (j == 0 || !s->open)
        return u;
    for (size_t i = 0; i < s->parts.nb; i++)
        s->link[i] = u[i] + s->open->step.al1 / s->open->step.al2 * (vf[i] - v[i]);
    return s->link;
}

static void displacement(const void *self, size_t j, double *sum)
{
    const pma_subdomain *s = self;
    pma_link_gather(&s->parts.link, 1.0, interface_displacement(s, j), sum);
}

static size_t interface_size(const void *self)
{
    const pma_subdomain *s = self;
    return s->parts.nb;
}

static const double *interface_values(void *self, pma_interface_kind kind, size_t j, bool twice,
                                      const double *lam)
{
    pma_subdomain *s = self;
    if (kind == PMA_LINK_VELOCITY) {
        pma_substep_solve_link(s, pma_operator_of(s, twice), lam);
        return s->link;
    }
    if (kind == PMA_EXPECTED_DISPLACEMENT)
        return pma_substep_expected(s, j, twice, lam);
    if (kind == PMA_FREE_VELOCITY || kind == PMA_REBASED_VELOCITY)
        return pma_levels_free_velocity(&s->levels, j);
    if (kind == PMA_DISPLACEMENT)
        return interface_displacement(s, j);
    return pma_interface_of(s, pma_levels_at(&s->levels, j)->v);
}

static bool is_finite(const void *self, size_t j)
{
    const pma_subdomain *s = self;
    const double *vf = pma_levels_free_velocity(&s->levels, j);
    for (size_t i = 0; i < s->parts.nb; i++) {
        if (!isfinite(vf[i]))
            return false;
    }
    return true;
}

/* ---- time levels ---------------------------------------------------------------------------- */

static void record(const void *self, size_t j, const pma_selection *selection, size_t row)
{
    const pma_subdomain *s = self;
    pma_selection_write(selection, pma_levels_at(&s->levels, j), row);
}

static void commit(void *self)
{
    pma_subdomain *s = self;
    pma_levels_commit(&s->levels);
    if (s->balance)
        pma_balance_commit(s->balance, s->levels.present.v);
    if (s->energy)
        pma_energy_commit(s->energy);
}

static void commit_iterated(void *self)
{
    commit(self);
    pma_iterate_commit(((pma_subdomain *)self)->iterate);
}

static void discard(void *self)
{
    pma_subdomain *s = self;
    s->open = NULL;
    pma_levels_discard(&s->levels);
}

static void discard_iterated(void *self)
{
    discard(self);
    pma_iterate_discard(((pma_subdomain *)self)->iterate);
}

/* (S3)  vf := v_b - al2 S^-1 L_b^T lam with the operator of the double step */
static void rebase(void *self, size_t j, const double *lam)
{
    pma_subdomain *s = self;
    const pma_operator *op = &s->parts.twice;
    const double *v_b = pma_interface_of(s, pma_levels_at(&s->levels, j)->v);
    pma_substep_store_free_velocity(s, op, v_b, lam, pma_levels_free_velocity(&s->levels, j));
}

/* ---- energy, look-ahead --------------------------------------------------------------------- */

static bool is_observed(const void *self)
{
    const pma_subdomain *s = self;
    return s->energy;
}

static void energy(const void *self, size_t j, double *out)
{
    const pma_subdomain *s = self;
    pma_energy_at(s->energy, j, pma_levels_at(&s->levels, j), out);
}

static pma_status look_ahead(void *self)
{
    pma_subdomain *s = self;
    return pma_levels_extend(&s->levels);
}

static bool is_known(const void *self, const pma_substep *step)
{
    const pma_subdomain *s = self;
    if (s->load.kind == PMA_LOAD_TABLE)
        return step->number - s->load.first < (int64_t)s->load.rows;
    return s->load.kind != PMA_LOAD_CALLED;
}

static pma_status prepare_visits(void *self)
{
    pma_subdomain *s = self;
    return pma_levels_take_turns(&s->levels);
}

static pma_status visit(void *self, const pma_substep *closed, const pma_substep *opened,
                        const double *lam)
{
    return pma_visit_substeps(self, closed, opened, lam);
}

/* ---- macro coupling ------------------------------------------------------------------------- */

static void hold(void *self, const pma_substep *step, const double *lam)
{
    pma_substep_hold(self, step, lam);
}

static void begin_response(void *self, bool twice, const double *dlam)
{
    const pma_subdomain *s = self;
    if (s->response)
        pma_response_begin(s->response, twice, dlam);
}

static void hold_energy(void *self, bool twice, const double *lam)
{
    const pma_subdomain *s = self;
    if (s->energy)
        pma_energy_hold(s->energy, twice, lam);
}

static void record_acceleration(void *self, const double *lam, const pma_selection *selection,
                                size_t row)
{
    pma_subdomain *s = self;
    pma_subdomain_push(s, lam, s->acceleration);
    pma_selection_accelerate(selection, s->acceleration, row);
}

static void expect(void *self, const pma_substep *step, const double *lam, double *sum)
{
    const pma_subdomain *s = self;
    const double *u = pma_substep_expected(self, step->j + 1, step->twice, lam);
    pma_link_gather(&s->parts.link, 1.0, u, sum);
}

static void shift(void *self, const pma_substep *step, const double *mu)
{
    pma_substep_shift(self, step, mu);
}

static void push(void *self, const double *lam)
{
    pma_subdomain *s = self;
    s->is_pushed = true;
    pma_subdomain_push(s, lam, s->push);
}

static void respond(void *self, size_t j, const double *lam, const double *dlam)
{
    pma_subdomain *s = self;
    pma_response_step(s->response, j, dlam);
    if (s->energy)
        pma_energy_respond(s->energy, j, pma_response_is_twice(s->response),
                           pma_response_state(s->response), lam, dlam);
}

static void record_response(const void *self, const pma_selection *selection, size_t row)
{
    const pma_subdomain *s = self;
    pma_selection_add(selection, pma_response_state(s->response), row);
}

/* A subdomain that no constraint reaches does not respond. */
static pma_status add_response(void *self, const double *dlam)
{
    const pma_subdomain *s = self;
    const pma_state *x = pma_levels_at(&s->levels, s->parts.substeps);
    return s->parts.nb > 0 ? pma_response_add(s->response, dlam, x) : PMA_OK;
}

/* The state at the end is bitwise identical, whether inner time levels are wanted or not: where the
 * response is stored, its substeps are repeated for the record and the energy alone. */
static size_t repeats(const void *self, bool recorded)
{
    const pma_subdomain *s = self;
    const bool tied = s->parts.nb > 0;
    if (s->energy || (tied && !pma_response_is_stored(s->response)))
        return s->parts.substeps;
    return tied && recorded ? s->parts.substeps - 1 : 0;
}

static double kinetic(const void *self, size_t j)
{
    const pma_subdomain *s = self;
    const double *v = pma_levels_at(&s->levels, j)->v;
    double sum = 0.0;
    memset(s->product, 0, s->parts.n * sizeof(double));
    pma_matrix_subtract(&s->parts.M, v, s->product);
    for (size_t i = 0; i < s->parts.n; i++)
        sum -= v[i] * s->product[i];
    return sum;
}

/* ---- ranges of rows ------------------------------------------------------------------------- */

static pma_status evaluate_load(void *self, const pma_substep *step)
{
    return pma_substep_load(self, step);
}

static void predict(void *self, const pma_substep *step, size_t begin, size_t end)
{
    pma_rows_predict(self, step, begin, end);
}

static void add_forces(void *self, const pma_substep *step, size_t begin, size_t end)
{
    pma_substep_add_forces(self, step, begin, end);
}

static void open_interface(void *self, const pma_substep *step)
{
    pma_rows_open_interface(self, step);
}

static void close_interface(void *self, const pma_substep *step, const double *lam)
{
    pma_rows_close_interface(self, step, lam);
}

static bool correct(void *self, const pma_substep *step, size_t begin, size_t end)
{
    return pma_rows_correct(self, step, begin, end);
}

static void observe(void *self, const pma_substep *step, const double *lam)
{
    (void)pma_substep_observe(self, step, lam); /* rows divide where there is no function */
}

/* ---- branches of a tree ---------------------------------------------------------------------- */

static pma_status divide(void *self, size_t workers)
{
    return pma_visit_divide(self, workers);
}

static pma_status begin_visit(void *self, const pma_substep *closed, const pma_substep *opened,
                              const double *lam)
{
    return pma_visit_begin(self, closed, opened, lam);
}

static bool go(const void *self, size_t worker)
{
    return pma_visit_go(self, worker);
}

static pma_status end_visit(void *self, bool finite)
{
    return pma_visit_end(self, finite);
}

/* ---- the table ------------------------------------------------------------------------------ */

static const pma_member_table TABLE = {
    .open = open_substep,
    .close = close_substep,
    .opened = opened,
    .compliance = compliance,
    .free_velocity = free_velocity,
    .velocity = velocity,
    .displacement = displacement,
    .is_finite = is_finite,
    .interface_size = interface_size,
    .interface_values = interface_values,
    .record = record,
    .commit = commit,
    .discard = discard,
    .rebase = rebase,
    .is_observed = is_observed,
    .energy = energy,
    .look_ahead = look_ahead,
    .is_known = is_known,
    .prepare_visits = prepare_visits,
    .visit = visit,
    .hold = hold,
    .begin_response = begin_response,
    .hold_energy = hold_energy,
    .record_acceleration = record_acceleration,
    .push = push,
    .respond = respond,
    .record_response = record_response,
    .add_response = add_response,
    .repeats = repeats,
    .expect = expect,
    .shift = shift,
    .kinetic = kinetic,
    .evaluate_load = evaluate_load,
    .predict = predict,
    .add_forces = add_forces,
    .open_interface = open_interface,
    .close_interface = close_interface,
    .correct = correct,
    .observe = observe,
    .divide = divide,
    .begin_visit = begin_visit,
    .go = go,
    .end_visit = end_visit,
};

/* Steps are begun, iterated and finished (iterated.h) instead of opened and closed. */
static const pma_member_table ITERATED = {
    .opened = opened,
    .compliance = compliance,
    .free_velocity = free_velocity,
    .velocity = velocity,
    .displacement = displacement,
    .is_finite = is_finite,
    .interface_size = interface_size,
    .interface_values = interface_values,
    .record = record,
    .commit = commit_iterated,
    .discard = discard_iterated,
    .is_observed = is_observed,
    .energy = energy,
    .hold_energy = hold_energy,
    .record_acceleration = record_acceleration,
    .push = push,
    .kinetic = kinetic,
};

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

/* What is swept from beyond the first caches, without a function of the caller's. */
static bool gains_from_visits(const pma_parts *p)
{
    return entries_of(p) > PMA_SUBTREE && !p->restoring.function && p->internal.count == 0;
}

/* Has to be evaluated by the thread that called advance? */
static bool is_by_caller(const pma_parts *p)
{
    bool by_caller = p->restoring.function && p->restoring.by_caller;
    for (size_t i = 0; i < p->internal.count; i++)
        by_caller = by_caller || p->internal.forces[i].by_caller;
    return by_caller;
}

pma_member pma_subdomain_member(pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    pma_member member = {.table = s->iterate ? &ITERATED : &TABLE,
                         .self = s,
                         .p = p->link.p,
                         .n = p->n,
                         .substeps = p->substeps,
                         .h = p->single.step.h,
                         .entries = entries_of(p),
                         .doubled = p->doubled,
                         .continues = p->continues,
                         .evaluates = p->restoring.function || p->internal.count > 0,
                         .by_caller = is_by_caller(p),
                         .responds = p->responds,
                         .waits = p->waits,
                         .shifts = p->shifts,
                         .shoots = p->shoots,
                         .divides = !s->iterate && pma_rows_divide(s),
                         .branches = s->fuses,
                         .alone = 2 * s->trunk,
                         .visits = !s->iterate && gains_from_visits(p)};
    if (s->iterate)
        member.iterated = pma_iterate_member(s->iterate);
    return member;
}
