/* substep.c - free and link problem of one substep, as one forward and one backward sweep; by
 * several workers; and their values on the interface. */
#include <assert.h>
#include <math.h>
#include <string.h>

#include "algebra/lists.h"
#include "memory.h"
#include "subdomain/inside.h"

/* ---- link problem on the interface alone ---------------------------------------------------- */

void pma_substep_solve_link(pma_subdomain *s, const pma_operator *op, const double *lam)
{
    pma_link_load(&s->parts.link, lam, s->link);
    pma_factor_interface(&op->factor, s->link, s->link_work);
}

void pma_substep_store_free_velocity(pma_subdomain *s, const pma_operator *op, const double *v_b,
                                     const double *lam, double *vf)
{
    pma_substep_solve_link(s, op, lam);
    for (size_t i = 0; i < s->parts.nb; i++)
        vf[i] = v_b[i] - op->step.al2 * s->link[i];
}

/* vf at the end of the open substep += al2 S^-1 L_b^T lam                                  (M6) */
static void hold(pma_subdomain *s, const pma_substep *step, const double *lam)
{
    assert(s->levels.opened == step->j + 1);
    const pma_operator *op = pma_operator_at(s, step);
    double *vf = pma_levels_free_velocity(&s->levels, step->j + 1);
    pma_substep_solve_link(s, op, lam);
    for (size_t i = 0; i < s->parts.nb; i++)
        vf[i] += op->step.al2 * s->link[i];
}

/* ---- open: the free problem ----------------------------------------------------------------- */

void pma_substep_extrapolate(double h, size_t n, const pma_state *from, double *vs)
{
    const double *v = from->v, *w = from->w;
    for (size_t i = 0; i < n; i++)
        vs[i] = v[i] + h * w[i];
}

void pma_substep_push(size_t n, double h, const double *y, const pma_state *to, double *vs)
{
    for (size_t i = 0; i < n; i++) {
        to->u[i] += 0.5 * h * h * y[i];
        to->v[i] += h * y[i];
    }
    for (size_t i = 0; vs && i < n; i++)
        vs[i] += h * y[i];
}

void pma_parts_accelerate(const pma_parts *p, const double *lam, double *pull, double *work,
                          double *y)
{
    assert(p->mean);
    memset(y, 0, p->n * sizeof(double)); /* as an open step without loads leaves it */
    pma_link_load(&p->link, lam, pull);
    pma_factor_close(&p->mass, pull, y, work);
}

/* y -= f(t1, ut, vs; q), internal forces of an explicit subdomain, which go on to q1 */
static pma_status subtract_internal(pma_subdomain *s, const pma_state *from, const pma_state *to,
                                    double t1)
{
    const pma_parts *p = &s->parts;
    double *f = s->internal->force;
    memset(f, 0, p->n * sizeof(double));
    const pma_internal_point at = {.t = t1, .u = to->u, .v = s->vs, .q = from->history};
    const pma_internal_values out = {.f = f, .q1 = to->history};
    pma_status status = pma_internal_evaluate(&p->internal, &at, &out, f + p->n, &s->code);
    for (size_t i = 0; i < p->n; i++)
        to->w[i] -= f[i];
    for (size_t i = 0; i < p->internal.history && status == PMA_OK; i++)
        status = isfinite(to->history[i]) ? PMA_OK : PMA_NOT_FINITE;
    return status;
}

void pma_substep_take_functions(const pma_subdomain *s, double *out)
{
    const pma_restoring *restoring = &s->parts.restoring;
    const double *last = pma_restoring_last(restoring), *load = restoring->load;
    const size_t n = s->parts.n;
    for (size_t i = 0; i < n; i++) {
        const size_t k = (size_t)restoring->order[i];
        out[n + i] = load ? load[k] : 0.0;
        out[i] = last[k] + out[n + i];
    }
}

pma_status pma_substep_subtract_restoring(pma_subdomain *s, const pma_substep *step,
                                          const pma_state *to, double *y)
{
    const pma_parts *p = &s->parts;
    const size_t springs = pma_springs_numbers(&p->springs);
    const pma_state *last = pma_levels_at(&s->levels, step->j);
    PMA_TRY(pma_restoring_subtract(&p->restoring, step->t1, to->u, s->vs, last->springs + springs,
                                   to->springs + springs, y, &s->code));
    const size_t slot = pma_evaluated_slot(s, step->number);
    s->evaluated.number[slot] = step->number;
    pma_substep_take_functions(s, s->evaluated.values + slot * 2 * p->n);
    return PMA_OK;
}

