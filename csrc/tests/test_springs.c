/* test_springs.c - the laws of springs against hand calculation, and where they act. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "check.h"
#include "forces/springs.h"
#include "models.h"
#include "naive.h"
#include "subdomain/subdomain.h"
#include "tests.h"

enum { NUMBERS = 64 };       /* that any spring remembers, at most */
enum { MANY_SPRINGS = 600 }; /* more than a chunk of the core */

/* Force and inner variable of one spring between dof 0 and the ground, led along a path. */
static void lead(pma_spring_law law, const double *parameters, size_t count, const double *path,
                 double *force, double *inner)
{
    const int32_t first = 0, ground = -1;
    pma_spring_set set = {.law = law, .count = 1, .first = &first, .second = &ground};
    set.elements = law == PMA_MULTILINEAR || law == PMA_ELASTIC ? 2 : 0;
    for (size_t k = 0; k < pma_spring_parameters(&set); k++)
        set.parameters[k] = &parameters[k];
    const pma_springs springs = {.count = 1, .sets = &set, .total = 1};
    double memory[NUMBERS] = {0.0};
    CHECK_STATUS(pma_springs_check(&springs, 1), PMA_OK);
    for (size_t i = 0; i < count; i++) {
        double y = 0.0;
        pma_springs_subtract(&springs, &path[i], NULL, memory, memory, &y);
        CHECK_BITS(1, &memory[0], &path[i]);
        CHECK(y == -memory[1] || isnan(y));
        force[i] = memory[1];
        inner[i] = memory[2];
    }
}

static void a_cubic_spring_and_a_gap_are_their_formulas(void)
{
    const double path[4] = {1.0, -2.0, 0.5, 0.25}, cubic[2] = {3.0, 2.0}, gap[2] = {8.0, 0.25};
    const double cubic_forces[4] = {5.0, -22.0, 1.75, 0.78125};
    const double gap_forces[4] = {6.0, 0.0, 2.0, 0.0};
    double force[4], inner[4];
    lead(PMA_CUBIC, cubic, 4, path, force, inner);
    CHECK_BITS(4, force, cubic_forces);
    lead(PMA_GAP, gap, 4, path, force, inner);
    for (size_t i = 0; i < 4; i++)
        CHECK(force[i] == gap_forces[i]);
}

/* k = 8, gap 1/4, c = 2: open, closing, opening, pulled open, and at rest. */
static void a_damped_gap_pushes_with_both_and_never_pulls(void)
{
    const int32_t first = 0, ground = -1;
    const double k = 8.0, gap = 0.25, c = 2.0, d[5] = {0.25, 0.5, 0.5, 0.5, 0.5};
    const double rates[5] = {9.0, 1.0, -0.5, -1.5, 0.0}, forces[5] = {0.0, 4.0, 1.0, 0.0, 2.0};
    const pma_spring_set set = {.law = PMA_DAMPED_GAP,
                                .count = 1,
                                .first = &first,
                                .second = &ground,
                                .parameters = {&k, &gap, &c}};
    const pma_springs springs = {.count = 1, .sets = &set, .total = 1};
    CHECK(pma_springs_have_rates(&springs));
    for (size_t i = 0; i < 5; i++) {
        double level[3] = {0.0}, y = 0.0, slope;
        pma_springs_subtract(&springs, &d[i], i < 4 ? &rates[i] : NULL, level, level, &y);
        CHECK(level[1] == forces[i] && y == -forces[i]);
        pma_springs_tangent(&springs, level, level, 1.0, 10.0, &slope);
        CHECK(slope == (forces[i] > 0.0 ? 28.0 : 0.0)); /* k + 10 c */
        CHECK(pma_springs_energy(&springs, level) == (i > 0 ? 0.25 : 0.0));
    }
}

