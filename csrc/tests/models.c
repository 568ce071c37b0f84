/* models.c - see models.h; the naive program is docs/method.md as written and keeps all nodes. */
#include "models.h"

#include <math.h>
#include <string.h>

#include "algebra/factor.h"
#include "algebra/link.h"
#include "check.h"
#include "naive.h"

/* ---- schemes --------------------------------------------------------------------------------- */

pma_scheme generalized_alpha(double rho)
{
    pma_scheme s = {.am = (2.0 * rho - 1.0) / (rho + 1.0), .af = rho / (rho + 1.0)};
    s.gamma = 0.5 - s.am + s.af;
    s.beta = (0.5 + s.gamma) * (0.5 + s.gamma) / 4.0;
    return s;
}

/* ---- parts: subdomains that know their equations --------------------------------------------- */

/* al1 = h^2 beta (1-af)/(1-am)                                                            (P2) */
static double al1_of(const part *x, bool twice)
{
    const pma_scheme s = x->scheme;
    const double h = twice ? 2.0 * x->h : x->h;
    return h * h * s.beta * (1.0 - s.af) / (1.0 - s.am);
}

double al2_of(const part *x, bool twice)
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
    d->times[d->asked++ % (2 * NODES)] = t;
    return d->asked == d->fail_at ? 7 : 0;
}

/* r (n) := the same, in elimination order */
static void naive_pull(const part *x, double t, const double *u, const double *v, double *r)
{
    for (size_t i = 0; i < x->n; i++) {
        const double next = v[(i + x->n - 1) % x->n];
        r[i] = x->restored
                   ? pow(u[i], 3.0) + u[i] * next / 2.0 + v[i] / 4.0 + t / 8.0
                   : 0.0;
    }
}

/* implicit M + al2 (C + D_r) + al1 (K + K_r), explicit without stiffness; lagged without C */
static pma_operator make_operator(part *x, bool twice)
{
    const double al1 = x->implicit ? al1_of(x, twice) : 0.0, al2 = al2_of(x, twice);
    for (size_t i = 0; i < x->n * x->n; i++) {
        const double C = x->lagged ? 0.0 : x->C[i];
        x->Mbar[twice][i] = x->M[i] + al2 * (C + x->D_r[i]) + al1 * (x->K[i] + x->K_r[i]);
    }
    naive_factor(x->n, x->Mbar[twice], x->R[twice], x->inverse[twice]);
    return (pma_operator){
        .step = pma_step_make(x->scheme, twice ? 2.0 * x->h : x->h),
        .factor = {.form = PMA_DENSE, .n = x->n, .nb = x->nb, .inverse = x->inverse[twice],
                   .values = x->R[twice]}};
}

static pma_link make_link(part *x)
{
    int64_t k = 0;
    for (size_t j = 0; j < x->nb; j++) {
        for (size_t row = 0; row < x->p; row++) {
            const double entry = x->L[row * x->n + (x->n - x->nb) + j];
            if (entry == 0.0)
                continue;
            x->condition[k] = (int32_t)row;
            x->sign[k++] = entry;
        }
        x->ptr[j + 1] = k;
    }
    return (pma_link){x->p, x->nb, x->ptr, x->condition, x->sign};
}

static pma_restoring make_restoring(part *x)
{
    for (size_t i = 0; i < x->n; i++)
        x->order[i] = (int64_t)(x->n - 1 - i);
    return (pma_restoring){x->restored ? pull : NULL, &x->pulled, false, x->n, x->order, x->work};
}

pma_parts describe(part *x)
{
    return (pma_parts){.n = x->n,
                       .nb = x->nb,
                       .substeps = x->substeps,
                       .doubled = x->doubled,
                       .lagged = x->lagged,
                       .restoring = make_restoring(x),
                       .D_r = {.form = PMA_DENSE, .n = x->n, .values = x->D_r},
                       .ramped = x->ramped,
                       .K = {.form = PMA_DENSE, .n = x->n, .values = x->K},
                       .C = {.form = PMA_DENSE, .n = x->n, .values = x->C},
                       .single = make_operator(x, false),
                       .twice = make_operator(x, true),
                       .link = make_link(x)};
}

void make_part(part *x)
{
    const pma_parts parts = describe(x);
    CHECK_STATUS(pma_subdomain_create(&parts, &x->core), PMA_OK);
    x->load.n = x->n;
    pma_subdomain_set_load(x->core, x->load);
}

