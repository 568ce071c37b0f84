/* models.c - see models.h; the naive program is docs/method.md as written and keeps all levels. */
#include "models.h"

#include <math.h>
#include <string.h>

#include "algebra/factor.h"
#include "algebra/link.h"
#include "check.h"
#include "naive.h"

/* ---- models: coupled subdomains, for the core and for the naive program ---------------------- */

/* v (n): what a unit multiplier adds to the velocity by the next interface problem; to the
 * displacement under mean coupling */
static void naive_unit_velocity(const model *m, const subdomain *x, bool twice, size_t row,
                                double *v)
{
    double unit[CONSTRAINTS] = {0.0};
    unit[row] = 1.0;
    if (m->macro) {
        const level end = naive_response(x, twice, unit);
        memcpy(v, x->mean ? end.u : end.v, x->n * sizeof(double));
        return;
    }
    naive_link(x, twice, unit, v);
    for (size_t i = 0; i < x->n; i++)
        v[i] *= al2_of(x, twice);
}

void add_interface(const model *m, const subdomain *x, bool later, double *H)
{
    for (size_t column = 0; column < m->p; column++) {
        double v[MOST];
        naive_unit_velocity(m, x, later && x->doubled, column, v);
        for (size_t row = 0; row < m->p; row++)
            H[row * m->p + column] += constrained(x, row, v);
    }
}

/* H, the doubled subdomains with 2 h if `later` */
static pma_interface make_interface(model *m, bool later)
{
    double *H = m->H[later];
    memset(H, 0, sizeof m->H[later]);
    for (size_t i = 0; i < m->count; i++)
        add_interface(m, &m->subdomains[i], later, H);
    if (m->mean)
        return make_unsymmetric_interface(&m->unsymmetric[later], m->p, H);
    naive_factor(m->p, H, m->R[later], m->inverse[later]);
    const pma_factor factor = {.form = PMA_DENSE,
                               .n = m->p,
                               .nb = m->p,
                               .inverse = m->inverse[later],
                               .values = m->R[later]};
    pma_interface_destroy(&m->interfaces[later]);
    CHECK_STATUS(pma_interface_create(&factor, &m->interfaces[later]), PMA_OK);
    return m->interfaces[later];
}

/* Of the multipliers of the last macro step, which a double step feels too                  (K4) */
static pma_matrix make_doubled(model *m)
{
    memset(m->doubled, 0, sizeof m->doubled);
    for (size_t i = 0; i < m->count; i++) {
        if (m->subdomains[i].doubled)
            add_interface(m, &m->subdomains[i], true, m->doubled);
    }
    return (pma_matrix){.form = PMA_DENSE, .n = m->p, .values = m->doubled};
}

