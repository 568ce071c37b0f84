/* test_subdomain.c - one subdomain, against closed forms and the naive program. */
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "algebra/factor.h"
#include "algebra/matrix.h"
#include "check.h"
#include "forces/load.h"
#include "models.h"
#include "naive.h"
#include "subdomain/inside.h"
#include "subdomain/scheme.h"
#include "subdomain/subdomain.h"
#include "tests.h"

static void a_subdomain_with_sizes_that_do_not_agree_is_refused(void)
{
    subdomain x = one_mass(1.0, 1.0, 1.0, TRAPEZOIDAL, true);
    x.n = 2, x.M[3] = 1.0;
    const pma_parts good = describe(&x);
    pma_parts bad[14];
    for (size_t i = 0; i < 14; i++)
        bad[i] = good;
    bad[0].n = 0;
    bad[1].nb = 3;
    bad[2].substeps = 0;
    bad[3].K.n = 3;
    bad[4].C.n = 1;
    bad[5].link.nb = 2;
    bad[6].single.factor.n = 3;
    bad[7].single.factor.nb = 2;
    bad[8].doubled = true, bad[8].twice.factor.n = 1;
    bad[9].doubled = true, bad[9].twice.factor.nb = 0;
    bad[10].nb = 0;
    bad[11].continues = true; /* without double steps */
    bad[12].deferred = true;  /* without mean coupling */
    bad[13].mean = true, bad[13].has_responses = true, bad[13].mass = good.single.factor;
    bad[13].deferred = true, bad[13].substeps = 2;
    for (size_t i = 0; i < 14; i++) {
        CHECK_STATUS(subdomain_status(&bad[i]), PMA_BAD_SIZE);
    }
    pma_subdomain *made = NULL;
    bad[8].doubled = false; /* the second operator is read only if doubled */
    CHECK_STATUS(pma_subdomain_create(&bad[8], &made), PMA_OK);
    CHECK_INT(pma_subdomain_parts(made)->n, 2);
    CHECK_INT(pma_subdomain_load(made)->kind, PMA_LOAD_NONE);
    pma_subdomain_destroy(made);
    pma_subdomain_destroy(NULL);
}

static void a_subdomain_with_a_bad_index_is_refused(void)
{
    subdomain x = one_mass(1.0, 1.0, 1.0, TRAPEZOIDAL, true);
    x.doubled = true;
    const pma_parts good = describe(&x);
    const int64_t ptr[2] = {0, 1};
    const int32_t one = 1;
    pma_parts bad[5] = {good, good, good, good, good};
    bad[0].K = (pma_matrix){.form = PMA_SPARSE, .n = 1, .values = x.K, .ptr = ptr, .index = &one};
    bad[1].C = (pma_matrix){.form = PMA_SPARSE, .n = 1, .values = x.K, .ptr = ptr, .index = &one};
    bad[2].link.index = &one;
    bad[3].single.factor = (pma_factor){.form = PMA_SPARSE,
                                        .n = 1,
                                        .nb = 1,
                                        .inverse = x.K,
                                        .values = x.K,
                                        .ptr = ptr,
                                        .index = &one};
    bad[4].twice.factor = bad[3].single.factor;
    for (size_t i = 0; i < 5; i++) {
        pma_subdomain *made = (pma_subdomain *)&x;
        CHECK_STATUS(pma_subdomain_create(&bad[i], &made), PMA_BAD_INDEX);
        CHECK(made == NULL);
    }
}

/* Over a change of the step a double step is h_old + h_new. */
static void a_double_step_that_continues_is_longer_than_a_step(void)
{
    subdomain x = one_mass(1.0, 1.0, 1.0, TRAPEZOIDAL, true);
    x.doubled = true;
    pma_parts parts = describe(&x);
    const double h = parts.single.step.h, good[2] = {1.5 * h, 9.0 * h}, bad[2] = {h, NAN};
    parts.continues = true;
    for (size_t i = 0; i < 2; i++) {
        parts.twice.step.h = bad[i];
        CHECK_STATUS(subdomain_status(&parts), PMA_BAD_STEP);
        parts.twice.step.h = good[i];
        CHECK_STATUS(subdomain_status(&parts), PMA_OK);
    }
}