part one_mass(double m, double k, double L, pma_scheme scheme, bool implicit)
{
    part x = {.n = 1, .nb = L != 0.0, .p = L != 0.0, .substeps = 1, .implicit = implicit,
              .scheme = scheme, .h = 0.1, .M = {m}, .K = {k}, .L = {L}};
    return x;
}

size_t copy_present(const part *x, double *out)
{
    const pma_state *s = pma_subdomain_at(x->core, 0);
    const double *const arrays[4] = {s->u, s->v, s->w, s->a};
    for (size_t i = 0; i < 4; i++)
        memcpy(out + i * x->n, arrays[i], x->n * sizeof(double));
    return 4 * x->n;
}

/* ---- the same step, naively: docs/method.md 3 and 4 as written ------------------------------- */

static void naive_force(const part *x, double t, size_t step, double *F)
{
    const pma_load *load = &x->load;
    memset(F, 0, x->n * sizeof(double));
    const size_t before = load->kind == PMA_LOAD_SAMPLED ? (size_t)(t / load->dt + 1e-9) : 0;
    const double theta = load->kind == PMA_LOAD_SAMPLED ? t / load->dt - (double)before : 0.0;
    for (size_t i = 0; i < x->n; i++) {
        if (load->kind == PMA_LOAD_CONSTANT)
            F[i] = load->values[i];
        if (load->kind == PMA_LOAD_TABLE)
            F[i] = load->values[step * x->n + i];
        for (size_t c = 0; load->kind == PMA_LOAD_SAMPLED && c < load->k; c++) {
            const double *at = load->values + before * load->k + c;
            F[i] += load->shape[c * x->n + i] * ((1.0 - theta) * at[0] + theta * at[load->k]);
        }
    }
}

void naive_free(const part *x, bool twice, double t, const double *F, const node *from, node *to)
{
    const pma_scheme s = x->scheme;
    const double h = twice ? 2.0 * x->h : x->h, d = 1.0 - s.am;
    double ut[MOST], vt[MOST], vs[MOST], r[MOST];
    for (size_t i = 0; i < x->n; i++) {
        ut[i] = from->u[i] + h * from->v[i] + h * h * (0.5 - s.beta / d) * from->a[i] +
                h * h * s.beta * s.af / d * from->w[i];
        vt[i] = from->v[i] + h * (1.0 - s.gamma / d) * from->a[i] +
                h * s.gamma * s.af / d * from->w[i];
        vs[i] = from->v[i] + h * from->w[i];
    }
    naive_pull(x, t, ut, vs, r);
    for (size_t i = 0; i < x->n; i++) {
        to->w[i] = F[i] - r[i];
        for (size_t j = 0; j < x->n; j++) {
            const size_t ij = i * x->n + j;
            to->w[i] -= x->C[ij] * (x->lagged ? vs[j] : vt[j]) + x->K[ij] * ut[j];
            to->w[i] -= x->D_r[ij] * (vt[j] - vs[j]);
        }
    }
    naive_solve(x->n, x->Mbar[twice], to->w);
    for (size_t i = 0; i < x->n; i++) {
        to->u[i] = ut[i] + al1_of(x, twice) * to->w[i];
        to->v[i] = to->vf[i] = vt[i] + al2_of(x, twice) * to->w[i];
    }
}

void naive_link(const part *x, bool twice, const double *lam, double *wl)
{
    memset(wl, 0, x->n * sizeof(double));
    for (size_t row = 0; row < x->p; row++) {
        for (size_t i = 0; i < x->n; i++)
            wl[i] += x->L[row * x->n + i] * lam[row];
    }
    naive_solve(x->n, x->Mbar[twice], wl);
}

void naive_close(const part *x, bool twice, const double *lam, const node *from, node *to)
{
    const pma_scheme s = x->scheme;
    double wl[MOST];
    naive_link(x, twice, lam, wl);
    for (size_t i = 0; i < x->n; i++) {
        to->u[i] += al1_of(x, twice) * wl[i];
        to->v[i] += al2_of(x, twice) * wl[i];
        to->w[i] += wl[i];
        to->a[i] = ((1.0 - s.af) * to->w[i] + s.af * from->w[i] - s.am * from->a[i]) / (1.0 - s.am);
    }
}

void naive_store(const part *x, bool twice, const double *lam, node *at)
{
    double wl[MOST];
    naive_link(x, twice, lam, wl);
    for (size_t i = 0; i < x->n; i++)
        at->vf[i] = at->v[i] - al2_of(x, twice) * wl[i];
}

double conditioned(const part *x, size_t row, const double *values)
{
    double sum = 0.0;
    for (size_t i = 0; i < x->n; i++)
        sum += x->L[row * x->n + i] * values[i];
    return sum;
}

