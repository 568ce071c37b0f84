/* test_method.c - what the coupled method has to come out with: closed forms and orders. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#include "check.h"
#include "couple/coupler.h"
#include "forces/load.h"
#include "models.h"
#include "naive.h"
#include "subdomain/scheme.h"
#include "subdomain/subdomain.h"
#include "tests.h"

/* Both sides under one and the same rule have the same predictors, so the tie never has to correct
 * them: the cut oscillator is the whole one, of frequency tan(q/2) = omega h/2 and constant energy.
 * Rounding: as for the free oscillator, and a division by h = 0.1. */
static void two_trapezoidal_halves_under_gc_are_the_whole_oscillator(void)
{
    static model m;
    make_oscillator(
        &m, (split){.dt = 0.1, .substeps = 1, .same = true, .A = TRAPEZOIDAL, .B = TRAPEZOIDAL});
    const double q = 2.0 * atan(OMEGA * 0.1 / 2.0), tolerance = 10.0 * SWING_TOLERANCE;
    for (size_t n = 0; n <= SWINGS; n++) {
        const pma_state *A = pma_subdomain_present(m.subdomains[0].core);
        const pma_state *B = pma_subdomain_present(m.subdomains[1].core);
        CHECK_NEAR(A->u[0], cos((double)n * q), tolerance);
        CHECK_NEAR(B->u[0], cos((double)n * q), tolerance);
        CHECK_NEAR(A->v[0], -OMEGA * sin((double)n * q), OMEGA * tolerance);
        CHECK_NEAR(A->v[0], B->v[0], 16.0 * EPS * OMEGA);
        const double energy = 0.5 * M_A * A->v[0] * A->v[0] + 0.5 * M_B * B->v[0] * B->v[0] +
                              0.5 * K_A * A->u[0] * A->u[0] + 0.5 * K_B * B->u[0] * B->u[0];
        CHECK_NEAR(energy, 20.0, 20.0 * tolerance);
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
    }
    destroy_model(&m);
}

/* A trapezoidal, B by the central difference, h = dt: with equal v both have equal w, and the two
 * updates of u leave u_A = u_B + h^2/4 (w_n - w_0). In (1) that is a central difference alone,
 * with the mass m = m_A + m_B + k_A h^2/4 and the constant load k_A h^2/4 w_0:
 * u_B = c + (u_0 - c) cos(n q), cos q = 1 - h^2 k/(2 m), c = k_A h^2/4 w_0/k, u_0 = 1 */
static void trapezoidal_and_central_difference_under_gc_have_a_closed_form(void)
{
    static model m;
    const double h = 0.1, k = K_A + K_B, mass = M_A + M_B + K_A * h * h / 4.0;
    const double w0 = -OMEGA * OMEGA, c = K_A * h * h / 4.0 * w0 / k;
    const double q = acos(1.0 - h * h * k / (2.0 * mass)), tolerance = 10.0 * SWING_TOLERANCE;
    make_oscillator(&m, (split){.dt = h, .substeps = 1, .A = TRAPEZOIDAL, .B = CENTRAL_DIFFERENCE});
    for (size_t n = 0; n <= SWINGS; n++) {
        const pma_state *A = pma_subdomain_present(m.subdomains[0].core);
        const pma_state *B = pma_subdomain_present(m.subdomains[1].core);
        const double cosine = (1.0 - c) * cos((double)n * q), w = -k / mass * cosine;
        CHECK_NEAR(B->u[0], c + cosine, tolerance);
        CHECK_NEAR(A->u[0] - B->u[0], h * h / 4.0 * (w - w0), tolerance);
        CHECK_NEAR(B->v[0], -(1.0 - c) * sin((double)n * q) * sin(q) / h, OMEGA * tolerance);
        CHECK_NEAR(A->v[0], B->v[0], 16.0 * EPS * OMEGA);
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
    }
    destroy_model(&m);
}

/* The same pair under PM, A from n - 1 to n + 1. With v_n = V e^{iqn} the updates give
 *   w_A = i tan(q)/h V,  u_A = h cos(q)/(i sin q) V,  w_B = 2i tan(q/2)/h V,  u_B = h/(i sin q) V
 * and (1), summed over the subdomains, with c = cos q:
 *   (m_A + 2 m_B + h^2 k_A) c^2 - (2 m_B - h^2 k_B) c - m_A = 0
 * Both roots lie in [-1, 1], near 1 the oscillator, the other the two chains of A. The remaining
 * eigenvalues, 1 and -1, have no part in v. So (E^2 - 2 c_1 E + 1)(E^2 - 2 c_2 E + 1) v = 0. */