static void a_double_step_of_another_length_than_two_steps_is_refused(void)
{
    subdomain x = one_mass(1.0, 1.0, 1.0, TRAPEZOIDAL, true);
    x.doubled = true;
    pma_parts parts = describe(&x);
    const double h = parts.twice.step.h;
    const double bad[4] = {parts.single.step.h, nextafter(h, 1.0), 0.0, NAN};
    for (size_t i = 0; i < 4; i++) {
        parts.twice.step.h = bad[i];
        parts.doubled = true;
        CHECK_STATUS(subdomain_status(&parts), PMA_BAD_STEP);
        parts.doubled = false; /* not read */
        CHECK_STATUS(subdomain_status(&parts), PMA_OK);
    }
    parts.twice.step.h = h;
    parts.doubled = true;
    CHECK_STATUS(subdomain_status(&parts), PMA_OK);
}

/* Without an interface and with diagonal forms no array is read before memory is allocated. */
static void a_subdomain_beyond_all_memory_is_refused(void)
{
    const size_t n = SIZE_MAX / 100;
    const double one = 1.0;
    const int64_t ptr = 0;
    const pma_parts parts = {.n = n,
                             .substeps = 1,
                             .K = {.form = PMA_DIAGONAL, .n = n, .values = &one},
                             .C = {.form = PMA_ZERO, .n = n},
                             .single = {.factor = {.form = PMA_DIAGONAL, .n = n, .inverse = &one}},
                             .link = {0, 0, &ptr, NULL, NULL, NULL}};
    CHECK_STATUS(subdomain_status(&parts), PMA_NO_MEMORY);
}

/* A substep reads the factor twice, K and C once, and the four vectors a few times. */
static void a_substep_reads_at_least_what_its_sweeps_and_products_read(void)
{
    subdomain x = one_mass(1.0, 1.0, 1.0, TRAPEZOIDAL, true);
    x.n = 3, x.M[4] = x.M[8] = 1.0, x.L[2] = 1.0, x.L[0] = 0.0;
    make_subdomain(&x);
    const size_t least = 2 * 6 + 9 + 9 + 4 * 3;
    CHECK(pma_subdomain_member(x.core).entries >= least);
    CHECK(pma_subdomain_member(x.core).entries < 2 * least);
    pma_subdomain_destroy(x.core);
}

/* `steps` macro steps of one substep each, nothing tied; u and v at every time level, 0 included */
static void swing(subdomain *x, double u0, double v0, size_t steps, double *u, double *v)
{
    const double w0 = -x->K[0] / x->M[0] * u0, lam = 0.0;
    make_subdomain(x);
    const pma_member m = pma_subdomain_member(x->core);
    pma_subdomain_start(x->core, &u0, &v0, &w0, &lam);
    for (size_t n = 0; n <= steps; n++) {
        u[n] = pma_subdomain_present(x->core)->u[0];
        v[n] = pma_subdomain_present(x->core)->v[0];
        const pma_substep step = {.number = (int64_t)n};
        CHECK_STATUS(m.table->advance(m.self, NULL, &step, NULL, NULL), PMA_OK);
        CHECK_STATUS(m.table->advance(m.self, &step, NULL, &lam, NULL), PMA_OK);
        m.table->commit(m.self);
    }
    pma_subdomain_destroy(x->core);
}

/* The amplification of (u, v) is a rotation: u_n = u0 cos(n q) + v0/omega sin(n q) with
 * tan(q/2) = omega h/2. */
