/* test_balance.c - energy and mass that evaluated forces add, by hand.  (B8) to (B13) */
#include <stddef.h>
#include <stdint.h>

#include "algebra/lanes.h"
#include "check.h"
#include "observe/balance.h"
#include "observe/passage.h"
#include "observe/stiffness.h"
#include "tests.h"

enum { N = 2 };

static const double ONES[N] = {1.0, 1.0}, STIFF[N] = {3.0, 5.0}, NONE[N] = {0.0, 0.0};
static const pma_springs NO_SPRINGS = {.count = 0};

static pma_balance *create(bool estimates, double al1)
{
    const pma_matrix none = {.form = PMA_ZERO, .n = N};
    const pma_matrix stiff = {.form = PMA_DIAGONAL, .n = N, .values = STIFF};
    const pma_balance_parts parts = {.n = N,
                                     .lanes = 1,
                                     .substeps = 1,
                                     .corrects = estimates,
                                     .is_passive = true,
                                     .estimates = estimates,
                                     .is_explicit = al1 == 0.0,
                                     .single = {.h = 1.0, .al1 = al1, .stiff = 0.25, .damp = 1.0},
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
    double *r = pma_balance_open(b, number, ut).r;
    for (size_t i = 0; i < N; i++)
        r[i] = force[i];
}

/* Without an acceleration, so that the displacement is that where forces were evaluated. */
static void close_substep(pma_balance *b, int64_t number, const double *ut, const double *v)
{
    double u[N] = {ut[0], ut[1]}, speed[N] = {v[0], v[1]}, zeros[N] = {0.0};
    const pma_state x = {.u = u, .v = speed, .w = zeros, .springs = zeros};
    const pma_substep step = {.number = number, .t1 = (double)(number + 1)};
    pma_balance_close(b, &step, &x);
    pma_balance_commit(b, &x);
}

/* Explicit: u is ut. The works are 1/16, 1/16 - 2 and -4. */
static void forces_that_give_more_than_they_took_are_seen_at_two_levels(void)
{
    static const double ut[3][N] = {{1.0, 0.5}, {0.0, 1.0}, {-2.0, 1.0}};
    static const double r[3][N] = {{0.0, 0.25}, {4.0, 0.0}, {0.0, 0.0}};
    static const double v[3][N] = {{1.0, 0.0}, {-2.0, 0.0}, {-4.0, 0.0}};
    pma_balance *b = create(false, 0.0);
    start(b, 1.0);
    open_substep(b, 0, ut[0], r[0]);
    open_substep(b, 1, ut[1], r[1]); /* before the first one is closed */
    close_substep(b, 0, ut[0], v[0]);
    CHECK(pma_balance_gain(b).t == 0.0);
    open_substep(b, 2, ut[2], r[2]);
    close_substep(b, 1, ut[1], v[1]); /* 1.875 of 2 */
    CHECK(pma_balance_gain(b).t == 0.0);
    close_substep(b, 2, ut[2], v[2]); /* 5.875 of 8 */
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
    pma_balance *b = create(false, 0.0);
    pma_balance_first(b)->once[0] = 1.0;
    start(b, 1.0);
    for (int64_t k = 0; k < 2; k++) {
        open_substep(b, k, ut[k], weight);
        close_substep(b, k, ut[k], v[k]);
    }
    CHECK(pma_balance_gain(b).t == 0.0);
    pma_balance_destroy(b);
}

/* (B13)  al1 = 1/4; dut = (1, 1), then (1, -3); of dof 0 the force has its stiffness, of dof 1
 * none: 1/4 (5 + 5 x 9) of 1 + 1 + 1 + 9 */
static void an_estimate_above_the_stiffness_is_a_mass(void)
{
    static const double ut[2][N] = {{1.0, 1.0}, {2.0, -2.0}}, r[2][N] = {{3.0, 0.0}, {6.0, 0.0}};
    pma_balance *b = create(true, 0.25);
    start(b, 1.0);
    for (int64_t k = 0; k < 2; k++) {
        open_substep(b, k, ut[k], r[k]);
        close_substep(b, k, ut[k], NONE);
    }
    CHECK_NEAR(pma_balance_added_mass(b), 12.5 / 12.0, 1e-15);
    pma_balance_destroy(b);
}

/* Three dofs in lanes and each lane alone, of small integers: no rounding, any order. */
static void a_passage_in_lanes_is_that_of_each_lane(void)
{
    enum { DOFS = 3, ALL = DOFS * PMA_LANES, INPUTS = 13 };
    static double x[INPUTS][ALL], terms[PMA_PASSAGE_TERMS * PMA_LANES];
    for (size_t k = 0; k < INPUTS * ALL; k++)
        x[k / ALL][k % ALL] = (double)((7 * k + 3 * (k / ALL)) % 11) - 5.0;
    double y[PMA_LANES][INPUTS][DOFS];
    for (size_t k = 0; k < INPUTS * ALL; k++)
        y[k % PMA_LANES][k / ALL][k % ALL / PMA_LANES] = x[k / ALL][k % ALL];
    const pma_passage lanes = {.from = x[0],
                               .to = x[3],
                               .u = x[6],
                               .v = x[7],
                               .w = x[8],
                               .r = x[9],
                               .fixed = x[10],
                               .al1 = 1.0};
    pma_passage_sum(ALL, PMA_LANES, &lanes, terms);
    for (size_t l = 0; l < PMA_LANES; l++) {
        double one[PMA_PASSAGE_TERMS];
        const pma_passage alone = {.from = y[l][0],
                                   .to = y[l][3],
                                   .u = y[l][6],
                                   .v = y[l][7],
                                   .w = y[l][8],
                                   .r = y[l][9],
                                   .fixed = y[l][10],
                                   .al1 = 1.0};
        pma_passage_sum(DOFS, 1, &alone, one);
        for (size_t k = 0; k < PMA_PASSAGE_KINETIC; k++)
            CHECK(terms[k * PMA_LANES + l] == one[k]);
        for (size_t i = 0; i < 3 * DOFS; i++)
            CHECK(x[3 + i / DOFS][i % DOFS * PMA_LANES + l] == y[l][3 + i / DOFS][i % DOFS]);
    }
}

/* By hand: acting -3 + 2 (1/2 4) = 1, inertia 5 x 4 = 20, du = 2; where they are given, 7 and 21 */
static void a_passage_sums_the_works_of_one_step(void)
{
    static const double from[] = {1.0, 1.0, -1.0}, fixed[] = {0.5, 2.0, 5.0};
    static const double u = 3.0, v = 2.0, w = 4.0, r = -3.0;
    double to[3] = {0.0, 7.0, 21.0}, terms[PMA_PASSAGE_TERMS];
    pma_passage hand = {
        .from = from, .to = to, .u = &u, .v = &v, .w = &w, .r = &r, .fixed = fixed, .al1 = 0.5};
    pma_passage_sum(1, 1, &hand, terms);
    static const double given[PMA_PASSAGE_TERMS] = {8.0, 1.0, 20.0, 9.0, 0.0};
    CHECK_BITS(PMA_PASSAGE_TERMS, terms, given);
    CHECK(to[0] == 3.0 && to[1] == 7.0 && to[2] == 21.0);
    hand.is_diagonal = true;
    pma_passage_sum(1, 1, &hand, terms);
    static const double diagonal[PMA_PASSAGE_TERMS] = {2.0, 1.0, 19.0, 9.0, 20.0};
    CHECK_BITS(PMA_PASSAGE_TERMS, terms, diagonal);
    CHECK(to[0] == 3.0 && to[1] == 1.0 && to[2] == 20.0);
}

/* (B15)  du = (2, 1), dr = (6, 8), M = (1, 1), K = (3, 5), K_r = (3, 5), D_r = (1, 1): dr.du = 20,
 * du.M du = 5, du.K du = 17; dv = (1, 1): dr.dv = 14, dv.M dv = 2, dv.D_r dv = 2 */
static void the_step_over_that_which_the_forces_allow_is_that_of_a_step_by_hand(void)
{
    static const double ut[2][N] = {{1.0, 0.0}, {3.0, 1.0}}, vs[2][N] = {{0.0, 1.0}, {1.0, 2.0}};
    static const double total[2][N] = {{-1.0, -2.0}, {5.0, 6.0}};
    const pma_matrix none = {.form = PMA_ZERO, .n = N};
    const pma_matrix one = {.form = PMA_DIAGONAL, .n = N, .values = ONES};
    const pma_matrix stiff = {.form = PMA_DIAGONAL, .n = N, .values = STIFF};
    const pma_step_limits step = {
        .h = 1.0, .al1 = 0.25, .stiff = 0.5, .inert = 0.125, .damp = 0.75};
    pma_stiffness s = {.n = N, .lanes = 1, .M = one, .K = stiff, .K_r = stiff, .D_r = one};
    const pma_evaluation_at from = {.ut = ut[0], .total = total[0], .vs = vs[0]};
    const pma_evaluation_at to = {.ut = ut[1], .total = total[1], .vs = vs[1]};
    double scratch[3 * N];
    /* (10 - 17/4 - 17/8) / 5 is below 1: nothing else is asked */
    pma_excess x = pma_stiffness_excess(&s, &step, &from, &to, 0, scratch);
    CHECK_NEAR(x.displacement, 0.725, 1e-15);
    CHECK(x.velocity == 0.0);
    s.K = s.K_r = none; /* 10 / 5; (10.5 - 1) / 2 */
    x = pma_stiffness_excess(&s, &step, &from, &to, 0, scratch);
    CHECK_NEAR(x.displacement, 2.0, 1e-15);
    CHECK_NEAR(x.velocity, 4.75, 1e-15);
    s.is_explicit = true; /* K alone is above: 8.5 / 5 */
    s.K = stiff;
    CHECK(pma_stiffness_excess(&s, &step, &from, &to, 0, scratch).displacement == 0.0);
    s.K = one; /* 0.5 (20 + 5) / 5 */
    CHECK_NEAR(pma_stiffness_excess(&s, &step, &from, &to, 0, scratch).displacement, 2.5, 1e-15);
    CHECK(pma_stiffness_excess(&s, &step, &to, &to, 0, scratch).displacement == 0.0);
}

const test BALANCE_TESTS[] = {
    TEST(forces_that_give_more_than_they_took_are_seen_at_two_levels),
    TEST(a_weight_is_no_source),
    TEST(an_estimate_above_the_stiffness_is_a_mass),
    TEST(a_passage_in_lanes_is_that_of_each_lane),
    TEST(a_passage_sums_the_works_of_one_step),
    TEST(the_step_over_that_which_the_forces_allow_is_that_of_a_step_by_hand),
    END_OF_TESTS,
};
