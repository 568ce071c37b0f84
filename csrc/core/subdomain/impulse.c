/* impulse.c - a substep with impulses on the interface at its end.
 *
 * To be read with (U3) and (U4) of docs/method/contact.md. The impulses go into predictors and
 * right-hand side of the open substep, which is then closed like any other. */
#include "subdomain/impulse.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "object.h"
#include "subdomain/inside.h"

pma_status pma_impulse_check(const pma_impulse_parts *parts, size_t n, size_t nb)
{
    if (!parts->inverse)
        return PMA_OK;
    for (size_t i = 0; i < nb; i++) {
        if (!(parts->inverse[i] >= 0.0 && isfinite(parts->inverse[i])))
            return PMA_BAD_SIZE;
    }
    if (!parts->ptr)
        return PMA_OK;
    for (int64_t k = parts->ptr[0]; k < parts->ptr[nb]; k++) {
        if (parts->index[k] < 0 || (size_t)parts->index[k] >= n)
            return PMA_BAD_INDEX;
    }
    return PMA_OK;
}

pma_status pma_impulse_create(const pma_parts *parts, pma_impulse **out)
{
    const bool sweeps = parts->impulse.ptr && parts->single.factor.form != PMA_DIAGONAL;
    const pma_array arrays[] = {PMA_ARRAY(pma_impulse, J, parts->nb),
                                PMA_ARRAY(pma_impulse, force, parts->nb),
                                PMA_ARRAY(pma_impulse, sweep, sweeps ? parts->n : 0),
                                {0}};
    *out = pma_object_create(sizeof **out, arrays);
    return *out ? PMA_OK : PMA_NO_MEMORY;
}

/* J = M^-1 f */
static void find_jump(const pma_subdomain *s, const double *f, double *J)
{
    for (size_t i = 0; i < s->parts.nb; i++)
        J[i] = s->parts.impulse.inverse[i] * f[i];
}

/* z -= B J, in the rows from `first` on */
static void resist(const pma_impulse_parts *p, size_t nb, const double *J, size_t first, double *z)
{
    for (size_t i = 0; i < nb; i++) {
        for (int64_t k = p->ptr[i]; k < p->ptr[i + 1] && J[i] != 0.0; k++) {
            if ((size_t)p->index[k] >= first)
                z[(size_t)p->index[k] - first] -= p->values[k] * J[i];
        }
    }
}

static bool is_diagonal(const pma_operator *op)
{
    return op->factor.form == PMA_DIAGONAL;
}

/* w_b (nb) := what is swept of w_l under f and J; the right-hand side, swept, in `sweep` if Mbar is
 * not diagonal and B is given                                                              (U4) */
static void find_link(pma_subdomain *s, const pma_operator *op, const double *f, const double *J,
                      double *w_b)
{
    const pma_impulse_parts *p = &s->parts.impulse;
    const size_t nb = s->parts.nb;
    if (!p->ptr) {
        for (size_t i = 0; i < nb; i++)
            w_b[i] = -p->beta * f[i];
    } else if (is_diagonal(op)) {
        memset(w_b, 0, nb * sizeof(double)); /* a diagonal Mbar needs no rows but these */
        resist(p, nb, J, s->parts.n - nb, w_b);
    } else {
        memset(s->impulse->sweep, 0, s->parts.n * sizeof(double));
        resist(p, nb, J, 0, s->impulse->sweep);
        pma_factor_open(&op->factor, s->impulse->sweep, w_b, s->link_work);
        return;
    }
    pma_factor_interface(&op->factor, w_b, s->link_work);
}

/* V f: v_l = J + al2 w_l                                                                   (U4) */
static void recoil(void *self, const double *f, double *v)
{
    pma_subdomain *s = self;
    const pma_operator *op = &s->parts.single;
    const double alpha = s->parts.impulse.ptr ? 0.0 : s->parts.impulse.alpha;
    double *J = s->impulse->J;
    find_jump(s, f, J);
    find_link(s, op, f, J, v);
    for (size_t i = 0; i < s->parts.nb; i++)
        v[i] = (1.0 - op->step.al2 * alpha) * J[i] + op->step.al2 * v[i];
}

