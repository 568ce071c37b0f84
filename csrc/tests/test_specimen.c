/* test_specimen.c - actuators and compensators before a specimen, against closed forms. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "check.h"
#include "rig/actuator.h"
#include "rig/adaptive.h"
#include "rig/inverse.h"
#include "rig/linkage.h"
#include "rig/specimen.h"
#include "tests.h"

enum { MEMORY = 4096 };

/* r = 3 x, in a call that counts */
static int spring(double t, intptr_t n, double *u, double *v, double *r, void *user)
{
    (void)t, (void)v;
    ++*(size_t *)user;
    for (intptr_t i = 0; i < n; i++)
        r[i] = 3.0 * u[i];
    return 0;
}

typedef struct {
    size_t calls;
    double work[5], memory[MEMORY];
    pma_specimen s;
} rig;

/* One dof behind `count` filters, which remember nothing yet. */
static void set_up(rig *x, size_t count, const pma_filter *filters)
{
    *x = (rig){0};
    x->s = (pma_specimen){.n = 1,
                          .width = 1,
                          .count = count,
                          .filters = filters,
                          .function = spring,
                          .user = &x->calls,
                          .work = x->work};
    CHECK(pma_specimen_numbers(&x->s) <= MEMORY);
}

/* The displacement measured under the command u at velocity v, of which r = 3 x. */
static double follow(rig *x, double u, double v)
{
    double r = 0.0;
    const pma_wanted wanted = {.u = &u, .v = &v};
    CHECK_INT(pma_specimen_evaluate(&x->s, 0.0, &wanted, &r, x->memory), 0);
    const pma_trace trace = pma_specimen_trace(&x->s);
    CHECK(x->memory[trace.command] == u && x->memory[trace.force] == r);
    CHECK(r == 3.0 * x->memory[trace.measured]);
    return x->memory[trace.measured];
}

static const int64_t TWO_STEPS = 2;
static const double ONE = 1.0, NO_SLOPE = 0.0;

/* Follows two steps late, and nothing else. */
static pma_actuator late(void)
{
    return (pma_actuator){.delay = {.taps = 1, .length = 3, .lag = &TWO_STEPS, .weight = &ONE},
                          .largest = INFINITY,
                          .slope = &NO_SLOPE};
}

static double command(size_t k)
{
    return cos(0.3 * (double)k) + 0.1 * (double)k;
}

static void an_actuator_follows_late_and_was_at_rest_before(void)
{
    const pma_actuator actuator = late();
    const pma_filter filter = {&pma_actuator_kind, &actuator};
    rig x;
    set_up(&x, 1, &filter);
    for (size_t k = 0; k < 10; k++)
        CHECK(follow(&x, command(k), 0.0) == command(k < 2 ? 0 : k - 2));
    CHECK_INT(x.calls, 10);
}

static void a_command_is_held_within_the_saturation_and_rounded_to_the_quantum(void)
{
    pma_actuator actuator = late();
    const pma_filter filter = {&pma_actuator_kind, &actuator};
    rig x;
    actuator.largest = 0.7;
    actuator.quantum = 0.25;
    set_up(&x, 1, &filter);
    const double commands[5] = {0.3, -2.0, 0.6, 0.0, 0.0},
                 expected[5] = {0.25, 0.25, 0.25, -0.75, 0.5};
    for (size_t k = 0; k < 5; k++)
        CHECK(follow(&x, commands[k], 0.0) == expected[k]);
}

/* x' = w (c - x) with commands that are linear in a step: on the ramp c = t from rest
 * x = t - (1 - exp(- w t)) / w. */
static void a_lag_of_the_first_order_is_exact_on_a_ramp(void)
{
    const double w = 3.0, h = 0.1, e = exp(-w * h), slope[2] = {-w, w};
    const double after = 1.0 - (1.0 - e) / (w * h), before = 1.0 - e - after;
    const int64_t now = 0;
    const pma_actuator actuator = {.delay = {.taps = 1, .length = 1, .lag = &now, .weight = &ONE},
                                   .largest = INFINITY,
                                   .order = 1,
                                   .phi = &e,
                                   .before = &before,
                                   .after = &after,
                                   .slope = slope};
    const pma_filter filter = {&pma_actuator_kind, &actuator};
    rig x;
    set_up(&x, 1, &filter);
    for (size_t k = 0; k < 20; k++) {
        const double t = h * (double)k;
        CHECK_NEAR(follow(&x, t, 1.0), t - (1.0 - exp(-w * t)) / w, 1e-14); /* rounding */
    }
}

