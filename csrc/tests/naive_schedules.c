/* naive_schedules.c - the coupled steps as docs/method.md has them, with all time levels kept. */
#include <string.h>

#include "models.h"

static const level REST = {.u = {0.0}};
static const double NOTHING[MOST] = {0.0};

level naive_response(const subdomain *x, bool twice, const double *lam)
{
    level at = REST;
    double y[MOST];
    naive_push(x, lam, y);
    for (size_t i = 0; i < x->n; i++)
        y[i] *= twice ? 0.5 : 1.0;
    for (size_t j = 1; j <= x->substeps; j++) {
        const level from = at;
        double grown[CONSTRAINTS];
        for (size_t row = 0; row < x->p; row++)
            grown[row] = lam[row] * (double)j / (double)x->substeps;
        if (x->mean)
            naive_pushed(x, twice, 0.0, NOTHING, y, &from, &at);
        else
            naive_link_response(x, twice, grown, &from, &at);
    }
    return at;
}

/* ---- the naive coupler: section 5 as written ------------------------------------------------ */

/* From time level k of subdomain i to the next one, the free problem. */
static void naive_open(model *m, size_t i, size_t k)
{
    const subdomain *x = &m->subdomains[i];
    const bool twice = x->doubled && k >= x->substeps;
    const double t = (double)(k + 1) / (double)x->substeps * m->dt;
    level *to = &m->levels[i][k + 1];
    double F[MOST];
    naive_force(x, t, k, F);
    naive_free(x, twice, t, F, twice ? to - 2 : to - 1, to);
}

static void naive_end(model *m, size_t i, size_t k, const double *lam)
{
    const subdomain *x = &m->subdomains[i];
    const bool twice = x->doubled && k >= x->substeps;
    level *to = &m->levels[i][k + 1];
    naive_close(x, twice, lam, twice ? to - 2 : to - 1, to);
}

/* L vf of subdomain i at fine step k, in mid-step interpolated; opens the substep that begins
 * there. */
static void naive_free_velocity(model *m, size_t i, size_t k, double *jump)
{
    const subdomain *x = &m->subdomains[i];
    const size_t ratio = m->fine / x->substeps, next = (k + ratio - 1) / ratio;
    const level *to = &m->levels[i][next], *last = to - 1;
    if ((k - 1) % ratio == 0)
        naive_open(m, i, next - 1);
    const double theta = (double)(k - (next - 1) * ratio) / (double)ratio;
    for (size_t row = 0; row < m->p; row++)
        jump[row] +=
            (1.0 - theta) * constrained(x, row, last->vf) + theta * constrained(x, row, to->vf);
}

/* A subdomain that has a time level at fine step k takes Lam. */
static void naive_arrive(model *m, size_t i, size_t k)
{
    const subdomain *x = &m->subdomains[i];
    const size_t ratio = m->fine / x->substeps;
    if (k % ratio != 0)
        return;
    naive_end(m, i, k / ratio - 1, m->lam[k]);
    if (k == m->fine && x->doubled && m->rebased)
        naive_store(x, true, m->lam[k], &m->levels[i][k / ratio]);
}

static void naive_fine_step(model *m, size_t k)
{
    double jump[CONSTRAINTS] = {0.0};
    prescribe(m, k, m->lam[k]);
    for (size_t i = 0; i < m->count; i++)
        naive_free_velocity(m, i, k, jump);
    for (size_t row = 0; row < m->p; row++)
        m->lam[k][row] -= jump[row];
    naive_solve(m->p, m->H[k > m->fine], m->lam[k]);
    for (size_t i = 0; i < m->count; i++)
        naive_arrive(m, i, k);
}

/* ---- the same in macro coupling: section 13 as written -------------------------------------- */

/* (M2), with lam held */
static void naive_free_macro_run(model *m, size_t i, size_t macro)
{
    const size_t begin = macro * m->subdomains[i].substeps;
    for (size_t k = begin; k < begin + m->subdomains[i].substeps; k++) {
        naive_open(m, i, k);
        naive_end(m, i, k, m->lam[macro]);
    }
}

/* (M3) added to every level of the macro step, (M5) */
static void naive_add_response(model *m, size_t i, size_t macro, const double *dlam)
{
    const subdomain *x = &m->subdomains[i];
    const bool twice = x->doubled && macro > 0;
    level at = REST;
    for (size_t j = 1; j <= x->substeps; j++) {
        const level from = at;
        double grown[CONSTRAINTS];
        for (size_t row = 0; row < m->p; row++)
            grown[row] = dlam[row] * (double)j / (double)x->substeps;
        naive_link_response(x, twice, grown, &from, &at);
        naive_add(x, &at, &m->levels[i][macro * x->substeps + j]);
    }
}

