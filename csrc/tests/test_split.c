/* test_split.c - one large explicit subdomain by all workers: bitwise what it is by one. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>

#include "check.h"
#include "couple/coupler.h"
#include "couple/inside.h"
#include "naive.h"
#include "solve/interface.h"
#include "subdomain/subdomain.h"
#include "tests.h"
#include "workers/roster.h"

/* Dofs of a banded B, of a dense one and of A: B reads four ranges at least, and A, with double
 * steps, more in one substep than B in two. */
enum { BANDED = 4 * PMA_RANGE / 18, WIDTH = 3, DENSE = 650, COARSE = 660, FINER = 6, SPAN = 4 };
enum { MOST_THREADS = 4, CONSTRAINTS = 2, FACE = 400 };

/* B large and explicit; with others A implicit with double steps and C one mass, which B is tied to
 * by its last dof and by the first of its interface. That is longer than a range of a dense B. */
typedef struct {
    size_t count, n;
    bool banded;
    double *K_A, *R_A, *inverse_A, *K, *inverse, *load, *scratch;
    double lam0[CONSTRAINTS], H[CONSTRAINTS * CONSTRAINTS], inverse_H[CONSTRAINTS];
    int64_t ptr_A[2], ptr[FACE + 1], ptr_C[2];
    int32_t row_A[1], rows[2], row_C[1];
    double one[2], minus_one[1], K_C[1], inverse_C[1];
    pma_subdomain *subdomains[3]; /* B, A, C */
    pma_member members[3];
    pma_interface H_factor;
    pma_coupler *coupler;
} large;

static double *random_numbers(size_t count, uint64_t *seed, double scale)
{
    double *x = malloc(count * sizeof *x);
    for (size_t i = 0; i < count; i++)
        x[i] = scale * draw_eighth(seed);
    return x;
}

static const pma_scheme SCHEME = {.am = 0.0, .af = 0.0, .beta = 0.25, .gamma = 0.5};

static void start(pma_subdomain *s, size_t n, large *m, uint64_t *seed)
{
    double *state = random_numbers(3 * n, seed, 1.0);
    pma_subdomain_start(s, state, state + n, state + 2 * n, m->lam0);
    free(state);
}

static void make_B(large *m, uint64_t *seed)
{
    const size_t n = m->n, entries = m->banded ? (WIDTH + 1) * n : n * n;
    m->K = random_numbers(entries, seed, 1.0);
    m->inverse = malloc(n * sizeof *m->inverse);
    m->load = random_numbers(n, seed, 1.0);
    for (size_t i = 0; i < n; i++)
        m->inverse[i] = 1.0 / (1.0 + (double)(i % 7));
    m->ptr[0] = 0;
    for (size_t i = 0; i < FACE; i++)
        m->ptr[i + 1] = i + 1 < FACE ? 1 : 2;
    m->rows[0] = 1;
    m->rows[1] = 0;
    m->one[0] = m->one[1] = 1.0;
    const bool tied = m->count > 1;
    const pma_parts parts = {
        .n = n,
        .nb = tied ? FACE : 0,
        .substeps = FINER,
        .K = {.form = m->banded ? PMA_BAND : PMA_DENSE, .n = n, .values = m->K, .width = WIDTH},
        .C = {.form = PMA_DIAGONAL, .n = n, .values = m->inverse},
        .single = {pma_step_make(SCHEME, 1e-2),
                   {.form = PMA_DIAGONAL, .n = n, .nb = tied ? FACE : 0, .inverse = m->inverse}},
        .link = {tied ? CONSTRAINTS : 0, tied ? FACE : 0, m->ptr, m->rows, m->one, NULL}};
    CHECK_STATUS(pma_subdomain_create(&parts, &m->subdomains[0]), PMA_OK);
    CHECK(pma_subdomain_member(m->subdomains[0]).divides);
    pma_subdomain_set_load(m->subdomains[0],
                           (pma_load){.kind = PMA_LOAD_CONSTANT, .n = n, .values = m->load});
    start(m->subdomains[0], n, m, seed);
}