/* A parabola goes through three commands, two steps apart. */
static void the_extrapolation_of_a_parabola_is_two_steps_ahead(void)
{
    const int64_t lags[3] = {0, 2, 4};
    const double weights[3] = {3.0, -3.0, 1.0};
    const pma_actuator actuators[2] = {
        {.delay = {.taps = 3, .length = 5, .lag = lags, .weight = weights},
         .largest = INFINITY,
         .slope = &NO_SLOPE},
        late()};
    const pma_filter filters[2] = {{&pma_actuator_kind, &actuators[0]},
                                   {&pma_actuator_kind, &actuators[1]}};
    rig x;
    set_up(&x, 2, filters);
    x.s.compensators = 1;
    for (size_t k = 0; k < 12; k++) {
        const double u = 2.0 - (double)k + 0.5 * (double)(k * k), reached = follow(&x, u, 0.0);
        CHECK(k < 6 || reached == u);
    }
}

/* Behind a delay of two steps the coefficients become those of a motion that far ahead: a sine
 * knows (a0, a2) as a0 - w^2 a2 only, and a1. */
static void an_adaptive_compensation_finds_the_delay(void)
{
    const double h = 0.01, w = 6.0, tau = 2.0 * h;
    const double through[5] = {1.0, 0.0, 0.0, 0.0, 0.0}; /* a low-pass filter that lets all pass */
    const pma_adaptive adaptive = {.h = h,
                                   .start = {1.0, 0.0, 0.0},
                                   .least = {0.5, 0.0, 0.0},
                                   .most = {1.5, 0.1, 0.01},
                                   .change = {1.0, 1.0, 1.0},
                                   .threshold = 0.05,
                                   .every = 2,
                                   .window = 64,
                                   .sections = 1,
                                   .section = through};
    const pma_actuator actuator = late();
    const pma_filter filters[2] = {{&pma_adaptive_kind, &adaptive},
                                   {&pma_actuator_kind, &actuator}};
    rig x;
    double error = 0.0;
    set_up(&x, 2, filters);
    x.s.compensators = 1;
    for (size_t k = 0; k < 1000; k++) {
        const double t = h * (double)k;
        const double reached = follow(&x, sin(w * t), w * cos(w * t));
        if (k >= 900)
            error = fmax(error, fabs(reached - sin(w * t)));
    }
    const double *a = x.memory + 2; /* after the displacement and the number of evaluations */
    /* a0 and a2 take what the backward differences are late: (w h)^2 of a1, and less */
    CHECK_NEAR(a[1], sin(w * tau) / w, 0.0036 * tau);
    /* without compensation w tau = 0.12; each window of 1.28 s that has passed leaves a tenth */
    CHECK(error < 1e-3);
}

typedef struct {
    double largest, seen;
} gate;

static bool allows(void *self, size_t i, const int64_t *dofs, size_t width, const double *u,
                   const double *v)
{
    gate *g = self;
    (void)v;
    CHECK_INT(i, 7);
    CHECK(!dofs && width == 1);
    g->seen = u[0];
    return fabs(u[0]) <= g->largest;
}

static void a_command_that_is_refused_after_the_compensator_does_not_reach_the_specimen(void)
{
    const int64_t lags[2] = {0, 1};
    const double weights[2] = {2.0, -1.0};
    const pma_actuator actuator = {
        .delay = {.taps = 2, .length = 2, .lag = lags, .weight = weights},
        .largest = INFINITY,
        .slope = &NO_SLOPE};
    const pma_filter filter = {&pma_actuator_kind, &actuator};
    gate g = {.largest = 1.0};
    pma_cell cell = {.allows = allows, .self = &g};
    rig x;
    set_up(&x, 1, &filter);
    x.s.compensators = 1;
    x.s.cell = &cell;
    x.s.number = 7;
    CHECK(follow(&x, 0.5, 0.0) == 0.5);
    const double u = 0.8;
    const pma_wanted wanted = {.u = &u};
    double r = 0.0;
    CHECK(pma_specimen_evaluate(&x.s, 0.0, &wanted, &r, x.memory) != 0);
    CHECK(g.seen == 2.0 * 0.8 - 0.5);
    CHECK(cell.refused && x.calls == 1 && r == 0.0);
}