/* y -= r(t1, ut, vs) + D_r (vt - vs); vs is then used up                                  (R3) */
__attribute__((noinline)) static pma_status
subtract_restoring(pma_subdomain *s, const pma_substep *step, const pma_state *from,
                   const pma_state *to)
{
    const pma_parts *p = &s->parts;
    if (s->is_observed)
        pma_observers_evaluate(s, step, to);
    if (s->rig)
        PMA_TRY(pma_rig_command(s->rig, step, to));
    if (p->springs.total > 0)
        pma_springs_subtract(&p->springs, to->u, s->vs, from->springs, to->springs, to->w);
    if (p->restoring.function)
        PMA_TRY(pma_substep_subtract_restoring(s, step, to, to->w));
    if (s->rig)
        PMA_TRY(pma_rig_reply(s->rig, to));
    if (s->extrapolates && s->internal)
        PMA_TRY(subtract_internal(s, from, to, step->t1));
    if (s->is_observed)
        pma_observers_evaluated(s, to);
    if (!s->extrapolates || p->D_r.form == PMA_ZERO)
        return PMA_OK;
    for (size_t i = 0; i < p->n; i++)
        s->vs[i] = to->v[i] - s->vs[i];
    pma_matrix_subtract(&p->D_r, s->vs, to->w);
    return PMA_OK;
}

void pma_substep_take_total(const pma_subdomain *s, const pma_state *x, double *total)
{
    const pma_restoring *restoring = &s->parts.restoring;
    const size_t n = s->parts.n;
    memset(total, 0, n * sizeof(double));
    if (!s->parts.iterate->springs)
        pma_springs_add(&s->parts.springs, x->springs, total);
    for (size_t i = 0; restoring->function && i < n; i++)
        total[i] += pma_restoring_last(restoring)[restoring->order[i]];
}

void pma_substep_add_evaluated(const pma_subdomain *s, const pma_state *x, double *r)
{
    const pma_restoring *restoring = &s->parts.restoring;
    pma_springs_add(&s->parts.springs, x->springs, r);
    if (!restoring->function)
        return;
    const double *last = pma_restoring_last(restoring), *load = restoring->load;
    for (size_t i = 0; i < s->parts.n; i++) {
        const size_t k = (size_t)restoring->order[i];
        r[i] += load ? last[k] + load[k] : last[k];
    }
}

pma_status pma_substep_load(pma_subdomain *s, const pma_substep *step)
{
    return pma_load_evaluate(&s->load, step->t1, &s->code);
}

/* (11)  F(t1) - C vt - K ut; lagged: C vs (R4) */
static void add_forces(const pma_subdomain *s, const pma_substep *step, const pma_state *to,
                       size_t begin, size_t end)
{
    const pma_parts *p = &s->parts;
    if (s->load.kind != PMA_LOAD_NONE)
        pma_load_add_rows(&s->load, step->t1, step->number, begin, end, to->w);
    if (p->C.form != PMA_ZERO)
        pma_matrix_subtract_rows(&p->C, begin, end, p->lagged ? s->vs : to->v, to->w);
    pma_matrix_subtract_rows(&p->K, begin, end, to->u, to->w);
}

/* The free problem (13) up to its acceleration on the interface, or NULL */
static inline pma_status solve_free(pma_subdomain *s, const pma_substep *step,
                                    const pma_operator *op, const pma_state *from,
                                    const pma_state *to, double *wf_b)
{
    const size_t n = s->parts.n;

    /* (R1) */
    if (s->extrapolates)
        pma_substep_extrapolate(op->step.h, n, from, s->vs);
    pma_restoring_accelerate(&s->parts.restoring, from->w, step->twice ? 2.0 : 1.0);

    /* (5), (6) */
    s->update->predict(&op->step, 0, n, from, to);
    if (s->mean && s->mean->is_pushed)
        pma_substep_push(n, op->step.h, s->mean->push, to, s->extrapolates ? s->vs : NULL);

    add_forces(s, step, to, 0, n);

    /* (R3) */
    if (s->evaluates)
        PMA_TRY(subtract_restoring(s, step, from, to));

    /* (F2), (F3) */
    if (wf_b)
        pma_factor_open(&op->factor, to->w, wf_b, s->work);
    else
        pma_factor_open_interior(&op->factor, to->w, s->work);
    return PMA_OK;
}

/* (F3)  vf_b = vt_b + al2 wf_b with wf_b in vf: the substep is open */
static inline void find_free_velocity(pma_subdomain *s, const pma_substep *step,
                                      const pma_operator *op, const pma_state *to, double *vf)
{
    const double *vt = pma_interface_of(s, to->v);
    for (size_t i = 0; i < s->parts.nb; i++)
        vf[i] = vt[i] + op->step.al2 * vf[i];
    s->levels.opened = step->j + 1;
}

