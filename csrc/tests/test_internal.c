/* test_internal.c - internal forces by hand: order of dofs, several functions, histories, codes. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "check.h"
#include "forces/internal.h"
#include "naive.h"
#include "subdomain/subdomain.h"
#include "tests.h"

enum { N = 3, ENTRIES = 4 };

/* What a function was given, and what it is to come back with. */
typedef struct {
    size_t calls, entries;
    double t, u[N], v[N], q[2], f[N], K[ENTRIES], C[ENTRIES], q1[2]; /* as they arrived */
    bool tangent;
    int code;
} witness;

/* f_k = 10 u_k + v_k, K = 1, 2, .., C = 100, 200, .., q1 = q + 1; then all copies are spoilt */
static int testify(double t, intptr_t n, double *u, double *v, double *q, double *f, double *K,
                   double *C, double *q1, void *user)
{
    witness *w = user;
    w->calls++;
    w->t = t;
    w->tangent = K && C;
    CHECK_INT(n, N);
    CHECK((K != NULL) == (C != NULL));
    memcpy(w->u, u, sizeof w->u);
    memcpy(w->v, v, sizeof w->v);
    memcpy(w->q, q, sizeof w->q);
    memcpy(w->f, f, sizeof w->f);
    memcpy(w->q1, q1, sizeof w->q1);
    for (size_t i = 0; K && i < w->entries; i++) {
        w->K[i] = K[i];
        w->C[i] = C[i];
        K[i] = (double)(i + 1);
        C[i] = 100.0 * (double)(i + 1);
    }
    for (intptr_t i = 0; i < n; i++) {
        f[i] = 10.0 * u[i] + v[i];
        u[i] = v[i] = NAN;
    }
    for (size_t i = 0; i < 2; i++) {
        q1[i] = q[i] + 1.0;
        q[i] = NAN;
    }
    return w->code;
}

static const double ZERO[ENTRIES] = {0.0};
static const int64_t ORDER[N] = {2, 0, 1}; /* the user's dof of each of ours */

/* Two functions, with two numbers of history each and patterns that overlap. */
typedef struct {
    witness saw[2];
    int64_t where[2][ENTRIES];
    pma_internal_force forces[2];
    pma_internal internal;
    double u[N], v[N], q[4], f[N], q1[4], tangent[6], scratch[64];
} bench;

static void set_up(bench *b)
{
    *b = (bench){.saw = {{.entries = 4}, {.entries = 2}},
                 .where = {{0, 2, 5, 2}, {5, 1}},
                 .u = {1, 2, 3},
                 .v = {4, 5, 6},
                 .q = {7, 8, 9, 10},
                 .f = {1000, 2000, 3000},
                 .tangent = {0.5, 0.5, 0.5, 0.5, 0.5, 0.5}};
    for (size_t k = 0; k < 2; k++)
        b->forces[k] = (pma_internal_force){.function = testify,
                                            .user = &b->saw[k],
                                            .history = 2,
                                            .entries = b->saw[k].entries,
                                            .where = b->where[k]};
    b->internal = (pma_internal){
        .n = N, .count = 2, .history = 4, .forces = b->forces, .order = ORDER, .initial = b->q};
    CHECK_STATUS(pma_internal_check(&b->internal, 6), PMA_OK);
    for (size_t i = 0; i < 64; i++)
        b->scratch[i] = i < pma_internal_scratch(&b->internal) ? (double)NAN : 7.0;
}

static pma_status evaluate_with(bench *b, double *q1, double *tangent, double *stiffness, int *code)
{
    const pma_internal_point at = {.t = 0.25, .u = b->u, .v = b->v, .q = b->q};
    const pma_internal_values out = {
        .f = b->f, .q1 = q1, .al1 = 2.0, .al2 = 0.125, .tangent = tangent, .stiffness = stiffness};
    return pma_internal_evaluate(&b->internal, &at, &out, b->scratch, code);
}

/* Nothing is written beyond the scratch. */
static pma_status evaluate(bench *b, double *q1, double *tangent, int *code)
{
    const pma_status status = evaluate_with(b, q1, tangent, NULL, code);
    for (size_t i = pma_internal_scratch(&b->internal); i < 64; i++)
        CHECK(b->scratch[i] == 7.0);
    return status;
}

