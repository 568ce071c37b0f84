/* test_clock.c - moments, times and substeps that follow from integers. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "check.h"
#include "couple/clock.h"
#include "tests.h"

enum { RATIOS = 12, SUBSTEPS = 12 };

/* (15): fine step k ends in the substep from level j if j * ratio < k <= (j + 1) * ratio */
static void a_moment_is_the_substep_in_which_a_fine_step_ends_and_how_far_it_is(void)
{
    for (size_t ratio = 1; ratio <= RATIOS; ratio++) {
        size_t j = 0;
        for (size_t k = 1; k <= 5 * RATIOS; k++) {
            while (k > (j + 1) * ratio)
                j++;
            const pma_moment now = pma_clock_moment(k, ratio);
            CHECK_INT(now.j, j);
            CHECK_INT(now.phase, k - j * ratio);
            CHECK(now.phase >= 1 && now.phase <= ratio);
        }
    }
}

/* Macro steps among which are some that a double counts exactly only just: times 12 below 2^53. */
static const int64_t MACROS[] = {0, 1, 2, 3, 7, 1000, 123456789, ((int64_t)1 << 49) - 1};
static const double STEP_LENGTHS[] = {1.0, 0.1, 0.3, 0.02 / 3.0, 1e-6, 7.0 / 11.0};

enum {
    MACRO_COUNT = sizeof MACROS / sizeof MACROS[0],
    LENGTH_COUNT = sizeof STEP_LENGTHS / sizeof STEP_LENGTHS[0]
};

/* j of a levels and j' of b levels are one instant where j b = j' a. */
static void check_equal_instants(double dt, int64_t macro, size_t a, size_t b)
{
    for (size_t j = 0; j <= a; j++) {
        if (j * b % a != 0)
            continue;
        const double by_a = pma_clock_time(0.0, dt, macro, j, a);
        const double by_b = pma_clock_time(0.0, dt, macro, j * b / a, b);
        CHECK_BITS(1, &by_a, &by_b);
    }
}

/* The count of levels is exact, so the quotient is the rounded one of the same rational number. */
/* gamma = 2 - sqrt 2 of a step of two stages, and whole steps bitwise as without stages */
static void odd_time_levels_of_two_stages_are_at_gamma_of_both(void)
{
    const double gamma = 2.0 - sqrt(2.0);
    for (size_t j = 0; j < 8; j++) {
        const double t = pma_clock_stage_time(0.5, 0.3, 7, j, 4, true);
        const double begin = pma_clock_time(0.5, 0.3, 7, j - j % 2, 4);
        CHECK_NEAR(t, begin + (j % 2 == 1 ? gamma * 0.15 : 0.0), 1e-15); /* of times up to 3 */
        CHECK(j % 2 == 1 || t == pma_clock_time(0.5, 0.3, 7, j, 4));
        CHECK(pma_clock_stage_time(0.5, 0.3, 7, j, 4, false) == pma_clock_time(0.5, 0.3, 7, j, 4));
    }
    CHECK_NEAR(pma_clock_fraction(1, 2, true), gamma, 2e-16); /* a rounding */
    CHECK_NEAR(pma_clock_fraction(3, 4, true), 0.5 + 0.5 * gamma, 2e-16);
    CHECK(pma_clock_fraction(3, 4, false) == 0.75);
    CHECK_NEAR(pma_clock_length(5, true), 2.0 * gamma, 4e-16);
    CHECK_NEAR(pma_clock_length(6, true), 2.0 - 2.0 * gamma, 4e-16);
    CHECK(pma_clock_length(5, false) == 1.0);
}

static void times_of_equal_instants_are_bitwise_identical_for_all_numbers_of_levels(void)
{
    for (size_t i = 0; i < MACRO_COUNT; i++) {
        for (size_t k = 0; k < LENGTH_COUNT; k++) {
            for (size_t a = 1; a <= SUBSTEPS; a++) {
                for (size_t b = 1; b <= SUBSTEPS; b++)
                    check_equal_instants(STEP_LENGTHS[k], MACROS[i], a, b);
            }
        }
    }
}

