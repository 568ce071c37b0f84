#include "member/response.h"

#include <stdlib.h>
#include <string.h>

#include "member/inside.h"

struct pma_response {
    const pma_subdomain *of;
    pma_state state;
    pma_unit_responses units;
    double *vs;   /* n: extrapolated velocity, if C is lagged */
    double *pull; /* nb: L_b^T lam */
    double *work; /* scratch of the factor */
    double *block;
};

/* ---- making --------------------------------------------------------------------------------- */

pma_status pma_response_create(pma_subdomain *s, pma_response **out)
{
    const size_t n = s->parts.n, nb = s->parts.nb;
    const size_t scratch = pma_factor_scratch(&s->parts.single.factor);
    *out = NULL;
    pma_response *r = calloc(1, sizeof *r);
    if (!r)
        return PMA_NO_MEMORY;
    r->of = s;
    r->block = calloc(5 * n + nb + scratch + 1, sizeof(double));
    if (!r->block) {
        free(r);
        return PMA_NO_MEMORY;
    }
    double *x = r->block;
    r->state = (pma_state){.u = x, .v = x + n, .w = x + 2 * n, .a = x + 3 * n};
    r->vs = x + 4 * n;
    r->pull = x + 5 * n;
    r->work = r->pull + nb;
    *out = r;
    return PMA_OK;
}

void pma_response_destroy(pma_response *r)
{
    if (r)
        free(r->block);
    free(r);
}

void pma_response_store(pma_response *r, pma_unit_responses units)
{
    r->units = units;
}

bool pma_response_is_stored(const pma_response *r)
{
    return r->units.count > 0;
}

const pma_state *pma_response_state(const pma_response *r)
{
    return &r->state;
}

/* ---- (M3), substep by substep --------------------------------------------------------------- */

void pma_response_step(pma_response *r, size_t j, const double *lam)
{
    const pma_subdomain *s = r->of;
    const pma_operator *op = &s->parts.single;
    const pma_state *x = &r->state;
    const double share = (double)j / (double)s->parts.substeps;
    double *w_b = pma_interface_of(s, x->w);
    if (j == 1)
        memset(x->u, 0, 4 * s->parts.n * sizeof(double)); /* all four: they are one array */

    /* (R1), (5), (6) */
    if (s->parts.lagged)
        pma_substep_extrapolate(op->step.h, s->parts.n, x, r->vs);
    s->update->predict(&op->step, 0, s->parts.n, x, x);

    /* -(C + D_r) vt - (K + K_r) ut; lagged: C vs (R4) */
    pma_matrix_subtract(&s->parts.C, s->parts.lagged ? r->vs : x->v, x->w);
    pma_matrix_subtract(&s->parts.K, x->u, x->w);
    pma_matrix_subtract(&s->parts.D_r, x->v, x->w);
    pma_matrix_subtract(&s->parts.K_r, x->u, x->w);

    /* (12)  w = Mbar^-1 (g + (j / substeps) L_b^T lam), (8), (9) */
    memset(r->pull, 0, s->parts.nb * sizeof(double));
    pma_link_load(&s->parts.link, lam, r->pull);
    for (size_t i = 0; i < s->parts.nb; i++)
        w_b[i] += share * r->pull[i];
    pma_factor_solve(&op->factor, x->w, r->work);
    s->update->correct(&op->step, 0, s->parts.n, x);
}

/* ---- (M5) ----------------------------------------------------------------------------------- */

static void add_to(size_t n, double scale, const double *x, double *y)
{
#pragma omp simd
    for (size_t i = 0; i < n; i++)
        y[i] += scale * x[i];
}

/* x (n) += sum over the constraints of lam times one of the four fields of U, in pieces of x that
 * stay in the cache while U is read */
static void add_stored(const pma_response *r, size_t field, const double *lam, double *x)
{
    enum { PIECE = 512 };
    const size_t n = r->of->parts.n;
    const pma_unit_responses *U = &r->units;
    for (size_t i = 0; i < n; i += PIECE) {
        const size_t size = n - i < PIECE ? n - i : PIECE;
        for (size_t k = 0; k < U->count; k++)
            add_to(size, lam[U->rows[k]], U->values + (4 * k + field) * n + i, x + i);
    }
}

static bool is_finite(size_t n, const double *x)
{
    double zero = 0.0;
#pragma omp simd reduction(+ : zero)
    for (size_t i = 0; i < n; i++)
        zero += 0.0 * x[i];
    return zero == 0.0;
}

pma_status pma_response_add(const pma_response *r, const double *lam, const pma_state *x)
{
    const size_t n = r->of->parts.n;
    double *const total[4] = {x->u, x->v, x->w, x->a};
    const double *const own[4] = {r->state.u, r->state.v, r->state.w, r->state.a};
    bool finite = true;
    for (size_t field = 0; field < 4; field++) {
        if (pma_response_is_stored(r))
            add_stored(r, field, lam, total[field]);
        else
            add_to(n, 1.0, own[field], total[field]);
        finite = is_finite(n, total[field]) && finite;
    }
    return finite ? PMA_OK : PMA_NOT_FINITE;
}

pma_status pma_response_run(pma_response *r, const double *lam, double *end, double *mean)
{
    const pma_subdomain *s = r->of;
    const double *v_b = pma_interface_of(s, r->state.v);
    const double share = 1.0 / (double)s->parts.substeps;
    for (size_t j = 1; j <= s->parts.substeps; j++) {
        pma_response_step(r, j, lam);
        pma_link_gather(&s->parts.link, share, v_b, mean);
    }
    pma_link_gather(&s->parts.link, 1.0, v_b, end);
    return is_finite(4 * s->parts.n, r->state.u) ? PMA_OK : PMA_NOT_FINITE;
}
