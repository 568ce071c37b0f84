/* test_cases.c - long narrow subdomains, several cases of one, and which ones can be divided. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "algebra/kernel.h"
#include "algebra/lanes.h"
#include "check.h"
#include "naive.h"
#include "subdomain/cases.h"
#include "subdomain/inside.h"
#include "subdomain/subdomain.h"
#include "subdomains.h"
#include "tests.h"

enum { LONG = 300, WIDTH = 2, SPRINGS = 4, FACE = 3, MACRO_STEPS = 5 };

/* K in a band and R in a band, and both once more as dense matrices. */
static double K_band[(WIDTH + 1) * LONG], K_dense[LONG * LONG];
static double R_band[LONG * WIDTH], R_dense[LONG * LONG];
static double diagonal[LONG], load[LONG], start[3 * LONG];

static const int32_t FIRST[SPRINGS] = {127, 0, 299, 200}, SECOND[SPRINGS] = {128, -1, 297, 100};
static const double HARD[SPRINGS] = {0.5, 0.5, 0.5, 0.5}, SOFT[SPRINGS] = {1.0, 2.0, 1.0, 2.0};
static const double LIMIT[SPRINGS] = {0.1, 0.1, 0.2, 0.2};
static const pma_spring_set SET = {.law = PMA_BILINEAR,
                                   .count = SPRINGS,
                                   .first = FIRST,
                                   .second = SECOND,
                                   .parameters = {HARD, SOFT, LIMIT}};

static void draw_numbers(void)
{
    uint64_t seed = 31;
    memset(K_dense, 0, sizeof K_dense);
    memset(R_dense, 0, sizeof R_dense);
    for (size_t i = 0; i < LONG; i++) {
        diagonal[i] = 1.0 / (1.0 + (double)(i % 5));
        load[i] = draw_eighth(&seed);
        for (size_t d = 0; d <= WIDTH; d++) {
            const double k = i + d < LONG ? draw_eighth(&seed) : 0.0;
            K_band[d * LONG + i] = k;
            if (i + d < LONG)
                K_dense[i * LONG + i + d] = K_dense[(i + d) * LONG + i] = k;
        }
        for (size_t d = 0; d < WIDTH; d++) {
            const double r = i + 1 + d < LONG ? 0.25 * draw_eighth(&seed) : 0.0;
            R_band[i * WIDTH + d] = r;
            if (i + 1 + d < LONG)
                R_dense[i * LONG + i + 1 + d] = r;
        }
    }
    for (size_t i = 0; i < 3 * LONG; i++)
        start[i] = draw_eighth(&seed);
}

static const int64_t LINK_PTR[FACE + 1] = {0, 0, 1, 1};
static const int32_t LINK_ROW[1] = {0};
static const double LINK_VALUE[1] = {1.0};

static pma_parts describe_long(bool narrow, bool sprung)
{
    const pma_factor band = {.form = PMA_BAND,
                             .n = LONG,
                             .nb = FACE,
                             .inverse = diagonal,
                             .values = R_band,
                             .width = WIDTH};
    const pma_factor dense = {
        .form = PMA_DENSE, .n = LONG, .nb = FACE, .inverse = diagonal, .values = R_dense};
    pma_parts parts = {.n = LONG,
                       .nb = FACE,
                       .substeps = 2,
                       .doubled = true,
                       .K = {.form = PMA_BAND, .n = LONG, .values = K_band, .width = WIDTH},
                       .C = {.form = PMA_DIAGONAL, .n = LONG, .values = diagonal},
                       .springs = {sprung ? 1 : 0, &SET, sprung ? SPRINGS : 0},
                       .single = {pma_step_make(TRAPEZOIDAL, 0.1), narrow ? band : dense},
                       .twice = {pma_step_make(TRAPEZOIDAL, 0.2), narrow ? band : dense},
                       .link = {1, FACE, LINK_PTR, LINK_ROW, LINK_VALUE, NULL}};
    if (!narrow)
        parts.K = (pma_matrix){.form = PMA_DENSE, .n = LONG, .values = K_dense};
    return parts;
}

