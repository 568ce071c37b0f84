/* iterated_substep.c - a substep of a subdomain with internal forces: guess, residual, correction.
 *
 * To be read with section 14 of docs/method.md. */
#include "subdomain/iterated_substep.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* Residuals are exact up to these parts of their terms, and of the forces that the tangents give to
 * the displacements.                                                                        (N8) */
#define OF_TERMS (100.0 * DBL_EPSILON)
#define OF_DISPLACEMENTS (10.0 * DBL_EPSILON)

/* No row has to be nearer to balance than this part of the largest own force asks for.      (N7) */
#define SHARE 1e-3

/* Rounding to come in its energy, and the part of the forces below which none is seen.      (N9) */
#define MARGIN 100.0
#define BALANCED 1e-6

/* No residual is a leap that began with less than this part of the forces.                  (N9) */
#define BEGAN 1e-11

static const pma_operator *operator_of(const pma_iterate *it)
{
    return pma_operator_at(it->of, &it->step);
}

static const pma_state *iterate_of(const pma_iterate *it)
{
    return pma_levels_at(&it->of->levels, it->step.j + 1);
}

/* ---- first guess (N4) ----------------------------------------------------------------------- */

/* fixed := F(t1) - r(t1, ut, vs) + D_r vs, evaluated once, from F(t1); lagged: - C vs too */
static pma_status hold(pma_iterate *it, const pma_state *from, const pma_state *to)
{
    pma_subdomain *s = it->of;
    const pma_parts *p = &s->parts;
    if (p->lagged)
        pma_matrix_subtract(&p->C, s->vs, it->fixed);
    if (s->rig)
        PMA_TRY(pma_rig_command(s->rig, &it->step, to));
    if (!it->parts.springs)
        pma_springs_subtract(&p->springs, to->u, s->vs, from->springs, to->springs, it->fixed);
    if (p->D_r.form != PMA_ZERO) {
        for (size_t i = 0; i < p->n; i++)
            it->product[i] = -s->vs[i];
        pma_matrix_subtract(&p->D_r, it->product, it->fixed);
    }
    if (p->restoring.function)
        PMA_TRY(pma_substep_subtract_restoring(s, &it->step, to, it->fixed));
    return s->rig ? pma_rig_reply(s->rig, to) : PMA_OK;
}

/* pull := L_b^T Lam, and its size */
static void load_interface(const pma_iterate *it, const double *lam, double *pull)
{
    const pma_parts *p = &it->of->parts;
    const pma_link *L = &p->link;
    memset(pull, 0, p->nb * sizeof(double));
    memset(it->pull_size, 0, p->nb * sizeof(double));
    if (p->mean)
        return; /* they push instead */
    pma_link_load(L, lam, pull);
    for (size_t i = 0; i < p->nb; i++) {
        for (int64_t k = L->ptr[i]; k < L->ptr[i + 1]; k++)
            it->pull_size[i] += fabs(L->values[k] * lam[L->index[k]]);
    }
}

/* M_size w, which is not negative, in it->product */
static void find_inertia(pma_iterate *it, const double *w)
{
    const size_t n = it->of->parts.n;
    for (size_t i = 0; i < n; i++) {
        it->size[i] = -fabs(w[i]);
        it->product[i] = 0.0;
    }
    pma_matrix_subtract(&it->parts.M_size, it->size, it->product);
}

/* The forces at the beginning: |F(t1)| + |L^T| |Lam| + |M| |w_n|                           (N7) */
static void begin_forces(pma_iterate *it, const pma_state *from)
{
    const pma_parts *p = &it->of->parts;
    const size_t n = p->n, inner = n - p->nb;
    memset(it->fixed, 0, n * sizeof(double));
    pma_load_add(&it->of->load, it->step.t1, it->step.number, it->fixed);
    find_inertia(it, from->w);
    for (size_t i = 0; i < n; i++)
        it->forces[i] =
            fabs(it->fixed[i]) + it->product[i] + (i < inner ? 0.0 : it->pull_size[i - inner]);
}