void check_state(const part *x, const pma_state *actual, const node *expected)
{
    for (size_t i = 0; i < x->n; i++) {
        CHECK_NEAR(actual->u[i], expected->u[i], AGREE);
        CHECK_NEAR(actual->v[i], expected->v[i], AGREE);
        CHECK_NEAR(actual->w[i], expected->w[i], AGREE);
        CHECK_NEAR(actual->a[i], expected->a[i], AGREE);
    }
}

/* ---- models: coupled parts, for the core and for the naive program --------------------------- */

/* H = sum_i al2_i L_i Mbar_i^-1 L_i^T, the doubled ones with 2 h if `later`               (18) */
static pma_factor make_interface(model *m, bool later)
{
    double *H = m->H[later];
    memset(H, 0, sizeof m->H[later]);
    for (size_t i = 0; i < m->count; i++) {
        const part *x = &m->parts[i];
        const bool twice = later && x->doubled;
        for (size_t column = 0; column < m->p; column++) {
            double unit[CONDITIONS] = {0.0}, wl[MOST];
            unit[column] = 1.0;
            naive_link(x, twice, unit, wl);
            for (size_t row = 0; row < m->p; row++)
                H[row * m->p + column] += al2_of(x, twice) * conditioned(x, row, wl);
        }
    }
    naive_factor(m->p, H, m->R[later], m->inverse[later]);
    return (pma_factor){.form = PMA_DENSE, .n = m->p, .nb = m->p, .inverse = m->inverse[later],
                        .values = m->R[later]};
}

pma_coupler_parts describe_coupler(model *m)
{
    return (pma_coupler_parts){.count = m->count, .subdomains = m->subdomains, .p = m->p,
                               .H_start = make_interface(m, false), .H = make_interface(m, true),
                               .dt = m->dt, .rebased = m->rebased,
                               .motion_count = m->motion_count, .motions = &m->motion,
                               .threads = m->threads};
}

void prescribe(const model *m, size_t k, double *g)
{
    memset(g, 0, m->p * sizeof(double));
    if (m->motion_count > 0 && k > 0)
        g[m->moved_row] = m->moved[k - 1];
}

/* M_i w_i - L_i^T Lam = F_i(0) - C_i v_i - K_i u_i and sum_i L_i w_i = 0                  (S1) */
static void solve_start(model *m)
{
    double A[LARGEST * LARGEST] = {0.0}, b[LARGEST] = {0.0}, F[MOST];
    size_t size = m->p, first = 0;
    for (size_t i = 0; i < m->count; i++)
        size += m->parts[i].n;
    for (size_t q = 0; q < m->count; first += m->parts[q++].n) {
        const part *x = &m->parts[q];
        double r[MOST];
        naive_force(x, 0.0, 0, F);
        naive_pull(x, 0.0, x->u0, x->v0, r);
        for (size_t i = 0; i < x->n; i++) {
            double *row = A + (first + i) * size;
            b[first + i] = (x->load.kind == PMA_LOAD_TABLE ? 0.0 : F[i]) - r[i];
            for (size_t j = 0; j < x->n; j++) {
                row[first + j] = x->M[i * x->n + j];
                b[first + i] -= x->C[i * x->n + j] * x->v0[j] + x->K[i * x->n + j] * x->u0[j];
            }
            for (size_t c = 0; c < m->p; c++) {
                row[size - m->p + c] = -x->L[c * x->n + i];
                A[(size - m->p + c) * size + first + i] = x->L[c * x->n + i];
            }
        }
    }
    naive_solve(size, A, b);
    memcpy(m->lam0, b + size - m->p, m->p * sizeof(double));
    first = 0;
    for (size_t q = 0; q < m->count; first += m->parts[q++].n)
        memcpy(m->nodes[q][0].w, b + first, m->parts[q].n * sizeof(double));
}

void start_model(model *m)
{
    solve_start(m);
    for (size_t i = 0; i < m->count; i++) {
        part *x = &m->parts[i];
        node *first = &m->nodes[i][0];
        memcpy(first->u, x->u0, sizeof first->u);
        memcpy(first->v, x->v0, sizeof first->v);
        memcpy(first->a, first->w, sizeof first->a);
        naive_store(x, false, m->lam0, first);
        pma_subdomain_start(x->core, x->u0, x->v0, first->w, m->lam0);
    }
    const double g0[CONDITIONS] = {0.0};
    pma_coupler_start(m->coupler, 0, m->lam0, g0);
}

