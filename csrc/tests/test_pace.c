/* test_pace.c - fine steps at times of a clock, which is a count here; limits of a specimen. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "check.h"
#include "coupling/coupler.h"
#include "coupling/pace.h"
#include "member/limits.h"
#include "models.h"
#include "tests.h"
#include "workers/thread.h"

static const plan RESTORED = {{2, 6, 3}, true, true, true, true, true};

enum { ROWS = STEPS * FINE };

/* A clock that goes on by `tick` ns when it is read, and sleeps as it is told. */
typedef struct {
    int64_t t, tick, longest;
    size_t slept;
} counted;

static int64_t read_counted(void *ctx)
{
    counted *c = ctx;
    c->t += c->tick;
    return c->t;
}

static void sleep_counted(void *ctx, int64_t until)
{
    counted *c = ctx;
    if (until - c->t > c->longest)
        c->longest = until - c->t;
    c->t = until;
    c->slept++;
}

static double rows[4][ROWS];

static pma_pace make_pace(counted *c, double period, bool stops)
{
    return (pma_pace){.clock = {read_counted, sleep_counted, c},
                      .period = period,
                      .stops = stops,
                      .rows = ROWS,
                      .begun = rows[0],
                      .commanded = rows[1],
                      .returned = rows[2],
                      .ended = rows[3]};
}

static void paced_steps_begin_when_they_are_due_and_are_those_of_any_run(void)
{
    static model m, unpaced;
    counted c = {.t = 7000, .tick = 1};
    pma_stamp stamp = {.now = read_counted, .ctx = &c};
    pma_pace pace = make_pace(&c, 1e6, true);
    pace.stamps = &stamp;
    pace.stamp_count = 1;
    make_chain(&unpaced, RESTORED, 1.0);
    CHECK_STATUS(pma_coupler_advance(unpaced.coupler, STEPS, NULL, NULL), PMA_OK);
    const snapshot expected = present(&unpaced);
    make_chain(&m, RESTORED, 1.0);
    pma_subdomain_time(m.subdomains[1].core,
                       &stamp); /* with as many substeps as there are fine steps */
    pma_coupler_set_pace(m.coupler, &pace);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    check_same_present(&m, &expected);
    CHECK_INT(pace.done, ROWS);
    CHECK_INT(c.slept, ROWS - 1); /* the first one is due at once */
    for (size_t k = 0; k < ROWS; k++) {
        const double due = 1e-3 * (double)k;
        /* the clock was read at most five times since */
        CHECK(rows[0][k] >= due && rows[0][k] <= due + 5e-9);
        CHECK(rows[1][k] > rows[0][k] && rows[2][k] > rows[1][k] && rows[3][k] > rows[2][k]);
    }
    destroy_model(&m);
    destroy_model(&unpaced);
}

/* Every reading takes longer than a period. */
static void a_step_that_ends_late_ends_a_run_that_stops_and_no_other(void)
{
    static model m;
    counted c = {.tick = 500000};
    pma_pace pace = make_pace(&c, 1e6, true);
    make_chain(&m, RESTORED, 1.0);
    const snapshot before = present(&m);
    pma_coupler_set_pace(m.coupler, &pace);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_LATE);
    CHECK(pace.done > 0 && pace.done <= FINE);
    CHECK(rows[3][pace.done - 1] > 1e-3 * (double)pace.done);
    CHECK(isnan(rows[1][0])); /* no member has a stamp */
    check_same_present(&m, &before);

    pma_pace patient = make_pace(&c, 1e6, false);
    pma_coupler_set_pace(m.coupler, &patient);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    CHECK_INT(patient.done, ROWS);
    CHECK_INT(c.slept, 0);
    destroy_model(&m);
}

static void a_long_wait_is_interrupted_to_poll(void)
{
    static model m;
    counted c = {.tick = 1};
    stopper a = {0, 4};
    const pma_poll poll = {poll_stopper, &a, SIZE_MAX};
    pma_pace pace = make_pace(&c, 1e12, false); /* a thousand seconds */
    make_chain(&m, RESTORED, 1.0);
    const snapshot before = present(&m);
    pma_coupler_set_pace(m.coupler, &pace);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, &poll), PMA_STOPPED);
    CHECK_INT(pace.done, 1);
    CHECK(c.slept >= 2 && c.longest <= 50000001);
    check_same_present(&m, &before);
    destroy_model(&m);
}

static void the_clock_of_the_system_goes_on_while_it_sleeps(void)
{
    const int64_t until = pma_timer_now() + 1000000;
    while (pma_timer_now() < until)
        pma_timer_sleep(until);
    CHECK(pma_timer_now() >= until);
}

/* ---- limits --------------------------------------------------------------------------------- */

