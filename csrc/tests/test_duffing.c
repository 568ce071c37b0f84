/* test_duffing.c - pairs of oscillators with a cubic spring: order, tangents that are singular, and
 * what does not fit together. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "check.h"
#include "couple/coupler.h"
#include "models.h"
#include "naive.h"
#include "subdomain/subdomain.h"
#include "tests.h"

/* ---- order ----------------------------------------------------------------------------------- */

typedef struct {
    size_t substeps[2];
    bool macro, doubled, explicit_B; /* doubled: A */
    double cubic[2];
} pair;

static void make_loose_pair(model *m, pair q, double dt, double tolerance)
{
    *m = (model){.count = 2, .p = 1, .dt = dt, .rebased = true, .macro = q.macro};
    m->newton = (pma_newton){.tolerance = tolerance, .iterations = 40};
    m->subdomains[0] = one_mass(M_A, K_A, 1.0, generalized_alpha(0.5), true);
    m->subdomains[1] = one_mass(M_B, K_B, -1.0, generalized_alpha(0.8), !q.explicit_B);
    m->subdomains[0].doubled = q.doubled;
    for (size_t i = 0; i < 2; i++) {
        subdomain *x = &m->subdomains[i];
        x->substeps = q.substeps[i];
        x->u0[0] = 1.0;
        x->inner = (inner){.used = q.cubic[i] != 0.0, .cubic = q.cubic[i]};
    }
    make_model(m);
}

static void make_pair(model *m, pair q, double dt)
{
    make_loose_pair(m, q, dt, TIGHT);
}

/* u at the end of (M_A + M_B) u'' + (K_A + K_B) u + cubic u^3 = 0 from u = 1, by 4000 steps of the
 * classical Runge-Kutta rule: exact to 1e-10 */
static double integrate(double cubic, double end)
{
    const double M = M_A + M_B, K = K_A + K_B, h = end / 4000.0;
    double u = 1.0, v = 0.0;
    for (size_t i = 0; i < 4000; i++) {
        double du[4], dv[4];
        for (size_t k = 0; k < 4; k++) {
            const double share = k == 0 ? 0.0 : k == 3 ? h : 0.5 * h;
            const double at = u + (k == 0 ? 0.0 : share * du[k - 1]);
            du[k] = v + (k == 0 ? 0.0 : share * dv[k - 1]);
            dv[k] = -(K * at + cubic * at * at * at) / M;
        }
        u += h / 6.0 * (du[0] + 2.0 * du[1] + 2.0 * du[2] + du[3]);
        v += h / 6.0 * (dv[0] + 2.0 * dv[1] + 2.0 * dv[2] + dv[3]);
    }
    return u;
}

/* Largest error of u of both subdomains at the end. */
static double error_of(pair q, int64_t steps, double end)
{
    static model m;
    const double exact = integrate(q.cubic[0] + q.cubic[1], end);
    make_pair(&m, q, end / (double)steps);
    CHECK_STATUS(pma_coupler_advance(m.coupler, steps, NULL, NULL), PMA_OK);
    double error = 0.0;
    for (size_t i = 0; i < 2; i++)
        error = fmax(error, fabs(pma_subdomain_present(m.subdomains[i].core)->u[0] - exact));
    destroy_model(&m);
    return error;
}

/* Half the step, a quarter of the error; a little more or less, as terms of third order have it. */
static void duffing_pairs_converge_with_second_order(void)
{
    const pair pairs[8] = {
        {{1, 1}, false, false, false, {20.0, 30.0}}, {{1, 1}, false, false, true, {20.0, 30.0}},
        {{1, 1}, false, true, false, {50.0, 0.0}},   {{1, 1}, true, false, false, {20.0, 30.0}},
        {{2, 3}, true, false, false, {20.0, 30.0}},  {{1, 4}, true, true, false, {20.0, 30.0}},
        {{1, 4}, true, false, true, {50.0, 0.0}},    {{3, 1}, true, false, false, {0.0, 50.0}},
    };
    for (size_t i = 0; i < 8; i++) {
        const double coarse = error_of(pairs[i], 200, 2.0), fine = error_of(pairs[i], 400, 2.0);
        CHECK_NEAR(coarse / fine, 4.0, 0.5);
        CHECK(fine < 2e-3);
    }
}

/* ---- units ----------------------------------------------------------------------------------- */

