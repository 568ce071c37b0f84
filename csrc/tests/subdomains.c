/* subdomains.c - see subdomains.h; the naive steps are docs/method.md as written. */
#include "subdomains.h"

#include <math.h>
#include <string.h>

#include "algebra/factor.h"
#include "algebra/link.h"
#include "check.h"
#include "naive.h"

/* ---- schemes -------------------------------------------------------------------------------- */

pma_scheme generalized_alpha(double rho)
{
    pma_scheme s = {.am = (2.0 * rho - 1.0) / (rho + 1.0), .af = rho / (rho + 1.0)};
    s.gamma = 0.5 - s.am + s.af;
    s.beta = (0.5 + s.gamma) * (0.5 + s.gamma) / 4.0;
    return s;
}

/* ---- subdomains ------------------------------------------------------------------------------ */

double al1_of(const subdomain *x, bool twice)
{
    const pma_scheme s = x->scheme;
    const double h = twice ? 2.0 * x->h : x->h;
    return h * h * s.beta * (1.0 - s.af) / (1.0 - s.am);
}

double al2_of(const subdomain *x, bool twice)
{
    const pma_scheme s = x->scheme;
    const double h = twice ? 2.0 * x->h : x->h;
    return h * s.gamma * (1.0 - s.af) / (1.0 - s.am);
}

int pull(double t, intptr_t n, double *u, double *v, double *r, void *user)
{
    diary *d = user;
    for (intptr_t k = 0; k < n; k++) {
        const double next = v[(k + 1) % n];
        r[k] += u[k] * u[k] * u[k] + 0.5 * u[k] * next + 0.25 * v[k] + 0.125 * t;
    }
    for (intptr_t k = 0; k < n; k++)
        u[k] = v[k] = NAN;
    d->times[d->evaluated++ % (2 * LEVELS)] = t;
    return d->evaluated == d->fail_at ? 7 : 0;
}

void naive_pull(const subdomain *x, double t, const double *u, const double *v, double *r)
{
    for (size_t i = 0; i < x->n; i++) {
        const double next = v[(i + x->n - 1) % x->n];
        r[i] = x->restored ? pow(u[i], 3.0) + u[i] * next / 2.0 + v[i] / 4.0 + t / 8.0 : 0.0;
    }
}

/* implicit M + al2 (C + D_r) + al1 (K + K_r), explicit without stiffness; lagged without C */
static pma_operator make_operator(subdomain *x, bool twice)
{
    const double al1 = x->implicit ? al1_of(x, twice) : 0.0, al2 = al2_of(x, twice);
    for (size_t i = 0; i < x->n * x->n; i++) {
        const double C = x->lagged ? 0.0 : x->C[i];
        x->Mbar[twice][i] = x->M[i] + al2 * (C + x->D_r[i]) + al1 * (x->K[i] + x->K_r[i]);
    }
    naive_factor(x->n, x->Mbar[twice], x->R[twice], x->inverse[twice]);
    return (pma_operator){.step = pma_step_make(x->scheme, twice ? 2.0 * x->h : x->h),
                          .factor = {.form = PMA_DENSE,
                                     .n = x->n,
                                     .nb = x->nb,
                                     .inverse = x->inverse[twice],
                                     .values = x->R[twice]}};
}

static pma_link make_link(subdomain *x)
{
    int64_t k = 0;
    for (size_t j = 0; j < x->nb; j++) {
        for (size_t row = 0; row < x->p; row++) {
            const double entry = x->L[row * x->n + (x->n - x->nb) + j];
            if (entry == 0.0)
                continue;
            x->constraint[k] = (int32_t)row;
            x->sign[k++] = entry;
        }
        x->ptr[j + 1] = k;
    }
    return (pma_link){x->p, x->nb, x->ptr, x->constraint, x->sign, NULL};
}

static pma_restoring make_restoring(subdomain *x)
{
    for (size_t i = 0; i < x->n; i++)
        x->order[i] = (int64_t)(x->n - 1 - i);
    return (pma_restoring){.function = x->restored ? pull : NULL,
                           .user = &x->pulled,
                           .n = x->n,
                           .order = x->order,
                           .work = x->work};
}

/* No form where there is nothing: the core then leaves out what belongs to it. */
static pma_matrix estimate(size_t n, const double *values)
{
    for (size_t i = 0; i < n * n; i++) {
        if (values[i] != 0.0)
            return (pma_matrix){.form = PMA_DENSE, .n = n, .values = values};
    }
    return (pma_matrix){.form = PMA_ZERO, .n = n};
}

static pma_factor make_mass(subdomain *x)
{
    naive_factor(x->n, x->M, x->R_mass, x->inverse_mass);
    return (pma_factor){
        .form = PMA_DENSE, .n = x->n, .nb = x->nb, .inverse = x->inverse_mass, .values = x->R_mass};
}