/* ut += (h/2 - al1 alpha) J,  vt += (1 - al2 alpha) J, and so on: w_l = -alpha J goes into all but
 * w itself, which is corrected when the substep is closed */
static void strike(void *self, const pma_substep *step, const double *f)
{
    assert(((pma_subdomain *)self)->impulse &&
           ((pma_subdomain *)self)->levels.opened == step->j + 1);
    pma_subdomain *s = self;
    const pma_impulse_parts *p = &s->parts.impulse;
    const pma_operator *op = &s->parts.single;
    const pma_step *c = &op->step;
    const pma_state *to = pma_levels_at(&s->levels, step->j + 1);
    const size_t nb = s->parts.nb;
    const double alpha = p->ptr ? 0.0 : p->alpha;
    double *J = s->impulse->J, *force = s->impulse->force;
    double *vf = pma_levels_free_velocity(&s->levels, step->j + 1);
    double *u = pma_interface_of(s, to->u), *v = pma_interface_of(s, to->v);
    double *a = pma_interface_of(s, to->a);
    find_jump(s, f, J);
    find_link(s, op, f, J, s->link);
    for (size_t i = 0; i < nb; i++) {
        vf[i] += (1.0 - c->al2 * alpha) * J[i] + c->al2 * s->link[i];
        u[i] += (0.5 * c->h - c->al1 * alpha) * J[i];
        v[i] += (1.0 - c->al2 * alpha) * J[i];
        a[i] -= c->a_w1 * alpha * J[i];
        force[i] = p->ptr ? 0.0 : -p->beta * f[i];
    }
    if (p->ptr && is_diagonal(op))
        resist(p, nb, J, 0, to->w);
    for (size_t i = 0; p->ptr && !is_diagonal(op) && i < s->parts.n; i++)
        to->w[i] += s->impulse->sweep[i];
}

static pma_status close(void *self, const pma_substep *step, const double *lam)
{
    assert(((pma_subdomain *)self)->impulse &&
           ((pma_subdomain *)self)->levels.opened == step->j + 1);
    pma_subdomain *s = self;
    const pma_state *x = pma_levels_at(&s->levels, step->j + 1);
    const double alpha = s->parts.impulse.ptr ? 0.0 : s->parts.impulse.alpha;
    const double *J = s->impulse->J, *force = s->impulse->force;
    double *w = pma_interface_of(s, x->w);
    pma_substep_load_interface(s, lam);
    for (size_t i = 0; i < s->parts.nb; i++)
        s->closing[i] += force[i];
    if (!pma_substep_sweep_back(s, &s->parts.single, x))
        return PMA_NOT_FINITE;
    for (size_t i = 0; i < s->parts.nb; i++)
        w[i] -= alpha * J[i];
    return s->is_observed ? pma_observers_close(s, step, lam) : PMA_OK;
}

/* v = vf + al2 S^-1 L_b^T lam,  u = ut + al1 (v - vt) / al2 */
static void approach(void *self, const pma_substep *step, const double *lam, double *u, double *v)
{
    pma_subdomain *s = self;
    const pma_operator *op = pma_operator_at(s, step);
    const pma_state *to = pma_levels_at(&s->levels, step->j + 1);
    const double *vf = pma_levels_free_velocity(&s->levels, step->j + 1);
    const double *ut = pma_interface_of(s, to->u), *vt = pma_interface_of(s, to->v);
    const bool tied = lam && s->parts.link.ptr[s->parts.nb] > 0;
    if (tied)
        pma_substep_solve_link(s, op, lam);
    for (size_t i = 0; i < s->parts.nb; i++) {
        v[i] = vf[i] + (tied ? op->step.al2 * s->link[i] : 0.0);
        u[i] = ut[i] + op->step.al1 * ((v[i] - vt[i]) / op->step.al2);
    }
}

static void add_work(void *self, size_t j, double work)
{
    const pma_subdomain *s = self;
    if (s->energy)
        pma_energy_add_work(s->energy, j, work);
}

const pma_impulse_table pma_impulse_operations = {
    .strike = strike, .close = close, .approach = approach, .recoil = recoil, .add_work = add_work};