static pma_status begin(void *self, const pma_substep *step, const double *lam)
{
    pma_subdomain *s = self;
    pma_iterate *it = s->iterate;
    const pma_parts *p = &s->parts;
    const pma_operator *op = pma_operator_at(s, step);
    const pma_state *from = pma_levels_origin(&s->levels, step);
    const pma_state *to = pma_levels_at(&s->levels, step->j + 1);
    if (s->is_observed)
        PMA_TRY(pma_observers_open(s));
    PMA_TRY(pma_substep_load(s, step));
    it->step = *step;
    it->corrections = 0;
    if (step->j == 0)
        it->scale = it->scale_present; /* a macro step may be run again */
    it->motion = it->scale;
    it->singular = SIZE_MAX;
    it->linearized = it->tied = it->evaluated = it->has_tangent = it->leapt = false;
    it->measure.correction = it->slope = it->moved = 0.0;
    memcpy(it->u_n, from->u, p->n * sizeof(double));
    memcpy(it->v_n, from->v, p->n * sizeof(double));
    memcpy(it->springs_n, from->springs, pma_iterate_spring_numbers(it) * sizeof(double));
    memcpy(it->history_n, from->history, p->internal.history * sizeof(double));
    load_interface(it, lam, it->pull);
    begin_forces(it, from);

    /* (R1), (5), (6); v1 = v_n */
    if (s->extrapolates)
        pma_substep_extrapolate(op->step.h, p->n, from, s->vs);
    pma_restoring_accelerate(&p->restoring, from->w, step->twice ? 2.0 : 1.0);
    s->update->predict(&op->step, 0, p->n, from, to);
    if (s->mean && s->mean->is_pushed)
        pma_substep_push(p->n, op->step.h, s->mean->push, to, s->extrapolates ? s->vs : NULL);
    for (size_t i = 0; i < p->n; i++)
        it->guess[i] = to->w[i] = (it->v_n[i] - to->v[i]) / op->step.al2;
    return hold(it, from, to);
}

static void restart(void *self, const double *lam)
{
    pma_iterate *it = ((pma_subdomain *)self)->iterate;
    it->linearized = it->tied = it->evaluated = it->has_tangent = false;
    it->slope = it->moved = 0.0;
    memcpy(iterate_of(it)->w, it->guess, it->of->parts.n * sizeof(double));
    load_interface(it, lam, it->pull);
}

static void move(void *self, double by)
{
    pma_iterate *it = ((pma_subdomain *)self)->iterate;
    double *w = iterate_of(it)->w;
    it->linearized = it->evaluated = it->has_tangent = false;
    it->moved += by;
    for (size_t i = 0; i < it->of->parts.n; i++)
        w[i] += by * it->dw[i];
}

/* ---- residual and tangent (N2) -------------------------------------------------------------- */

/* tangent += al1 K_t + al2 C_t of the springs */
static void add_spring_tangents(const pma_iterate *it, const double *to, const pma_step *step,
                                double *tangent)
{
    static const double signs[4] = {1.0, -1.0, -1.0, 1.0};
    const pma_springs *springs = &it->of->parts.springs;
    pma_springs_tangent(springs, it->springs_n, to, step->al1, step->al2, it->slopes);
    for (size_t i = 0; i < springs->total; i++) {
        for (size_t k = 0; k < 4; k++) {
            const int64_t entry = it->spring_entries[4 * i + k];
            if (entry >= 0)
                tangent[entry] += signs[k] * it->slopes[i];
        }
    }
}

/* f := C v + K u + f(t1, u, v; q_n) of springs and functions; the tangent of Mbar if wanted */
static pma_status evaluate_forces(pma_iterate *it, const double *u, const double *v,
                                  double *tangent)
{
    pma_subdomain *s = it->of;
    const pma_parts *p = &s->parts;
    const pma_operator *op = operator_of(it);
    const pma_state *x = iterate_of(it);
    memset(it->f, 0, p->n * sizeof(double));
    memset(it->force, 0, p->n * sizeof(double));
    if (tangent && p->internal.count > 0)
        memset(it->stiffness, 0, pma_iterate_entries(it) * sizeof(double));
    const pma_internal_point at = {.t = it->step.t1, .u = u, .v = v, .q = it->history_n};
    const pma_internal_values out = {.f = it->force,
                                     .q1 = x->history,
                                     .al1 = op->step.al1,
                                     .al2 = op->step.al2,
                                     .tangent = tangent,
                                     .stiffness = it->stiffness};
    PMA_TRY(pma_internal_evaluate(&p->internal, &at, &out, it->scratch, &s->code));
    if (it->parts.springs) {
        pma_springs_subtract(&p->springs, u, v, it->springs_n, x->springs, it->f);
        if (tangent)
            add_spring_tangents(it, x->springs, &op->step, tangent);
    }
    if (!p->lagged)
        pma_matrix_subtract(&p->C, v, it->f);
    pma_matrix_subtract(&p->D_r, v, it->f);
    pma_matrix_subtract(&p->K, u, it->f);
    for (size_t i = 0; i < p->n; i++)
        it->f[i] = it->force[i] - it->f[i];
    return PMA_OK;
}