static void naive_macro_step(model *m, size_t macro)
{
    double dlam[CONSTRAINTS];
    prescribe(m, macro + 1, dlam);
    for (size_t i = 0; i < m->count; i++) {
        const subdomain *x = &m->subdomains[i];
        naive_free_macro_run(m, i, macro);
        for (size_t row = 0; row < m->p; row++)
            dlam[row] -= constrained(x, row, m->levels[i][(macro + 1) * x->substeps].v);
    }
    naive_solve(m->p, m->H[macro > 0], dlam); /* (M4) */
    for (size_t row = 0; row < m->p; row++)
        m->lam[macro + 1][row] = m->lam[macro][row] + dlam[row];
    for (size_t i = 0; i < m->count; i++)
        naive_add_response(m, i, macro, dlam);
}

/* ---- mean coupling: section 15 as written ---------------------------------------------------- */

/* All substeps of a macro step under lam, in a double step under the mean of both           (K2) */
static void naive_mean_run(model *m, size_t i, size_t macro, const double *lam)
{
    const subdomain *x = &m->subdomains[i];
    const bool twice = x->doubled && macro > 0;
    double both[CONSTRAINTS], y[MOST], F[MOST];
    for (size_t row = 0; row < m->p; row++)
        both[row] = twice ? (m->lam[macro][row] + lam[row]) / 2.0 : lam[row];
    naive_push(x, both, y);
    for (size_t k = macro * x->substeps; k < (macro + 1) * x->substeps; k++) {
        const double t = (double)(k + 1) / (double)x->substeps * m->dt;
        level *to = &m->levels[i][k + 1];
        naive_force(x, t, k, F);
        naive_pushed(x, twice, t, F, y, twice ? to - 2 : to - 1, to);
    }
}

/* g_u (p): 0, and where a velocity is prescribed the displacement that it leads to          (K4) */
static void naive_target(const model *m, size_t macro, double *target)
{
    double g0[CONSTRAINTS], g1[CONSTRAINTS];
    prescribe(m, macro, g0);
    prescribe(m, macro + 1, g1);
    memset(target, 0, m->p * sizeof(double));
    if (m->motion_count == 0)
        return;
    const size_t row = (size_t)m->moved_row;
    target[row] = m->dt * (g0[row] + g1[row]) / 2.0;
    for (size_t i = 0; i < m->count; i++)
        target[row] +=
            constrained(&m->subdomains[i], row, m->levels[i][macro * m->subdomains[i].substeps].u);
}

/* The multiplier at time t of macro step `macro`, in macro steps: on the line through the last two
 * means of neighbours, at the time level between them; at first through Lam_0 and what there is
 * (K5) */
static double multiplier_at(const model *m, size_t macro, double t, size_t row)
{
    const double first = m->lam[0][row], now = m->lam[macro + 1][row];
    if (macro == 0)
        return first + t / 0.5 * (now - first);
    const double mean = (m->lam[macro][row] + now) / 2.0;
    const double before = macro == 1 ? first : (m->lam[macro - 1][row] + m->lam[macro][row]) / 2.0;
    return before + (t - (double)macro + 1.0) * (mean - before);
}

static void naive_accelerate(model *m, size_t i, size_t macro)
{
    const subdomain *x = &m->subdomains[i];
    for (size_t j = 1; j <= x->substeps; j++) {
        const double t = (double)macro + (double)j / (double)x->substeps;
        double lam[CONSTRAINTS];
        for (size_t row = 0; row < m->p; row++)
            lam[row] = multiplier_at(m, macro, t, row);
        naive_push(x, lam, m->levels[i][macro * x->substeps + j].more);
    }
}

static void naive_mean_step(model *m, size_t macro)
{
    double *lam = m->lam[macro + 1];
    naive_target(m, macro, lam);
    for (size_t i = 0; i < m->count; i++) {
        naive_mean_run(m, i, macro, NOTHING);
        for (size_t row = 0; row < m->p; row++)
            lam[row] -= constrained(&m->subdomains[i], row,
                                    m->levels[i][(macro + 1) * m->subdomains[i].substeps].u);
    }
    naive_solve(m->p, m->H[macro > 0], lam); /* (K4) */
    for (size_t i = 0; i < m->count; i++) {
        naive_mean_run(m, i, macro, lam);
        naive_accelerate(m, i, macro);
    }
}

/* ---- all of them ----------------------------------------------------------------------------- */

void naive_run(model *m, size_t steps)
{
    for (size_t i = 0; i < m->count && m->mean; i++)
        naive_push(&m->subdomains[i], m->lam0, m->levels[i][0].more);
    memcpy(m->lam[0], m->lam0, sizeof m->lam0);
    for (size_t macro = 0; m->macro && macro < steps; macro++)
        (m->mean ? naive_mean_step : naive_macro_step)(m, macro);
    for (size_t k = 1; !m->macro && k <= steps * m->fine; k++)
        naive_fine_step(m, k);
}