pma_parts describe(subdomain *x)
{
    const double al1[2] = {al1_of(x, false), al1_of(x, true)};
    const double al2[2] = {al2_of(x, false), al2_of(x, true)};
    share_matrices(x);
    return (pma_parts){.n = x->n,
                       .nb = x->nb,
                       .substeps = x->substeps,
                       .doubled = x->doubled,
                       .lagged = x->lagged,
                       .restoring = make_restoring(x),
                       .springs = x->springs,
                       .D_r = estimate(x->n, x->D_r),
                       .K_r = estimate(x->n, x->K_r),
                       .has_responses = x->has_responses,
                       .mean = x->mean,
                       .mass = make_mass(x),
                       .deferred = x->deferred,
                       .has_internal = x->inner.used,
                       .M = {.form = PMA_DENSE, .n = x->n, .values = x->M},
                       .K = {.form = PMA_DENSE, .n = x->n, .values = x->inner.K},
                       .C = {.form = PMA_DENSE, .n = x->n, .values = x->inner.C},
                       .internal = describe_internal(x),
                       .iterate = describe_iterate(x, al1, al2),
                       .single = make_operator(x, false),
                       .twice = make_operator(x, true),
                       .link = make_link(x)};
}

void make_subdomain(subdomain *x)
{
    const pma_parts parts = describe(x);
    CHECK_STATUS(pma_subdomain_create(&parts, &x->core), PMA_OK);
    x->load.n = x->n;
    pma_subdomain_set_load(x->core, x->load);
}

pma_status subdomain_status(const pma_parts *parts)
{
    pma_subdomain *made = (pma_subdomain *)&made;
    const pma_status status = pma_subdomain_create(parts, &made);
    CHECK((made != NULL) == (status == PMA_OK));
    pma_subdomain_destroy(made);
    return status;
}

subdomain one_mass(double m, double k, double L, pma_scheme scheme, bool implicit)
{
    subdomain x = {.n = 1,
                   .nb = L != 0.0,
                   .p = L != 0.0,
                   .substeps = 1,
                   .implicit = implicit,
                   .scheme = scheme,
                   .h = 0.1,
                   .M = {m},
                   .K = {k},
                   .L = {L}};
    return x;
}

size_t copy_present(const subdomain *x, double *out)
{
    const pma_state *s = pma_subdomain_present(x->core);
    const double *const arrays[4] = {s->u, s->v, s->w, s->a};
    for (size_t i = 0; i < 4; i++)
        memcpy(out + i * x->n, arrays[i], x->n * sizeof(double));
    return 4 * x->n;
}

/* ---- the same step, naively: sections 3 and 4 as written ------------------------------------ */

void naive_force(const subdomain *x, double t, size_t substep, double *F)
{
    const pma_load *load = &x->load;
    memset(F, 0, x->n * sizeof(double));
    const size_t before = load->kind == PMA_LOAD_SAMPLED ? (size_t)(t / load->dt + 1e-9) : 0;
    const double theta = load->kind == PMA_LOAD_SAMPLED ? t / load->dt - (double)before : 0.0;
    for (size_t i = 0; i < x->n; i++) {
        if (load->kind == PMA_LOAD_CONSTANT)
            F[i] = load->values[i];
        if (load->kind == PMA_LOAD_TABLE)
            F[i] = load->values[substep * x->n + i];
        for (size_t c = 0; load->kind == PMA_LOAD_SAMPLED && c < load->k; c++) {
            const double *at = load->values + before * load->k + c;
            F[i] += load->shape[c * x->n + i] * ((1.0 - theta) * at[0] + theta * at[load->k]);
        }
    }
}

void naive_predict(const subdomain *x, bool twice, const level *from, double *ut, double *vt,
                   double *vs)
{
    const pma_scheme s = x->scheme;
    const double h = twice ? 2.0 * x->h : x->h, d = 1.0 - s.am;
    for (size_t i = 0; i < x->n; i++) {
        ut[i] = from->u[i] + h * from->v[i] + h * h * (0.5 - s.beta / d) * from->a[i] +
                h * h * s.beta * s.af / d * from->w[i];
        vt[i] =
            from->v[i] + h * (1.0 - s.gamma / d) * from->a[i] + h * s.gamma * s.af / d * from->w[i];
        vs[i] = from->v[i] + h * from->w[i];
    }
}

/* y (n) -= A x */
static void subtract(size_t n, const double *A, const double *x, double *y)
{
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++)
            y[i] -= A[i * n + j] * x[j];
    }
}

/* (8) */
static void naive_correct(const subdomain *x, bool twice, const double *ut, const double *vt,
                          level *to)
{
    for (size_t i = 0; i < x->n; i++) {
        to->u[i] = ut[i] + al1_of(x, twice) * to->w[i];
        to->v[i] = vt[i] + al2_of(x, twice) * to->w[i];
    }
}

double naive_recur(pma_scheme s, double w1, double w0, double a0)
{
    return ((1.0 - s.af) * w1 + s.af * w0 - s.am * a0) / (1.0 - s.am);
}