static void internal_forces_are_evaluated_in_the_order_of_the_user_and_added(void)
{
    bench b;
    int code = 99;
    set_up(&b);
    CHECK_STATUS(evaluate(&b, b.q1, b.tangent, &code), PMA_OK);
    CHECK_INT(code, 0);
    for (size_t k = 0; k < 2; k++) {
        const witness *w = &b.saw[k];
        CHECK_INT(w->calls, 1);
        CHECK(w->tangent && w->t == 0.25);
        CHECK_BITS(N, w->u, ((double[]){2, 3, 1}));
        CHECK_BITS(N, w->v, ((double[]){5, 6, 4}));
        CHECK_BITS(2, w->q, b.q + 2 * k);
        CHECK_BITS(2, w->q1, b.q + 2 * k);
        CHECK_BITS(N, w->f, ZERO);
        CHECK_BITS(w->entries, w->K, ZERO);
        CHECK_BITS(w->entries, w->C, ZERO);
    }
    CHECK_BITS(N, b.u, ((double[]){1, 2, 3})); /* they had copies */
    CHECK_BITS(N, b.v, ((double[]){4, 5, 6}));
    CHECK_BITS(4, b.q, ((double[]){7, 8, 9, 10}));
    CHECK_BITS(N, b.f, ((double[]){1028, 2050, 3072})); /* twice 10 u + v */
    CHECK_BITS(4, b.q1, ((double[]){8, 9, 10, 11}));
    /* 2 K + C / 8 = 14.5 (i + 1): {1}, {2'}, {2 + 4}, -, -, {3 + 1'} */
    CHECK_BITS(6, b.tangent, ((double[]){15, 29.5, 87.5, 0.5, 0.5, 58.5}));
}

static void the_stiffness_is_added_by_itself_too(void)
{
    bench b;
    int code;
    double stiffness[6] = {1.0};
    set_up(&b);
    CHECK_STATUS(evaluate_with(&b, b.q1, b.tangent, stiffness, &code), PMA_OK);
    CHECK_BITS(6, stiffness, ((double[]){2, 2, 6, 0, 0, 4})); /* K = i + 1, the first one added */
    CHECK_BITS(6, b.tangent, ((double[]){15, 29.5, 87.5, 0.5, 0.5, 58.5}));
}

static void without_a_tangent_functions_are_given_none_and_histories_may_be_in_place(void)
{
    bench b;
    int code;
    set_up(&b);
    CHECK_STATUS(evaluate(&b, b.q, NULL, &code), PMA_OK);
    CHECK(!b.saw[0].tangent && !b.saw[1].tangent);
    CHECK_BITS(4, b.q, ((double[]){8, 9, 10, 11}));
    CHECK_BITS(N, b.f, ((double[]){1028, 2050, 3072}));
}

/* The second one is not called after the first, and no history goes on. */
static void a_code_other_than_zero_ends_the_evaluation(void)
{
    for (size_t k = 0; k < 2; k++) {
        bench b;
        int code = 0;
        set_up(&b);
        b.saw[k].code = -5 - (int)k;
        b.q1[0] = b.q1[3] = 0.5;
        CHECK_STATUS(evaluate(&b, b.q1, b.tangent, &code), PMA_INTERNAL_FAILED);
        CHECK_INT(code, -5 - (int)k);
        CHECK_INT(b.saw[1].calls, k);
        CHECK(b.q1[0] == 0.5 && b.q1[3] == 0.5);
    }
}

static void where_there_is_no_function_nothing_is_needed(void)
{
    const pma_internal none = {.n = N};
    double f[N] = {1, 2, 3};
    int code = 3;
    CHECK_STATUS(pma_internal_check(&none, 0), PMA_OK);
    CHECK_INT(pma_internal_scratch(&none), 0);
    const pma_internal_point at = {.u = f, .v = f};
    const pma_internal_values out = {.f = f};
    CHECK_STATUS(pma_internal_evaluate(&none, &at, &out, NULL, &code), PMA_OK);
    CHECK_BITS(N, f, ((double[]){1, 2, 3}));
}

static void positions_dofs_and_histories_that_do_not_fit_are_refused(void)
{
    const int64_t low[N] = {-1, 0, 1}, high[N] = {0, 1, 3};
    bench b;
    set_up(&b);
    CHECK_STATUS(pma_internal_check(&b.internal, 5), PMA_BAD_INDEX);
    b.where[1][1] = -1;
    CHECK_STATUS(pma_internal_check(&b.internal, 6), PMA_BAD_INDEX);
    set_up(&b);
    b.internal.order = low;
    CHECK_STATUS(pma_internal_check(&b.internal, 6), PMA_BAD_INDEX);
    b.internal.order = high;
    CHECK_STATUS(pma_internal_check(&b.internal, 6), PMA_BAD_INDEX);
    set_up(&b);
    b.internal.history = 3;
    CHECK_STATUS(pma_internal_check(&b.internal, 6), PMA_BAD_SIZE);
    b.internal.history = 5;
    CHECK_STATUS(pma_internal_check(&b.internal, 6), PMA_BAD_SIZE);
}

const test INTERNAL_TESTS[] = {
    TEST(internal_forces_are_evaluated_in_the_order_of_the_user_and_added),
    TEST(the_stiffness_is_added_by_itself_too),
    TEST(without_a_tangent_functions_are_given_none_and_histories_may_be_in_place),
    TEST(a_code_other_than_zero_ends_the_evaluation),
    TEST(where_there_is_no_function_nothing_is_needed),
    TEST(positions_dofs_and_histories_that_do_not_fit_are_refused),
    END_OF_TESTS,
};