static void a_free_oscillator_under_the_trapezoidal_rule_turns_by_its_closed_form(void)
{
    subdomain x = one_mass(2.0, 18.0, 0.0, TRAPEZOIDAL, true); /* omega = 3 */
    double u[SWINGS + 1], v[SWINGS + 1];
    swing(&x, 1.0, 1.5, SWINGS, u, v);
    const double q = 2.0 * atan(3.0 * x.h / 2.0);
    for (size_t n = 0; n <= SWINGS; n++) {
        const double c = cos((double)n * q), s = sin((double)n * q);
        CHECK_NEAR(u[n], c + 0.5 * s, SWING_TOLERANCE);
        CHECK_NEAR(v[n], 1.5 * c - 3.0 * s, 3.0 * SWING_TOLERANCE);
    }
}

/* u_{n+1} - 2 u_n + u_{n-1} = -(omega h)^2 u_n: u_n = cos(n q), cos q = 1 - (omega h)^2/2, and
 * v_n = (u_{n+1} - u_{n-1})/(2 h) = -sin(n q) sin(q)/h */
static void a_free_oscillator_under_the_central_difference_turns_by_its_closed_form(void)
{
    subdomain x = one_mass(2.0, 18.0, 0.0, CENTRAL_DIFFERENCE, false);
    double u[SWINGS + 1], v[SWINGS + 1];
    swing(&x, 1.0, 0.0, SWINGS, u, v);
    const double q = acos(1.0 - 0.5 * 0.3 * 0.3);
    for (size_t n = 0; n <= SWINGS; n++) {
        CHECK_NEAR(u[n], cos((double)n * q), SWING_TOLERANCE);
        /* the rounding of q, divided by sin q = 0.3, is multiplied with n in the expectation */
        CHECK_NEAR(v[n], -sin((double)n * q) * sin(q) / x.h, 10.0 * SWING_TOLERANCE);
    }
}

/* At omega h = (1 + rho) sqrt(2 - rho) all three roots of the explicit scheme are -rho, so that
 * (E + rho)^3 v = 0 for the shift E, once the fourth root, 0, has had its step; and there
 * al1 omega^2 = 1, so that u1 = ut - al1 omega^2 ut = 0. */
static void the_explicit_scheme_has_three_equal_roots_at_its_bifurcation(void)
{
    for (double rho = 0.25; rho < 1.0; rho += 0.25) {
        const double omega_h = (1.0 + rho) * sqrt(2.0 - rho);
        subdomain x = one_mass(1.0, omega_h * omega_h / 0.01, 0.0, generalized_alpha(rho), false);
        double u[11], v[11];
        swing(&x, 1.0, 10.0, 10, u, v);
        for (size_t n = 1; n + 3 <= 10; n++) {
            const double sum = v[n + 3] + 3.0 * rho * v[n + 2] + 3.0 * rho * rho * v[n + 1] +
                               rho * rho * rho * v[n];
            /* terms up to 10 in u and up to 300 in v, four to ten roundings of them */
            CHECK_NEAR(u[n], 0.0, 100.0 * EPS);
            CHECK_NEAR(sum, 0.0, 3000.0 * EPS);
        }
        CHECK(fabs(v[5]) > 0.1); /* not all is zero */
    }
}

/* Three dofs with a full mass matrix and damping, two of them on the interface with two
 * constraints, under a constant load. */
static subdomain three_dofs(size_t substeps, bool doubled)
{
    subdomain x = {.n = 3,
                   .nb = 2,
                   .p = 2,
                   .substeps = substeps,
                   .implicit = true,
                   .doubled = doubled,
                   .scheme = generalized_alpha(0.6),
                   .h = 0.2,
                   .M = {2.0, 0.25, 0.0, 0.25, 1.0, 0.25, 0.0, 0.25, 1.5},
                   .C = {0.5, -0.125, 0.0, -0.125, 0.25, 0.0, 0.0, 0.0, 0.125},
                   .K = {5.0, -2.0, 0.0, -2.0, 4.0, -2.0, 0.0, -2.0, 2.0},
                   .L = {0.0, 1.0, 0.0, 0.0, -1.0, 1.0},
                   .u0 = {1.0, 0.5, -0.5},
                   .v0 = {0.0, -1.0, 0.25},
                   .shape = {0.5, 0.0, -0.25}};
    return x;
}