__attribute__((noinline)) static pma_status open_substep(pma_subdomain *s, const pma_substep *step)
{
    assert(s->levels.opened >= step->j);
    const pma_operator *op = pma_operator_at(s, step);
    const pma_span at = pma_levels_span(&s->levels, step);
    if (s->is_observed)
        PMA_TRY(pma_observers_open(s));
    PMA_TRY(pma_substep_load(s, step));
    PMA_TRY(solve_free(s, step, op, at.from, at.to, at.vf));
    find_free_velocity(s, step, op, at.to, at.vf);
    if (s->parts.deferred)
        s->mean->open = op;
    return PMA_OK;
}

/* The same for a substep without an interface problem at its end: vf is the predictor. */
static pma_status open_apart(pma_subdomain *s, const pma_substep *step)
{
    assert(s->levels.opened >= step->j);
    const pma_span at = pma_levels_span(&s->levels, step);
    if (s->is_observed)
        PMA_TRY(pma_observers_open(s));
    PMA_TRY(pma_substep_load(s, step));
    PMA_TRY(solve_free(s, step, pma_operator_at(s, step), at.from, at.to, NULL));
    memcpy(at.vf, pma_interface_of(s, at.to->v), s->parts.nb * sizeof(double));
    s->levels.opened = step->j + 1;
    return PMA_OK;
}

/* ---- close: the link problem, added --------------------------------------------------------- */

/* L^T Lam */
void pma_substep_load_interface(pma_subdomain *s, const double *lam)
{
    if (s->parts.mean) /* they push instead */
        memset(s->closing, 0, s->parts.nb * sizeof(double));
    else
        pma_link_load(&s->parts.link, lam, s->closing);
}

/* (F4) and (F5) with L^T Lam in s->closing, (8), (9); true when every new value is finite */
bool pma_substep_sweep_back(const pma_subdomain *s, const pma_operator *op, const pma_state *x)
{
    assert(op->factor.n == s->parts.n);
    pma_factor_close(&op->factor, s->closing, x->w, s->work);
    return s->update->correct(&op->step, 0, s->parts.n, x);
}

/* Closed under h^2 / (2 al1) L^T lam, w -= h^2 / (2 al1) y, and what (8), (9) make of y; in v that
 * is zero for the trapezoidal rule, in u always                                           (K7) */
__attribute__((noinline)) static pma_status close_waiting(pma_subdomain *s, const pma_substep *step,
                                                          const double *lam)
{
    const pma_operator *op = s->mean->open;
    const pma_step *c = &op->step;
    double *y = s->mean->push;
    const pma_state *x = pma_levels_at(&s->levels, step->j + 1);
    const double share = 0.5 * c->h * c->h / c->al1, v_y = c->h - c->al2 * share;
    double zero = 0.0;
    pma_link_load(&s->parts.link, lam, s->closing);
    for (size_t i = 0; i < s->parts.nb; i++)
        s->closing[i] *= share;
    bool finite = pma_substep_sweep_back(s, op, x);
    s->mean->open = NULL;
    pma_substep_accelerate(s, lam, y);
    for (size_t i = 0; i < s->parts.n; i++) {
        x->v[i] += v_y * y[i];
        x->w[i] -= share * y[i];
        x->a[i] -= c->a_w1 * share * y[i];
        zero += 0.0 * y[i];
    }
    if (!finite || zero != 0.0)
        return PMA_NOT_FINITE;
    return s->is_observed ? pma_observers_close(s, step, lam) : PMA_OK;
}

/* Not inlined, as open_substep: advance itself then needs no registers. */
__attribute__((noinline)) static pma_status close_substep(pma_subdomain *s, const pma_substep *step,
                                                          const double *lam)
{
    assert(s->levels.opened > step->j && (lam || s->parts.link.p == 0));
    if (s->mean && s->mean->open)
        return close_waiting(s, step, lam);
    /* (14), (8), (9)  w = Mbar^-1 (g + L^T Lam) */
    pma_substep_load_interface(s, lam);
    if (!pma_substep_sweep_back(s, pma_operator_at(s, step),
                                pma_levels_at(&s->levels, step->j + 1)))
        return PMA_NOT_FINITE;
    return s->is_observed ? pma_observers_close(s, step, lam) : PMA_OK;
}

/* ---- divided among several workers ----------------------------------------------------------
 *
 * With a diagonal Mbar no row waits for another: every worker has a range of them, which is fixed,
 * so that it stays in the caches of one core. */