/* Limits are of dofs: what a compensator behind J = 2 sends is allowed as J^-1 of it. */
static void a_command_behind_a_linkage_is_refused_as_that_of_the_dofs(void)
{
    const int64_t lags[2] = {0, 1};
    const double weights[2] = {2.0, -1.0}, J = 2.0, inverse = 0.5;
    double scratch;
    const pma_linkage linkage = {.matrix = &J, .inverse = &inverse, .work = &scratch};
    const pma_actuator extrapolation = {
        .delay = {.taps = 2, .length = 2, .lag = lags, .weight = weights},
        .largest = INFINITY,
        .slope = &NO_SLOPE};
    const pma_filter filters[2] = {{&pma_linkage_kind, &linkage},
                                   {&pma_actuator_kind, &extrapolation}};
    gate g = {.largest = 1.0};
    pma_cell cell = {.allows = allows, .self = &g};
    rig x;
    set_up(&x, 2, filters);
    x.s.compensators = 2;
    x.s.cell = &cell;
    x.s.number = 7;
    const double first = 0.5, second = 0.8;
    double r = 0.0;
    pma_wanted wanted = {.u = &first};
    CHECK_INT(pma_specimen_evaluate(&x.s, 0.0, &wanted, &r, x.memory), 0);
    CHECK(g.seen == first && r == J * 3.0 * J * first);
    wanted.u = &second;
    CHECK(pma_specimen_evaluate(&x.s, 0.0, &wanted, &r, x.memory) != 0);
    CHECK_NEAR(g.seen, 2.0 * second - first, 1e-15);
    CHECK(cell.refused && x.calls == 1);
}

/* ---- linear systems ------------------------------------------------------------------------- */

/* x' = w (c - x) of the dof 2 of three, and r = 5 x there. */
static void a_linear_system_is_commanded_at_its_dofs_and_has_its_forces_there(void)
{
    const double w = 3.0, h = 0.1, e = exp(-w * h), five = 5.0;
    const double after = 1.0 - (1.0 - e) / (w * h), before = 1.0 - e - after;
    const int64_t now = 0, dof = 2;
    double work[5], memory[32] = {0.0};
    const pma_linear linear = {.inputs = 1,
                               .states = 1,
                               .phi = &e,
                               .before = &before,
                               .after = &after,
                               .rest = &ONE,
                               .displacement = &ONE,
                               .force = &five,
                               .delay = {.taps = 1, .length = 1, .lag = &now, .weight = &ONE},
                               .largest = INFINITY,
                               .work = work + 4};
    const pma_specimen s = {.n = 3, .width = 1, .dofs = &dof, .linear = &linear, .work = work};
    CHECK(pma_specimen_numbers(&s) <= 32);
    for (size_t k = 0; k < 20; k++) {
        const double t = h * (double)k, u[3] = {7.0, 8.0, 0.5 + t};
        double r[3] = {1.0, 2.0, 3.0};
        CHECK_INT(pma_specimen_evaluate(&s, t, &(pma_wanted){.u = u}, r, memory), 0);
        const double x = 0.5 + t - (1.0 - exp(-w * t)) / w;
        CHECK(r[0] == 1.0 && r[1] == 2.0);
        CHECK_NEAR(r[2], 3.0 + 5.0 * x, 1e-13); /* rounding */
        CHECK_NEAR(memory[pma_specimen_trace(&s).measured], x, 1e-14);
    }
}

/* Without states: c = (d + 2 d' + 3 d'') (1 + delta), and what it moves has half the stroke, so
 * that the least squares of  c = (1 + delta) x  end at delta = 1. */