static void start_three_dofs(subdomain *x, level *naive)
{
    const double w0[3] = {0.5, -1.0, 2.0}, lam0[2] = {0.5, -0.25};
    x->load = (pma_load){.kind = PMA_LOAD_CONSTANT, .values = x->shape};
    make_subdomain(x);
    pma_subdomain_start(x->core, x->u0, x->v0, w0, lam0);
    memcpy(naive->u, x->u0, sizeof naive->u);
    memcpy(naive->v, x->v0, sizeof naive->v);
    memcpy(naive->w, w0, sizeof naive->w);
    memcpy(naive->a, w0, sizeof naive->a);
    naive_store(x, false, lam0, naive);
}

/* A substep of both, towards time level k of the run; lam is anything but zero. */
static void step_both(subdomain *x, size_t k, bool twice, level *naive)
{
    const pma_member m = pma_subdomain_member(x->core);
    const pma_substep step = {.j = (k - 1) % x->substeps, .number = (int64_t)k - 1, .twice = twice};
    const double lam[2] = {sin((double)k), cos(2.0 * (double)k)};
    const level *from = &naive[twice ? k - 2 : k - 1];
    double jump[2] = {1.0, 2.0}, theta = 0.25;
    CHECK_STATUS(m.table->advance(m.self, NULL, &step, NULL, NULL), PMA_OK);
    CHECK_INT(m.table->opened(m.self), step.j + 1);
    naive_free(x, twice, 0.0, x->load.values, from, &naive[k]);
    pma_member_free_velocity(&m, step.j, theta, -2.0, jump);
    for (size_t row = 0; row < 2; row++) {
        const double vf = (1.0 - theta) * constrained(x, row, naive[k - 1].vf) +
                          theta * constrained(x, row, naive[k].vf);
        CHECK_NEAR(jump[row], 1.0 + (double)row - 2.0 * vf, AGREE);
    }
    CHECK_STATUS(m.table->advance(m.self, &step, NULL, lam, NULL), PMA_OK);
    naive_close(x, twice, lam, from, &naive[k]);
    check_state(x, pma_levels_at(&x->core->levels, step.j + 1), &naive[k]);
}

/* Naively all time levels are kept; the core has room for two or three, in turn. */
static void check_against_all_levels(size_t substeps, bool doubled)
{
    subdomain x = three_dofs(substeps, doubled);
    level naive[LEVELS];
    start_three_dofs(&x, &naive[0]);
    const pma_member m = pma_subdomain_member(x.core);
    for (size_t macro = 0; macro < STEPS; macro++) {
        const size_t begin = macro * substeps, end = begin + substeps;
        check_state(&x, pma_subdomain_present(x.core), &naive[begin]);
        for (size_t k = begin + 1; k <= end; k++)
            step_both(&x, k, doubled && macro > 0, naive);
        if (doubled && macro == 0) {
            const double lam[2] = {3.0, 4.0};
            m.table->rebase(m.self, substeps, lam);
            naive_store(&x, true, lam, &naive[end]);
        }
        m.table->commit(m.self);
    }
    pma_subdomain_destroy(x.core);
}

static void single_steps_are_those_of_a_program_that_keeps_all_levels(void)
{
    for (size_t substeps = 1; substeps <= 5; substeps++)
        check_against_all_levels(substeps, false);
}

static void double_steps_are_those_of_a_program_that_keeps_all_levels(void)
{
    for (size_t substeps = 1; substeps <= 5; substeps++)
        check_against_all_levels(substeps, true);
}