static void make_scaled_pair(model *m, double scale, double length, bool keeps)
{
    *m = (model){.count = 2, .p = 1, .dt = 0.2, .rebased = true};
    m->newton = (pma_newton){.tolerance = 1e-8, .iterations = 40, .reuse = keeps};
    m->subdomains[0] = one_mass(scale * M_A, scale * K_A, 1.0, generalized_alpha(0.5), true);
    m->subdomains[1] = one_mass(scale * M_B, scale * K_B, -1.0, generalized_alpha(0.8), true);
    m->subdomains[1].substeps = 2;
    for (size_t i = 0; i < 2; i++) {
        subdomain *x = &m->subdomains[i];
        x->u0[0] = length;
        x->inner = (inner){.used = true, .keeps = keeps};
        x->inner.cubic = scale * 300.0 / (length * length);
    }
    make_model(m);
}

/* Newton's method has no scale of its own: powers of two in forces, and in displacements, change
 * what it accepts by nothing, (N7) and (N8). */
static void iterations_are_the_same_in_other_units(void)
{
    static const double scales[3] = {1.0, 1048576.0, 1.0 / 1073741824.0};
    static const double lengths[3] = {1.0, 1.0 / 1048576.0, 1048576.0};
    static model m[3];
    for (int keeps = 0; keeps < 2; keeps++) {
        for (size_t k = 0; k < 3; k++) {
            make_scaled_pair(&m[k], scales[k], lengths[k], keeps);
            CHECK_STATUS(pma_coupler_advance(m[k].coupler, STEPS, NULL, NULL), PMA_OK);
            for (size_t i = 0; i < 2; i++) {
                const pma_state *x = pma_subdomain_present(m[k].subdomains[i].core);
                const pma_state *first = pma_subdomain_present(m[0].subdomains[i].core);
                const double u = x->u[0] / lengths[k], v = x->v[0] / lengths[k];
                CHECK_NEAR(u, first->u[0], 1e-14); /* rounding of the last correction */
                CHECK_NEAR(v, first->v[0], 1e-13);
                CHECK(x->history[HISTORY] == first->history[HISTORY]); /* corrections */
            }
        }
        for (size_t k = 0; k < 3; k++)
            destroy_model(&m[k]);
    }
}

/* ---- the law in the middle of a substep ------------------------------------------------------ */

enum { RATIO = 4 }; /* substeps of B in one of A */

/* A step of one mass, in which everything follows from the velocity at its end. */
typedef struct {
    const subdomain *x;
    double ut, vt, al1, al2;
} mass_step;

static mass_step begin_step(const subdomain *x, bool twice, const level *from)
{
    double ut[MOST], vt[MOST], vs[MOST];
    naive_predict(x, twice, from, ut, vt, vs);
    return (mass_step){x, ut[0], vt[0], al1_of(x, twice), al2_of(x, twice)};
}

static level end_step(const mass_step *s, const level *from, double v)
{
    level to = {.v = {v}};
    to.w[0] = (v - s->vt) / s->al2;
    to.u[0] = s->ut + s->al1 * to.w[0];
    to.a[0] = naive_recur(s->x->scheme, to.w[0], from->w[0], from->a[0]);
    return to;
}

/* M w + K u + cubic u^3 with this velocity at the end, and its derivative */
static double force(const mass_step *s, double v, double *slope)
{
    const subdomain *x = s->x;
    const double w = (v - s->vt) / s->al2, u = s->ut + s->al1 * w, cubic = x->inner.cubic;
    *slope += (x->M[0] + s->al1 * (x->K[0] + 3.0 * cubic * u * u)) / s->al2;
    return x->M[0] * w + x->K[0] * u + cubic * u * u * u;
}

/* The velocity of force(a) + force(b) + (v - o) k = lam, a or b may be NULL. */
static double balance(const mass_step *a, const mass_step *b, double o, double k, double lam)
{
    double v = 0.0;
    for (size_t i = 0; i < 30; i++) {
        double slope = k, sum = k * (v - o) - lam;
        if (a)
            sum += force(a, v, &slope);
        if (b)
            sum += force(b, v, &slope);
        v -= sum / slope;
    }
    return v;
}

/* A substep of A that is open: its law o0 + (o1 - o0) theta + Lam / stiffness. */
typedef struct {
    mass_step step;
    double o0, o1, stiffness;
} open_mass;

/* (N13) as written: its free solution under the multiplier lam of the last time level n, and the
 * law with the tangent there; a double step begins before n. */
static open_mass open_naively(const subdomain *x, const level *n, bool twice, double lam)
{
    open_mass a = {.step = begin_step(x, twice, n - twice)};
    const double v = balance(&a.step, NULL, 0.0, 0.0, lam);
    force(&a.step, v, &a.stiffness);
    a.o0 = n->v[0] - lam / a.stiffness;
    a.o1 = v - lam / a.stiffness;
    return a;
}