/* k = 3, k3 = 2, c = 4 at d = 1 and -2 with the rates 1/2 and 1, and at rest. */
static void a_damped_cubic_spring_pushes_and_pulls_with_both(void)
{
    const int32_t first = 0, ground = -1;
    const double k = 3.0, k3 = 2.0, c = 4.0, d[3] = {1.0, -2.0, -2.0}, rates[2] = {0.5, 1.0};
    const double forces[3] = {7.0, -18.0, -22.0}, slopes[3] = {49.0, 67.0, 67.0};
    const pma_spring_set set = {.law = PMA_DAMPED_CUBIC,
                                .count = 1,
                                .first = &first,
                                .second = &ground,
                                .parameters = {&k, &k3, &c}};
    const pma_springs springs = {.count = 1, .sets = &set, .total = 1};
    CHECK(pma_springs_have_rates(&springs));
    for (size_t i = 0; i < 3; i++) {
        double level[3] = {0.0}, y = 0.0, slope;
        pma_springs_subtract(&springs, &d[i], i < 2 ? &rates[i] : NULL, level, level, &y);
        CHECK(level[1] == forces[i] && y == -forces[i]);
        pma_springs_tangent(&springs, level, level, 1.0, 10.0, &slope);
        CHECK(slope == slopes[i]); /* k + 3 k3 d^2 + 10 c */
        CHECK(pma_springs_energy(&springs, level) == (i > 0 ? 14.0 : 2.0));
    }
}

static void a_bilinear_spring_drags_its_plastic_deformation(void)
{
    const double law[3] = {1.0, 3.0, 0.5}; /* k = 4, d_y = 1/2, hardening 1/4 */
    const double path[6] = {0.25, 1.0, 0.75, 0.0, -1.0, -1.0};
    const double plastic[6] = {0.0, 0.5, 0.5, 0.5, -0.5, -0.5};
    const double forces[6] = {1.0, 2.5, 1.5, -1.5, -2.5, -2.5};
    double force[6], inner[6];
    lead(PMA_BILINEAR, law, 6, path, force, inner);
    CHECK_BITS(6, inner, plastic);
    CHECK_BITS(6, force, forces);
}

/* n = 2, beta = gamma = 1/2: z = tanh x on the way out, dz/dx = 1 on the way back to z = 0 */
static void a_bouc_wen_spring_follows_the_closed_form_of_n_2(void)
{
    const double law[7] = {0.0, 1.0, 1.0, 2.0, 0.5, 0.5, 2.0};
    double path[400], force[400], inner[400];
    for (size_t i = 0; i < 400; i++)
        path[i] = i < 200 ? 0.01 * (double)(i + 1) : 2.0 - 0.004 * (double)(i - 199);
    lead(PMA_BOUC_WEN, law, 400, path, force, inner);
    for (size_t i = 0; i < 400; i++) {
        const double z = i < 200 ? tanh(path[i]) : tanh(2.0) - (2.0 - path[i]);
        CHECK_NEAR(inner[i], z, 1e-9); /* 200 steps of 0.01, of order 4 */
        CHECK(force[i] == inner[i]);
    }
    const double far[2] = {1e6, -1e300};
    lead(PMA_BOUC_WEN, law, 2, far, force, inner);
    CHECK_NEAR(inner[0], 1.0, 4.0 * EPS);
    CHECK_NEAR(inner[1], -1.0, 4.0 * EPS);
}