pma_coupler_parts describe_coupler(model *m)
{
    const pma_interface H_start = make_interface(m, false), H = make_interface(m, true);
    return (pma_coupler_parts){.count = m->count,
                               .members = m->members,
                               .p = m->p,
                               .H_start = H_start,
                               .H = H,
                               .doubled = m->mean ? make_doubled(m) : (pma_matrix){.n = 0},
                               .dt = m->dt,
                               .rebased = m->rebased,
                               .schedule = schedule_of(m),
                               .iteration = describe_iteration(m),
                               .motion_count = m->motion_count,
                               .motions = &m->motion,
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
        size += m->subdomains[i].n;
    for (size_t q = 0; q < m->count; first += m->subdomains[q++].n) {
        const subdomain *x = &m->subdomains[q];
        double r[MOST], f[MOST], q1[HISTORY];
        naive_force(x, 0.0, 0, F);
        naive_pull(x, 0.0, x->u0, x->v0, r);
        naive_inner(x, 0.0, x->u0, x->inner.initial, f, q1);
        for (size_t i = 0; i < x->n; i++) {
            double *row = A + (first + i) * size;
            b[first + i] = (x->load.kind == PMA_LOAD_TABLE ? 0.0 : F[i]) - r[i] - f[i];
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
    for (size_t q = 0; q < m->count; first += m->subdomains[q++].n)
        memcpy(m->levels[q][0].w, b + first, m->subdomains[q].n * sizeof(double));
}

/* w = M^-1 (F(0) - C v - K u), without multipliers                                             */
static void start_free(const subdomain *x, level *first)
{
    double F[MOST];
    naive_force(x, 0.0, 0, F);
    for (size_t i = 0; i < x->n; i++) {
        first->w[i] = x->load.kind == PMA_LOAD_TABLE ? 0.0 : F[i];
        for (size_t j = 0; j < x->n; j++)
            first->w[i] -= x->C[i * x->n + j] * x->v0[j] + x->K[i * x->n + j] * x->u0[j];
    }
    naive_solve(x->n, x->M, first->w);
}

void start_model(model *m)
{
    solve_start(m);
    for (size_t i = 0; i < m->count && m->mean; i++)
        start_free(&m->subdomains[i], &m->levels[i][0]);
    start_histories(m);
    for (size_t i = 0; i < m->count; i++) {
        subdomain *x = &m->subdomains[i];
        level *first = &m->levels[i][0];
        memcpy(first->u, x->u0, sizeof first->u);
        memcpy(first->v, x->v0, sizeof first->v);
        memcpy(first->a, first->w, sizeof first->a);
        naive_store(x, false, m->lam0, first);
        pma_subdomain_start(x->core, x->u0, x->v0, first->w, m->lam0);
        naive_member_start(&m->wrapped[i], first);
    }
    const double g0[CONSTRAINTS] = {0.0};
    pma_coupler_start(m->coupler, 0, m->lam0, g0);
    if (m->mean)
        memcpy(present_array(m->coupler, "end_multipliers").values, m->lam0, m->p * sizeof(double));
}

pma_state_array present_array(pma_coupler *c, const char *name)
{
    pma_state_array arrays[PMA_COUPLER_ARRAYS];
    const size_t count = pma_coupler_arrays(c, arrays);
    for (size_t i = 0; i < count; i++) {
        if (strcmp(arrays[i].name, name) == 0)
            return arrays[i];
    }
    return (pma_state_array){.name = name};
}

size_t copy_levels(pma_subdomain *from, pma_subdomain *to)
{
    pma_state_array a[PMA_LEVEL_ARRAYS], b[PMA_LEVEL_ARRAYS];
    const size_t count = pma_subdomain_arrays(from, a);
    CHECK_INT(pma_subdomain_arrays(to, b), count);
    for (size_t i = 0; i < count; i++)
        memcpy(b[i].values, a[i].values, a[i].count * sizeof(double));
    return count;
}

static bool has_entry(const subdomain *x, size_t row)
{
    for (size_t i = 0; i < x->n; i++) {
        if (x->L[row * x->n + i] != 0.0)
            return true;
    }
    return false;
}

/* U of every constraint that the subdomain has                                              (M5) */
static void store_response(model *m, size_t i)
{
    const subdomain *x = &m->subdomains[i];
    pma_unit_responses units = {.rows = m->unit_rows[i], .values = m->units[i]};
    for (size_t row = 0; row < x->p; row++) {
        double unit[CONSTRAINTS] = {0.0};
        unit[row] = 1.0;
        if (!has_entry(x, row))
            continue;
        const level end = naive_response(x, false, unit);
        const double *const fields[4] = {end.u, end.v, end.w, end.a};
        for (size_t k = 0; k < 4; k++)
            memcpy(m->units[i] + (4 * units.count + k) * x->n, fields[k], x->n * sizeof(double));
        m->unit_rows[i][units.count++] = (int64_t)row;
    }
    pma_response_store(pma_subdomain_response(x->core), units);
}

static bool is_damped(const subdomain *x)
{
    double sum = 0.0;
    for (size_t i = 0; i < x->n * x->n; i++)
        sum += fabs(x->C[i]);
    return sum > 0.0;
}

static pma_member make_member(model *m, size_t i)
{
    subdomain *x = &m->subdomains[i];
    x->h = m->dt / (double)x->substeps;
    x->has_responses = (m->mean || (m->macro && x->substeps > 1)) && !x->inner.used;
    x->mean = m->mean;
    x->deferred = m->mean && x->implicit && x->substeps == 1 && !is_damped(x);
    make_subdomain(x);
    if (m->stored && x->has_responses)
        store_response(m, i);
    m->wrapped[i] =
        (naive_member){.of = x, .looks_ahead = m->looks_ahead, .link = describe(x).link};
    return m->naive[i] ? naive_member_of(&m->wrapped[i]) : pma_subdomain_member(x->core);
}

void make_model(model *m)
{
    if (m->newton.iterations == 0)
        m->newton = (pma_newton){.tolerance = TIGHT, .iterations = 40};
    m->fine = 1;
    for (size_t i = 0; i < m->count && !m->macro; i++)
        m->fine = m->subdomains[i].substeps > m->fine ? m->subdomains[i].substeps : m->fine;
    for (size_t i = 0; i < m->count; i++)
        m->members[i] = make_member(m, i);
    const pma_coupler_parts parts = describe_coupler(m);
    CHECK_STATUS(pma_coupler_create(&parts, &m->coupler), PMA_OK);
    start_model(m);
}

void destroy_model(model *m)
{
    pma_coupler_destroy(m->coupler);
    for (size_t i = 0; i < m->count; i++)
        pma_subdomain_destroy(m->subdomains[i].core);
    pma_interface_destroy(&m->interfaces[0]);
    pma_interface_destroy(&m->interfaces[1]);
    pma_interface_destroy(&m->unsymmetric[0].interface);
    pma_interface_destroy(&m->unsymmetric[1].interface);
}

pma_status coupler_status(const pma_coupler_parts *parts)
{
    pma_coupler *made = (pma_coupler *)&made;
    const pma_status status = pma_coupler_create(parts, &made);
    CHECK((made != NULL) == (status == PMA_OK));
    pma_coupler_destroy(made);
    return status;
}

void check_infinite_load(model *m, size_t i, size_t dof, int64_t after, model *like)
{
    double F[MOST] = {0.0};
    F[dof] = INFINITY;
    pma_subdomain *s = m->subdomains[i].core;
    CHECK_STATUS(pma_coupler_advance(m->coupler, after, NULL, NULL), PMA_OK);
    const snapshot before = present(m);
    const pma_load good = *pma_subdomain_load(s);
    pma_subdomain_set_load(s, (pma_load){.kind = PMA_LOAD_CONSTANT, .n = good.n, .values = F});
    CHECK_STATUS(pma_coupler_advance(m->coupler, STEPS - after, NULL, NULL), PMA_NOT_FINITE);
    CHECK_INT(pma_coupler_failed(m->coupler), i);
    CHECK_INT(pma_coupler_step_count(m->coupler), after);
    check_same_present(m, &before);
    pma_subdomain_set_load(s, good);
    CHECK_STATUS(pma_coupler_advance(m->coupler, STEPS - after, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_coupler_advance(like->coupler, STEPS, NULL, NULL), PMA_OK);
    check_same(m, like);
    destroy_model(m);
    destroy_model(like);
}

snapshot present(const model *m)
{
    snapshot s = {.count = 0};
    for (size_t i = 0; i < m->count; i++)
        s.count += copy_present(&m->subdomains[i], s.values + s.count);
    memcpy(s.values + s.count, pma_coupler_multipliers(m->coupler), m->p * sizeof(double));
    s.count += m->p;
    s.count += copy_iteration(m, s.values + s.count);
    return s;
}

void check_same_present(const model *m, const snapshot *expected)
{
    const snapshot actual = present(m);
    CHECK_INT(actual.count, expected->count);
    CHECK_BITS(actual.count, actual.values, expected->values);
}

void check_same(const model *m, const model *expected)
{
    const snapshot s = present(expected);
    check_same_present(m, &s);
}

void make_oscillator(model *m, split s)
{
    *m = (model){.count = 2, .p = 1, .dt = s.dt, .rebased = true};
    m->subdomains[0] = one_mass(M_A, K_A, 1.0, s.A, true);
    m->subdomains[1] = one_mass(M_B, K_B, -1.0, s.B, s.same);
    m->subdomains[0].doubled = s.doubled;
    m->subdomains[1].substeps = s.substeps;
    m->subdomains[0].u0[0] = m->subdomains[1].u0[0] = 1.0;
    make_model(m);
}

static void fill_loads(model *m, double scale)
{
    subdomain *A = &m->subdomains[0], *B = &m->subdomains[1], *C = &m->subdomains[2];
    const double shape[6] = {1.0, 0.0, 0.5, 0.0, -1.0, 0.0};
    memcpy(A->shape, shape, sizeof shape);
    uint64_t seed = 7;
    for (size_t i = 0; i < LEVELS * MOST; i++) {
        A->loads[i] = scale * draw_eighth(&seed);
        B->loads[i] = scale * draw_eighth(&seed);
    }
    C->loads[0] = scale * 0.5;
    C->loads[1] = -scale;
    A->load = (pma_load){.kind = PMA_LOAD_SAMPLED,
                         .values = A->loads,
                         .shape = A->shape,
                         .samples = LEVELS,
                         .k = 2,
                         .dt = 0.11};
    B->load = (pma_load){.kind = PMA_LOAD_TABLE, .values = B->loads, .rows = LEVELS};
    C->load = (pma_load){.kind = PMA_LOAD_CONSTANT, .values = C->loads};
    for (size_t k = 0; k < LEVELS; k++)
        m->moved[k] = scale * draw_eighth(&seed) / 8.0;
    m->moved_row = 1;
    m->motion = (pma_motion){&m->moved_row,
                             {.kind = PMA_LOAD_TABLE, .n = 1, .values = m->moved, .rows = LEVELS}};
}

/* Estimates on the implicit A, lagged damping on the explicit B, a force alone on C */
static void fill_restoring(model *m)
{
    subdomain *A = &m->subdomains[0];
    for (size_t i = 0; i < m->count; i++)
        m->subdomains[i].restored = true;
    for (size_t i = 0; i < A->n; i++) {
        A->K_r[i * A->n + i] = 0.75;
        A->D_r[i * A->n + i] = 0.375;
    }
    m->subdomains[1].lagged = true;
}

/* Between two dofs or a dof and the ground, one law in each set; parameters in its order. */
static const int32_t GROUND[1] = {-1}, FIRST[1] = {0}, SECOND[1] = {1};
static const double ONE[1] = {1.0}, HALF[1] = {0.5}, TENTH[1] = {0.1}, TWO[1] = {2.0};
static const double TEN[1] = {10.0};

static const pma_spring_set SETS[4] = {
    {.law = PMA_BILINEAR,
     .count = 1,
     .first = FIRST,
     .second = SECOND,
     .parameters = {HALF, TWO, TENTH}},
    {.law = PMA_CUBIC, .count = 1, .first = SECOND, .second = GROUND, .parameters = {ONE, TWO}},
    {.law = PMA_BOUC_WEN,
     .count = 1,
     .first = FIRST,
     .second = GROUND,
     .parameters = {HALF, HALF, TEN, TWO, HALF, HALF, TWO}},
    {.law = PMA_GAP, .count = 1, .first = SECOND, .second = GROUND, .parameters = {ONE, TENTH}},
};

/* A has the first two, B the third one, C the last two. */
static void fill_springs(model *m)
{
    m->subdomains[0].springs = (pma_springs){.count = 2, .sets = SETS, .total = 2};
    m->subdomains[1].springs = (pma_springs){.count = 1, .sets = SETS + 2, .total = 1};
    m->subdomains[2].springs = (pma_springs){.count = 2, .sets = SETS + 2, .total = 2};
}

static void fill_chain(model *m, const plan *chosen, double scale)
{
    m->subdomains[0] = (subdomain){.n = 3,
                                   .nb = 1,
                                   .implicit = true,
                                   .doubled = chosen->A_doubled,
                                   .scheme = generalized_alpha(0.5),
                                   .M = {2, 0, 0, 0, 1.5, 0, 0, 0, 1},
                                   .C = {0.5, -0.25, 0, -0.25, 0.5, -0.25, 0, -0.25, 0.25},
                                   .K = {5, -2, 0, -2, 4, -2, 0, -2, 2},
                                   .L = {0, 0, 1, 0, 0, 0}};
    m->subdomains[1] = (subdomain){.n = 2,
                                   .nb = 2,
                                   .scheme = generalized_alpha(0.8),
                                   .M = {1, 0, 0, 1},
                                   .C = {0.25, 0, 0, 0},
                                   .K = {3, -2, -2, 3},
                                   .L = {-1, 0, 0, 1}};
    m->subdomains[2] = (subdomain){.n = 2,
                                   .nb = 1,
                                   .implicit = true,
                                   .doubled = chosen->C_doubled,
                                   .scheme = TRAPEZOIDAL,
                                   .M = {1, 0.25, 0.25, 1},
                                   .K = {4, -2, -2, 2},
                                   .L = {0, 0, 0, -1}};
    const double u0[SUBDOMAINS][MOST] = {{0.25, -0.5, 1.0}, {1.0, 0.5}, {0.75, 0.5}};
    for (size_t i = 0; i < SUBDOMAINS; i++) {
        m->subdomains[i].p = 2;
        m->subdomains[i].substeps = chosen->substeps[i];
        for (size_t k = 0; k < m->subdomains[i].n; k++) {
            m->subdomains[i].u0[k] = scale * u0[i][k];
            m->subdomains[i].v0[k] = scale;
        }
    }
}

void build_chain(model *m, const chain *chosen)
{
    const double scale = chosen->scale != 0.0 ? chosen->scale : 1.0;
    *m = (model){.count = 3,
                 .p = 2,
                 .dt = 0.3,
                 .rebased = chosen->plan.rebased,
                 .motion_count = chosen->plan.moved,
                 .threads = chosen->threads,
                 .macro = chosen->macro || chosen->mean,
                 .mean = chosen->mean,
                 .stored = chosen->stored,
                 .looks_ahead = chosen->looks_ahead};
    memcpy(m->naive, chosen->naive, sizeof m->naive);
    m->newton = chosen->newton;
    fill_chain(m, &chosen->plan, scale);
    for (size_t i = 0; i < SUBDOMAINS && chosen->undamped; i++)
        memset(m->subdomains[i].C, 0, sizeof m->subdomains[i].C);
    fill_loads(m, scale);
    if (chosen->plan.restored)
        fill_restoring(m);
    for (size_t i = 0; i < SUBDOMAINS; i++)
        fill_inner(&m->subdomains[i], chosen->inner[i], chosen);
    if (chosen->sprung && (chosen->nonlinear || !has_inner(m)))
        fill_springs(m);
    make_model(m);
}

void make_chain(model *m, plan chosen, double scale)
{
    build_chain(m, &(chain){.plan = chosen, .scale = scale});
}

void make_threaded_chain(model *m, plan chosen, size_t threads)
{
    build_chain(m, &(chain){.plan = chosen, .threads = threads});
}

/* ---- tapes: records of everything ----------------------------------------------------------- */

void make_tape(tape *t, const model *m, int64_t begin, int64_t every)
{
    memset(t, 0xff, sizeof *t); /* all bits set: NaN */
    for (size_t i = 0; i < MOST; i++)
        t->position[i] = (int64_t)i;
    for (size_t i = 0; i < m->count; i++)
        t->selections[i] = (pma_selection){.count = m->subdomains[i].n,
                                           .position = t->position,
                                           .u = t->u[i],
                                           .v = t->v[i],
                                           .w = t->w[i]};
    t->record = (pma_record){.begin = begin,
                             .every = every,
                             .selections = t->selections,
                             .multipliers = t->lam,
                             .velocity_jump = t->velocity,
                             .displacement_jump = t->displacement};
}

void run_taped(model *m, tape *t, int64_t steps)
{
    pma_coupler_record_present(m->coupler, &t->record);
    CHECK_STATUS(pma_coupler_advance(m->coupler, steps, &t->record, NULL), PMA_OK);
}

void check_tape(const tape *actual, const tape *expected)
{
    for (size_t i = 0; i < SUBDOMAINS; i++) {
        CHECK_BITS(LEVELS * MOST, actual->u[i], expected->u[i]);
        CHECK_BITS(LEVELS * MOST, actual->v[i], expected->v[i]);
        CHECK_BITS(LEVELS * MOST, actual->w[i], expected->w[i]);
    }
    CHECK_BITS(LEVELS * CONSTRAINTS, actual->lam, expected->lam);
    CHECK_BITS(LEVELS * CONSTRAINTS, actual->velocity, expected->velocity);
    CHECK_BITS(LEVELS * CONSTRAINTS, actual->displacement, expected->displacement);
}

static void check_subdomain_against_naive(const model *m, size_t i, const tape *t, size_t steps)
{
    const subdomain *x = &m->subdomains[i];
    for (size_t row = 0; row <= steps * x->substeps; row++) {
        for (size_t k = 0; k < x->n; k++) {
            CHECK_NEAR(t->u[i][row * x->n + k], m->levels[i][row].u[k], AGREE);
            CHECK_NEAR(t->v[i][row * x->n + k], m->levels[i][row].v[k], AGREE);
            CHECK_NEAR(t->w[i][row * x->n + k], m->levels[i][row].w[k] + m->levels[i][row].more[k],
                       AGREE);
        }
    }
    const level *last = &m->levels[i][steps * x->substeps];
    const level *reached = &m->wrapped[i].levels[m->wrapped[i].present];
    if (!m->naive[i])
        check_state(x, pma_subdomain_present(x->core), last);
    for (size_t k = 0; m->naive[i] && k < x->n; k++)
        CHECK_NEAR(reached->a[k], last->a[k], AGREE);
}

/* moved (p) += h/2 (g0 + g1), from interface problem k - 1 to k                             (G2) */
static void move_supports(const model *m, size_t k, double *moved)
{
    double g0[CONSTRAINTS] = {0.0}, g1[CONSTRAINTS] = {0.0};
    prescribe(m, k - 1, g0);
    prescribe(m, k, g1);
    for (size_t row = 0; row < m->p; row++)
        moved[row] += 0.5 * m->dt / (double)m->fine * (g0[row] + g1[row]);
}

void check_against_naive(const model *m, const tape *t, size_t steps)
{
    double moved[CONSTRAINTS] = {0.0};

    for (size_t i = 0; i < m->count; i++)
        check_subdomain_against_naive(m, i, t, steps);
    for (size_t k = 0; k <= steps * m->fine; k++) {
        for (size_t row = 0; row < m->p; row++)
            CHECK_NEAR(t->lam[k * m->p + row], m->lam[k][row], AGREE);
    }
    for (size_t k = 0; k <= steps; k++) {
        for (size_t j = 1; k > 0 && j <= m->fine; j++)
            move_supports(m, (k - 1) * m->fine + j, moved);
        for (size_t row = 0; row < m->p; row++) {
            double jump = -moved[row];
            for (size_t i = 0; i < m->count; i++)
                jump += constrained(&m->subdomains[i], row,
                                    m->levels[i][k * m->subdomains[i].substeps].u);
            CHECK_NEAR(t->displacement[k * m->p + row], jump, AGREE);
        }
    }
}

void check_chain(const chain *chosen)
{
    static model m;
    static tape t;
    build_chain(&m, chosen);
    make_tape(&t, &m, 0, 0);
    run_taped(&m, &t, STEPS);
    naive_run(&m, STEPS);
    check_against_naive(&m, &t, STEPS);
    destroy_model(&m);
}
