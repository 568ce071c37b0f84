/* test_macro.c - macro coupling against docs/method.md 13 as written, by the naive steps. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "algebra/factor.h"
#include "check.h"
#include "coupling/coupler.h"
#include "coupling/record.h"
#include "member/subdomain.h"
#include "models.h"
#include "naive.h"
#include "tests.h"

enum { SS = 3 }; /* substeps of B */

/* A, implicit and damped, in one step, and B, explicit, in three; one condition. */
typedef struct {
    part A, B;
    double H[2], inverse[2]; /* of the first macro step, of the later ones */
    double U[4 * MOST];      /* response of B to a unit of multiplier, u v w a */
    int64_t row;
    pma_subdomain *subdomains[2];
    pma_coupler *coupler;
} pair;

/* Own nodes 1..ss under lam times j/ss from rest, or held from a node; the last one */
static node naive_own_steps(const part *x, bool twice, const double *F, double lam, bool ramp,
                            node from)
{
    node to;
    for (size_t j = 1; j <= x->substeps; j++) {
        const double own = ramp ? lam * (double)j / (double)x->substeps : lam;
        naive_free(x, twice, 0.0, F, &from, &to);
        naive_close(x, twice, &own, &from, &to);
        from = to;
    }
    return from;
}

static const double NO_FORCE[MOST] = {0.0}, FORCE[MOST] = {0.5, -1.0, 0.0};
static const node REST = {{0.0}, {0.0}, {0.0}, {0.0}, {0.0}};

/* H = sum_i L_i U_i^v                                                                     (M4) */
static void fill_interface(pair *q, bool later)
{
    const node a = naive_own_steps(&q->A, later && q->A.doubled, NO_FORCE, 1.0, true, REST);
    const node b = naive_own_steps(&q->B, false, NO_FORCE, 1.0, true, REST);
    q->H[later] = conditioned(&q->A, 0, a.v) + conditioned(&q->B, 0, b.v);
    q->inverse[later] = 1.0 / q->H[later];
    memcpy(q->U, b.u, 2 * sizeof(double));
    memcpy(q->U + 2, b.v, 2 * sizeof(double));
    memcpy(q->U + 4, b.w, 2 * sizeof(double));
    memcpy(q->U + 6, b.a, 2 * sizeof(double));
}

static pma_coupler_parts describe_pair(pair *q)
{
    pma_coupler_parts parts = {.count = 2, .subdomains = q->subdomains, .p = 1, .dt = 0.3,
                               .macro = true};
    for (int later = 0; later <= 1; later++)
        *(later ? &parts.H : &parts.H_start) =
            (pma_factor){.form = PMA_DIAGONAL, .n = 1, .nb = 1, .inverse = &q->inverse[later]};
    return parts;
}

static void make_pair(pair *q, bool doubled, bool stored)
{
    *q = (pair){
        .A = {.n = 2, .nb = 1, .p = 1, .substeps = 1, .implicit = true, .doubled = doubled,
              .scheme = generalized_alpha(0.5), .h = 0.3, .M = {2, 0, 0, 1.5},
              .C = {0.5, -0.25, -0.25, 0.5}, .K = {5, -2, -2, 4}, .L = {0, 1},
              .load = {.kind = PMA_LOAD_CONSTANT, .values = FORCE}},
        .B = {.n = 2, .nb = 1, .p = 1, .substeps = SS, .ramped = true,
              .scheme = generalized_alpha(0.8), .h = 0.3 / SS, .M = {1, 0, 0, 1},
              .C = {0.25, 0, 0, 0}, .K = {30, -20, -20, 30}, .L = {0, -1}}};
    make_part(&q->A);
    make_part(&q->B);
    q->subdomains[0] = q->A.core;
    q->subdomains[1] = q->B.core;
    fill_interface(q, false);
    fill_interface(q, true);
    if (stored)
        pma_subdomain_set_response(q->B.core, (pma_response){1, &q->row, q->U});
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
}

/* known + U dLam                                                                          (M5) */
static void add_response(const part *x, bool twice, double dlam, node *known)
{
    const node more = naive_own_steps(x, twice, NO_FORCE, dlam, true, REST);
    for (size_t i = 0; i < x->n; i++) {
        known->u[i] += more.u[i];
        known->v[i] += more.v[i];
        known->w[i] += more.w[i];
        known->a[i] += more.a[i];
    }
}