/* Mbar = R R^T, whatever mass it belongs to. */
static void make_A(large *m, uint64_t *seed)
{
    const size_t n = COARSE;
    m->K_A = random_numbers(n * n, seed, 1e-2);
    m->R_A = random_numbers(n * n, seed, 1e-3);
    m->inverse_A = malloc(n * sizeof *m->inverse_A);
    for (size_t i = 0; i < n; i++)
        m->inverse_A[i] = 1.0;
    m->ptr_A[0] = 0;
    m->ptr_A[1] = 1;
    m->row_A[0] = 0;
    m->minus_one[0] = -1.0;
    const pma_factor factor = {
        .form = PMA_DENSE, .n = n, .nb = 1, .inverse = m->inverse_A, .values = m->R_A};
    const pma_parts parts = {.n = n,
                             .nb = 1,
                             .substeps = 1,
                             .doubled = true,
                             .K = {.form = PMA_DENSE, .n = n, .values = m->K_A},
                             .C = {.form = PMA_ZERO, .n = n},
                             .single = {pma_step_make(SCHEME, 6e-2), factor},
                             .twice = {pma_step_make(SCHEME, 12e-2), factor},
                             .link = {CONSTRAINTS, 1, m->ptr_A, m->row_A, m->minus_one, NULL}};
    CHECK_STATUS(pma_subdomain_create(&parts, &m->subdomains[1]), PMA_OK);
    CHECK(!pma_subdomain_member(m->subdomains[1]).divides);
    start(m->subdomains[1], n, m, seed);
}

static void make_C(large *m, uint64_t *seed)
{
    m->ptr_C[0] = 0;
    m->ptr_C[1] = 1;
    m->row_C[0] = 1;
    m->K_C[0] = m->inverse_C[0] = 1.0;
    const pma_parts parts = {
        .n = 1,
        .nb = 1,
        .substeps = 2,
        .K = {.form = PMA_DIAGONAL, .n = 1, .values = m->K_C},
        .C = {.form = PMA_ZERO, .n = 1},
        .single = {pma_step_make(SCHEME, 3e-2),
                   {.form = PMA_DIAGONAL, .n = 1, .nb = 1, .inverse = m->inverse_C}},
        .link = {CONSTRAINTS, 1, m->ptr_C, m->row_C, m->minus_one, NULL}};
    CHECK_STATUS(pma_subdomain_create(&parts, &m->subdomains[2]), PMA_OK);
    start(m->subdomains[2], 1, m, seed);
}

static void couple(large *m, size_t threads)
{
    double unit[CONSTRAINTS] = {0.0};
    const size_t p = m->count > 1 ? CONSTRAINTS : 0;
    for (size_t i = 0; i < m->count; i++)
        m->members[i] = pma_subdomain_member(m->subdomains[i]);
    for (size_t row = 0; row < p; row++) { /* no dof has both constraints: H is diagonal */
        double column[CONSTRAINTS] = {0.0};
        unit[row] = 1.0;
        for (size_t i = 0; i < m->count; i++)
            pma_member_compliance(&m->members[i], i == 1, unit, column);
        unit[row] = 0.0;
        m->inverse_H[row] = 1.0 / column[row];
    }
    const pma_factor factor = {.form = PMA_DIAGONAL, .n = p, .nb = p, .inverse = m->inverse_H};
    CHECK_STATUS(pma_interface_create(&factor, &m->H_factor), PMA_OK);
    const pma_interface H = m->H_factor;
    const pma_coupler_parts parts = {.count = m->count,
                                     .members = m->members,
                                     .p = p,
                                     .H_start = H,
                                     .H = H,
                                     .dt = 6e-2,
                                     .rebased = true,
                                     .schedule = &pma_fine_schedule,
                                     .threads = threads};
    CHECK_STATUS(pma_coupler_create(&parts, &m->coupler), PMA_OK);
    pma_coupler_start(m->coupler, 0, m->lam0, m->lam0);
}