/* Commands u of one dof in turn, from u0 = 0 at rest, with h = 1/2. The number that were within. */
static size_t count_within(pma_limits_parts parts, size_t count, const double *u, pma_breach *at)
{
    const double zero = 0.0;
    pma_limits *l;
    size_t within = 0;
    parts.n = 1;
    parts.h = 0.5;
    CHECK_STATUS(pma_limits_create(&parts, &l), PMA_OK);
    while (within < count &&
           pma_limits_command(l, (int64_t)within, within % 3 == 0, 0.5 * (double)(within + 1),
                              &zero, &zero, &u[within], NULL)) {
        *pma_limits_force(l) = 2.0 * u[within];
        if (!pma_limits_measure(l))
            break;
        within++;
    }
    *at = *pma_limits_breach(l);
    pma_limits_destroy(l);
    return within;
}

static void a_command_is_judged_by_its_differences_and_a_force_by_its_size(void)
{
    const double limit = 4.0, any = INFINITY, u[6] = {1.0, 2.0, 3.0, 5.0, 7.5, NAN};
    pma_breach at;
    /* rates 2 2 2 4 5, accelerations 4 0 0 4 2, forces 2 4 6 10 15 */
    CHECK_INT(count_within((pma_limits_parts){.displacement = &limit, .energy = any}, 6, u, &at),
              3);
    CHECK(at.what == PMA_OF_DISPLACEMENT && at.value == 5.0 && at.limit == 4.0 && at.t == 2.0);
    CHECK_INT(count_within((pma_limits_parts){.velocity = &limit, .energy = any}, 6, u, &at), 4);
    CHECK(at.what == PMA_OF_VELOCITY && at.value == 5.0 && at.t == 2.5);
    CHECK_INT(count_within((pma_limits_parts){.acceleration = &limit, .energy = any}, 6, u, &at),
              5);
    CHECK(at.what == PMA_OF_ACCELERATION && isnan(at.value) && at.t == 3.0);
    CHECK_INT(count_within((pma_limits_parts){.force = &limit, .energy = any}, 6, u, &at), 2);
    CHECK(at.what == PMA_OF_FORCE && at.value == 6.0 && at.t == 1.5);
}

/* A spring of stiffness 2 that is let go returns what it was given after its first command, at
 * u = 1: (2 + 2 u) (u - 1) / 2 at the command u. */
static void energy_is_that_returned_beyond_what_was_given(void)
{
    const double u[4] = {1.0, 2.0, 1.0, 0.5};
    pma_breach at;
    CHECK_INT(count_within((pma_limits_parts){.energy = 0.8}, 4, u, &at), 4);
    CHECK_INT(count_within((pma_limits_parts){.energy = 0.7}, 4, u, &at), 3);
    CHECK(at.what == PMA_OF_ENERGY && at.t == 2.0);
    CHECK_NEAR(at.value, 0.75, 1e-15); /* exact but for rounding */
}

/* A macro step of three commands is taken again: rates are those to the command before it. */
static void a_macro_step_that_is_taken_again_has_the_commands_before_it(void)
{
    const double zero = 0.0, limit = 2.0, u[6] = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0};
    const pma_limits_parts parts = {.n = 1, .h = 0.5, .velocity = &limit, .energy = INFINITY};
    pma_limits *l;
    CHECK_STATUS(pma_limits_create(&parts, &l), PMA_OK);
    for (int64_t again = 0; again < 3; again++) {
        for (int64_t k = again == 0 ? 0 : 3; k < 6; k++)
            CHECK(pma_limits_command(l, k, k % 3 == 0, 0.0, &zero, &zero, &u[k], NULL));
    }
    const double far = 4.5; /* from 3 at a rate of 3 */
    CHECK(!pma_limits_command(l, 3, true, 0.0, &zero, &zero, &far, NULL));
    pma_limits_begin(l); /* nothing is known: from u0, at the rate of 9 */
    CHECK(!pma_limits_command(l, 3, true, 0.0, &zero, &zero, &far, NULL));
    CHECK(pma_limits_breach(l)->value == 9.0);
    pma_limits_destroy(l);
}

const test PACE_TESTS[] = {
    TEST(paced_steps_begin_when_they_are_due_and_are_those_of_any_run),
    TEST(a_step_that_ends_late_ends_a_run_that_stops_and_no_other),
    TEST(a_long_wait_is_interrupted_to_poll),
    TEST(the_clock_of_the_system_goes_on_while_it_sleeps),
    TEST(a_command_is_judged_by_its_differences_and_a_force_by_its_size),
    TEST(energy_is_that_returned_beyond_what_was_given),
    TEST(a_macro_step_that_is_taken_again_has_the_commands_before_it),
    END_OF_TESTS,
};