static pma_subdomain *make_long(bool narrow, bool sprung)
{
    const pma_parts parts = describe_long(narrow, sprung);
    const double lam = 0.5;
    pma_subdomain *s = NULL;
    CHECK_STATUS(pma_subdomain_create(&parts, &s), PMA_OK);
    pma_subdomain_set_load(s, (pma_load){.kind = PMA_LOAD_CONSTANT, .n = LONG, .values = load});
    pma_subdomain_start(s, start, start + LONG, start + 2 * LONG, &lam);
    return s;
}

static void walk(pma_subdomain *s)
{
    const pma_member m = pma_subdomain_member(s);
    for (int64_t macro = 0; macro < MACRO_STEPS; macro++) {
        for (size_t j = 0; j < 2; j++) {
            const pma_substep step = {.j = j, .number = 2 * macro + (int64_t)j, .twice = macro > 0};
            const double lam = 1.0 - (double)j;
            CHECK_STATUS(m.table->advance(m.self, NULL, &step, NULL, NULL), PMA_OK);
            CHECK_STATUS(m.table->advance(m.self, &step, NULL, &lam, NULL), PMA_OK);
        }
        m.table->commit(m.self);
    }
}

/* Ten steps of sums of at most 300 numbers of order one, each rounded otherwise. */
static const double STEPS_AGREE = 1e-11;

static void check_narrow(bool sprung)
{
    pma_subdomain *narrow = make_long(true, sprung), *dense = make_long(false, sprung);
    walk(narrow);
    walk(dense);
    const pma_state *x = pma_subdomain_present(narrow), *y = pma_subdomain_present(dense);
    double largest = 0.0;
    for (size_t i = 0; i < LONG; i++) {
        CHECK_NEAR(x->u[i], y->u[i], STEPS_AGREE);
        CHECK_NEAR(x->v[i], y->v[i], STEPS_AGREE);
        CHECK_NEAR(x->w[i], y->w[i], STEPS_AGREE);
        largest = fmax(largest, fabs(x->w[i]));
    }
    CHECK(largest < 100.0 && largest > 0.1); /* of order one */
    for (size_t i = 0; sprung && i < SPRING_FIELDS * SPRINGS; i++)
        CHECK_NEAR(x->springs[i], y->springs[i], STEPS_AGREE);
    pma_subdomain_destroy(narrow);
    pma_subdomain_destroy(dense);
}

static void a_subdomain_in_bands_is_stepped_as_in_dense_matrices(void)
{
    draw_numbers();
    check_narrow(false);
    check_narrow(true);
}

/* ---- several cases side by side ------------------------------------------------------------- */

/* The load of a lane: constant, sampled in two columns or in all, or none, each times its
 * number. */
static double samples[3][4 * LONG];

static pma_load load_of_lane(size_t l)
{
    double *own = samples[l % 3];
    if (l % 4 == 3)
        return (pma_load){.kind = PMA_LOAD_NONE, .n = LONG};
    if (l % 4 == 2)
        return (pma_load){.kind = PMA_LOAD_CONSTANT, .n = LONG, .values = own};
    return (pma_load){.kind = PMA_LOAD_SAMPLED,
                      .n = LONG,
                      .values = own,
                      .shape = l % 4 == 0 ? NULL : start,
                      .samples = 4,
                      .k = l % 4 == 0 ? LONG : 2,
                      .dt = l < PMA_LANES / 2 ? 0.15 : 0.1,
                      .hold = l % 2 == 0};
}