/* Springs are integrated several at a time: those with whole n together, others, and a rest. */
static void bouc_wen_springs_follow_their_paths_bitwise_as_each_alone(void)
{
    enum { COUNT = 21 };
    int32_t dofs[COUNT], ground[COUNT];
    double P[7][COUNT], u[COUNT], y[COUNT] = {0.0}, memory[3 * COUNT] = {0.0};
    const double *parameters[7] = {P[0], P[1], P[2], P[3], P[4], P[5], P[6]};
    for (size_t i = 0; i < COUNT; i++) {
        const double law[7] = {0.1, 1.0, 1.0 + (double)i, 1.0 + (double)(i % 2), 0.5, 0.5, 2.0};
        for (size_t k = 0; k < 7; k++)
            P[k][i] = k == 3 && i > 9 ? 1.0 + 0.5 * (double)(i % 5) : law[k];
        dofs[i] = (int32_t)i, ground[i] = -1;
    }
    pma_spring_set set = {.law = PMA_BOUC_WEN, .count = COUNT, .first = dofs, .second = ground};
    memcpy(set.parameters, parameters, sizeof parameters);
    const pma_springs springs = {.count = 1, .sets = &set, .total = COUNT};
    for (size_t step = 0; step < 3; step++) {
        double before[3 * COUNT], force, inner;
        memcpy(before, memory, sizeof before);
        for (size_t i = 0; i < COUNT; i++)
            u[i] = step == 1 ? -0.4 : 0.3 * (double)(step + i % 4); /* one step, or many */
        pma_springs_subtract(&springs, u, NULL, memory, memory, y);
        for (size_t i = 0; i < COUNT; i++) {
            double own[3] = {before[i], before[COUNT + i], before[2 * COUNT + i]}, y_own = 0.0;
            const int32_t first = 0;
            pma_spring_set one = {
                .law = PMA_BOUC_WEN, .count = 1, .first = &first, .second = ground};
            for (size_t k = 0; k < 7; k++)
                one.parameters[k] = &P[k][i];
            pma_springs_subtract(&(pma_springs){.count = 1, .sets = &one, .total = 1}, &u[i], NULL,
                                 own, own, &y_own);
            force = own[1], inner = own[2];
            CHECK_BITS(1, &memory[COUNT + i], &force);
            CHECK_BITS(1, &memory[2 * COUNT + i], &inner);
        }
    }
}

static void a_deformation_that_is_not_finite_shows_in_the_force(void)
{
    const double path[2] = {NAN, INFINITY}, law[7] = {1.0, 1.0, 1.0, 2.0, 0.5, 0.5, 2.0};
    double force[2], inner[2];
    for (int l = 0; l < PMA_SPRING_LAWS; l++) {
        lead((pma_spring_law)l, law, 1, path, force, inner);
        CHECK(!isfinite(force[0]));
        lead((pma_spring_law)l, law, 1, path + 1, force, inner);
        CHECK(!isfinite(force[0]));
    }
}

static void springs_that_do_not_fit_are_refused(void)
{
    const int32_t places[4] = {0, 2, -1, -2};
    const double k[1] = {1.0};
    for (size_t i = 0; i < 4; i++) {
        const pma_spring_set set = {.law = PMA_CUBIC,
                                    .count = 1,
                                    .first = &places[i],
                                    .second = &places[2],
                                    .parameters = {k, k}};
        const pma_springs springs = {.count = 1, .sets = &set, .total = 1},
                          other = {.count = 1, .sets = &set, .total = 2};
        CHECK_STATUS(pma_springs_check(&springs, 2), i % 2 ? PMA_BAD_INDEX : PMA_OK);
        CHECK_STATUS(pma_springs_check(&other, 2), i % 2 ? PMA_BAD_INDEX : PMA_BAD_SIZE);
    }
}

/* (u_0 - u_1) k in many equal springs, half of them the other way round */
static void many_springs_between_two_dofs_pull_equally_on_both(void)
{
    static int32_t first[MANY_SPRINGS], second[MANY_SPRINGS];
    static double k[MANY_SPRINGS], zero[MANY_SPRINGS], from[3 * MANY_SPRINGS], to[3 * MANY_SPRINGS];
    const double u[2] = {2.0, 0.5};
    double y[2] = {1.0, 1.0};
    for (size_t i = 0; i < MANY_SPRINGS; i++) {
        first[i] = i % 2, second[i] = 1 - i % 2;
        k[i] = 0.25;
    }
    const pma_spring_set sets[2] = {
        {.law = PMA_CUBIC,
         .count = MANY_SPRINGS - 1,
         .first = first,
         .second = second,
         .parameters = {k, zero}},
        {.law = PMA_GAP, .count = 1, .first = first, .second = second, .parameters = {k, zero}}};
    const pma_springs springs = {.count = 2, .sets = sets, .total = MANY_SPRINGS};
    pma_springs_subtract(&springs, u, NULL, from, to, y);
    CHECK(y[0] == 1.0 - MANY_SPRINGS * 0.25 * 1.5 && y[1] == 1.0 + MANY_SPRINGS * 0.25 * 1.5);
    CHECK(from[0] == 0.0 && to[0] == 1.5 && to[1] == -1.5 && to[MANY_SPRINGS] == 0.375);
    CHECK_NEAR(pma_springs_energy(&springs, to), MANY_SPRINGS * 0.125 * 2.25, 1e-9);
    CHECK_NEAR(pma_springs_work(&springs, from, to), MANY_SPRINGS * 0.125 * 2.25, 1e-9);
}