static void trapezoidal_and_central_difference_under_pm_have_a_closed_form(void)
{
    static model m;
    const double h = 0.1, lead = M_A + 2.0 * M_B + h * h * K_A;
    const double sum = (2.0 * M_B - h * h * K_B) / lead, product = -M_A / lead;
    double v[SWINGS + 1], most = 0.0;
    make_oscillator(
        &m,
        (split){
            .dt = h, .substeps = 1, .doubled = true, .A = TRAPEZOIDAL, .B = CENTRAL_DIFFERENCE});
    for (size_t n = 0; n <= SWINGS; n++) {
        v[n] = pma_subdomain_present(m.subdomains[1].core)->v[0];
        most = fmax(most, fabs(v[n]));
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
    }
    for (size_t n = 1; n + 4 <= SWINGS; n++) {
        /* five steps of some twenty roundings, of terms up to 4 omega */
        CHECK_NEAR(v[n] - 2.0 * sum * v[n + 1] + (2.0 + 4.0 * product) * v[n + 2] -
                       2.0 * sum * v[n + 3] + v[n + 4],
                   0.0, 400.0 * EPS * OMEGA);
    }
    CHECK_NEAR(most, OMEGA, 0.1 * OMEGA); /* it swings, and nothing grows */
    destroy_model(&m);
}

/* The largest error of the velocity of B at macro time levels over one period, over omega u0. */
static double velocity_error(split s, size_t steps)
{
    static model m;
    double worst = 0.0;
    s.dt = 2.0 * PI / OMEGA / (double)steps;
    make_oscillator(&m, s);
    for (size_t n = 1; n <= steps; n++) {
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
        const double v = pma_subdomain_present(m.subdomains[1].core)->v[0] / OMEGA;
        worst = fmax(worst, fabs(v + sin(2.0 * PI * (double)n / (double)steps)));
    }
    destroy_model(&m);
    return worst;
}

/* Halving dt divides the error by 2^order, up to a relative O(omega dt), here 0.016. */
static void check_order(size_t substeps, bool doubled, pma_scheme A, pma_scheme B, double order)
{
    const split s = {.substeps = substeps, .doubled = doubled, .A = A, .B = B};
    const double factor = velocity_error(s, 400) / velocity_error(s, 800);
    CHECK_NEAR(factor, exp2(order), 0.02 * exp2(order));
}

static void the_order_is_two_without_subcycling_and_one_with_it(void)
{
    const pma_scheme half = generalized_alpha(0.5);
    for (int pm = 0; pm <= 1; pm++) {
        check_order(1, pm, TRAPEZOIDAL, CENTRAL_DIFFERENCE, 2.0);
        check_order(1, pm, half, half, 2.0);
        check_order(4, pm, TRAPEZOIDAL, CENTRAL_DIFFERENCE, 1.0);
        check_order(4, pm, half, half, 1.0);
    }
}

/* The error of Lam(t) = (k_A - m_A omega^2) cos(omega t) after two macro steps, over its size. */
static double multiplier_error(double dt, bool rebased)
{
    static model m;
    make_oscillator(&m, (split){.dt = dt,
                                .substeps = 4,
                                .doubled = true,
                                .A = generalized_alpha(0.5),
                                .B = generalized_alpha(0.5)});
    pma_coupler_parts parts = describe_coupler(&m);
    parts.rebased = rebased;
    pma_coupler_destroy(m.coupler);
    CHECK_STATUS(pma_coupler_create(&parts, &m.coupler), PMA_OK);
    start_model(&m);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 2, NULL, NULL), PMA_OK);
    const double exact = (K_A - M_A * OMEGA * OMEGA) * cos(2.0 * OMEGA * dt);
    const double error = fabs(pma_coupler_multipliers(m.coupler)[0] / exact - 1.0);
    destroy_model(&m);
    return error;
}

/* (S3): without it the misfit of vf, O(h), is divided by h in (18) and never shrinks. */
static void a_rebased_start_converges_and_a_plain_one_does_not(void)
{
    const double dt = 1e-3, factor = 8.0;
    const double rebased = multiplier_error(factor * dt, true) / multiplier_error(dt, true);
    const double plain = multiplier_error(factor * dt, false) / multiplier_error(dt, false);
    CHECK(rebased > 0.9 * factor);                      /* O(dt) at least */
    CHECK_NEAR(plain, 1.0, 10.0 * factor * OMEGA * dt); /* O(1), up to O(omega dt) */
    CHECK(multiplier_error(dt, false) > 0.01);
}

/* Undamped oscillation is the worst case for rho = 0.5: nothing may grow, and since the step is
 * long for A (omega dt = 1), the dissipation of the scheme must show. */
