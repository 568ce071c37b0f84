/* test_lu.c - sweeps over factors of an unsymmetric matrix, part of whose unknowns are wanted. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "algebra/lu.h"
#include "check.h"
#include "coupling/interface.h"
#include "naive.h"
#include "tests.h"

enum { N = 5 };

/* Full random triangles by columns; L and U are dense here and may be read as sparse. */
typedef struct {
    double inverse[N], L[N * N], U[N * N];
    int64_t below[N + 1], above[N + 1];
    int32_t lower[N * N], upper[N * N], row[N], column[N];
    pma_lu factor;
} triangles;

static void make(triangles *t, size_t p, uint64_t *seed)
{
    t->below[0] = t->above[0] = 0;
    for (size_t j = 0; j < N; j++) {
        int64_t low = t->below[j], high = t->above[j];
        t->inverse[j] = 1.0 / (2.0 + draw_eighth(seed));
        for (size_t i = 0; i < N; i++) {
            if (i > j && draw(seed, 5) > 0) {
                t->lower[low] = (int32_t)i;
                t->L[low++] = 0.5 * draw_eighth(seed);
            } else if (i < j && draw(seed, 5) > 0) {
                t->upper[high] = (int32_t)i;
                t->U[high++] = 0.5 * draw_eighth(seed);
            }
        }
        t->below[j + 1] = low;
        t->above[j + 1] = high;
    }
    for (size_t k = 0; k < p; k++) {
        t->row[k] = (int32_t)((3 * k + 1) % N);
        t->column[k] = (int32_t)((2 * k + 4) % N);
    }
    t->factor = (pma_lu){N,        p,        t->inverse, t->below, t->lower, t->L,
                         t->above, t->upper, t->U,       t->row,   t->column};
}

/* y := L U x, by the definition */
static void multiply(const triangles *t, const double *x, double *y)
{
    double z[N];
    for (size_t i = 0; i < N; i++)
        z[i] = x[i] / t->inverse[i];
    for (size_t j = 0; j < N; j++) {
        for (int64_t k = t->above[j]; k < t->above[j + 1]; k++)
            z[t->upper[k]] += t->U[k] * x[j];
    }
    memcpy(y, z, sizeof z);
    for (size_t j = 0; j < N; j++) {
        for (int64_t k = t->below[j]; k < t->below[j + 1]; k++)
            y[t->lower[k]] += t->L[k] * z[j];
    }
}

/* 1e-12: five unknowns with entries of order one, and a condition far below 1e4 */
static void a_solution_is_that_of_the_product_of_the_factors(void)
{
    uint64_t seed = 7;
    for (size_t p = 0; p <= N; p++) {
        triangles t;
        double x[N], right[N], work[N], wanted[N];
        make(&t, p, &seed);
        for (size_t k = 0; k < p; k++)
            wanted[k] = draw_eighth(&seed);
        /* the whole solution, with unit places: row k of L belongs to unknown k */
        memset(right, 0, sizeof right);
        for (size_t k = 0; k < p; k++)
            right[t.row[k]] = wanted[k];
        memcpy(x, right, sizeof x);
        pma_lu whole = t.factor;
        const int32_t in_turn[N] = {0, 1, 2, 3, 4};
        whole.p = N;
        whole.row = whole.column = in_turn;
        pma_lu_solve(&whole, x, work);
        double product[N];
        multiply(&t, x, product);
        for (size_t i = 0; i < N; i++)
            CHECK_NEAR(product[i], right[i], 1e-12);
        /* the wanted part of it */
        pma_lu_solve(&t.factor, wanted, work);
        for (size_t k = 0; k < p; k++)
            CHECK_NEAR(wanted[k], x[t.column[k]], 0.0);
        CHECK_INT((long long)pma_lu_entries(&t.factor),
                  (long long)(N + (size_t)t.below[N] + (size_t)t.above[N]));
    }
}

static void check_refused(const pma_lu *f, pma_status expected)
{
    double unused = 1.0;
    pma_interface S_mu = {.work = &unused};
    CHECK_STATUS(pma_interface_create_lu(f, &S_mu), expected);
    CHECK_INT(S_mu.work != NULL, expected == PMA_OK);
    pma_interface_destroy(&S_mu);
}

static void factors_that_are_no_triangles_are_refused(void)
{
    uint64_t seed = 11;
    triangles t;
    make(&t, N, &seed);
    check_refused(&t.factor, PMA_OK);
    pma_lu bad = t.factor;
    bad.p = N + 1;
    check_refused(&bad, PMA_BAD_SIZE);
    bad = t.factor;
    bad.lower = t.upper; /* above the diagonal */
    check_refused(&bad, PMA_BAD_INDEX);
    const int32_t outside[N] = {0, 1, N, 2, 3}, negative[N] = {0, -1, 2, 3, 4};
    bad = t.factor;
    bad.row = outside;
    check_refused(&bad, PMA_BAD_INDEX);
    bad = t.factor;
    bad.column = negative;
    check_refused(&bad, PMA_BAD_INDEX);
    const int64_t falling[N + 1] = {0, 3, 2, 2, 2, 2}, late[N + 1] = {1, 1, 1, 1, 1, 1};
    bad = t.factor;
    bad.below = falling;
    check_refused(&bad, PMA_BAD_INDEX);
    bad.below = late;
    check_refused(&bad, PMA_BAD_INDEX);
}

const test LU_TESTS[] = {
    TEST(a_solution_is_that_of_the_product_of_the_factors),
    TEST(factors_that_are_no_triangles_are_refused),
    END_OF_TESTS,
};
