/* test_interface.c - the interface problem, by a factor of any form. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "algebra/factor.h"
#include "check.h"
#include "matrices.h"
#include "naive.h"
#include "solve/interface.h"
#include "tests.h"

/* ---- H = R D R^T ---------------------------------------------------------------------------- */

static void check_refused(const pma_factor *H, pma_status expected)
{
    double unused = 1.0;
    pma_interface interface = {.work = &unused};
    CHECK_STATUS(pma_interface_create(H, &interface), expected);
    CHECK(interface.work == NULL);
    pma_interface_destroy(&interface); /* an empty one is allowed */
}

static void an_interface_factor_with_unknowns_inside_is_refused(void)
{
    const double ones[4] = {1.0, 1.0, 1.0, 1.0};
    for (size_t nb = 0; nb <= 3; nb++) {
        const pma_factor H = {.form = PMA_DENSE, .n = 2, .nb = nb, .inverse = ones, .values = ones};
        if (nb != 2)
            check_refused(&H, PMA_BAD_SIZE);
    }
}

static void an_interface_factor_with_a_bad_index_is_refused(void)
{
    const double ones[2] = {1.0, 1.0};
    const int64_t ptr[3] = {0, 1, 1};
    for (int32_t index = -1; index <= 2; index++) {
        const pma_factor H = {.form = PMA_SPARSE,
                              .n = 2,
                              .nb = 2,
                              .inverse = ones,
                              .values = ones,
                              .ptr = ptr,
                              .index = &index};
        if (index != 1)
            check_refused(&H, PMA_BAD_INDEX);
    }
}

/* Condition of R D R^T below 1e4 for R in eighths and D from 1/4 to 4: 1e4 eps and some. */
static const double SOLVED = 1e-10;

static void check_solve(const triple *t, const pma_factor *H, uint64_t *seed)
{
    double A[SIZE * SIZE], x[SIZE], expected[SIZE];
    pma_interface interface;
    for (size_t i = 0; i < t->n; i++) {
        for (size_t j = 0; j < t->n; j++) {
            A[i * t->n + j] = 0.0;
            for (size_t k = 0; k < t->n; k++)
                A[i * t->n + j] += t->R[i * t->n + k] * t->D[k] * t->R[j * t->n + k];
        }
    }
    draw_vector(t->n, seed, x);
    memcpy(expected, x, sizeof x);
    naive_solve(t->n, A, expected);
    CHECK_STATUS(pma_interface_create(H, &interface), PMA_OK);
    CHECK_INT(interface.p, t->n);
    CHECK_INT(interface.entries, 2 * pma_factor_entries(H));
    pma_interface_solve(&interface, x);
    for (size_t i = 0; i < t->n; i++)
        CHECK_NEAR(x[i], expected[i], SOLVED);
    pma_interface_destroy(&interface);
}

static void an_interface_factor_of_any_form_solves(void)
{
    uint64_t seed = 23;
    for (size_t n = 1; n <= 5; n++) {
        const triple t = make_triple(n, 0.6, &seed), d = make_triple(n, 0.0, &seed);
        const pma_factor dense = {
            .form = PMA_DENSE, .n = n, .nb = n, .inverse = t.inverse, .values = t.columns};
        const pma_factor sparse = {.form = PMA_SPARSE,
                                   .n = n,
                                   .nb = n,
                                   .inverse = t.inverse,
                                   .values = t.sparse.values,
                                   .ptr = t.sparse.ptr,
                                   .index = t.sparse.index};
        const pma_factor diagonal = {.form = PMA_DIAGONAL, .n = n, .nb = n, .inverse = d.inverse};
        check_solve(&t, &dense, &seed);
        check_solve(&t, &sparse, &seed);
        check_solve(&d, &diagonal, &seed);
    }
}

const test INTERFACE_TESTS[] = {
    TEST(an_interface_factor_with_unknowns_inside_is_refused),
    TEST(an_interface_factor_with_a_bad_index_is_refused),
    TEST(an_interface_factor_of_any_form_solves),
    END_OF_TESTS,
};
