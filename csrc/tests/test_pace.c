/* test_pace.c - fine steps at times of a clock, which is a count here; limits of a specimen. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "check.h"
#include "couple/coupler.h"
#include "models.h"
#include "rig/limits.h"
#include "rig/pace.h"
#include "subdomain/inside.h"
#include "tests.h"
#include "workers/thread.h"

static const plan RESTORED = {{2, 6, 3}, true, true, true, true, true};

enum { ROWS = STEPS * FINE };

/* A clock that goes on by `tick` ns when it is read, and sleeps as it is told; from sleep number
 * `stalled` on it sleeps for `stall` ns more, `stalls` times. */
typedef struct {
    int64_t t, tick, longest, stall;
    size_t slept, stalled, stalls;
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
    if (c->slept >= c->stalled && c->slept < c->stalled + c->stalls)
        c->t += c->stall;
    c->slept++;
}

static double rows[5][ROWS];

static pma_pace make_pace(counted *c, double period, bool stops)
{
    return (pma_pace){.clock = {read_counted, sleep_counted, c},
                      .period = period,
                      .stops = stops,
                      .rows = ROWS,
                      .begun = rows[0],
                      .commanded = rows[1],
                      .returned = rows[2],
                      .ended = rows[3],
                      .shifts = rows[4]};
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
    /* with as many substeps as there are fine steps */
    CHECK_STATUS(pma_subdomain_time(m.subdomains[1].core, &stamp, NULL), PMA_OK);
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

static void a_subdomain_has_a_rig_while_it_is_paced_and_for_its_limits(void)
{
    static model m;
    make_chain(&m, RESTORED, 1.0);
    pma_subdomain *s = m.subdomains[1].core;
    pma_stamp stamp = {.now = read_counted};
    const pma_limits_parts limits = {.n = s->parts.n, .h = 0.5, .energy = INFINITY};
    CHECK(!s->rig);
    CHECK_STATUS(pma_subdomain_time(s, &stamp, NULL), PMA_OK);
    CHECK(s->rig);
    CHECK_STATUS(pma_subdomain_time(s, NULL, NULL), PMA_OK);
    CHECK(!s->rig);
    CHECK_STATUS(pma_subdomain_limit(s, &limits), PMA_OK);
    CHECK_STATUS(pma_subdomain_time(s, NULL, NULL), PMA_OK);
    CHECK(s->rig);
    destroy_model(&m);
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
    for (size_t k = 1; k < ROWS; k++) /* a period after the command before, which has no stamp */
        CHECK(rows[0][k] - rows[0][k - 1] >= 1e-3 * (1.0 - 1e-12));
    destroy_model(&m);
}

/* The clock stands still for 40.5 periods, three sleeps in turn: the schedule is later by as much
 * as these, and no step after them is missed.                                    (Y10) (Y11) */
static void a_stall_shifts_the_schedule_and_no_step_is_made_up_for(void)
{
    static model m;
    const size_t first = 4, stalls = 3;
    counted c = {.tick = 1, .stall = 40500000, .stalled = first, .stalls = stalls};
    pma_pace pace = make_pace(&c, 1e6, false);
    make_chain(&m, RESTORED, 1.0);
    pma_coupler_set_pace(m.coupler, &pace);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    for (size_t k = 0; k < ROWS; k++) {
        const size_t before = k <= first + 1 ? 0 : k - first - 1;
        const size_t missed = before < stalls ? before : stalls;
        /* the clock was read at most six times in a step */
        CHECK_NEAR(rows[4][k], 40.5e-3 * (double)missed, 20e-9);
        const bool stalled = k > first && k <= first + stalls;
        CHECK_NEAR(rows[0][k], 1e-3 * (double)k + rows[4][k] + (stalled ? 40.5e-3 : 0.0), 20e-9);
        CHECK(k == 0 || rows[0][k] - rows[0][k - 1] >= 1e-3 - 10e-9);
    }
    CHECK(pace.shift > 0 && rows[4][ROWS - 1] == 1e-9 * (double)pace.shift);
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

/* ---- limits by the clock                                                          (Y12) ------ */

/* The same commands, h = 1/2, each given at its time of the clock, in ms, by which a period lasts
 * `period` ms. */
static size_t count_given(pma_limits_parts parts, double period, size_t count, const double *u,
                          const int64_t *at, pma_breach *breach)
{
    const double zero = 0.0;
    counted c = {0};
    const pma_limits_clock clock = {read_counted, &c, 1e6 * period};
    pma_limits *l;
    size_t given = 0;
    parts.n = 1;
    parts.h = 0.5;
    parts.energy = INFINITY;
    CHECK_STATUS(pma_limits_create(&parts, &l), PMA_OK);
    pma_limits_pace(l, &clock);
    for (; given < count; given++) {
        c.t = 1000000 * at[given];
        if (!pma_limits_command(l, (int64_t)given, given == 0, 0.5 * (double)(given + 1), &zero,
                                &zero, &u[given], NULL))
            break;
    }
    *breach = *pma_limits_breach(l);
    pma_limits_destroy(l);
    return given;
}

static const double EVEN[8] = {0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0}; /* at the rate 1 */

static void a_run_that_is_faster_than_its_problem_is_limited_by_the_clock(void)
{
    const double limit = 8.0, u[5] = {1.0, 2.0, 3.0, 5.0, 7.5}; /* rates 2 2 2 4 5 */
    const int64_t at[5] = {250, 500, 750, 1000, 1250};
    pma_breach b;
    CHECK_INT(count_given((pma_limits_parts){.velocity = &limit}, 250.0, 5, u, at, &b), 4);
    CHECK(b.by_clock && b.what == PMA_OF_VELOCITY && b.value == 10.0 && b.t == 2.5);
    CHECK_INT(count_given((pma_limits_parts){.velocity = &limit}, 500.0, 5, u, at, &b), 5);
}

static void commands_in_a_burst_add_up_and_one_that_is_late_does_not(void)
{
    const double limit = 2.0, hardly = 1.0;
    const int64_t burst[8] = {500, 1000, 1500, 4000, 4010, 4020, 4030, 4040};
    const int64_t late[8] = {500, 1490, 1500, 2000, 2990, 3000, 3700, 4000};
    pma_breach b;
    CHECK_INT(count_given((pma_limits_parts){.velocity = &limit}, 500.0, 8, EVEN, burst, &b), 6);
    CHECK(b.by_clock && b.what == PMA_OF_VELOCITY && b.value == 3.0 && b.t == 3.5);
    CHECK_INT(count_given((pma_limits_parts){.velocity = &hardly}, 500.0, 8, EVEN, late, &b), 8);
}

/* From the rate 0 at first, at which the state is: an acceleration of 2, and then of 0. */
static void a_specimen_that_has_stood_still_starts_from_rest(void)
{
    const double limit = 1.5, high = 2.5;
    const double u[4] = {0.25, 0.75, 1.25, 1.75}; /* rates 1/2 1 1 1 */
    const int64_t held[4] = {500, 1000, 2000, 2500}, waited[4] = {500, 1000, 1990, 2500};
    pma_breach b;
    CHECK_INT(count_given((pma_limits_parts){.acceleration = &limit}, 500.0, 4, u, held, &b), 2);
    CHECK(b.by_clock && b.what == PMA_OF_ACCELERATION && b.value == 2.0 && b.t == 1.5);
    CHECK_INT(count_given((pma_limits_parts){.acceleration = &limit}, 500.0, 4, u, waited, &b), 4);
    CHECK_INT(count_given((pma_limits_parts){.acceleration = &high}, 500.0, 4, u, held, &b), 4);
}

/* Four commands by no clock in between: how fast they came is not known, and not asked. */
static void a_clock_judges_only_commands_that_were_given_by_it(void)
{
    const double zero = 0.0, limit = 1.5;
    const pma_limits_parts parts = {.n = 1, .h = 0.5, .velocity = &limit, .energy = INFINITY};
    counted c = {0};
    const pma_limits_clock clock = {read_counted, &c, 5e8};
    pma_limits *l;
    CHECK_STATUS(pma_limits_create(&parts, &l), PMA_OK);
    for (int64_t k = 0; k < 8; k++) {
        pma_limits_pace(l, k < 2 || k > 5 ? &clock : NULL);
        c.t += k < 2 || k > 5 ? 500000000 : 0;
        CHECK(pma_limits_command(l, k, k == 0, 0.0, &zero, &zero, &EVEN[k], NULL));
    }
    pma_limits_destroy(l);
}

const test PACE_TESTS[] = {
    TEST(paced_steps_begin_when_they_are_due_and_are_those_of_any_run),
    TEST(a_subdomain_has_a_rig_while_it_is_paced_and_for_its_limits),
    TEST(a_step_that_ends_late_ends_a_run_that_stops_and_no_other),
    TEST(a_stall_shifts_the_schedule_and_no_step_is_made_up_for),
    TEST(a_long_wait_is_interrupted_to_poll),
    TEST(the_clock_of_the_system_goes_on_while_it_sleeps),
    TEST(a_command_is_judged_by_its_differences_and_a_force_by_its_size),
    TEST(energy_is_that_returned_beyond_what_was_given),
    TEST(a_macro_step_that_is_taken_again_has_the_commands_before_it),
    TEST(a_run_that_is_faster_than_its_problem_is_limited_by_the_clock),
    TEST(commands_in_a_burst_add_up_and_one_that_is_late_does_not),
    TEST(a_specimen_that_has_stood_still_starts_from_rest),
    TEST(a_clock_judges_only_commands_that_were_given_by_it),
    END_OF_TESTS,
};