/* al2 L Mbar^-1 L^T lam, added to what is there, for h and for 2 h */
static void the_compliance_is_the_dense_product(void)
{
    subdomain x = three_dofs(1, true);
    level naive;
    const double lam[2] = {1.5, -0.5};
    double wl[MOST];
    start_three_dofs(&x, &naive);
    const pma_member m = pma_subdomain_member(x.core);
    for (int twice = 0; twice <= 1; twice++) {
        double out[2] = {1.0, 2.0};
        pma_member_compliance(&m, twice, lam, out);
        naive_link(&x, twice, lam, wl);
        for (size_t row = 0; row < 2; row++) {
            const double expected = al2_of(&x, twice) * constrained(&x, row, wl);
            /* a 3 x 3 solve of condition below 10 */
            CHECK_NEAR(out[row], 1.0 + (double)row + expected, 100.0 * EPS);
        }
    }
    pma_subdomain_destroy(x.core);
}

/* L = [0 1 0; 0 -1 1] and dyadic numbers: no rounding */
static void velocities_and_displacements_on_the_interface_are_added_to_the_jump(void)
{
    subdomain x = three_dofs(1, false);
    level naive;
    double jump[2] = {8.0, 16.0};
    start_three_dofs(&x, &naive);
    const pma_member m = pma_subdomain_member(x.core);
    pma_member_gather(&m, PMA_DISPLACEMENT, 0, 1.0, jump);
    CHECK_BITS(2, jump, ((double[]){8.0 + 0.5, 16.0 - 0.5 - 0.5}));
    pma_member_gather(&m, PMA_VELOCITY, 0, 1.0, jump);
    CHECK_BITS(2, jump, ((double[]){8.5 - 1.0, 15.0 + 1.0 + 0.25}));
    pma_subdomain_destroy(x.core);
}

/* substeps 1..count of a macro step, not committed */
static void walk(const pma_member *m, size_t count, bool twice)
{
    for (size_t j = 0; j < count; j++) {
        const pma_substep step = {.j = j, .twice = twice};
        const double lam[2] = {1.0 + (double)j, -2.0};
        CHECK_STATUS(m->table->advance(m->self, NULL, &step, NULL, NULL), PMA_OK);
        CHECK_STATUS(m->table->advance(m->self, &step, NULL, lam, NULL), PMA_OK);
    }
}

/* Both walk three macro steps, one of them after `given_up` substeps that it never commits. */
static void check_given_up(size_t substeps, bool doubled, size_t given_up)
{
    subdomain x = three_dofs(substeps, doubled), y = three_dofs(substeps, doubled);
    double before[4 * MOST], after[4 * MOST], jump_x[2] = {0.0}, jump_y[2] = {0.0};
    level naive;
    start_three_dofs(&x, &naive);
    start_three_dofs(&y, &naive);
    const pma_member m_x = pma_subdomain_member(x.core), m_y = pma_subdomain_member(y.core);
    for (size_t macro = 0; macro < 3; macro++) {
        const size_t count = copy_present(&x, before);
        const pma_substep last = {.j = given_up, .twice = doubled && macro > 0};
        walk(&m_x, given_up, last.twice);
        CHECK_STATUS(m_x.table->advance(m_x.self, NULL, &last, NULL, NULL), PMA_OK);
        m_x.table->discard(m_x.self);
        CHECK_INT(m_x.table->opened(m_x.self), 0);
        copy_present(&x, after);
        CHECK_BITS(count, after, before);
        walk(&m_x, substeps, last.twice);
        walk(&m_y, substeps, last.twice);
        pma_member_free_velocity(&m_x, 0, 0.5, 1.0, jump_x);
        pma_member_free_velocity(&m_y, 0, 0.5, 1.0, jump_y);
        m_x.table->commit(m_x.self);
        m_y.table->commit(m_y.self);
        copy_present(&x, after);
        copy_present(&y, before);
        CHECK_BITS(count, after, before);
    }
    CHECK_BITS(2, jump_x, jump_y);
    pma_subdomain_destroy(x.core);
    pma_subdomain_destroy(y.core);
}

static void an_unfinished_macro_step_leaves_the_present_untouched(void)
{
    for (size_t substeps = 1; substeps <= 4; substeps++) {
        for (size_t given_up = 0; given_up < substeps; given_up++) {
            check_given_up(substeps, false, given_up);
            check_given_up(substeps, true, given_up);
        }
    }
}