static void pm_alpha_dissipates_in_the_long_run(void)
{
    static model m;
    double early = 0.0, late = 0.0;
    make_oscillator(&m, (split){.dt = 1.0 / OMEGA,
                                .substeps = 5,
                                .doubled = true,
                                .A = generalized_alpha(0.5),
                                .B = generalized_alpha(0.5)});
    for (size_t n = 0; n < 2000; n++) {
        const double v = fabs(pma_subdomain_present(m.subdomains[1].core)->v[0]);
        early = n < 20 ? fmax(early, v) : early;
        late = n >= 1980 ? fmax(late, v) : late;
        CHECK(v < 2.0 * OMEGA);
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
    }
    CHECK(late < 1e-3 * early);
    destroy_model(&m);
}

/* One mass whose velocity is prescribed, v = t: u = t^2/2 and Lam = m + k t^2/2, exact for the
 * trapezoidal rule, to which the acceleration is a constant. After t = 1 another motion, v = 1/2:
 * the rule takes v from 1 to 1/2 in one step h = 0.1 by w = -1 - 1/h = -11, after that w = +-11. */
static void a_prescribed_velocity_is_followed(void)
{
    static model m;
    const double ramp[2] = {0.0, 1.0}, half = 0.5, zero = 0.0, w0 = 1.0, lam0 = 2.0;
    m = (model){.count = 1, .p = 1, .dt = 0.1, .motion_count = 1};
    m.motion = (pma_motion){
        &m.moved_row,
        {.kind = PMA_LOAD_SAMPLED, .n = 1, .values = ramp, .samples = 2, .k = 1, .dt = 1.0}};
    m.subdomains[0] = one_mass(2.0, 3.0, 1.0, TRAPEZOIDAL, true);
    make_model(&m);
    pma_subdomain_start(m.subdomains[0].core, &zero, &zero, &w0, &lam0);
    pma_coupler_start(m.coupler, 0, &lam0, &zero);
    for (int n = 1; n <= 20; n++) {
        if (n == 11)
            pma_coupler_set_motion(m.coupler, 0,
                                   (pma_load){.kind = PMA_LOAD_CONSTANT, .n = 1, .values = &half});
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
        const double t = 0.1 * n, u = n <= 10 ? t * t / 2.0 : t / 2.0 + 0.025;
        const double w = n <= 10 ? 1.0 : n % 2 ? -11.0 : 11.0;
        const pma_state *x = pma_subdomain_present(m.subdomains[0].core);
        /* 20 steps of a few roundings each; in w and Lam times 2/h = 20 and all alternating */
        CHECK_NEAR(x->v[0], n <= 10 ? t : half, 16.0 * EPS);
        CHECK_NEAR(x->u[0], u, 100.0 * EPS);
        CHECK_NEAR(x->w[0], w, 5000.0 * EPS);
        CHECK_NEAR(pma_coupler_multipliers(m.coupler)[0], 2.0 * w + 3.0 * u, 10000.0 * EPS);
    }
    destroy_model(&m);
}

/* Also in mid-step of the others. A jump is a difference of velocities, each of a few roundings of
 * terms up to 4, and so is what Lam leaves of it. */
static void check_jump(plan chosen)
{
    static model m;
    static tape t;
    make_chain(&m, chosen, 1.0);
    make_tape(&t, &m, 0, 0);
    run_taped(&m, &t, STEPS);
    double most = 0.0, drift = 0.0;
    for (size_t i = 0; i < (STEPS * m.fine + 1) * m.p; i++) {
        CHECK_NEAR(t.velocity[i], 0.0, 64.0 * EPS);
        most = fmax(most, fabs(t.lam[i]));
    }
    for (size_t i = 0; i < (STEPS + 1) * m.p; i++)
        drift = fmax(drift, fabs(t.displacement[i]));
    CHECK(most > 1.0 && drift > 1e-6); /* there was something to hold together */
    destroy_model(&m);
}

static void velocities_of_both_sides_agree_at_every_fine_step(void)
{
    check_jump((plan){{1, 6, 2}, false, false, true, false, false});
    check_jump((plan){{6, 3, 1}, false, false, true, false, false});
    check_jump((plan){{1, 4, 2}, true, false, true, false, false});
    check_jump((plan){{2, 6, 3}, true, true, false, false, false});
    check_jump(MIXED);
}

const test METHOD_TESTS[] = {
    TEST(two_trapezoidal_halves_under_gc_are_the_whole_oscillator),
    TEST(trapezoidal_and_central_difference_under_gc_have_a_closed_form),
    TEST(trapezoidal_and_central_difference_under_pm_have_a_closed_form),
    TEST(the_order_is_two_without_subcycling_and_one_with_it),
    TEST(a_rebased_start_converges_and_a_plain_one_does_not),
    TEST(pm_alpha_dissipates_in_the_long_run),
    TEST(a_prescribed_velocity_is_followed),
    TEST(velocities_of_both_sides_agree_at_every_fine_step),
    END_OF_TESTS,
};