void make_model(model *m)
{
    m->fine = 1;
    for (size_t i = 0; i < m->count; i++)
        m->fine = m->parts[i].substeps > m->fine ? m->parts[i].substeps : m->fine;
    for (size_t i = 0; i < m->count; i++) {
        m->parts[i].h = m->dt / (double)m->parts[i].substeps;
        make_part(&m->parts[i]);
        m->subdomains[i] = m->parts[i].core;
    }
    const pma_coupler_parts parts = describe_coupler(m);
    CHECK_STATUS(pma_coupler_create(&parts, &m->coupler), PMA_OK);
    start_model(m);
}

void destroy_model(model *m)
{
    pma_coupler_destroy(m->coupler);
    for (size_t i = 0; i < m->count; i++)
        pma_subdomain_destroy(m->parts[i].core);
}

snapshot present(const model *m)
{
    snapshot s = {.count = 0};
    for (size_t i = 0; i < m->count; i++)
        s.count += copy_present(&m->parts[i], s.values + s.count);
    memcpy(s.values + s.count, pma_coupler_multipliers(m->coupler), m->p * sizeof(double));
    s.count += m->p;
    return s;
}

void check_same_present(const model *m, const snapshot *expected)
{
    const snapshot actual = present(m);
    CHECK_INT(actual.count, expected->count);
    CHECK_BITS(actual.count, actual.values, expected->values);
}

void make_oscillator(model *m, split s)
{
    *m = (model){.count = 2, .p = 1, .dt = s.dt, .rebased = true};
    m->parts[0] = one_mass(M_A, K_A, 1.0, s.A, true);
    m->parts[1] = one_mass(M_B, K_B, -1.0, s.B, s.same);
    m->parts[0].doubled = s.doubled;
    m->parts[1].substeps = s.substeps;
    m->parts[0].u0[0] = m->parts[1].u0[0] = 1.0;
    make_model(m);
}

static void fill_loads(model *m, double scale)
{
    part *A = &m->parts[0], *B = &m->parts[1], *C = &m->parts[2];
    const double shape[6] = {1.0, 0.0, 0.5, 0.0, -1.0, 0.0};
    memcpy(A->shape, shape, sizeof shape);
    uint64_t seed = 7;
    for (size_t i = 0; i < NODES * MOST; i++) {
        A->loads[i] = scale * draw_eighth(&seed);
        B->loads[i] = scale * draw_eighth(&seed);
    }
    C->loads[0] = scale * 0.5;
    C->loads[1] = -scale;
    A->load = (pma_load){.kind = PMA_LOAD_SAMPLED, .values = A->loads, .shape = A->shape,
                         .samples = NODES, .k = 2, .dt = 0.11};
    B->load = (pma_load){.kind = PMA_LOAD_TABLE, .values = B->loads, .rows = NODES};
    C->load = (pma_load){.kind = PMA_LOAD_CONSTANT, .values = C->loads};
    for (size_t k = 0; k < NODES; k++)
        m->moved[k] = scale * draw_eighth(&seed) / 8.0;
    m->moved_row = 1;
    m->motion = (pma_motion){&m->moved_row, {.kind = PMA_LOAD_TABLE, .n = 1, .values = m->moved,
                                             .rows = NODES}};
}

/* Estimates on the implicit A, lagged damping on the explicit B, a force alone on C */
static void fill_restoring(model *m)
{
    part *A = &m->parts[0];
    for (size_t i = 0; i < m->count; i++)
        m->parts[i].restored = true;
    for (size_t i = 0; i < A->n; i++) {
        A->K_r[i * A->n + i] = 0.75;
        A->D_r[i * A->n + i] = 0.375;
    }
    m->parts[1].lagged = true;
}