/* Numbers of springs with and without a rest beyond registers; (H4) with whole exponents and
 * others, with paths of a few substeps and of more than it takes. */
static void springs_pull_bitwise_identically_on_all_processors(void)
{
    enum { COUNT = 21 };
    static double from[NUMBERS * COUNT], to[2][NUMBERS * COUNT];
    double P[PMA_SPRING_PARAMETERS][COUNT], u[COUNT], v[COUNT], forces[2][COUNT];
    int32_t first[COUNT], ground[COUNT];
    uint64_t seed = 5;
    for (int law = 0; law < PMA_SPRING_LAWS; law++) {
        pma_spring_set set = {.law = (pma_spring_law)law, .first = first, .second = ground};
        set.elements = law == PMA_MULTILINEAR || law == PMA_ELASTIC ? 3 : 0;
        for (size_t k = 0; k < PMA_SPRING_PARAMETERS; k++) {
            draw_vector(COUNT, &seed, P[k]);
            set.parameters[k] = P[k];
        }
        for (size_t i = 0; i < COUNT; i++) {
            first[i] = (int32_t)i, ground[i] = -1;
            u[i] = i == 3 ? NAN : i == 4 ? 1e200 : 3.0 * P[0][i];
            v[i] = i == 5 ? NAN : P[1][i];
            P[3][i] = i < 11 ? 1.0 + (double)(i % 2) : 1.5;
            P[6][i] = 10.0 * fabs(P[6][i]) + 0.1;
        }
        for (set.count = 1; set.count <= COUNT; set.count++) {
            const pma_springs springs = {.count = 1, .sets = &set, .total = set.count};
            memset(from, 0, sizeof from);
            draw_vector(set.count, &seed, from);
            memset(to, 0, sizeof to);
            memset(forces, 0, sizeof forces);
            pma_springs_subtract(&springs, u, v, from, to[0], forces[0]);
            pma_springs_subtract_plain(&springs, u, v, from, to[1], forces[1]);
            CHECK_BITS(NUMBERS * COUNT, to[1], to[0]);
            CHECK_BITS(COUNT, forces[1], forces[0]);
        }
    }
}

/* ---- laws of several inner variables --------------------------------------------------------- */

/* Backbone through (1, 4), (2, 6), (4, 7) and on with slope 1/2: elements of stiffness 2 and 3/2
 * that yield at 1 and 2. By hand, out, back and out again. */
static void a_multilinear_spring_is_elements_in_parallel(void)
{
    const double law[5] = {0.5, 2.0, 1.0, 1.5, 2.0};
    const double path[7] = {1.0, 2.0, 4.0, 2.0, 0.0, -4.0, 4.0};
    const double forces[7] = {4.0, 6.0, 7.0, -1.0, -5.0, -7.0, 7.0};
    const double elastic[7] = {4.0, 6.0, 7.0, 6.0, 0.0, -7.0, 7.0};
    double force[7], inner[7];
    lead(PMA_MULTILINEAR, law, 7, path, force, inner);
    CHECK_BITS(7, force, forces);
    lead(PMA_ELASTIC, law, 7, path, force, inner);
    CHECK_BITS(7, force, elastic);
}

/* d_y = 1/2, f_y = 2, n = 3, alpha = 1: on the skeleton f = f_y g at d = d_y (g + g^3), on a branch
 * twice that from where it begins. Loops within loops close at the force at which they began, and
 * what was before goes on: Masing's rules. */