/* Until its substep ends A contributes its law; then both are in equilibrium with the same
 * velocity, and Lam is the force on A. */
static void run_naively(model *m, size_t steps, double *lam)
{
    level *A = m->levels[0], *B = m->levels[1];
    open_mass a = {.o0 = 0.0};
    lam[0] = m->lam0[0];
    for (size_t k = 1; k <= steps * RATIO; k++) {
        const size_t n = (k - 1) / RATIO, phase = (k - 1) % RATIO + 1;
        const bool twice = m->subdomains[0].doubled && n > 0, ends = phase == RATIO;
        if (phase == 1)
            a = open_naively(&m->subdomains[0], &A[n], twice, lam[k - 1]);
        const mass_step b = begin_step(&m->subdomains[1], false, &B[k - 1]);
        const double theta = (double)phase / RATIO, o = (1.0 - theta) * a.o0 + theta * a.o1;
        const double v =
            ends ? balance(&a.step, &b, 0.0, 0.0, 0.0) : balance(&b, NULL, o, a.stiffness, 0.0);
        double unused = 0.0;
        lam[k] = ends ? force(&a.step, v, &unused) : (v - o) * a.stiffness;
        B[k] = end_step(&b, &B[k - 1], v);
        if (ends)
            A[n + 1] = end_step(&a.step, &A[n - twice], v);
    }
}

/* Forces and accelerations are of order ten. */
static const double AGREE_10 = 10.0 * AGREE;

static void check_mass(const model *m, size_t i, const level *expected)
{
    const pma_state *s = pma_subdomain_present(m->subdomains[i].core);
    CHECK_NEAR(s->u[0], expected->u[0], AGREE_10);
    CHECK_NEAR(s->v[0], expected->v[0], AGREE_10);
    CHECK_NEAR(s->w[0], expected->w[0], AGREE_10);
    CHECK_NEAR(s->a[0], expected->a[0], AGREE_10);
}

/* Single steps or double ones, B linear or not, with fresh tangents and kept ones. */
static void between_its_time_levels_a_member_has_the_law_of_its_free_solution(void)
{
    static model m;
    static tape t;
    for (int k = 0; k < 8; k++) {
        double lam[LEVELS];
        make_pair(&m, (pair){{1, RATIO}, false, k & 4, false, {50.0, k & 1 ? 20.0 : 0.0}}, 0.2);
        pma_coupler_parts parts = describe_coupler(&m);
        pma_iteration_parts iteration = *parts.iteration;
        iteration.newton.reuse = k & 2;
        parts.iteration = &iteration;
        pma_coupler_destroy(m.coupler);
        CHECK_STATUS(pma_coupler_create(&parts, &m.coupler), PMA_OK);
        start_model(&m);
        make_tape(&t, &m, 0, 0);
        run_taped(&m, &t, STEPS);
        run_naively(&m, STEPS, lam);
        for (size_t i = 0; i <= STEPS * RATIO; i++)
            CHECK_NEAR(t.lam[i], lam[i], AGREE_10);
        check_mass(&m, 0, &m.levels[0][STEPS]);
        check_mass(&m, 1, &m.levels[1][STEPS * RATIO]);
        destroy_model(&m);
    }
}

/* ---- shooting -------------------------------------------------------------------------------- */

/* Sum of v . M v at the present, and of the energy scales of the substeps. */
static void read_scales(const model *m, double *kinetic, double *scales)
{
    *kinetic = *scales = 0.0;
    for (size_t i = 0; i < m->count; i++) {
        const double v = pma_subdomain_present(m->subdomains[i].core)->v[0];
        *kinetic += v * m->subdomains[i].M[0] * v;
        *scales += pma_iterate_kept(pma_subdomain_iterate(m->subdomains[i].core)).scale;
    }
}

/* (N16) from the velocities that are left apart: e^2 = dt r^2 / H. H is that of the start, and B
 * has learned since; the stiffness grows by less than 4, so that e is right within a factor 2. */
static void shooting_leaves_a_tie_within_its_tolerance_and_goes_no_further(void)
{
    static model m;
    const double tolerance = 1e-5;
    double largest = 0.0, most = 0.0;
    make_loose_pair(&m, (pair){{1, 4}, true, false, false, {20.0, 30.0}}, 0.1, tolerance);
    for (size_t step = 0; step < 40; step++) {
        double kinetic, scales;
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
        const double r = pma_subdomain_present(m.subdomains[0].core)->v[0] -
                         pma_subdomain_present(m.subdomains[1].core)->v[0];
        read_scales(&m, &kinetic, &scales);
        most = fmax(most, kinetic);
        const double e = sqrt(m.dt * r * r / m.H[0][0]) / sqrt(most + scales);
        CHECK(e <= 2.0 * 10.0 * tolerance);
        largest = fmax(largest, e);
    }
    CHECK(largest > 1e-3 * tolerance); /* rounding would be 1e-15 */
    destroy_model(&m);
}

