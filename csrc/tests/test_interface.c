/* test_interface.c - the interface problem behind its table: factors, and another solver. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "algebra/factor.h"
#include "check.h"
#include "coupling/coupler.h"
#include "coupling/interface.h"
#include "matrices.h"
#include "models.h"
#include "naive.h"
#include "tests.h"

/* ---- H = R D R^T ---------------------------------------------------------------------------- */

static void check_refused(const pma_factor *H, pma_status expected)
{
    double unused = 1.0;
    pma_ldl ldl = {.work = &unused};
    CHECK_STATUS(pma_ldl_create(H, &ldl), expected);
    CHECK(ldl.work == NULL);
    pma_ldl_destroy(&ldl); /* an empty one is allowed */
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
    pma_ldl ldl;
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
    CHECK_STATUS(pma_ldl_create(H, &ldl), PMA_OK);
    const pma_interface interface = pma_ldl_interface(&ldl);
    CHECK_INT(interface.p, t->n);
    CHECK_INT(interface.entries, 2 * pma_factor_entries(H));
    interface.table->solve(interface.self, x);
    for (size_t i = 0; i < t->n; i++)
        CHECK_NEAR(x[i], expected[i], SOLVED);
    pma_ldl_destroy(&ldl);
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

/* ---- another solver ------------------------------------------------------------------------- */

/* The matrix itself, eliminated anew every time. */
typedef struct {
    size_t p, solves;
    const double *H; /* p*p */
} dense;

static void solve_dense(void *self, double *x)
{
    dense *d = self;
    d->solves++;
    naive_solve(d->p, d->H, x);
}

static const pma_interface_table DENSE = {.solve = solve_dense};

static void check_dense_interface(const chain *chosen)
{
    static model m;
    static tape t;
    build_chain(&m, chosen);
    dense start = {.p = m.p, .H = m.H[0]}, later = {.p = m.p, .H = m.H[1]};
    pma_coupler_parts parts = describe_coupler(&m);
    parts.H_start = (pma_interface){&DENSE, &start, m.p, 4};
    parts.H = (pma_interface){&DENSE, &later, m.p, 4};
    pma_coupler_destroy(m.coupler);
    CHECK_STATUS(pma_coupler_create(&parts, &m.coupler), PMA_OK);
    start_model(&m);
    make_tape(&t, &m, 0, 0);
    run_taped(&m, &t, STEPS);
    naive_run(&m, STEPS);
    check_against_naive(&m, &t, STEPS);
    CHECK_INT(start.solves, m.fine);
    CHECK_INT(later.solves, (STEPS - 1) * m.fine);
    destroy_model(&m);
}

static void a_run_with_another_interface_solver_is_the_same_run(void)
{
    const chain pm = {.plan = MIXED}, gc = {.plan = {{1, 6, 2}, false, false, true, true, false}};
    const chain macro = {.plan = {{1, 3, 4}, true, false, true, true, false}, .macro = true};
    check_dense_interface(&pm);
    check_dense_interface(&gc);
    check_dense_interface(&macro);
}

const test INTERFACE_TESTS[] = {
    TEST(an_interface_factor_with_unknowns_inside_is_refused),
    TEST(an_interface_factor_with_a_bad_index_is_refused),
    TEST(an_interface_factor_of_any_form_solves),
    TEST(a_run_with_another_interface_solver_is_the_same_run),
    END_OF_TESTS,
};
