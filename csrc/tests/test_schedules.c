/* test_schedules.c - section 15 of docs/method.md, mean coupling, against the naive program. */
#include <stdbool.h>
#include <stddef.h>

#include "check.h"
#include "models.h"
#include "tests.h"

static void check(chain chosen)
{
    check_chain(&chosen);
}

/* A, damped, has responses; without damping single implicit steps are closed (K7). */
static void mean_coupling_is_the_schedule_as_it_is_written(void)
{
    for (int k = 0; k < 8; k++) {
        const bool moved = k & 1, undamped = k & 2, stored = k & 4;
        check((chain){.plan = {{1, 1, 1}, false, false, true, moved, false},
                      .mean = true,
                      .undamped = undamped});
        check((chain){.plan = {{1, 3, 5}, false, false, true, moved, false},
                      .mean = true,
                      .stored = stored,
                      .undamped = undamped});
        check((chain){.plan = {{2, 6, 1}, false, false, true, moved, false},
                      .mean = true,
                      .stored = stored,
                      .undamped = undamped});
    }
}

static void double_steps_of_mean_coupling_feel_both_multipliers(void)
{
    for (int k = 0; k < 4; k++) {
        const bool moved = k & 1, undamped = k & 2;
        check((chain){.plan = {{1, 4, 1}, true, false, true, moved, false},
                      .mean = true,
                      .undamped = undamped});
        check((chain){.plan = {{1, 4, 1}, true, true, true, moved, false},
                      .mean = true,
                      .undamped = undamped});
    }
}

const test SCHEDULES_TESTS[] = {
    TEST(mean_coupling_is_the_schedule_as_it_is_written),
    TEST(double_steps_of_mean_coupling_feel_both_multipliers),
    END_OF_TESTS,
};
