/* test_balance.c - energy and mass that evaluated forces add, by hand.  (B8) to (B13) */
#include <stddef.h>
#include <stdint.h>

#include "check.h"
#include "member/balance.h"
#include "tests.h"

enum { N = 2 };

static const double ONES[N] = {1.0, 1.0}, STIFF[N] = {3.0, 5.0}, NONE[N] = {0.0, 0.0};
static const pma_springs NO_SPRINGS = {.count = 0};

static pma_balance *create(bool estimates)
{
    const pma_matrix none = {.form = PMA_ZERO, .n = N};
    const pma_matrix stiff = {.form = PMA_DIAGONAL, .n = N, .values = STIFF};
    const pma_balance_parts parts = {.n = N,
                                     .lanes = 1,
                                     .substeps = 1,
                                     .corrects = estimates,
                                     .is_passive = true,
                                     .estimates = estimates,
                                     .h = 1.0,
                                     .M = {.form = PMA_DIAGONAL, .n = N, .values = ONES},
                                     .K = none,
                                     .K_r = estimates ? stiff : none,
                                     .D_r = none,
                                     .springs = &NO_SPRINGS};
    pma_balance *b;
    CHECK_STATUS(pma_balance_create(&parts, &b), PMA_OK);
    return b;
}

/* At rest at zero but for the velocity v of dof 0, without a force. */
static void start(pma_balance *b, double v)
{
    double zeros[N] = {0.0}, speed[N] = {v, 0.0};
    const pma_state x = {.u = zeros, .v = speed, .w = zeros, .a = zeros, .springs = zeros};
    pma_balance_begin(b);
    pma_balance_start(b, &x);
}

static void open_substep(pma_balance *b, int64_t number, const double *ut, const double *force)
{
    double *r = pma_balance_open(b, number, ut);
    for (size_t i = 0; i < N; i++)
        r[i] = force[i];
}

/* Without an acceleration, so that the displacement is that where forces were evaluated. */
static void close_substep(pma_balance *b, int64_t number, double al1, const double *ut,
                          const double *v)
{
    double u[N] = {ut[0], ut[1]}, speed[N] = {v[0], v[1]}, zeros[N] = {0.0};
    const pma_state x = {.u = u, .v = speed, .w = zeros, .springs = zeros};
    const pma_substep step = {.number = number, .t1 = (double)(number + 1)};
    pma_balance_close(b, &step, al1, &x);
    pma_balance_commit(b, &x);
}

/* Explicit: u is ut. The works are 1/16, 1/16 - 2 and -4. */
static void forces_that_give_more_than_they_took_are_seen_at_two_levels(void)
{
    static const double ut[3][N] = {{1.0, 0.5}, {0.0, 1.0}, {-2.0, 1.0}};
    static const double r[3][N] = {{0.0, 0.25}, {4.0, 0.0}, {0.0, 0.0}};
    static const double v[3][N] = {{1.0, 0.0}, {-2.0, 0.0}, {-4.0, 0.0}};
    pma_balance *b = create(false);
    start(b, 1.0);
    open_substep(b, 0, ut[0], r[0]);
    open_substep(b, 1, ut[1], r[1]); /* before the first one is closed */
    close_substep(b, 0, 0.0, ut[0], v[0]);
    CHECK(pma_balance_gain(b).t == 0.0);
    open_substep(b, 2, ut[2], r[2]);
    close_substep(b, 1, 0.0, ut[1], v[1]); /* 1.875 of 2 */
    CHECK(pma_balance_gain(b).t == 0.0);
    close_substep(b, 2, 0.0, ut[2], v[2]); /* 5.875 of 8 */
    const pma_gain gain = pma_balance_gain(b);
    CHECK_NEAR(gain.added, 5.875, 0.0);
    CHECK_NEAR(gain.energy, 8.0, 0.0);
    CHECK_NEAR(gain.t, 2.0, 0.0);
    CHECK_NEAR(pma_balance_added_mass(b), 0.0, 0.0);
    pma_balance_destroy(b);
}

/* A force that was there at the start and goes on has given its work, but is a weight. */
static void a_weight_is_no_source(void)
{
    static const double ut[2][N] = {{-1.0, 0.0}, {-3.0, 0.0}}, v[2][N] = {{-2.0, 0.0}, {-3.0, 0.0}};
    static const double weight[N] = {1.0, 0.0};
    pma_balance *b = create(false);
    pma_balance_first(b)->once[0] = 1.0;
    start(b, 1.0);
    for (int64_t k = 0; k < 2; k++) {
        open_substep(b, k, ut[k], weight);
        close_substep(b, k, 0.0, ut[k], v[k]);
    }
    CHECK(pma_balance_gain(b).t == 0.0);
    pma_balance_destroy(b);
}

/* (B13)  al1 = 1/4; dut = (1, 1), then (1, -3); of dof 0 the force has its stiffness, of dof 1
 * none: 1/4 (5 + 5 x 9) of 1 + 1 + 1 + 9 */
static void an_estimate_above_the_stiffness_is_a_mass(void)
{
    static const double ut[2][N] = {{1.0, 1.0}, {2.0, -2.0}}, r[2][N] = {{3.0, 0.0}, {6.0, 0.0}};
    pma_balance *b = create(true);
    start(b, 1.0);
    for (int64_t k = 0; k < 2; k++) {
        open_substep(b, k, ut[k], r[k]);
        close_substep(b, k, 0.25, ut[k], NONE);
    }
    CHECK_NEAR(pma_balance_added_mass(b), 12.5 / 12.0, 1e-15);
    pma_balance_destroy(b);
}

const test BALANCE_TESTS[] = {
    TEST(forces_that_give_more_than_they_took_are_seen_at_two_levels),
    TEST(a_weight_is_no_source),
    TEST(an_estimate_above_the_stiffness_is_a_mass),
    END_OF_TESTS,
};
