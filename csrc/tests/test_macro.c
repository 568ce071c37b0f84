/* test_macro.c - macro coupling against docs/method.md 13 as written, by the naive steps. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "algebra/factor.h"
#include "algebra/lanes.h"
#include "check.h"
#include "couple/coupler.h"
#include "models.h"
#include "naive.h"
#include "solve/interface.h"
#include "subdomain/cases.h"
#include "subdomain/subdomain.h"
#include "tests.h"

enum { SS = 3 }; /* substeps of B */

/* A, implicit and damped, in one step, and B, explicit, in three; one constraint. */
typedef struct {
    subdomain A, B;
    double H[2], inverse[2]; /* of the first macro step, of the later ones */
    double U[4 * MOST];      /* response of B to a unit of multiplier, u v w a */
    int64_t row;
    pma_interface interfaces[2];
    pma_member members[2];
    pma_coupler *coupler;
} pair;

/* Time levels 1..ss under lam times j/ss from rest, or held from a level; the last one */
static level naive_substeps(const subdomain *x, bool twice, const double *F, double lam, bool ramp,
                            level from)
{
    level to;
    for (size_t j = 1; j <= x->substeps; j++) {
        const double grown = ramp ? lam * (double)j / (double)x->substeps : lam;
        naive_free(x, twice, 0.0, F, &from, &to);
        naive_close(x, twice, &grown, &from, &to);
        from = to;
    }
    return from;
}

static const double NO_FORCE[MOST] = {0.0}, FORCE[MOST] = {0.5, -1.0, 0.0};
static const level REST = {.u = {0.0}};

/* H = sum_i L_i U_i^v                                                                     (M4) */
static void fill_interface(pair *q, bool later)
{
    const level a = naive_substeps(&q->A, later && q->A.doubled, NO_FORCE, 1.0, true, REST);
    const level b = naive_substeps(&q->B, false, NO_FORCE, 1.0, true, REST);
    q->H[later] = constrained(&q->A, 0, a.v) + constrained(&q->B, 0, b.v);
    q->inverse[later] = 1.0 / q->H[later];
    memcpy(q->U, b.u, 2 * sizeof(double));
    memcpy(q->U + 2, b.v, 2 * sizeof(double));
    memcpy(q->U + 4, b.w, 2 * sizeof(double));
    memcpy(q->U + 6, b.a, 2 * sizeof(double));
}

static pma_coupler_parts describe_pair(pair *q)
{
    pma_coupler_parts parts = {
        .count = 2, .members = q->members, .p = 1, .dt = 0.3, .schedule = &pma_macro_schedule};
    for (int later = 0; later <= 1; later++) {
        const pma_factor H = {.form = PMA_DIAGONAL, .n = 1, .nb = 1, .inverse = &q->inverse[later]};
        pma_interface_destroy(&q->interfaces[later]);
        CHECK_STATUS(pma_interface_create(&H, &q->interfaces[later]), PMA_OK);
        *(later ? &parts.H : &parts.H_start) = q->interfaces[later];
    }
    return parts;
}

static void make_pair(pair *q, bool doubled, bool stored)
{
    *q = (pair){.A = {.n = 2,
                      .nb = 1,
                      .p = 1,
                      .substeps = 1,
                      .implicit = true,
                      .doubled = doubled,
                      .scheme = generalized_alpha(0.5),
                      .h = 0.3,
                      .M = {2, 0, 0, 1.5},
                      .C = {0.5, -0.25, -0.25, 0.5},
                      .K = {5, -2, -2, 4},
                      .L = {0, 1},
                      .load = {.kind = PMA_LOAD_CONSTANT, .values = FORCE}},
                .B = {.n = 2,
                      .nb = 1,
                      .p = 1,
                      .substeps = SS,
                      .has_responses = true,
                      .scheme = generalized_alpha(0.8),
                      .h = 0.3 / SS,
                      .M = {1, 0, 0, 1},
                      .C = {0.25, 0, 0, 0},
                      .K = {30, -20, -20, 30},
                      .L = {0, -1}}};
    make_subdomain(&q->A);
    make_subdomain(&q->B);
    q->members[0] = pma_subdomain_member(q->A.core);
    q->members[1] = pma_subdomain_member(q->B.core);
    fill_interface(q, false);
    fill_interface(q, true);
    if (stored)
        pma_response_store(pma_subdomain_response(q->B.core),
                           (pma_unit_responses){1, &q->row, q->U});
    const pma_coupler_parts parts = describe_pair(q);
    CHECK_STATUS(pma_coupler_create(&parts, &q->coupler), PMA_OK);
    const double at_rest[MOST] = {0.0}, w[2] = {0.25, 0.5}, lam = 0.125, g = 0.0;
    pma_subdomain_start(q->A.core, at_rest, at_rest, w, &lam);
    pma_subdomain_start(q->B.core, at_rest, at_rest, w, &lam);
    pma_coupler_start(q->coupler, 0, &lam, &g);
}