static void a_ramberg_osgood_spring_closes_loops_within_loops(void)
{
    const double law[4] = {0.5, 2.0, 3.0, 1.0};
    /* g = 2, then branches of g = -1.5 and 1, closed, on to the first, to its mirror and the
     * skeleton */
    const double path[8] = {5.0, 0.125, 2.125, 0.125, 5.0 - 10.0, -5.0, -15.0, 15.0};
    const double forces[8] = {4.0, -2.0, 2.0, -2.0, -4.0, -4.0, -6.0, 6.0};
    double force[8], inner[8];
    lead(PMA_RAMBERG_OSGOOD, law, 8, path, force, inner);
    for (size_t i = 0; i < 8; i++)
        CHECK_NEAR(force[i], forces[i], 32.0 * EPS);
    CHECK(inner[2] == 2.0 && inner[4] == 0.0 && inner[7] == 0.0); /* open reversals */
}

/* More loops within loops than it has room for: the smallest are forgotten, and the outermost loop
 * still closes. */
static void a_ramberg_osgood_spring_forgets_the_smallest_loops(void)
{
    const double law[4] = {0.5, 2.0, 3.0, 1.0};
    double path[62], force[62], inner[62];
    for (size_t i = 0; i < 60; i++)
        path[i] = (i % 2 ? -5.0 : 5.0) * pow(0.9, (double)i);
    path[60] = -5.0;
    path[61] = 5.0;
    lead(PMA_RAMBERG_OSGOOD, law, 62, path, force, inner);
    CHECK_NEAR(force[60], -4.0, 32.0 * EPS);
    CHECK_NEAR(force[61], 4.0, 32.0 * EPS);
}

/* What a spring can give back is never more than the work done on it, and around a closed loop it
 * is the same again; the work by the trapezoidal rule over 2000 steps of a swing. */
static void check_energy(pma_spring_law law, size_t elements, const double *parameters)
{
    const int32_t first = 0, ground = -1;
    pma_spring_set set = {
        .law = law, .count = 1, .elements = elements, .first = &first, .second = &ground};
    for (size_t k = 0; k < pma_spring_parameters(&set); k++)
        set.parameters[k] = &parameters[k];
    const pma_springs springs = {.count = 1, .sets = &set, .total = 1};
    double level[NUMBERS] = {0.0}, to[NUMBERS] = {0.0}, work = 0.0, lost = 0.0, y = 0.0,
           first_top = 0.0;
    for (size_t i = 1; i <= 10000; i++) {
        const double d = 5.0 * sin(2.0 * PI * (double)i / 2000.0);
        pma_springs_subtract(&springs, &d, NULL, level, to, &y);
        work += pma_springs_work(&springs, level, to);
        const double stored = pma_springs_energy(&springs, to);
        CHECK(stored >= -1e-12 && work - stored >= lost - 2e-4);
        lost = fmax(lost, work - stored);
        first_top = i == 500 ? stored : first_top;
        if (i == 8500)
            CHECK_NEAR(stored, first_top, 1e-9);
        memcpy(level, to, sizeof level);
    }
    CHECK(law == PMA_ELASTIC ? lost < 2e-4 : lost > 10.0);
}

static void energy_is_stored_and_lost_but_never_made(void)
{
    const double multilinear[5] = {0.5, 2.0, 1.0, 1.5, 2.0}, masing[4] = {0.5, 2.0, 3.0, 1.0};
    check_energy(PMA_MULTILINEAR, 2, multilinear);
    check_energy(PMA_ELASTIC, 2, multilinear);
    check_energy(PMA_RAMBERG_OSGOOD, 0, masing);
}

/* ---- tangents -------------------------------------------------------------------------------- */

/* Force of one spring that goes from a level to d, and the tangent there. */
static double pull_to(pma_spring_law law, const double *parameters, const double *from, double d,
                      double *to, double *slope)
{
    const int32_t first = 0, ground = -1;
    pma_spring_set set = {.law = law, .count = 1, .first = &first, .second = &ground};
    set.elements = law == PMA_MULTILINEAR || law == PMA_ELASTIC ? 2 : 0;
    for (size_t k = 0; k < pma_spring_parameters(&set); k++)
        set.parameters[k] = &parameters[k];
    const pma_springs springs = {.count = 1, .sets = &set, .total = 1};
    double y = 0.0;
    pma_springs_subtract(&springs, &d, NULL, from, to, &y);
    pma_springs_tangent(&springs, from, to, 1.0, 0.0, slope);
    return to[1];
}