/* Lane l begins with 1 + l times the values of `start`, and lam is 1 + l. */
static void set_lane(pma_subdomain *s, size_t lane)
{
    double state[3 * LONG];
    const double lam = 1.0 + (double)lane;
    for (size_t i = 0; i < 3 * LONG; i++)
        state[i] = (1.0 + (double)lane) * start[i];
    pma_subdomain_set_load(s, load_of_lane(lane));
    pma_subdomain_start(s, state, state + LONG, state + 2 * LONG, &lam);
}

static void set_lanes(pma_subdomain *s, pma_load *each)
{
    static double state[3 * LONG * PMA_LANES], shapes[2 * LONG * PMA_LANES]; /* two columns */
    static pma_lane_term term;
    const size_t n = LONG * PMA_LANES;
    double lam[PMA_LANES];
    for (size_t k = 0; k < 3 * n; k++)
        state[k] = (1.0 + (double)(k % PMA_LANES)) * start[k / PMA_LANES];
    for (size_t l = 0; l < PMA_LANES; l++) {
        each[l] = load_of_lane(l);
        lam[l] = 1.0 + (double)l;
    }
    CHECK(pma_load_lane_terms(each) == 1);
    CHECK(pma_load_lane_shapes(each) == sizeof shapes / sizeof *shapes);
    pma_subdomain_set_load(s, pma_load_in_lanes(each, &term, shapes));
    pma_subdomain_start(s, state, state + n, state + 2 * n, lam);
}

static void walk_with(pma_subdomain *s, size_t lanes, size_t lane)
{
    const pma_member m = pma_subdomain_member(s);
    for (int64_t macro = 0; macro < MACRO_STEPS; macro++) {
        for (size_t j = 0; j < 2; j++) {
            const int64_t number = 2 * macro + (int64_t)j;
            const pma_substep step = {
                .j = j, .number = number, .t1 = 0.1 * (double)(number + 1), .twice = macro > 0};
            double lam[PMA_LANES];
            for (size_t l = 0; l < lanes; l++)
                lam[l] = (double)(lane + l) - (double)j;
            CHECK_STATUS(m.table->advance(m.self, NULL, &step, NULL, NULL), PMA_OK);
            CHECK_STATUS(m.table->advance(m.self, &step, NULL, lam, NULL), PMA_OK);
        }
        m.table->commit(m.self);
    }
}

static void check_lane(size_t count, size_t lane, const double *ours, const double *alone)
{
    double own[LONG];
    for (size_t i = 0; i < count; i++)
        own[i] = ours[i * PMA_LANES + lane];
    CHECK_BITS(count, own, alone);
}

static void check_cases(bool narrow, bool sprung)
{
    pma_load each[PMA_LANES];
    pma_subdomain *alone = make_long(narrow, sprung), *cases = NULL;
    CHECK(pma_cases_are_possible(alone));
    CHECK_STATUS(pma_cases_create(alone, &cases), PMA_OK);
    set_lanes(cases, each);
    walk_with(cases, PMA_LANES, 0);
    const pma_state *x = pma_subdomain_present(cases);
    for (size_t l = 0; l < PMA_LANES; l++) {
        pma_subdomain *one = make_long(narrow, sprung);
        set_lane(one, l);
        walk_with(one, 1, l);
        const pma_state *y = pma_subdomain_present(one);
        check_lane(LONG, l, x->u, y->u);
        check_lane(LONG, l, x->v, y->v);
        check_lane(LONG, l, x->w, y->w);
        check_lane(LONG, l, x->a, y->a);
        check_lane(sprung ? SPRING_FIELDS * SPRINGS : 0, l, x->springs, y->springs);
        pma_subdomain_destroy(one);
    }
    pma_subdomain_destroy(cases);
    pma_subdomain_destroy(alone);
}

static void every_case_in_a_lane_is_bitwise_the_subdomain_alone(void)
{
    uint64_t seed = 43;
    draw_numbers();
    for (size_t k = 0; k < 3; k++)
        draw_vector(4 * LONG, &seed, samples[k]);
    for (size_t way = 0; way < 4; way++)
        check_cases(way % 2 == 0, way / 2 == 0);
}