static void destroy_pair(pair *q)
{
    pma_coupler_destroy(q->coupler);
    pma_subdomain_destroy(q->A.core);
    pma_subdomain_destroy(q->B.core);
    pma_interface_destroy(&q->interfaces[0]);
    pma_interface_destroy(&q->interfaces[1]);
}

/* known + U dLam                                                                          (M5) */
static void add_response(const subdomain *x, bool twice, double dlam, level *known)
{
    const level more = naive_substeps(x, twice, NO_FORCE, dlam, true, REST);
    naive_add(x, &more, known);
}

static void check_macro_steps(bool doubled, bool stored)
{
    static pair q;
    make_pair(&q, doubled, stored);
    level a[2] = {REST, REST}, b = REST; /* A at n-1 and n */
    double lam = 0.125;
    memcpy(a[1].w, (double[2]){0.25, 0.5}, 2 * sizeof(double));
    memcpy(a[1].a, a[1].w, sizeof a[1].a);
    memcpy(b.w, a[1].w, sizeof b.w);
    memcpy(b.a, a[1].w, sizeof b.a);
    for (size_t step = 0; step < STEPS; step++) {
        const bool twice = doubled && step > 0;
        level next = naive_substeps(&q.A, twice, FORCE, lam, false, twice ? a[0] : a[1]);
        b = naive_substeps(&q.B, false, NO_FORCE, lam, false, b);
        const double jump = constrained(&q.A, 0, next.v) + constrained(&q.B, 0, b.v);
        const double dlam = -jump / q.H[step > 0];
        add_response(&q.A, twice, dlam, &next);
        add_response(&q.B, false, dlam, &b);
        lam += dlam;
        a[0] = a[1];
        a[1] = next;
        CHECK_STATUS(pma_coupler_advance(q.coupler, 1, NULL, NULL), PMA_OK);
        check_state(&q.A, pma_subdomain_present(q.A.core), &a[1]);
        check_state(&q.B, pma_subdomain_present(q.B.core), &b);
        CHECK_NEAR(pma_coupler_multipliers(q.coupler)[0], lam, AGREE);
    }
    destroy_pair(&q);
}

static void macro_steps_are_free_run_plus_link_response(void)
{
    for (int doubled = 0; doubled <= 1; doubled++) {
        check_macro_steps(doubled, false);
        check_macro_steps(doubled, true);
    }
}

/* All substeps of the responses to unit multipliers. */
static pma_unit_response *run_units(const subdomain *x, size_t count, const int64_t *rows)
{
    pma_unit_response *r;
    CHECK_STATUS(pma_unit_response_create(x->core, &r), PMA_OK);
    pma_unit_response_begin(r, false, count, rows);
    for (size_t j = 1; j <= x->substeps; j++)
        pma_unit_response_step(r, j);
    return r;
}

static void a_unit_response_gives_the_interface_matrix_and_its_mean(void)
{
    static pair q;
    make_pair(&q, false, false);
    pma_unit_response *r = run_units(&q.B, 1, (int64_t[]){0});
    const double end = pma_unit_response_end(r, 0, 0), mean = pma_unit_response_mean(r, 0, 0);
    const level b = naive_substeps(&q.B, false, NO_FORCE, 1.0, true, REST);
    CHECK_NEAR(end, constrained(&q.B, 0, b.v), AGREE);
    CHECK(mean > 0.0 && mean < end); /* far from a resonance the velocity grows */
    CHECK(pma_unit_response_is_finite(r));
    pma_unit_response_destroy(r);
    destroy_pair(&q);
}