static double dot(size_t n, const double *x, const double *y)
{
    double sum = 0.0;
    for (size_t i = 0; i < n; i++)
        sum += x[i] * y[i];
    return sum;
}

/* The force has jumped within rounding, and so does what this residual would move.          (N9) */
static bool is_fixed(const pma_iterate *it, double residual)
{
    return it->leapt && residual <= BEGAN;
}

/* max |R_i| / T_i of the rows in which R is more than rounding, or those in which it is
 *                                                                                    (N7) (N8) */
static double largest_part(const pma_iterate *it, bool rounding)
{
    double largest = 0.0;
    for (size_t i = 0; i < it->of->parts.n; i++) {
        const double R = fabs(it->R[i]);
        if ((R <= it->rounding[i]) == rounding && R > 0.0)
            largest = fmax(largest, R / it->limit[i]);
    }
    return largest;
}

/* |s(x) - (1 - x) s(0)| / |x s(0)| along the last correction, of a subdomain in doubt      (N21) */
static double departure(const pma_iterate *it)
{
    const double x = 1.0 + it->moved, expected = (1.0 - x) * it->slope;
    if (!it->doubtful || it->slope == 0.0 || x == 0.0)
        return 0.0;
    return fabs(it->measure.slope - expected) / fabs(x * it->slope);
}

/* (N7)  T: the forces at the beginning, and at the iterate; rows by the root of D
 * (N8)  rounding: of the largest terms t and displacements of all rows, or what was found (N9) */
static void measure_residual(pma_iterate *it)
{
    const pma_parts *p = &it->of->parts;
    const size_t n = p->n, inner = n - p->nb;
    const double al1 = operator_of(it)->step.al1, s2 = it->scale / al1;
    const double *base = it->step.twice ? it->parts.base_twice : it->parts.base;
    double *root = it->rounding, *terms = it->product, own = sqrt(fmax(0.0, s2));
    double rounding = sqrt(fmax(0.0, -s2));
    find_inertia(it, iterate_of(it)->w);
    for (size_t i = 0; i < n; i++) {
        const int64_t k = it->diagonal[i];
        const double pull = i < inner ? 0.0 : it->pull_size[i - inner];
        const double tangent = fabs(it->numeric.values[k] - base[k]);
        root[i] = sqrt(fabs(base[k]) + tangent);
        terms[i] += fabs(it->force[i]) + fabs(it->f[i] - it->force[i]) + fabs(it->fixed[i]) + pull;
        const double whole = tangent / al1 * fabs(it->u[i]);
        rounding = fmax(rounding, (OF_TERMS * terms[i] + OF_DISPLACEMENTS * whole) / root[i]);
        it->limit[i] = fmax(it->forces[i], terms[i]);
        own = fmax(own, (it->limit[i] - pull) / root[i]);
    }
    for (size_t i = 0; i < n; i++) {
        it->limit[i] = fmax(it->limit[i], SHARE * own * root[i]);
        root[i] *= rounding;
    }
    it->measure.residual = largest_part(it, false);
    it->measure.rounded = largest_part(it, true);
    it->measure.leap = it->tied ? it->measure.residual / fmax(it->left, BEGAN) : 0.0;
    it->leapt = it->leapt || it->measure.leap > PMA_LEAP;
    if (is_fixed(it, it->measure.residual))
        it->measure.residual = 0.0;
    if (it->moved <= 0.0)
        it->doubtful = it->measure.rounded > PMA_SMALL;
}

