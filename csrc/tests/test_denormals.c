/* test_denormals.c - denormal numbers are zero in the core, in all threads, and nowhere else. */
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#include "check.h"
#include "couple/coupler.h"
#include "models.h"
#include "tests.h"
#include "workers/denormals.h"

/* Half of the smallest normal number, as this thread computes it. */
static bool is_flushing(void)
{
    volatile double smallest = DBL_MIN;
    volatile double half = 0.5 * smallest;
    return half == 0.0;
}

/* Whether the polls have found the mode of the core. */
static bool see(void *ctx)
{
    *(bool *)ctx = is_flushing();
    return false;
}

static size_t count_denormals(size_t count, const double *x)
{
    size_t found = 0;
    for (size_t i = 0; i < count; i++)
        found += fpclassify(x[i]) == FP_SUBNORMAL;
    return found;
}

static void denormal_numbers_are_zero_in_the_core_and_come_back_with_the_caller(void)
{
    static model m;
    bool seen = false;
    const pma_poll poll = {see, &seen, 0};
    make_chain(&m, MIXED, 1.0);
    CHECK(!is_flushing());
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, &poll), PMA_OK);
    CHECK(seen == (PMA_DENORMALS_FLUSHED != 0));
    CHECK(!is_flushing());
    destroy_model(&m);
}

/* A caller that flushes has its mode again as well. */
static void a_caller_keeps_its_own_mode(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    const pma_denormals before = pma_denormals_flush();
    CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
    CHECK(is_flushing() == (PMA_DENORMALS_FLUSHED != 0));
    pma_denormals_restore(before);
    CHECK(!is_flushing());
    destroy_model(&m);
}

/* Values around 2.2e-308, of which some are below in each level of time. */
static void a_small_motion_is_bitwise_identical_for_any_number_of_threads(void)
{
    static model m;
    static tape expected, actual;
    for (size_t threads = 1; threads <= 3; threads++) {
        tape *t = threads == 1 ? &expected : &actual;
        build_chain(&m, &(chain){.plan = MIXED, .scale = 1e-307, .threads = threads});
        make_tape(t, &m, 0, 0);
        CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, &t->record, NULL), PMA_OK);
        destroy_model(&m);
        for (size_t i = 0; PMA_DENORMALS_FLUSHED && i < SUBDOMAINS; i++) {
            CHECK_INT(count_denormals(LEVELS * MOST, t->u[i]), 0);
            CHECK_INT(count_denormals(LEVELS * MOST, t->v[i]), 0);
        }
        if (threads > 1)
            check_tape(&actual, &expected);
    }
}

const test DENORMALS_TESTS[] = {
    TEST(denormal_numbers_are_zero_in_the_core_and_come_back_with_the_caller),
    TEST(a_caller_keeps_its_own_mode),
    TEST(a_small_motion_is_bitwise_identical_for_any_number_of_threads),
    END_OF_TESTS,
};