/* ---- lagged damping, and estimates of restoring forces -------------------------------------- */

/* A has both estimates, B lagged damping, and each has restoring forces. */
static const chain ESTIMATED = {.plan = {{3, 5, 2}, false, false, true, true, true}, .macro = true};

static void internal_forces_are_refused_by_a_schedule_that_does_not_shoot(void)
{
    static model m;
    build_chain(&m, &ESTIMATED);
    const pma_coupler_parts parts = describe_coupler(&m);
    CHECK_STATUS(coupler_status(&parts), PMA_OK);
    m.members[2].has_internal = true;
    CHECK_STATUS(coupler_status(&parts), PMA_BAD_SIZE);
    destroy_model(&m);
}

static void link_responses_know_lagged_damping_and_estimates(void)
{
    chain chosen = ESTIMATED;
    for (int stored = 0; stored <= 1; stored++) {
        for (size_t threads = 1; threads <= 3; threads++) {
            chosen.stored = stored;
            chosen.threads = threads;
            check_chain(&chosen);
        }
    }
}

/* L v of all substeps of the response to one multiplier: the last one, and their mean */
static void check_unit_response(const subdomain *x, const pma_unit_response *r, size_t lane,
                                size_t unit)
{
    double sum[CONSTRAINTS] = {0.0}, state[4 * MOST];
    level at = REST;
    for (size_t j = 1; j <= x->substeps; j++) {
        const level from = at;
        double grown[CONSTRAINTS] = {0.0};
        grown[unit] = (double)j / (double)x->substeps;
        naive_link_response(x, false, grown, &from, &at);
        for (size_t row = 0; row < x->p; row++)
            sum[row] += constrained(x, row, at.v) / (double)x->substeps;
    }
    for (size_t row = 0; row < x->p; row++) {
        CHECK_NEAR(pma_unit_response_end(r, lane, (int64_t)row), constrained(x, row, at.v), AGREE);
        CHECK_NEAR(pma_unit_response_mean(r, lane, (int64_t)row), sum[row], AGREE);
    }
    pma_unit_response_copy(r, lane, state);
    check_state(
        x,
        &(pma_state){.u = state, .v = state + x->n, .w = state + 2 * x->n, .a = state + 3 * x->n},
        &at);
}

static void unit_responses_are_the_naive_ones_in_every_lane(void)
{
    static model m;
    const int64_t rows[PMA_LANES] = {1, 0, 0, 1, 0, 1, 1, 0};
    build_chain(&m, &ESTIMATED);
    for (size_t i = 0; i < m.count; i++) {
        pma_unit_response *r = run_units(&m.subdomains[i], PMA_LANES, rows);
        for (size_t l = 0; l < PMA_LANES; l++)
            check_unit_response(&m.subdomains[i], r, l, (size_t)rows[l]);
        pma_unit_response_begin(r, false, 1, rows); /* what was there is forgotten */
        for (size_t j = 1; j <= m.subdomains[i].substeps; j++)
            pma_unit_response_step(r, j);
        check_unit_response(&m.subdomains[i], r, 0, 1);
        pma_unit_response_destroy(r);
    }
    destroy_model(&m);
}

/* Stored responses are repeated for the record of inner levels alone, others always. */
static void responses_are_repeated_where_they_have_to_be(void)
{
    static model m;
    const double M[4] = {1.0, 0.0, 0.0, 1.0}, none[MOST] = {0.0};
    for (int stored = 0; stored <= 1; stored++) {
        chain chosen = ESTIMATED;
        chosen.stored = stored;
        build_chain(&m, &chosen);
        const pma_member *B = &m.members[1];
        CHECK_INT(pma_response_is_stored(pma_subdomain_response(m.subdomains[1].core)), stored);
        CHECK_INT(B->table->repeats(B->self, false), stored ? 0 : 5);
        CHECK_INT(B->table->repeats(B->self, true), stored ? 4 : 5);
        const pma_matrix mass = {.form = PMA_DENSE, .n = 2, .values = M};
        CHECK_STATUS(pma_subdomain_begin_energy(m.subdomains[1].core, mass,
                                                (pma_matrix){.form = PMA_ZERO}, none, m.lam0, NULL),
                     PMA_OK);
        CHECK_INT(B->table->repeats(B->self, false), 5); /* works want all levels */
        destroy_model(&m);
    }
}