/* R = F + L^T Lam - M w - f at the iterate                                                 (N2) */
static pma_status evaluate(void *self, bool tangent, pma_measure *m)
{
    pma_subdomain *s = self;
    pma_iterate *it = s->iterate;
    const size_t n = s->parts.n;
    const pma_step *c = &operator_of(it)->step;
    const pma_state *x = iterate_of(it);
    *m = it->measure;
    if (it->evaluated && (it->has_tangent || !tangent))
        return PMA_OK; /* as it was left by the last look, or the free solution of a long substep */
    for (size_t i = 0; i < n; i++) {
        it->u[i] = x->u[i] + c->al1 * x->w[i];
        it->v[i] = x->v[i] + c->al2 * x->w[i];
    }
    double *entries = tangent ? it->numeric.values : NULL;
    it->refactored = it->refactored || tangent;
    if (it->overwritten && !tangent) /* by the tangent of an iterate that was accepted */
        memcpy(it->numeric.values, it->numeric.factored, pma_iterate_entries(it) * sizeof(double));
    it->overwritten = tangent;
    if (tangent)
        memcpy(entries, it->step.twice ? it->parts.base_twice : it->parts.base,
               (size_t)it->parts.tangent.ptr[n] * sizeof(double));
    PMA_TRY(evaluate_forces(it, it->u, it->v, entries));
    for (size_t i = 0; i < n; i++)
        it->R[i] = it->fixed[i] - it->f[i];
    double *R_b = pma_interface_of(s, it->R);
    for (size_t i = 0; i < s->parts.nb; i++)
        R_b[i] += it->pull[i];
    pma_matrix_subtract(&s->parts.M, x->w, it->R);
    if (s->parts.K_r.form != PMA_ZERO) {
        for (size_t i = 0; i < n; i++)
            it->size[i] = c->al1 * x->w[i];
        pma_matrix_subtract(&s->parts.K_r, it->size, it->R); /* K_r (u - ut) */
    }
    if (!pma_is_finite(n, it->R) ||
        (tangent && !pma_is_finite(pma_iterate_entries(it), it->numeric.values)))
        return PMA_NOT_FINITE;
    measure_residual(it);
    it->evaluated = true;
    it->has_tangent = tangent;
    it->measure.slope = c->al2 * dot(n, it->dw, it->R);
    it->measure.departs = departure(it);
    *m = it->measure;
    return PMA_OK;
}

/* ---- correction ----------------------------------------------------------------------------- */

/* changed: the compliance follows another tangent, or another step */
static pma_status factor(pma_iterate *it, bool *changed)
{
    const size_t made = it->numeric.made;
    const bool other = !it->factored || it->factored_twice != it->step.twice;
    size_t column;
    it->factored = false;
    const pma_status status = pma_numeric_factor(&it->numeric, &column);
    if (status == PMA_NOT_DEFINITE) {
        it->singular = column;
        return pma_is_finite(pma_iterate_entries(it), it->numeric.values) ? PMA_SINGULAR
                                                                          : PMA_NOT_FINITE;
    }
    it->factored = status == PMA_OK;
    it->overwritten = status != PMA_OK;
    it->factored_twice = it->step.twice;
    *changed = other || it->numeric.made > made;
    return status;
}

/* o = L (v + al2 Mbar_t^-1 R) - G Lam, before L: the free velocity                        (N11) */
static pma_status linearize(void *self, bool fresh, const double *lam, bool *changed)
{
    pma_subdomain *s = self;
    pma_iterate *it = s->iterate;
    const pma_operator *op = operator_of(it);
    const size_t n = s->parts.n, nb = s->parts.nb;
    double *vf = pma_levels_free_velocity(&s->levels, it->step.j + 1);
    *changed = false;
    if (it->linearized)
        return PMA_OK;
    PMA_TRY(fresh ? factor(it, changed) : PMA_OK);
    it->linearized = fresh;
    memcpy(it->dw, it->R, n * sizeof(double));
    pma_factor_open(&it->numeric.factor, it->dw, vf, s->work);
    pma_substep_solve_link(s, op, lam);
    const double *v_b = pma_interface_of(s, it->v);
    for (size_t i = 0; i < nb; i++)
        vf[i] = v_b[i] + op->step.al2 * (vf[i] - s->link[i]);
    s->levels.opened = it->step.j + 1;
    return PMA_OK;
}

/* du . Mbar_t du / al1 from the beginning of the substep on, with the iterate in it->u */
static double motion(const pma_iterate *it, double al1)
{
    const size_t n = it->of->parts.n;
    for (size_t i = 0; i < n; i++) {
        it->size[i] = it->u[i] - it->u_n[i];
        it->product[i] = 0.0;
    }
    pma_numeric_multiply(&it->numeric, it->size, it->product);
    return dot(n, it->size, it->product) / al1;
}