static void functions_are_evaluated_for_one_case_alone(void)
{
    int64_t order[LONG];
    double work[3 * LONG];
    draw_numbers();
    for (size_t i = 0; i < LONG; i++)
        order[i] = (int64_t)i;
    pma_parts parts = describe_long(true, false);
    parts.restoring = (pma_restoring){.function = pull, .n = LONG, .order = order, .work = work};
    pma_subdomain *s = NULL, *cases = NULL;
    CHECK_STATUS(pma_subdomain_create(&parts, &s), PMA_OK);
    CHECK(!pma_cases_are_possible(s));
    CHECK_STATUS(pma_cases_create(s, &cases), PMA_BAD_SIZE);
    CHECK(cases == NULL);
    pma_subdomain_destroy(s);
}

/* ---- what a coupler has to know beforehand -------------------------------------------------- */

static pma_member member_of(const pma_parts *parts)
{
    pma_subdomain *s = NULL;
    CHECK_STATUS(pma_subdomain_create(parts, &s), PMA_OK);
    const pma_member m = pma_subdomain_member(s);
    pma_subdomain_destroy(s);
    return m;
}

/* Diagonal Mbar, linear, single steps: no row waits for another. */
static void only_an_explicit_linear_subdomain_with_single_steps_is_shared(void)
{
    int64_t order[LONG];
    double work[3 * LONG];
    draw_numbers();
    for (size_t i = 0; i < LONG; i++)
        order[i] = (int64_t)i;
    pma_parts good = describe_long(true, false);
    good.doubled = false;
    good.single.factor.form = PMA_DIAGONAL;
    CHECK(member_of(&good).divides);
    pma_parts bad[6] = {good, good, good, good, good, good};
    bad[0].single.factor.form = PMA_BAND;
    bad[1].doubled = true;
    bad[2].lagged = true;
    bad[3].springs = (pma_springs){.count = 1, .sets = &SET, .total = SPRINGS};
    bad[4].restoring = (pma_restoring){.function = pull, .n = LONG, .order = order, .work = work};
    bad[5].D_r = good.C;
    for (size_t i = 0; i < 6; i++)
        CHECK(!member_of(&bad[i]).divides);
}

static void a_member_is_what_its_parts_are(void)
{
    int64_t order[LONG] = {0};
    double work[3 * LONG];
    draw_numbers();
    pma_parts parts = describe_long(true, false);
    const pma_member plain = member_of(&parts);
    CHECK_INT(plain.substeps, 2);
    CHECK(plain.h == 0.1);
    CHECK(plain.doubling == PMA_DOUBLED && plain.forces == PMA_NO_FORCES);
    parts.springs = (pma_springs){.count = 1, .sets = &SET, .total = SPRINGS};
    CHECK(member_of(&parts).entries > plain.entries);
    CHECK_INT(member_of(&parts).forces, PMA_NO_FORCES);
    parts.doubled = false;
    CHECK_INT(member_of(&parts).doubling, PMA_SINGLE);
    parts.restoring = (pma_restoring){.function = pull, .n = LONG, .order = order, .work = work};
    CHECK_INT(member_of(&parts).forces, PMA_BY_ANY);
    parts.restoring.by_caller = true;
    CHECK_INT(member_of(&parts).forces, PMA_BY_CALLER);
    parts.restoring.function = NULL;
    CHECK_INT(member_of(&parts).forces, PMA_NO_FORCES);
}

const test CASES_TESTS[] = {
    TEST(a_subdomain_in_bands_is_stepped_as_in_dense_matrices),
    TEST(every_case_in_a_lane_is_bitwise_the_subdomain_alone),
    TEST(functions_are_evaluated_for_one_case_alone),
    TEST(only_an_explicit_linear_subdomain_with_single_steps_is_shared),
    TEST(a_member_is_what_its_parts_are),
    END_OF_TESTS,
};