static void an_inverse_takes_rates_of_its_command_and_learns_what_it_lacks(void)
{
    const double two[2] = {1.0, 1.0}, half = 0.5, one = 1.0;
    double work[5];
    const pma_modal both = {.inputs = 1, .outputs = 2, .D = two};
    const pma_modal low = {.inputs = 1, .outputs = 1, .D = &one};
    const pma_inverse inverse = {.h = 0.1,
                                 .rate = 2.0,
                                 .acceleration = 3.0,
                                 .command = both,
                                 .variations = 1,
                                 .regressors = both,
                                 .low = low,
                                 .variance = 1e-12,
                                 .largest = 3.0,
                                 .work = work};
    const pma_filter filter = {&pma_inverse_kind, &inverse};
    double memory[16] = {0.0}, u, v, a, f = 0.0;
    CHECK(filter.kind->numbers(filter.of, 1) <= 16);
    const pma_command command = {&u, &v, &a};
    for (size_t k = 0; k < 6; k++) {
        u = (double)k, v = 1.0, a = -0.25;
        const double sum = u + (k > 0 ? 2.0 * v + 3.0 * a : 0.0);
        filter.kind->send(filter.of, 1, (double)k, &command, memory);
        /* k = 0: at rest, k = 1: what is learned comes after the first motion */
        CHECK_NEAR(u, k < 2 ? sum : 2.0 * sum, 1e-9);
        double x = half * u;
        filter.kind->receive(filter.of, 1, (double)k, &x, &f, memory);
    }
}

/* Two arms at + and - alpha: theta = asin((x1 - x2) / (2 l sin alpha)), and the work of the forces
 * is that of the moment and the force. */
static void arms_turn_and_their_forces_do_the_same_work(void)
{
    const double l = 0.3, alpha = 0.45, x = 0.02, theta = -0.03, step = 1e-6;
    const pma_linkage linkage = {.has_arms = true, .length = {l, l}, .angle = {alpha, -alpha}};
    const pma_filter filter = {&pma_linkage_kind, &linkage};
    double at[2][2], f[2] = {5.0, -7.0};
    for (size_t i = 0; i < 2; i++) {
        double u[2] = {x, theta + (double)i * step}, v[2] = {0.0}, a[2] = {0.0};
        const pma_command command = {u, v, a};
        filter.kind->send(filter.of, 2, 1.0, &command, NULL);
        at[i][0] = u[0], at[i][1] = u[1];
    }
    CHECK_NEAR(at[0][0], x + l * (cos(theta - alpha) - cos(alpha)), 1e-15);
    CHECK_NEAR(asin((at[0][0] - at[0][1]) / (2.0 * l * sin(alpha))), theta, 1e-14);
    const double work = 5.0 * (at[1][0] - at[0][0]) - 7.0 * (at[1][1] - at[0][1]);
    filter.kind->receive(filter.of, 2, 1.0, at[0], f, NULL);
    CHECK_NEAR(at[0][0], x, 1e-14);
    CHECK_NEAR(at[0][1], theta, 1e-14);
    CHECK_NEAR(f[0], -2.0, 1e-15);
    CHECK_NEAR(f[1], work / step, 1e-5); /* the difference: step times the curvature */
}

const test SPECIMEN_TESTS[] = {
    TEST(an_actuator_follows_late_and_was_at_rest_before),
    TEST(a_command_is_held_within_the_saturation_and_rounded_to_the_quantum),
    TEST(a_lag_of_the_first_order_is_exact_on_a_ramp),
    TEST(the_extrapolation_of_a_parabola_is_two_steps_ahead),
    TEST(an_adaptive_compensation_finds_the_delay),
    TEST(a_command_that_is_refused_after_the_compensator_does_not_reach_the_specimen),
    TEST(a_command_behind_a_linkage_is_refused_as_that_of_the_dofs),
    TEST(a_linear_system_is_commanded_at_its_dofs_and_has_its_forces_there),
    TEST(an_inverse_takes_rates_of_its_command_and_learns_what_it_lacks),
    TEST(arms_turn_and_their_forces_do_the_same_work),
    END_OF_TESTS,
};