static void make_large(large *m, bool banded, bool alone, size_t threads)
{
    uint64_t seed = 21;
    *m = (large){.count = alone ? 1 : 3, .banded = banded, .n = banded ? BANDED : DENSE};
    make_B(m, &seed);
    if (!alone) {
        make_A(m, &seed);
        make_C(m, &seed);
    }
    couple(m, threads);
}

static void destroy_large(large *m)
{
    pma_coupler_destroy(m->coupler);
    for (size_t i = 0; i < 3; i++)
        pma_subdomain_destroy(m->subdomains[i]);
    pma_interface_destroy(&m->H_factor);
    double *const arrays[6] = {m->K_A, m->R_A, m->inverse_A, m->K, m->inverse, m->load};
    for (size_t i = 0; i < 6; i++)
        free(arrays[i]);
}

static void check_same(const large *actual, const large *expected)
{
    CHECK_BITS(actual->count > 1 ? CONSTRAINTS : 0, pma_coupler_multipliers(actual->coupler),
               pma_coupler_multipliers(expected->coupler));
    for (size_t i = 0; i < actual->count; i++) {
        const pma_state *x = pma_subdomain_present(actual->subdomains[i]),
                        *y = pma_subdomain_present(expected->subdomains[i]);
        const size_t n = pma_subdomain_parts(actual->subdomains[i])->n;
        CHECK_BITS(n, x->u, y->u);
        CHECK_BITS(n, x->v, y->v);
        CHECK_BITS(n, x->w, y->w);
        CHECK_BITS(n, x->a, y->a);
        CHECK(isfinite(y->u[0]) && isfinite(y->a[n - 1]));
    }
}

/* ---- tests ---------------------------------------------------------------------------------- */

static void check_threads(bool banded, bool alone)
{
    large one, several;
    make_large(&one, banded, alone, 1);
    CHECK_STATUS(pma_coupler_advance(one.coupler, SPAN, NULL, NULL), PMA_OK);
    for (size_t threads = 2; threads <= MOST_THREADS; threads++) {
        make_large(&several, banded, alone, threads);
        CHECK_INT(pma_coupler_threads(several.coupler), threads);
        CHECK_INT(several.coupler->roster.split, 0);
        CHECK_INT(several.coupler->roster.fine, alone || threads == 2 ? threads : threads - 1);
        CHECK_STATUS(pma_coupler_advance(several.coupler, 1, NULL, NULL), PMA_OK);
        CHECK_STATUS(pma_coupler_advance(several.coupler, SPAN - 1, NULL, NULL), PMA_OK);
        check_same(&several, &one);
        destroy_large(&several);
    }
    destroy_large(&one);
}

static void a_split_subdomain_alone_is_bitwise_identical_for_any_number_of_threads(void)
{
    check_threads(false, true);
    check_threads(true, true);
}

static void a_split_subdomain_beside_double_steps_is_bitwise_identical_too(void)
{
    check_threads(false, false);
    check_threads(true, false);
}