/* Mbar_t dw = R + L^T (Lam - Lam*),  w += dw                                         (N3) (N12) */
static void correct(void *self, const double *lam, pma_measure *m)
{
    pma_subdomain *s = self;
    pma_iterate *it = s->iterate;
    const size_t n = s->parts.n, nb = s->parts.nb;
    const pma_step *c = &operator_of(it)->step;
    const pma_state *x = iterate_of(it);
    double *R_b = pma_interface_of(s, it->R), pull = 0.0;
    const double *rounding_b = pma_interface_of(s, it->rounding);
    load_interface(it, lam, s->closing);
    for (size_t i = 0; i < nb; i++) {
        s->closing[i] -= it->pull[i];
        it->pull[i] += s->closing[i];
        R_b[i] += s->closing[i];
        pull = fmax(pull, fabs(s->closing[i]) / rounding_b[i]); /* not a number: 0 of 0 */
    }
    pma_factor_close(&it->numeric.factor, s->closing, it->dw, s->work);
    it->left = largest_part(it, false);
    if (is_fixed(it, it->left))
        memset(it->dw, 0, n * sizeof(double));
    it->tied = true;
    for (size_t i = 0; i < n; i++) {
        x->w[i] += it->dw[i];
        it->u[i] = x->u[i] + c->al1 * x->w[i];
    }
    const double step = dot(n, it->dw, it->R), s2 = motion(it, c->al1);
    it->motion = s2 > MARGIN * -it->scale ? fmax(it->scale, s2) : it->scale;
    it->measure.correction = fabs(c->al1 * step);
    it->measure.motion = fmax(it->scale, s2);
    it->measure.slope = it->slope = c->al2 * step;
    it->moved = 0.0;
    it->measure.pull = pull;
    *m = it->measure;
    it->corrections++;
    it->linearized = it->evaluated = it->has_tangent = false;
}

static void remember_rounding(void *self)
{
    pma_iterate *it = ((pma_subdomain *)self)->iterate;
    if (it->left > BALANCED)
        it->motion = -MARGIN * fabs(it->motion);
}

/* ---- in interface space --------------------------------------------------------------------- */

/* v at the beginning of single steps is no longer in the time level, which is made in place. */
static void rebase(void *self, size_t j, const double *lam)
{
    pma_subdomain *s = self;
    const pma_iterate *it = s->iterate;
    double *v = it->step.twice ? pma_levels_at(&s->levels, j)->v : it->v_n;
    pma_substep_store_free_velocity(s, operator_of(it), pma_interface_of(s, v), lam,
                                    pma_levels_free_velocity(&s->levels, j));
}

static void block(void *self, double *out)
{
    pma_subdomain *s = self;
    const pma_iterate *it = s->iterate;
    const double al2 = operator_of(it)->step.al2;
    if (pma_numeric_compliance_scratch(&it->numeric, it->count) > 0) {
        pma_numeric_compliance(&it->numeric, &s->parts.link, it->column, it->count, al2, out,
                               it->many);
        return;
    }
    double *lam = it->lam, *sum = it->lam + s->parts.link.p;
    for (size_t k = 0; k < it->count; k++) {
        lam[it->rows[k]] = 1.0;
        pma_substep_solve_link(s, operator_of(it), lam);
        lam[it->rows[k]] = 0.0;
        for (size_t i = 0; i < it->count; i++)
            sum[it->rows[i]] = 0.0;
        pma_link_gather(&s->parts.link, al2, s->link, sum);
        for (size_t i = 0; i < it->count; i++)
            out[i * it->count + k] = sum[it->rows[i]];
    }
}

static double *corrections(void *self, size_t j)
{
    const pma_subdomain *s = self;
    return pma_levels_at(&s->levels, j)->history + s->parts.internal.history;
}

static double scale(const void *self)
{
    return ((const pma_subdomain *)self)->iterate->scale;
}

static bool has_factor(const void *self)
{
    const pma_iterate *it = ((const pma_subdomain *)self)->iterate;
    return it->factored && it->factored_twice == it->step.twice;
}