static void the_end_of_a_macro_step_is_the_beginning_of_the_next(void)
{
    for (size_t i = 0; i < MACRO_COUNT; i++) {
        for (size_t levels = 1; levels <= SUBSTEPS; levels++) {
            const double end = pma_clock_time(0.0, 0.3, MACROS[i], levels, levels);
            const double begin = pma_clock_time(0.0, 0.3, MACROS[i] + 1, 0, 1);
            const double by_definition = (double)(MACROS[i] + 1) * 0.3;
            CHECK_BITS(1, &end, &begin);
            CHECK_BITS(1, &end, &by_definition);
        }
    }
}

/* Not self-starting: the first macro step is made of single steps, wherever it is counted from. One
 * that continues from an earlier time level takes double steps at once. */
static void double_steps_are_taken_from_the_second_macro_step_on(void)
{
    for (int64_t macro = 0; macro <= 3; macro++) {
        for (size_t substeps = 1; substeps <= SUBSTEPS; substeps++) {
            for (size_t j = 0; j < 2 * substeps; j++) {
                const bool first = macro == 0 && j < substeps;
                const int64_t doubles = pma_clock_first_double(PMA_DOUBLED, substeps);
                const int64_t none = pma_clock_first_double(PMA_SINGLE, substeps);
                const int64_t all = pma_clock_first_double(PMA_CONTINUED, substeps);
                CHECK_INT(pma_clock_substep(0.0, 0.3, macro, substeps, j, doubles, false).twice,
                          !first);
                CHECK_INT(pma_clock_substep(0.0, 0.3, macro, substeps, j, none, false).twice,
                          false);
                CHECK_INT(pma_clock_substep(0.0, 0.3, macro, substeps, j, all, false).twice, true);
            }
        }
    }
}

/* t0 + (j / levels) dt: after a change of the step times go on from the time of the change. */
static void times_after_a_change_are_counted_from_it(void)
{
    const double t0 = 7.0 * 0.3;
    for (size_t levels = 1; levels <= SUBSTEPS; levels++) {
        for (size_t j = 0; j <= levels; j++) {
            const double t = pma_clock_time(t0, 0.1, 0, j, levels);
            const double by_definition = t0 + (double)j / (double)levels * 0.1;
            CHECK_BITS(1, &t, &by_definition);
        }
    }
}

/* Counted from the present, or from the macro step before that waits to be committed. */
static void a_substep_is_the_same_from_wherever_it_is_counted(void)
{
    for (size_t i = 0; i < MACRO_COUNT; i++) {
        for (size_t substeps = 1; substeps <= SUBSTEPS; substeps++) {
            const int64_t first = pma_clock_first_double(PMA_DOUBLED, substeps);
            for (size_t j = 0; j < substeps; j++) {
                const pma_substep later =
                    pma_clock_substep(0.0, 0.3, MACROS[i], substeps, j + substeps, first, false);
                const pma_substep next =
                    pma_clock_substep(0.0, 0.3, MACROS[i] + 1, substeps, j, first, false);
                CHECK_INT(later.j, j + substeps);
                CHECK_INT(next.j, j);
                CHECK_INT(next.number, (MACROS[i] + 1) * (int64_t)substeps + (int64_t)j);
                CHECK_INT(later.number, next.number);
                CHECK_INT(later.twice, next.twice);
                CHECK_BITS(1, &later.t1, &next.t1);
                const double end = pma_clock_time(0.0, 0.3, MACROS[i] + 1, j + 1, substeps);
                CHECK_BITS(1, &next.t1, &end);
            }
        }
    }
}

const test CLOCK_TESTS[] = {
    TEST(a_moment_is_the_substep_in_which_a_fine_step_ends_and_how_far_it_is),
    TEST(odd_time_levels_of_two_stages_are_at_gamma_of_both),
    TEST(times_of_equal_instants_are_bitwise_identical_for_all_numbers_of_levels),
    TEST(the_end_of_a_macro_step_is_the_beginning_of_the_next),
    TEST(double_steps_are_taken_from_the_second_macro_step_on),
    TEST(times_after_a_change_are_counted_from_it),
    TEST(a_substep_is_the_same_from_wherever_it_is_counted),
    END_OF_TESTS,
};