/* The tangent at the end of every interval of a path to and fro, by central differences: their
 * error is h^2/6 of the third derivative, 1e-12, and the rounding of the forces over h, 1e-9. */
static void check_tangents(pma_spring_law law, const double *parameters, double step,
                           double tolerance)
{
    const double h = 1e-6;
    double level[NUMBERS] = {0.0}, to[NUMBERS], slope, unused;
    for (size_t i = 1; i < 200; i++) {
        const double d = 0.9 * sin(step * (double)i) + 0.003;
        const bool turns = fabs(d - level[0]) < 4.0 * h; /* loading on one side, unloading beyond */
        const double above = pull_to(law, parameters, level, d + h, to, &unused);
        const double below = pull_to(law, parameters, level, d - h, to, &unused);
        pull_to(law, parameters, level, d, to, &slope);
        const bool crosses = law == PMA_BOUC_WEN && level[2] * to[2] < 0.0; /* |z|^n has a kink */
        if (!turns && !crosses)
            CHECK_NEAR(slope, (above - below) / (2.0 * h), tolerance);
        memcpy(level, to, sizeof level);
    }
}

static void tangents_of_springs_are_the_differences_of_their_forces(void)
{
    const double cubic[2] = {3.0, 2.0}, gap[2] = {8.0, 0.25}, bilinear[3] = {1.0, 3.0, 0.3};
    check_tangents(PMA_CUBIC, cubic, 0.1, 4e-9);
    check_tangents(PMA_GAP, gap, 0.1, 4e-9);
    check_tangents(PMA_BILINEAR, bilinear, 0.1, 4e-9);
    check_tangents(PMA_BILINEAR, bilinear, 2.0, 4e-9);
    const double parallel[5] = {0.5, 2.0, 0.1, 1.5, 0.3}, masing[4] = {0.2, 2.0, 3.0, 1.0};
    check_tangents(PMA_MULTILINEAR, parallel, 0.1, 4e-9);
    check_tangents(PMA_ELASTIC, parallel, 0.1, 4e-9);
    check_tangents(PMA_RAMBERG_OSGOOD, masing, 0.1, 1e-8);
    /* f_soft/d_y dz/dx of the path itself; a step of the Runge-Kutta rule of length x < 1/10
     * departs from that by x^4/24 times the fifth derivative of z, which for tanh is 16 at most */
    const double bouc_wen[7] = {0.5, 0.25, 2.0, 2.0, 0.5, 0.5, 2.0};
    const double other[7] = {0.5, 0.25, 2.0, 1.0, 0.75, 0.25, 2.0};
    check_tangents(PMA_BOUC_WEN, bouc_wen, 0.05, 4e-5);
    check_tangents(PMA_BOUC_WEN, other, 0.05, 4e-5);
}

/* By hand: on the hardening branch, and back with both springs. */
static void a_tangent_is_that_of_the_branch_on_which_the_spring_is(void)
{
    const double bilinear[3] = {1.0, 3.0, 0.5}, path[6] = {0.25, 1.0, 1.5, 1.25, 0.0, -1.0};
    const double expected[6] = {4.0, 1.0, 1.0, 4.0, 1.0, 1.0};
    double level[NUMBERS] = {0.0}, out[NUMBERS], back[NUMBERS], slope;
    for (size_t i = 0; i < 6; i++) {
        pull_to(PMA_BILINEAR, bilinear, level, path[i], out, &slope);
        CHECK(slope == expected[i]);
        memcpy(level, out, sizeof level);
    }
    /* n = 2, beta = gamma = 1/2: k_hard + f_soft/d_y (1 - z^2) on the way out, and without the
     * square on the way back as long as z keeps its sign */
    const double bouc_wen[7] = {0.5, 0.25, 2.0, 2.0, 0.5, 0.5, 2.0};
    memset(level, 0, sizeof level);
    pull_to(PMA_BOUC_WEN, bouc_wen, level, 0.25, out, &slope);
    CHECK_NEAR(slope, 0.5 + 0.5 * (1.0 - out[2] * out[2]), 4.0 * EPS);
    pull_to(PMA_BOUC_WEN, bouc_wen, out, 0.2, back, &slope);
    CHECK(slope == 1.0);
}