/* Diagonal Mbar, linear, single steps: no row waits for another. */
static bool is_in_ranges(const pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    return p->single.factor.form == PMA_DIAGONAL && !p->doubled && !s->evaluates;
}

pma_status pma_substep_divide(pma_subdomain *s)
{
    if (!is_in_ranges(s))
        return PMA_OK;
    s->division = pma_memory_allocate(1, sizeof *s->division);
    return s->division ? PMA_OK : PMA_NO_MEMORY;
}

static const pma_division *begin_division(pma_subdomain *s, const pma_substep *step,
                                          const pma_workers *workers)
{
    pma_division *d = s->division;
    assert(d && workers->count > 0);
    d->op = pma_operator_at(s, step);
    d->step = step;
    d->at = pma_levels_span(&s->levels, step);
    d->workers = workers;
    return d;
}

static bool share(pma_subdomain *s, bool (*work)(void *self, size_t worker))
{
    const pma_workers *workers = s->division->workers;
    return workers->share(workers->ctx, work, s);
}

/* The first row of a range. */
static size_t begin_of(const pma_subdomain *s, size_t worker)
{
    const size_t n = s->parts.n, workers = s->division->workers->count;
    return worker < workers ? worker * (n / workers) : n;
}

/* (5), (6) */
static bool predict_range(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_division *d = s->division;
    s->update->predict(&d->op->step, begin_of(s, worker), begin_of(s, worker + 1), d->at.from,
                       d->at.to);
    return true;
}

/* (11) */
static bool add_forces_in_range(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_division *d = s->division;
    add_forces(s, d->step, d->at.to, begin_of(s, worker), begin_of(s, worker + 1));
    return true;
}

static pma_status open_divided(pma_subdomain *s, const pma_substep *step,
                               const pma_workers *workers)
{
    PMA_TRY(pma_substep_load(s, step));
    const pma_division *d = begin_division(s, step, workers);
    (void)share(s, predict_range); /* of all rows, before K ut of any */
    (void)share(s, add_forces_in_range);
    pma_factor_open_border(&d->op->factor, d->at.to->w, d->at.vf, s->work);
    find_free_velocity(s, step, d->op, d->at.to, d->at.vf);
    return PMA_OK;
}

/* (14) inside, (8), (9) */
static bool close_range(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_division *d = s->division;
    const size_t begin = begin_of(s, worker), end = begin_of(s, worker + 1);
    const size_t inside = pma_least(end, s->parts.n - s->parts.nb);
    if (begin < inside)
        pma_factor_divide(&d->op->factor, begin, inside, d->at.to->w);
    return s->update->correct(&d->op->step, begin, end, d->at.to);
}

static pma_status close_divided(pma_subdomain *s, const pma_substep *step, const double *lam,
                                const pma_workers *workers)
{
    const pma_division *d = begin_division(s, step, workers);
    pma_substep_load_interface(s, lam);
    pma_factor_close_border(&d->op->factor, s->closing, d->at.to->w, s->work);
    if (!share(s, close_range))
        return PMA_NOT_FINITE;
    return s->is_observed ? pma_observers_close(s, step, lam) : PMA_OK;
}

/* ---- what a coupler calls in every fine step ------------------------------------------------- */

/* Several workers; or a free run, in whose only substep the multipliers are held (M6), and where
 * there are several the velocities at its end are those of the last one */
__attribute__((noinline)) static pma_status
advance_otherwise(pma_subdomain *s, const pma_substep *closed, const pma_substep *opened,
                  const double *lam, const pma_workers *workers)
{
    if (workers)
        return closed ? close_divided(s, closed, lam, workers) : open_divided(s, opened, workers);
    if (s->parts.mean)
        return s->parts.deferred ? open_substep(s, opened) : open_apart(s, opened);
    if (s->parts.substeps > 1)
        return open_apart(s, opened);
    PMA_TRY(open_substep(s, opened));
    hold(s, opened, lam);
    return PMA_OK;
}

pma_status pma_substep_advance(void *self, const pma_substep *closed, const pma_substep *opened,
                               const double *lam, const pma_workers *workers)
{
    if (!workers && closed)
        return close_substep(self, closed, lam);
    if (!workers && !opened->is_free_run)
        return open_substep(self, opened);
    return advance_otherwise(self, closed, opened, lam, workers);
}

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
const double *pma_substep_values(void *self, pma_interface_kind kind, size_t j, bool twice,
                                 const double *lam)
{
    const pma_subdomain *s = self;
    if (kind == PMA_FREE_VELOCITY || kind == PMA_BEGINNING_VELOCITY)
        return pma_levels_free_velocity(&s->levels, j);
    return other_values(self, kind, j, twice, lam);
}