/* ---- tangents that are singular -------------------------------------------------------------- */

/* No part of the tangent is left: of A, or of B alone. */
static void a_tangent_that_is_singular_is_named(void)
{
    for (size_t i = 0; i < 2; i++) {
        for (int macro = 0; macro <= 1; macro++) {
            static model m;
            pair q = {{1, 2}, macro, false, false, {1.0, 1.0}};
            q.cubic[i] = 1e-307; /* 3 al1 cubic u^2 is denormal */
            make_pair(&m, q, 0.1);
            inner *in = &m.subdomains[i].inner;
            in->base[0][0] = in->K1[0] = in->K2[0] = in->C2[0] = 0.0;
            const snapshot before = present(&m);
            CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_SINGULAR);
            CHECK_INT(pma_coupler_failed(m.coupler), i);
            const pma_iterate_failure failure =
                pma_iterate_failed(pma_subdomain_iterate(m.subdomains[i].core));
            CHECK_INT(failure.dof, 0);
            CHECK_INT(failure.iterations, 0);
            CHECK(failure.t == (i == 0 ? 0.1 : 0.05));
            check_same_present(&m, &before);
            destroy_model(&m);
        }
    }
}

/* The constant part, of B, is not a number. */
static void an_interface_matrix_that_has_no_factor_is_singular(void)
{
    static model m;
    const double less = NAN;
    make_pair(&m, (pair){{1, 1}, false, false, true, {1.0, 0.0}}, 0.1);
    pma_coupler_parts parts = describe_coupler(&m);
    pma_iteration_parts iteration = *parts.iteration;
    iteration.start = iteration.later = &less;
    parts.iteration = &iteration;
    pma_coupler_destroy(m.coupler);
    CHECK_STATUS(pma_coupler_create(&parts, &m.coupler), PMA_OK);
    start_model(&m);
    const snapshot before = present(&m);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_SINGULAR);
    CHECK(pma_coupler_failed(m.coupler) == PMA_INTERFACE);
    check_same_present(&m, &before);
    destroy_model(&m);
}

/* ---- an iteration that fails ----------------------------------------------------------------- */

/* One iteration is not enough; the time is that of the substep, and in it one correction was
 * made. */
static void a_failed_iteration_knows_where_it_was(void)
{
    static model m;
    for (int macro = 0; macro <= 1; macro++) {
        make_pair(&m, (pair){{1, 4}, macro, false, false, {50.0, 50.0}}, 0.2);
        pma_coupler_parts parts = describe_coupler(&m);
        pma_iteration_parts iteration = *parts.iteration;
        iteration.newton.iterations = 1;
        parts.iteration = &iteration;
        pma_coupler_destroy(m.coupler);
        CHECK_STATUS(pma_coupler_create(&parts, &m.coupler), PMA_OK);
        start_model(&m);
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_NOT_CONVERGED);
        CHECK_INT(pma_coupler_failed(m.coupler), 0); /* the first of those that fail */
        const pma_iterate_failure failure =
            pma_iterate_failed(pma_subdomain_iterate(m.subdomains[0].core));
        CHECK(failure.t == 0.2);
        CHECK_INT(failure.iterations, 1);
        CHECK(failure.dof == SIZE_MAX);
        destroy_model(&m);
    }
}

/* ---- couplers and subdomains that cannot be -------------------------------------------------- */

static void couplers_that_cannot_iterate_are_refused(void)
{
    static model m;
    const pma_schedule *const schedules[4] = {&pma_fine_schedule, &pma_macro_schedule,
                                              &pma_iterated_schedule, &pma_shooting_schedule};
    for (size_t i = 0; i < 4; i++) {
        make_pair(&m, (pair){{1, 1}, i == 3, false, false, {1.0, 1.0}}, 0.1);
        pma_coupler_parts parts = describe_coupler(&m);
        pma_iteration_parts iteration = *parts.iteration;
        full_pattern larger;
        parts.schedule = schedules[i];
        CHECK_STATUS(coupler_status(&parts), i < 2 ? PMA_BAD_SIZE : PMA_OK);
        parts.iteration = NULL;
        CHECK_STATUS(coupler_status(&parts), PMA_BAD_SIZE);
        parts.iteration = &iteration;
        iteration.H = describe_full(&larger, 2, 2);
        iteration.response.n = 2;
        CHECK_STATUS(coupler_status(&parts), PMA_BAD_SIZE);
        destroy_model(&m);
    }
}