/* Nine free masses, a load at one of them: wherever it acts, a value that is not finite is seen;
 * on the interface, the last three, already before the step is closed. */
static void check_not_finite(size_t dof, double force, double velocity, bool fits)
{
    const double ones[SIZE] = {1, 1, 1, 1, 1, 1, 1, 1, 1}, zeros[SIZE] = {0.0};
    double F[SIZE] = {0.0}, v[SIZE] = {0.0};
    const pma_parts parts = {
        .n = SIZE,
        .nb = 3,
        .substeps = 1,
        .K = {.form = PMA_DIAGONAL, .n = SIZE, .values = ones},
        .C = {.form = PMA_ZERO, .n = SIZE},
        .single = {pma_step_make(CENTRAL_DIFFERENCE, 0.5),
                   {.form = PMA_DIAGONAL, .n = SIZE, .nb = 3, .inverse = ones}},
        .link = {1, 3, (int64_t[]){0, 0, 0, 0}, NULL, NULL, NULL}};
    pma_subdomain *s = NULL;
    CHECK_STATUS(pma_subdomain_create(&parts, &s), PMA_OK);
    F[dof] = force;
    v[dof] = velocity;
    pma_subdomain_start(s, zeros, v, zeros, zeros);
    pma_subdomain_set_load(s, (pma_load){.kind = PMA_LOAD_CONSTANT, .n = SIZE, .values = F});
    const pma_member m = pma_subdomain_member(s);
    const pma_substep step = {.j = 0};
    CHECK_STATUS(m.table->advance(m.self, NULL, &step, NULL, NULL), PMA_OK);
    const double *vf = m.table->values(m.self, PMA_FREE_VELOCITY, 1, false, NULL);
    CHECK_INT(isfinite(vf[0] + vf[1] + vf[2]), fits || dof < SIZE - 3);
    CHECK_STATUS(m.table->advance(m.self, &step, NULL, zeros, NULL),
                 fits ? PMA_OK : PMA_NOT_FINITE);
    pma_subdomain_destroy(s);
}

static void a_value_that_is_not_finite_is_seen_at_every_dof(void)
{
    for (size_t dof = 0; dof < SIZE; dof++) {
        check_not_finite(dof, INFINITY, 0.0, false);
        check_not_finite(dof, -INFINITY, 0.0, false);
        check_not_finite(dof, NAN, 0.0, false);
        check_not_finite(dof, 1e300, 0.0, true);
        /* h = 1/2: u1 = h v and w1 = F - u1 fit, v1 = v + h/2 w1 is 9/8 of the largest number */
        check_not_finite(dof, DBL_MAX, DBL_MAX, false);
    }
}

const test SUBDOMAIN_TESTS[] = {
    TEST(a_subdomain_with_sizes_that_do_not_agree_is_refused),
    TEST(a_subdomain_with_a_bad_index_is_refused),
    TEST(a_double_step_of_another_length_than_two_steps_is_refused),
    TEST(a_double_step_that_continues_is_longer_than_a_step),
    TEST(a_subdomain_beyond_all_memory_is_refused),
    TEST(a_substep_reads_at_least_what_its_sweeps_and_products_read),
    TEST(a_free_oscillator_under_the_trapezoidal_rule_turns_by_its_closed_form),
    TEST(a_free_oscillator_under_the_central_difference_turns_by_its_closed_form),
    TEST(the_explicit_scheme_has_three_equal_roots_at_its_bifurcation),
    TEST(single_steps_are_those_of_a_program_that_keeps_all_levels),
    TEST(double_steps_are_those_of_a_program_that_keeps_all_levels),
    TEST(the_compliance_is_the_dense_product),
    TEST(velocities_and_displacements_on_the_interface_are_added_to_the_jump),
    TEST(an_unfinished_macro_step_leaves_the_present_untouched),
    TEST(a_value_that_is_not_finite_is_seen_at_every_dof),
    END_OF_TESTS,
};