static void make_scaled_chain(model *m, plan chosen, double scale, size_t threads)
{
    *m = (model){.count = 3, .p = 2, .dt = 0.3, .rebased = chosen.rebased,
                 .motion_count = chosen.moved, .threads = threads};
    m->parts[0] = (part){.n = 3, .nb = 1, .implicit = true, .doubled = chosen.A_doubled,
                         .scheme = generalized_alpha(0.5), .M = {2, 0, 0, 0, 1.5, 0, 0, 0, 1},
                         .C = {0.5, -0.25, 0, -0.25, 0.5, -0.25, 0, -0.25, 0.25},
                         .K = {5, -2, 0, -2, 4, -2, 0, -2, 2}, .L = {0, 0, 1, 0, 0, 0}};
    m->parts[1] = (part){.n = 2, .nb = 2, .scheme = generalized_alpha(0.8), .M = {1, 0, 0, 1},
                         .C = {0.25, 0, 0, 0}, .K = {3, -2, -2, 3}, .L = {-1, 0, 0, 1}};
    m->parts[2] = (part){.n = 2, .nb = 1, .implicit = true, .doubled = chosen.C_doubled,
                         .scheme = TRAPEZOIDAL, .M = {1, 0.25, 0.25, 1},
                         .K = {4, -2, -2, 2}, .L = {0, 0, 0, -1}};
    const double u0[PARTS][MOST] = {{0.25, -0.5, 1.0}, {1.0, 0.5}, {0.75, 0.5}};
    for (size_t i = 0; i < PARTS; i++) {
        m->parts[i].p = 2;
        m->parts[i].substeps = chosen.substeps[i];
        for (size_t k = 0; k < m->parts[i].n; k++) {
            m->parts[i].u0[k] = scale * u0[i][k];
            m->parts[i].v0[k] = scale;
        }
    }
    fill_loads(m, scale);
    if (chosen.restored)
        fill_restoring(m);
    make_model(m);
}

void make_chain(model *m, plan chosen, double scale)
{
    make_scaled_chain(m, chosen, scale, 1);
}

void make_threaded_chain(model *m, plan chosen, size_t threads)
{
    make_scaled_chain(m, chosen, 1.0, threads);
}

/* ---- the naive coupler: docs/method.md 5 and 6 as written ------------------------------------ */

/* L vf of part i at fine node k, in mid-step interpolated; opens the step that begins at k - 1. */
static void naive_free_velocity(model *m, size_t i, size_t k, double *jump)
{
    const part *x = &m->parts[i];
    const size_t ratio = m->fine / x->substeps, next = (k + ratio - 1) / ratio;
    node *to = &m->nodes[i][next], *last = to - 1;
    if ((k - 1) % ratio == 0) {
        const bool twice = x->doubled && k > m->fine;
        double F[MOST];
        const double t = (double)(next * ratio) / (double)m->fine * m->dt;
        naive_force(x, t, next - 1, F);
        naive_free(x, twice, t, F, twice ? to - 2 : last, to);
    }
    const double theta = (double)(k - (next - 1) * ratio) / (double)ratio;
    for (size_t row = 0; row < m->p; row++)
        jump[row] += (1.0 - theta) * conditioned(x, row, last->vf) +
                     theta * conditioned(x, row, to->vf);
}

/* Those with a node of their own at k take Lam. */
static void naive_arrive(model *m, size_t i, size_t k)
{
    const part *x = &m->parts[i];
    const size_t ratio = m->fine / x->substeps;
    const bool twice = x->doubled && k > m->fine;
    node *to = &m->nodes[i][k / ratio];
    if (k % ratio != 0)
        return;
    naive_close(x, twice, m->lam[k], twice ? to - 2 : to - 1, to);
    if (k == m->fine && x->doubled && m->rebased)
        naive_store(x, true, m->lam[k], to);
}

void naive_run(model *m, size_t steps)
{
    memcpy(m->lam[0], m->lam0, sizeof m->lam0);
    for (size_t k = 1; k <= steps * m->fine; k++) {
        double jump[CONDITIONS] = {0.0};
        prescribe(m, k, m->lam[k]);
        for (size_t i = 0; i < m->count; i++)
            naive_free_velocity(m, i, k, jump);
        for (size_t row = 0; row < m->p; row++)
            m->lam[k][row] -= jump[row];
        naive_solve(m->p, m->H[k > m->fine], m->lam[k]);
        for (size_t i = 0; i < m->count; i++)
            naive_arrive(m, i, k);
    }
}

/* ---- tapes: records of everything ------------------------------------------------------------ */

void make_tape(tape *t, const model *m, int64_t begin, int64_t every)
{
    memset(t, 0xff, sizeof *t); /* all bits set: NaN */
    for (size_t i = 0; i < MOST; i++)
        t->position[i] = (int64_t)i;
    for (size_t i = 0; i < m->count; i++)
        t->nodes[i] =
            (pma_record_nodes){.count = m->parts[i].n, .position = t->position, .u = t->u[i],
                               .v = t->v[i], .w = t->w[i]};
    t->record = (pma_record){.begin = begin,
                             .every = every,
                             .nodes = t->nodes,
                             .multipliers = t->lam,
                             .velocity_jump = t->velocity,
                             .displacement_jump = t->displacement};
}

void run_taped(model *m, tape *t, int64_t steps)
{
    pma_coupler_record_present(m->coupler, &t->record);
    CHECK_STATUS(pma_coupler_advance(m->coupler, steps, &t->record, NULL), PMA_OK);
}