/* Two masses tied twice, of which the second tie couples to the first in H. */
static void an_interface_matrix_without_an_entry_of_a_member_is_refused(void)
{
    static model m;
    m = (model){.count = 2, .p = 2, .dt = 0.1, .rebased = true};
    for (size_t i = 0; i < 2; i++) {
        const double sign = i == 0 ? 1.0 : -1.0;
        m.subdomains[i] = (subdomain){.n = 2,
                                      .nb = 2,
                                      .p = 2,
                                      .substeps = 1,
                                      .implicit = true,
                                      .scheme = TRAPEZOIDAL,
                                      .M = {1.0, 0.0, 0.0, 1.0},
                                      .K = {2.0, -1.0, -1.0, 2.0},
                                      .L = {sign, 0.0, 0.0, sign},
                                      .inner = {.used = true}};
    }
    make_model(&m);
    const int64_t ptr[3] = {0, 1, 2};
    const int32_t index[2] = {0, 1};
    pma_coupler_parts parts = describe_coupler(&m);
    pma_iteration_parts iteration = *parts.iteration;
    parts.iteration = &iteration;
    CHECK_STATUS(coupler_status(&parts), PMA_OK);
    iteration.H.ptr = ptr;
    iteration.H.index = index;
    CHECK_STATUS(coupler_status(&parts), PMA_BAD_INDEX);
    destroy_model(&m);
}

static void subdomains_that_cannot_be_iterated_are_refused(void)
{
    static model m;
    chain chosen = {.plan = {{1, 6, 1}, false, false, true, false, false}, .inner = {true}};
    chosen.nonlinear = chosen.sprung = true;
    build_chain(&m, &chosen);
    const pma_parts good = *pma_subdomain_parts(m.subdomains[0].core);
    const pma_iterate_parts sound = *good.iterate;
    CHECK_STATUS(subdomain_status(&good), PMA_OK);
    pma_parts bad = good;
    bad.has_internal = false;
    CHECK_STATUS(subdomain_status(&bad), PMA_BAD_SIZE);
    bad = good;
    bad.M.n = 2;
    CHECK_STATUS(subdomain_status(&bad), PMA_BAD_SIZE);
    bad = good;
    bad.internal.n = 2;
    CHECK_STATUS(subdomain_status(&bad), PMA_BAD_SIZE);
    bad = good;
    bad.internal.history = 7;
    CHECK_STATUS(subdomain_status(&bad), PMA_BAD_SIZE);
    pma_iterate_parts iterate = sound;
    bad = good;
    bad.iterate = &iterate;
    iterate.tangent.nb = 2;
    CHECK_STATUS(subdomain_status(&bad), PMA_BAD_SIZE);
    iterate = sound;
    iterate.M_size.n = 2;
    CHECK_STATUS(subdomain_status(&bad), PMA_BAD_SIZE);
    /* a diagonal pattern has neither all positions of the functions nor those of the springs */
    const int64_t ptr[4] = {0, 1, 2, 3};
    const int32_t index[3] = {0, 1, 2};
    iterate = sound;
    iterate.tangent.ptr = ptr;
    iterate.tangent.index = index;
    CHECK_STATUS(subdomain_status(&bad), PMA_BAD_INDEX);
    bad.internal.count = bad.internal.history = 0;
    CHECK_STATUS(subdomain_status(&bad), PMA_BAD_INDEX);
    iterate.springs = false;
    CHECK_STATUS(subdomain_status(&bad), PMA_OK);
    destroy_model(&m);
}

const test DUFFING_TESTS[] = {
    TEST(duffing_pairs_converge_with_second_order),
    TEST(between_its_time_levels_a_member_has_the_law_of_its_free_solution),
    TEST(shooting_leaves_a_tie_within_its_tolerance_and_goes_no_further),
    TEST(a_tangent_that_is_singular_is_named),
    TEST(an_interface_matrix_that_has_no_factor_is_singular),
    TEST(a_failed_iteration_knows_where_it_was),
    TEST(couplers_that_cannot_iterate_are_refused),
    TEST(an_interface_matrix_without_an_entry_of_a_member_is_refused),
    TEST(subdomains_that_cannot_be_iterated_are_refused),
    TEST(iterations_are_the_same_in_other_units),
    END_OF_TESTS,
};
