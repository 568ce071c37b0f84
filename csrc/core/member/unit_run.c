#include "member/unit_run.h"

#include <stdlib.h>
#include <string.h>

#include "algebra/lanes.h"
#include "algebra/loops.h"
#include "member/subdomain_struct.h"

struct pma_unit_run {
    const pma_subdomain *of;
    bool twice;
    pma_state state;    /* n each */
    double *vs;         /* n: extrapolated velocity, if C is lagged */
    double *y;          /* n: mean coupling: M^-1 L_b^T lam */
    double *pull;       /* nb: L_b^T lam */
    double *lam;        /* p */
    double *end, *mean; /* p: L_b v, or L_b u, at the end, and the mean of all L_b v */
    double *work;       /* scratch of the factor */
    double *block;
};

static size_t most(size_t a, size_t b)
{
    return a > b ? a : b;
}

static size_t scratch_of(const pma_parts *p)
{
    const size_t single = pma_factor_scratch(&p->single.factor);
    const size_t twice = p->doubled ? pma_factor_scratch(&p->twice.factor) : 0;
    const size_t mass = p->mean ? pma_factor_scratch(&p->mass) : 0;
    return most(most(single, twice), mass);
}

/* The numbers of an unknown are a line of the cache. */
static double *aligned(double *block)
{
    const size_t line = PMA_LANES * sizeof *block;
    const size_t numbers = (line - (uintptr_t)block % line) % line / sizeof *block;
    return block + numbers;
}

static double *take(double **next, size_t count)
{
    double *taken = *next;
    *next += count * PMA_LANES;
    return taken;
}

pma_status pma_unit_run_create(const pma_subdomain *s, pma_unit_run **out)
{
    const pma_parts *p = &s->parts;
    const size_t n = p->n, scratch = scratch_of(p);
    const size_t n_vs = p->lagged ? n : 0, n_y = p->mean ? n : 0;
    const size_t size = 4 * n + n_vs + n_y + p->nb + 3 * p->link.p + scratch;
    *out = NULL;
    pma_unit_run *r = calloc(1, sizeof *r);
    if (!r)
        return PMA_NO_MEMORY;
    r->of = s;
    r->block = calloc((size + 1) * PMA_LANES, sizeof(double));
    if (!r->block) {
        free(r);
        return PMA_NO_MEMORY;
    }
    double *next = aligned(r->block);
    r->state.u = take(&next, n);
    r->state.v = take(&next, n);
    r->state.w = take(&next, n);
    r->state.a = take(&next, n);
    r->vs = take(&next, n_vs);
    r->y = take(&next, n_y);
    r->pull = take(&next, p->nb);
    r->lam = take(&next, p->link.p);
    r->end = take(&next, p->link.p);
    r->mean = take(&next, p->link.p);
    r->work = take(&next, scratch);
    *out = r;
    return PMA_OK;
}

void pma_unit_run_destroy(pma_unit_run *r)
{
    if (r)
        free(r->block);
    free(r);
}

/* ---- substeps ------------------------------------------------------------------------------- */

static void clear(double *x, size_t count)
{
    memset(x, 0, count * PMA_LANES * sizeof *x);
}

/* (K1)  y := M^-1 L_b^T lam, half of it in a double step */
static void accelerate(pma_unit_run *r)
{
    const pma_parts *p = &r->of->parts;
    const double share = r->twice ? 0.5 : 1.0;
    double *y_b = r->y + (p->n - p->nb) * PMA_LANES;
    clear(r->y, p->n);
    for (size_t k = 0; k < p->nb * PMA_LANES; k++)
        y_b[k] = share * r->pull[k];
    const pma_factor mass = pma_lanes_factor(&p->mass);
    pma_factor_solve(&mass, r->y, r->work);
}

void pma_unit_run_begin(pma_unit_run *r, bool twice, size_t count, const int64_t *rows)
{
    const pma_parts *p = &r->of->parts;
    r->twice = twice;
    clear(r->state.u, 4 * p->n); /* all four: they are one array */
    clear(r->pull, p->nb);
    clear(r->lam, p->link.p);
    clear(r->end, p->link.p);
    clear(r->mean, p->link.p);
    for (size_t l = 0; l < count; l++)
        r->lam[(size_t)rows[l] * PMA_LANES + l] = 1.0;
    pma_loops_add(&p->link, r->lam, r->pull);
    if (p->mean)
        accelerate(r);
}

/* y += scale x */
static void add(size_t count, double scale, const double *x, double *restrict y)
{
    for (size_t k = 0; k < count * PMA_LANES; k++)
        y[k] += scale * x[k];
}

/* (R1), (5), (6), and of the multipliers (K2) */
static void predict(pma_unit_run *r, const pma_step *step)
{
    const pma_subdomain *s = r->of;
    const size_t n = s->parts.n;
    const pma_state *x = &r->state;
    if (s->parts.lagged)
        pma_substep_extrapolate(step->h, n * PMA_LANES, x, r->vs);
    s->update->predict(step, 0, n * PMA_LANES, x, x);
    if (!s->parts.mean)
        return;
    add(n, 0.5 * step->h * step->h, r->y, x->u);
    add(n, step->h, r->y, x->v);
    if (s->parts.lagged)
        add(n, step->h, r->y, r->vs);
}

void pma_unit_run_step(pma_unit_run *r, size_t j)
{
    const pma_parts *p = &r->of->parts;
    const pma_operator *op = pma_operator_of(r->of, r->twice);
    const pma_factor factor = pma_lanes_factor(&op->factor);
    const pma_state *x = &r->state;
    const size_t interior = (p->n - p->nb) * PMA_LANES;
    predict(r, &op->step);

    /* -(C + D_r) vt - (K + K_r) ut; lagged: C vs (R4) */
    pma_loops_subtract(&p->C, p->lagged ? r->vs : x->v, x->w);
    pma_loops_subtract(&p->K, x->u, x->w);
    pma_loops_subtract(&p->D_r, x->v, x->w);
    pma_loops_subtract(&p->K_r, x->u, x->w);

    /* (12)  w = Mbar^-1 (g + (j / substeps) L_b^T lam), (8), (9) */
    if (!p->mean)
        add(p->nb, (double)j / (double)p->substeps, r->pull, x->w + interior);
    pma_factor_solve(&factor, x->w, r->work);
    r->of->update->correct(&op->step, 0, p->n * PMA_LANES, x);

    pma_loops_gather(&p->link, 1.0 / (double)p->substeps, x->v + interior, r->mean);
    if (j == p->substeps)
        pma_loops_gather(&p->link, 1.0, (p->mean ? x->u : x->v) + interior, r->end);
}

/* ---- results -------------------------------------------------------------------------------- */

double pma_unit_run_end(const pma_unit_run *r, size_t lane, int64_t row)
{
    return r->end[(size_t)row * PMA_LANES + lane];
}

double pma_unit_run_mean(const pma_unit_run *r, size_t lane, int64_t row)
{
    return r->mean[(size_t)row * PMA_LANES + lane];
}

void pma_unit_run_copy(const pma_unit_run *r, size_t lane, double *out)
{
    for (size_t i = 0; i < 4 * r->of->parts.n; i++)
        out[i] = r->state.u[i * PMA_LANES + lane];
}

bool pma_unit_run_is_finite(const pma_unit_run *r)
{
    double zero = 0.0;
#pragma omp simd reduction(+ : zero)
    for (size_t k = 0; k < 4 * r->of->parts.n * PMA_LANES; k++)
        zero += 0.0 * r->state.u[k];
    return zero == 0.0;
}