/* Works of B from the second macro step on; A and C are not observed. */
static void sum_works(large *m, double *out)
{
    const pma_matrix M = {.form = PMA_DIAGONAL, .n = m->n, .values = m->inverse};
    CHECK_STATUS(pma_coupler_advance(m->coupler, 1, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_subdomain_begin_energy(m->subdomains[0], M, (pma_matrix){.form = PMA_ZERO},
                                            m->load, pma_coupler_multipliers(m->coupler), NULL),
                 PMA_OK);
    CHECK_STATUS(pma_coupler_advance(m->coupler, SPAN, NULL, NULL), PMA_OK);
    m->members[0].table->energy(m->members[0].self, 0, out);
}

static void a_split_subdomain_sums_its_works_bitwise_identically(void)
{
    for (int alone = 0; alone <= 1; alone++) {
        large one, several;
        double expected[PMA_ENERGIES], actual[PMA_ENERGIES];
        make_large(&one, false, alone, 1);
        make_large(&several, false, alone, 3);
        CHECK_INT(several.coupler->roster.split, 0);
        sum_works(&one, expected);
        sum_works(&several, actual);
        CHECK_BITS(PMA_ENERGIES, actual, expected);
        CHECK(expected[PMA_EXTERNAL] != 0.0 && expected[PMA_DISSIPATED] != 0.0);
        CHECK_INT(expected[PMA_INTERFACE_WORK] != 0.0, !alone);
        check_same(&several, &one);
        destroy_large(&one);
        destroy_large(&several);
    }
}

/* A load at one dof that is infinite, in whatever range that is. Alone nothing but the correctors
 * can see it. */
static void check_infinite_load(bool alone, size_t dof, size_t threads)
{
    large m, expected;
    make_large(&m, false, alone, threads);
    make_large(&expected, false, alone, 1);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 2, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_coupler_advance(expected.coupler, 2, NULL, NULL), PMA_OK);
    double *F = malloc(m.n * sizeof *F);
    memcpy(F, m.load, m.n * sizeof *F);
    F[dof] = INFINITY;
    const pma_load good = *pma_subdomain_load(m.subdomains[0]);
    pma_load bad = good;
    bad.values = F;
    pma_subdomain_set_load(m.subdomains[0], bad);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 2, NULL, NULL), PMA_NOT_FINITE);
    CHECK_INT(pma_coupler_failed(m.coupler), 0);
    CHECK_INT(pma_coupler_step_count(m.coupler), 2);
    check_same(&m, &expected);
    pma_subdomain_set_load(m.subdomains[0], good);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 2, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_coupler_advance(expected.coupler, 2, NULL, NULL), PMA_OK);
    check_same(&m, &expected);
    free(F);
    destroy_large(&m);
    destroy_large(&expected);
}

static void check_all_ranges(bool alone)
{
    const size_t dofs[4] = {0, DENSE - FACE - 1, DENSE - FACE + 1, DENSE - 1};
    for (size_t i = 0; i < 4; i++)
        check_infinite_load(alone, dofs[i], 2 + (i + alone) % (MOST_THREADS - 1));
}

static void a_value_that_is_not_finite_is_seen_in_every_range(void)
{
    check_all_ranges(true);
    check_all_ranges(false);
}

/* t, until its third evaluation */
static int refuse(double t, intptr_t n, double *f, void *user)
{
    size_t *evaluated = user;
    for (intptr_t i = 0; i < n; i++)
        f[i] = t;
    return ++*evaluated == 3 ? 5 : 0;
}

static void a_load_that_fails_is_named_and_leaves_the_last_macro_step(void)
{
    large m;
    make_large(&m, true, true, 3);
    size_t evaluated = 0;
    double *work = malloc(m.n * sizeof *work);
    int64_t *order = malloc(m.n * sizeof *order);
    for (size_t i = 0; i < m.n; i++)
        order[i] = (int64_t)(m.n - 1 - i);
    pma_subdomain_set_load(m.subdomains[0], (pma_load){.kind = PMA_LOAD_CALLED,
                                                       .n = m.n,
                                                       .function = refuse,
                                                       .user = &evaluated,
                                                       .order = order,
                                                       .work = work});
    const double before = pma_subdomain_present(m.subdomains[0])->u[0];
    CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_FORCE_FAILED);
    CHECK_INT(pma_coupler_failed(m.coupler), 0);
    CHECK_INT(pma_subdomain_code(m.subdomains[0]), 5);
    CHECK_INT(pma_coupler_step_count(m.coupler), 0);
    CHECK(pma_subdomain_present(m.subdomains[0])->u[0] == before);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
    CHECK_INT(evaluated, 3 + FINER);
    free(work);
    free(order);
    destroy_large(&m);
}

/* ---- all of them ---------------------------------------------------------------------------- */

const test SPLIT_TESTS[] = {
    TEST(a_split_subdomain_alone_is_bitwise_identical_for_any_number_of_threads),
    TEST(a_split_subdomain_beside_double_steps_is_bitwise_identical_too),
    TEST(a_split_subdomain_sums_its_works_bitwise_identically),
    TEST(a_value_that_is_not_finite_is_seen_in_every_range),
    TEST(a_load_that_fails_is_named_and_leaves_the_last_macro_step),
    END_OF_TESTS,
};