/* Infinite times an entry of U or of Mbar^-1 that is not zero. */
static void a_link_response_that_is_not_finite_is_reported(void)
{
    static model m;
    const double lam[CONSTRAINTS] = {INFINITY, INFINITY}, one[CONSTRAINTS] = {1.0, 1.0};
    for (int stored = 0; stored <= 1; stored++) {
        chain chosen = ESTIMATED;
        chosen.stored = stored;
        build_chain(&m, &chosen);
        for (size_t i = 0; i < m.count; i++) {
            const pma_member *member = &m.members[i];
            for (size_t j = 1; j <= member->substeps; j++)
                member->table->advance_response(member->self, j, one, one);
            CHECK_STATUS(member->table->add_response(member->self, one), PMA_OK);
            for (size_t j = 1; j <= member->substeps; j++)
                member->table->advance_response(member->self, j, one, lam);
            CHECK_STATUS(member->table->add_response(member->self, lam), PMA_NOT_FINITE);
        }
        destroy_model(&m);
    }
}

/* ---- runs that are stopped, and couplers that cannot be ------------------------------------- */

static void check_same_state(const subdomain *actual, const subdomain *expected)
{
    double x[4 * MOST], y[4 * MOST];
    const size_t count = copy_present(actual, x);
    copy_present(expected, y);
    CHECK_BITS(count, x, y);
}

static void a_stopped_macro_step_leaves_the_last_whole_one(void)
{
    for (size_t stop_at = 1; stop_at <= 14; stop_at++) {
        static pair stopped, whole;
        make_pair(&stopped, true, false);
        make_pair(&whole, true, false);
        stopper stop = {0, stop_at};
        const pma_poll poll = {poll_stopper, &stop, 0};
        CHECK_STATUS(pma_coupler_advance(stopped.coupler, STEPS, NULL, &poll), PMA_STOPPED);
        const int64_t done = pma_coupler_step_count(stopped.coupler);
        CHECK_INT(done, (stop_at - 1) / (1 + 2 * SS)); /* one step of A, two times three of B */
        CHECK_STATUS(pma_coupler_advance(stopped.coupler, STEPS - done, NULL, NULL), PMA_OK);
        CHECK_STATUS(pma_coupler_advance(whole.coupler, STEPS, NULL, NULL), PMA_OK);
        check_same_state(&stopped.A, &whole.A);
        check_same_state(&stopped.B, &whole.B);
        CHECK_BITS(1, pma_coupler_multipliers(stopped.coupler),
                   pma_coupler_multipliers(whole.coupler));
        destroy_pair(&stopped);
        destroy_pair(&whole);
    }
}

static void substeps_need_a_response_and_no_double_step(void)
{
    static pair q;
    make_pair(&q, false, false);
    const pma_coupler_parts good = describe_pair(&q);
    pma_coupler *made = NULL;
    CHECK_INT(pma_coupler_instants(q.coupler), 1);
    pma_subdomain_destroy(q.B.core);
    q.B.has_responses = false;
    make_subdomain(&q.B);
    q.members[1] = pma_subdomain_member(q.B.core);
    CHECK_STATUS(pma_coupler_create(&good, &made), PMA_BAD_SIZE);
    pma_subdomain_destroy(q.B.core);
    q.B.has_responses = q.B.doubled = true;
    make_subdomain(&q.B);
    q.members[1] = pma_subdomain_member(q.B.core);
    CHECK_STATUS(pma_coupler_create(&good, &made), PMA_BAD_SIZE);
    destroy_pair(&q);
}

const test MACRO_TESTS[] = {
    TEST(internal_forces_are_refused_by_a_schedule_that_does_not_shoot),
    TEST(macro_steps_are_free_run_plus_link_response),
    TEST(a_unit_response_gives_the_interface_matrix_and_its_mean),
    TEST(link_responses_know_lagged_damping_and_estimates),
    TEST(unit_responses_are_the_naive_ones_in_every_lane),
    TEST(responses_are_repeated_where_they_have_to_be),
    TEST(a_link_response_that_is_not_finite_is_reported),
    TEST(a_stopped_macro_step_leaves_the_last_whole_one),
    TEST(substeps_need_a_response_and_no_double_step),
    END_OF_TESTS,
};