/* Every spring has the tangent that it would have alone, in the order of the sets. */
static void tangents_are_in_the_order_of_the_sets(void)
{
    const int32_t dofs[2] = {0, 1}, ground[2] = {-1, -1};
    const double k[2] = {1.0, 2.0}, k3[2] = {0.0, 1.0}, gaps[2] = {0.5, 5.0}, u[2] = {1.0, 2.0};
    const pma_spring_set sets[2] = {
        {.law = PMA_CUBIC, .count = 2, .first = dofs, .second = ground, .parameters = {k, k3}},
        {.law = PMA_GAP, .count = 2, .first = dofs, .second = ground, .parameters = {k, gaps}}};
    const pma_springs springs = {.count = 2, .sets = sets, .total = 4};
    double from[12] = {0.0}, to[12], y[2] = {0.0, 0.0}, slopes[4];
    pma_springs_subtract(&springs, u, NULL, from, to, y);
    pma_springs_tangent(&springs, from, to, 1.0, 0.0, slopes);
    CHECK_BITS(4, slopes, ((double[]){1.0, 14.0, 1.0, 0.0}));
}

/* Of the second set, behind those of the first, the number of open loops. */
static void the_counts_of_springs_are_found_and_checked(void)
{
    const int32_t dofs[2] = {0, 1}, ground[2] = {-1, -1};
    const double k[2] = {1.0, 2.0};
    const pma_spring_set sets[2] = {
        {.law = PMA_CUBIC, .count = 1, .first = dofs, .second = ground, .parameters = {k, k}},
        {.law = PMA_RAMBERG_OSGOOD,
         .count = 2,
         .first = dofs,
         .second = ground,
         .parameters = {k, k, k, k}}};
    const pma_springs springs = {.count = 2, .sets = sets, .total = 3};
    const double bad[] = {-1.0, 0.5, 13.0, NAN, INFINITY};
    double level[81] = {0.0}, most;
    pma_state_counts counts;
    CHECK(pma_springs_numbers(&springs) == 81 && pma_springs_tables(&springs) == 1);
    pma_springs_counts(&springs, &counts);
    const pma_state_array array = {"springs", 81, level, 1, &counts};
    CHECK(counts.first == 7 && counts.count == 2 && counts.most == 12.0);
    level[6] = -1.0; /* of the cubic spring, which has none */
    level[8] = 12.0;
    CHECK(!pma_state_wrong_count(&array, level, &most));
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        level[8] = bad[i];
        CHECK(pma_state_wrong_count(&array, level, &most) == level + 8 && most == 12.0);
    }
}

const test SPRINGS_TESTS[] = {
    TEST(a_cubic_spring_and_a_gap_are_their_formulas),
    TEST(a_damped_gap_pushes_with_both_and_never_pulls),
    TEST(a_damped_cubic_spring_pushes_and_pulls_with_both),
    TEST(a_bilinear_spring_drags_its_plastic_deformation),
    TEST(a_bouc_wen_spring_follows_the_closed_form_of_n_2),
    TEST(bouc_wen_springs_follow_their_paths_bitwise_as_each_alone),
    TEST(a_deformation_that_is_not_finite_shows_in_the_force),
    TEST(springs_that_do_not_fit_are_refused),
    TEST(many_springs_between_two_dofs_pull_equally_on_both),
    TEST(springs_pull_bitwise_identically_on_all_processors),
    TEST(a_multilinear_spring_is_elements_in_parallel),
    TEST(a_ramberg_osgood_spring_closes_loops_within_loops),
    TEST(a_ramberg_osgood_spring_forgets_the_smallest_loops),
    TEST(energy_is_stored_and_lost_but_never_made),
    TEST(tangents_of_springs_are_the_differences_of_their_forces),
    TEST(a_tangent_is_that_of_the_branch_on_which_the_spring_is),
    TEST(tangents_are_in_the_order_of_the_sets),
    TEST(the_counts_of_springs_are_found_and_checked),
    END_OF_TESTS,
};