/* ---- a substep that is iterated alone ------------------------------------------------------- */

typedef pma_iterated_alone alone;

static pma_status alone_evaluate(void *self, bool tangent, pma_measure *m)
{
    const alone *own = &((pma_subdomain *)self)->iterate->alone;
    return own->stop(own->ctx) ? PMA_STOPPED : evaluate(self, tangent, m);
}

static pma_status alone_correct(void *self, bool fresh, pma_measure *m)
{
    const alone *own = &((pma_subdomain *)self)->iterate->alone;
    bool changed;
    PMA_TRY(linearize(self, fresh, own->lam, &changed));
    correct(self, own->lam, m);
    return PMA_OK;
}

static void alone_restart(void *self)
{
    restart(self, ((pma_subdomain *)self)->iterate->alone.lam);
}

static pma_status converge(void *self, const pma_newton *newton, const double *lam,
                           bool (*stop)(void *ctx), void *ctx)
{
    static const pma_equations EQUATIONS = {.evaluate = alone_evaluate,
                                            .correct = alone_correct,
                                            .move = move,
                                            .restart = alone_restart,
                                            .remember_rounding = remember_rounding};
    pma_iterate *it = ((pma_subdomain *)self)->iterate;
    it->alone = (alone){.lam = lam, .stop = stop, .ctx = ctx};
    PMA_TRY(pma_newton_solve(newton, &EQUATIONS, self, has_factor(self)));
    it->tied = false; /* under multipliers that are given, not with those of all subdomains */
    it->scale = it->motion;
    return PMA_OK;
}

/* Springs and functions that are iterated, at the end of the substep, are evaluated at the state
 * itself; what is evaluated once was at the predictor. */
static void balance(pma_iterate *it, const pma_state *x)
{
    pma_subdomain *s = it->of;
    const double al1 = operator_of(it)->step.al1;
    if (s->parts.internal.count > 0)
        pma_balance_bend(s->balance, &it->step, x->u, it->force,
                         it->has_tangent ? it->stiffness : NULL);
    for (size_t i = 0; i < s->parts.n; i++)
        it->size[i] = x->u[i] - al1 * x->w[i];
    const pma_evaluated_forces watched = pma_balance_open(s->balance, it->step.number, it->size);
    double *r = watched.r;
    if (watched.total)
        pma_substep_take_total(s, x, watched.total);
    memcpy(r, it->force, s->parts.n * sizeof(double));
    pma_substep_add_evaluated(s, x, r);
    pma_balance_iterate(s->balance, &it->step, it->parts.springs ? r : it->force);
}

/* (8), (9); what springs and functions remember is that of the last evaluation, at the state */
static pma_status finish(void *self, const double *lam)
{
    pma_subdomain *s = self;
    pma_iterate *it = s->iterate;
    const size_t history = s->parts.internal.history;
    const pma_state *x = iterate_of(it);
    if (!s->update->correct(&operator_of(it)->step, 0, s->parts.n, x))
        return PMA_NOT_FINITE;
    const bool springs = it->parts.springs && s->parts.springs.total > 0;
    if (!it->evaluated && (s->is_observed || history > 0 || springs)) {
        PMA_TRY(evaluate_forces(it, x->u, x->v, NULL));
        if (!pma_is_finite(s->parts.n, it->f))
            return PMA_NOT_FINITE;
    }
    if (!pma_is_finite(history, x->history))
        return PMA_NOT_FINITE;
    x->history[history] = (double)it->corrections;
    if (s->balance)
        balance(it, x);
    it->scale = it->motion;
    return s->is_observed ? pma_observers_close(s, &it->step, lam) : PMA_OK;
}

/* ---- the table ------------------------------------------------------------------------------ */

static const pma_iterated_table TABLE = {.begin = begin,
                                         .converge = converge,
                                         .evaluate = evaluate,
                                         .linearize = linearize,
                                         .correct = correct,
                                         .move = move,
                                         .restart = restart,
                                         .rebase = rebase,
                                         .block = block,
                                         .finish = finish,
                                         .has_factor = has_factor,
                                         .remember_rounding = remember_rounding,
                                         .corrections = corrections,
                                         .scale = scale};

pma_iterated pma_iterated_substep_member(const pma_iterate *it)
{
    return (pma_iterated){.table = &TABLE, .count = it->count, .rows = it->rows};
}