static void check_macro_steps(bool doubled, bool stored)
{
    static pair q;
    make_pair(&q, doubled, stored);
    node a[2] = {REST, REST}, b = REST; /* A at n-1 and n */
    double lam = 0.125;
    memcpy(a[1].w, (double[2]){0.25, 0.5}, 2 * sizeof(double));
    memcpy(a[1].a, a[1].w, sizeof a[1].a);
    memcpy(b.w, a[1].w, sizeof b.w);
    memcpy(b.a, a[1].w, sizeof b.a);
    for (size_t step = 0; step < STEPS; step++) {
        const bool twice = doubled && step > 0;
        node next = naive_own_steps(&q.A, twice, FORCE, lam, false, twice ? a[0] : a[1]);
        b = naive_own_steps(&q.B, false, NO_FORCE, lam, false, b);
        const double jump = conditioned(&q.A, 0, next.v) + conditioned(&q.B, 0, b.v);
        const double dlam = -jump / q.H[step > 0];
        add_response(&q.A, twice, dlam, &next);
        add_response(&q.B, false, dlam, &b);
        lam += dlam;
        a[0] = a[1];
        a[1] = next;
        CHECK_STATUS(pma_coupler_advance(q.coupler, 1, NULL, NULL), PMA_OK);
        check_state(&q.A, pma_subdomain_at(q.A.core, 0), &a[1]);
        check_state(&q.B, pma_subdomain_at(q.B.core, 0), &b);
        CHECK_NEAR(pma_coupler_multipliers(q.coupler)[0], lam, AGREE);
    }
    destroy_pair(&q);
}

static void macro_steps_are_known_run_plus_response(void)
{
    for (int doubled = 0; doubled <= 1; doubled++) {
        check_macro_steps(doubled, false);
        check_macro_steps(doubled, true);
    }
}

static void a_ramp_gives_the_interface_matrix_and_its_mean(void)
{
    static pair q;
    make_pair(&q, false, false);
    const double unit = 1.0;
    double end = 0.0, mean = 0.0;
    CHECK_STATUS(pma_subdomain_ramp(q.B.core, &unit, &end, &mean), PMA_OK);
    const node b = naive_own_steps(&q.B, false, NO_FORCE, 1.0, true, REST);
    CHECK_NEAR(end, conditioned(&q.B, 0, b.v), AGREE);
    CHECK(mean > 0.0 && mean < end); /* far from a resonance the velocity grows */
    destroy_pair(&q);
}

static void a_stopped_macro_step_leaves_the_last_whole_one(void)
{
    for (size_t stop_at = 1; stop_at <= 14; stop_at++) {
        static pair stopped, whole;
        make_pair(&stopped, true, false);
        make_pair(&whole, true, false);
        asker asked = {0, stop_at};
        const pma_poll poll = {ask, &asked, 0};
        CHECK_STATUS(pma_coupler_advance(stopped.coupler, STEPS, NULL, &poll), PMA_STOPPED);
        const int64_t done = pma_coupler_step_count(stopped.coupler);
        CHECK_INT(done, (stop_at - 1) / (1 + 2 * SS)); /* one step of A, two times three of B */
        CHECK_STATUS(pma_coupler_advance(stopped.coupler, STEPS - done, NULL, NULL), PMA_OK);
        CHECK_STATUS(pma_coupler_advance(whole.coupler, STEPS, NULL, NULL), PMA_OK);
        CHECK_BITS(2, pma_subdomain_at(stopped.B.core, 0)->u, pma_subdomain_at(whole.B.core, 0)->u);
        CHECK_BITS(2, pma_subdomain_at(stopped.A.core, 0)->u, pma_subdomain_at(whole.A.core, 0)->u);
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
    q.B.ramped = false;
    make_part(&q.B);
    q.subdomains[1] = q.B.core;
    CHECK_STATUS(pma_coupler_create(&good, &made), PMA_BAD_SIZE);
    pma_subdomain_destroy(q.B.core);
    q.B.ramped = q.B.doubled = true;
    make_part(&q.B);
    q.subdomains[1] = q.B.core;
    CHECK_STATUS(pma_coupler_create(&good, &made), PMA_BAD_SIZE);
    destroy_pair(&q);
}

const test MACRO_TESTS[] = {
    TEST(macro_steps_are_known_run_plus_response),
    TEST(a_ramp_gives_the_interface_matrix_and_its_mean),
    TEST(a_stopped_macro_step_leaves_the_last_whole_one),
    TEST(substeps_need_a_response_and_no_double_step),
    END_OF_TESTS,
};
