#include "subdomain/response.h"

#include <assert.h>
#include <string.h>

#include "algebra/lanes.h"
#include "memory.h"
#include "object.h"
#include "subdomain/inside.h"

/* ---- making --------------------------------------------------------------------------------- */

pma_status pma_response_create(pma_subdomain *s, pma_response **out)
{
    const size_t n = s->parts.n;
    /* first of all the state: in lanes an unknown has a line */
    const pma_array arrays[] = {PMA_ARRAY(pma_response, state.u, 4 * n),
                                PMA_ARRAY(pma_response, vs, n),
                                PMA_ARRAY(pma_response, y, s->parts.mean ? n : 0),
                                PMA_ARRAY(pma_response, pull, s->parts.nb),
                                PMA_ARRAY(pma_response, work, pma_parts_scratch(&s->parts)),
                                {0}};
    pma_response *r = *out = pma_object_create(sizeof *r, arrays);
    if (!r)
        return PMA_NO_MEMORY;
    r->of = s;
    r->state.v = r->state.u + n;
    r->state.w = r->state.u + 2 * n;
    r->state.a = r->state.u + 3 * n;
    return PMA_OK;
}

void pma_response_destroy(pma_response *r)
{
    pma_memory_release(r);
}

void pma_response_store(pma_response *r, pma_unit_responses units)
{
    assert(r->of->parts.has_responses);
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

/* ---- (M3), (K3), substep by substep --------------------------------------------------------- */

void pma_response_begin(pma_response *r, bool twice, const double *lam)
{
    r->twice = twice;
    if (!r->of->parts.mean)
        return;
    pma_parts_accelerate(&r->of->parts, lam, r->pull, r->work, r->y);
    for (size_t i = 0; twice && i < r->of->parts.n; i++)
        r->y[i] *= 0.5;
}

/* w += (j / substeps) L_b^T lam */
static void add_ramp(const pma_response *r, size_t j, const double *lam, double *w)
{
    const pma_subdomain *s = r->of;
    const double share = (double)j / (double)s->parts.substeps;
    double *w_b = pma_interface_of(s, w);
    pma_link_load(&s->parts.link, lam, r->pull);
    for (size_t i = 0; i < s->parts.nb; i++)
        w_b[i] += share * r->pull[i];
}

void pma_response_step(pma_response *r, size_t j, const double *lam)
{
    assert(j >= 1 && j <= r->of->parts.substeps);
    const pma_subdomain *s = r->of;
    const pma_operator *op = pma_operator_of(s, r->twice);
    const pma_state *x = &r->state;
    if (j == 1) /* from rest: u, v, w, a are one array */
        memset(x->u, 0, 4 * s->parts.n * sizeof(double));

    /* (R1), (5), (6) */
    if (s->parts.lagged)
        pma_substep_extrapolate(op->step.h, s->parts.n, x, r->vs);
    s->update->predict(&op->step, 0, s->parts.n, x, x);
    if (s->parts.mean)
        pma_substep_push(s->parts.n, op->step.h, r->y, x, s->parts.lagged ? r->vs : NULL);

    /* -(C + D_r) vt - (K + K_r) ut; lagged: C vs (R4) */
    pma_matrix_subtract(&s->parts.C, s->parts.lagged ? r->vs : x->v, x->w);
    pma_matrix_subtract(&s->parts.K, x->u, x->w);
    pma_matrix_subtract(&s->parts.D_r, x->v, x->w);
    pma_matrix_subtract(&s->parts.K_r, x->u, x->w);

    /* (12)  w = Mbar^-1 (g + (j / substeps) L_b^T lam), (8), (9) */
    if (!s->parts.mean)
        add_ramp(r, j, lam, x->w);
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

/* The same; true when every sum is finite. */
static bool add_last(size_t n, double scale, const double *x, double *y)
{
    double zero = 0.0;
#pragma omp simd reduction(+ : zero)
    for (size_t i = 0; i < n; i++) {
        y[i] += scale * x[i];
        zero += 0.0 * y[i];
    }
    return zero == 0.0;
}

/* x (n) += sum over the constraints of lam times one of the four fields of U, in pieces of x that
 * stay in the cache while U is read; true when every sum is finite */
static bool add_stored(const pma_response *r, size_t field, const double *lam, double *x)
{
    enum { PIECE = 512 };
    const size_t n = r->of->parts.n;
    const pma_unit_responses *U = &r->units;
    bool finite = true;
    for (size_t i = 0; i < n; i += PIECE) {
        const size_t size = n - i < PIECE ? n - i : PIECE;
        const double *values = U->values + field * n + i;
        for (size_t k = 0; k + 1 < U->count; k++)
            add_to(size, lam[U->rows[k]], values + 4 * k * n, x + i);
        const size_t last = U->count - 1;
        finite = add_last(size, lam[U->rows[last]], values + 4 * last * n, x + i) && finite;
    }
    return finite;
}

/* x += scale U for one unit response, side by side */
PMA_LANE_LOOP(add_lanes, (size_t n, const double *scale, const double *U, double *x), {
    const number factor = *(const number *)scale;
    number *to = (number *)x;
    for (size_t i = 0; i < n; i++)
        PMA_ADD(U[i], &factor, &to[i]);
})

/* The same in lanes; what is stored is that of each lane. */
static bool add_stored_lanes(const pma_response *r, size_t field, const double *lam, double *x)
{
    enum { PIECE = 256 };
    const size_t n = r->of->parts.n / PMA_LANES;
    const pma_unit_responses *U = &r->units;
    for (size_t i = 0; i < n; i += PIECE) {
        const size_t size = n - i < PIECE ? n - i : PIECE;
        for (size_t k = 0; k < U->count; k++)
            (pma_has_avx2() ? add_lanes_avx2 : add_lanes_plain)(
                size, lam + (size_t)U->rows[k] * PMA_LANES, U->values + (4 * k + field) * n + i,
                x + i * PMA_LANES);
    }
    return pma_is_finite(n * PMA_LANES, x);
}

static bool add_unit_responses(const pma_response *r, size_t field, const double *lam, double *x)
{
    return r->of->parts.link.each ? add_stored_lanes(r, field, lam, x)
                                  : add_stored(r, field, lam, x);
}

pma_status pma_response_add(const pma_response *r, const double *lam, const pma_state *x)
{
    const size_t n = r->of->parts.n;
    double *const total[4] = {x->u, x->v, x->w, x->a};
    const double *const own[4] = {r->state.u, r->state.v, r->state.w, r->state.a};
    bool finite = true;
    for (size_t field = 0; field < 4; field++) {
        finite = (pma_response_is_stored(r) ? add_unit_responses(r, field, lam, total[field])
                                            : add_last(n, 1.0, own[field], total[field])) &&
                 finite;
    }
    return finite ? PMA_OK : PMA_NOT_FINITE;
}