/* (5), (6) and (R1) under an acceleration y                                               (K2) */
static void take_free(const subdomain *x, bool twice, double t, const double *F, const double *y,
                      const level *from, level *to)
{
    double ut[MOST], vt[MOST], vs[MOST], late[MOST];
    const double h = twice ? 2.0 * x->h : x->h;
    naive_predict(x, twice, from, ut, vt, vs);
    for (size_t i = 0; i < x->n; i++) {
        ut[i] += h * h / 2.0 * y[i];
        vt[i] += h * y[i];
        vs[i] += h * y[i];
    }
    naive_pull(x, t, ut, vs, to->r);
    for (size_t i = 0; i < x->n; i++) {
        to->w[i] = F[i] - to->r[i];
        late[i] = vt[i] - vs[i];
    }
    subtract(x->n, x->C, x->lagged ? vs : vt, to->w);
    subtract(x->n, x->K, ut, to->w);
    subtract(x->n, x->D_r, late, to->w);
    naive_solve(x->n, x->Mbar[twice], to->w);
    naive_correct(x, twice, ut, vt, to);
    memcpy(to->vf, to->v, x->n * sizeof(double));
}

void naive_free(const subdomain *x, bool twice, double t, const double *F, const level *from,
                level *to)
{
    const double none[MOST] = {0.0};
    take_free(x, twice, t, F, none, from, to);
}

void naive_push(const subdomain *x, const double *lam, double *y)
{
    memset(y, 0, x->n * sizeof(double));
    for (size_t row = 0; row < x->p; row++) {
        for (size_t i = 0; i < x->n; i++)
            y[i] += x->L[row * x->n + i] * lam[row];
    }
    naive_solve(x->n, x->M, y);
}

void naive_pushed(const subdomain *x, bool twice, double t, const double *F, const double *y,
                  const level *from, level *to)
{
    take_free(x, twice, t, F, y, from, to);
    for (size_t i = 0; i < x->n; i++)
        to->a[i] = naive_recur(x->scheme, to->w[i], from->w[i], from->a[i]);
}

void naive_link(const subdomain *x, bool twice, const double *lam, double *wl)
{
    memset(wl, 0, x->n * sizeof(double));
    for (size_t row = 0; row < x->p; row++) {
        for (size_t i = 0; i < x->n; i++)
            wl[i] += x->L[row * x->n + i] * lam[row];
    }
    naive_solve(x->n, x->Mbar[twice], wl);
}

void naive_close(const subdomain *x, bool twice, const double *lam, const level *from, level *to)
{
    double wl[MOST];
    naive_link(x, twice, lam, wl);
    for (size_t i = 0; i < x->n; i++) {
        to->u[i] += al1_of(x, twice) * wl[i];
        to->v[i] += al2_of(x, twice) * wl[i];
        to->w[i] += wl[i];
        to->a[i] = naive_recur(x->scheme, to->w[i], from->w[i], from->a[i]);
    }
}

void naive_store(const subdomain *x, bool twice, const double *lam, level *at)
{
    double wl[MOST];
    naive_link(x, twice, lam, wl);
    for (size_t i = 0; i < x->n; i++)
        at->vf[i] = at->v[i] - al2_of(x, twice) * wl[i];
}

void naive_link_response(const subdomain *x, bool twice, const double *lam, const level *from,
                         level *to)
{
    double ut[MOST], vt[MOST], vs[MOST];
    naive_predict(x, twice, from, ut, vt, vs);
    memset(to->w, 0, sizeof to->w);
    for (size_t row = 0; row < x->p; row++) {
        for (size_t i = 0; i < x->n; i++)
            to->w[i] += x->L[row * x->n + i] * lam[row];
    }
    subtract(x->n, x->C, x->lagged ? vs : vt, to->w);
    subtract(x->n, x->D_r, vt, to->w);
    subtract(x->n, x->K, ut, to->w);
    subtract(x->n, x->K_r, ut, to->w);
    naive_solve(x->n, x->Mbar[twice], to->w);
    naive_correct(x, twice, ut, vt, to);
    for (size_t i = 0; i < x->n; i++)
        to->a[i] = naive_recur(x->scheme, to->w[i], from->w[i], from->a[i]);
}

void naive_add(const subdomain *x, const level *more, level *to)
{
    for (size_t i = 0; i < x->n; i++) {
        to->u[i] += more->u[i];
        to->v[i] += more->v[i];
        to->w[i] += more->w[i];
        to->a[i] += more->a[i];
    }
}

double constrained(const subdomain *x, size_t row, const double *values)
{
    double sum = 0.0;
    for (size_t i = 0; i < x->n; i++)
        sum += x->L[row * x->n + i] * values[i];
    return sum;
}

void check_state(const subdomain *x, const pma_state *actual, const level *expected)
{
    for (size_t i = 0; i < x->n; i++) {
        CHECK_NEAR(actual->u[i], expected->u[i], AGREE);
        CHECK_NEAR(actual->v[i], expected->v[i], AGREE);
        CHECK_NEAR(actual->w[i], expected->w[i], AGREE);
        CHECK_NEAR(actual->a[i], expected->a[i], AGREE);
    }
}
