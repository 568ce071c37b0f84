/* test_blas.c - products and triangular solutions by loops, against sums one after the other. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "check.h"
#include "factor/blas.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"

/* Two tiles of the longest vectors and all that can be left of a third, and two rows that are not
 * to be written. */
enum { MOST = 21, NEXT = MOST + 2 };

static const pma_blas LOOPS = {NULL, NULL, 0};

typedef struct {
    double A[NEXT * NEXT], B[NEXT * NEXT], C[NEXT * NEXT], expected[NEXT * NEXT];
} blocks;

static pma_block block(double *values)
{
    return (pma_block){values, NEXT};
}

static void draw_blocks(uint64_t *seed, blocks *x)
{
    draw_vector(NEXT * NEXT, seed, x->A);
    draw_vector(NEXT * NEXT, seed, x->B);
    draw_vector(NEXT * NEXT, seed, x->C);
    memcpy(x->expected, x->C, sizeof x->C);
}

/* An entry is a sum in the order of the columns, in whatever tile it is: to the bit. */
static void check_product(size_t m, size_t n, size_t k, bool transposed, double beta,
                          uint64_t *seed)
{
    blocks x;
    draw_blocks(seed, &x);
    for (size_t j = 0; j < n; j++) {
        for (size_t i = 0; i < m; i++) {
            double sum = 0.0, *c = &x.expected[j * NEXT + i];
            for (size_t l = 0; l < k; l++)
                sum += x.A[l * NEXT + i] * (transposed ? x.B[l * NEXT + j] : x.B[j * NEXT + l]);
            *c = beta == 0.0 ? -0.7 * sum : beta * *c + -0.7 * sum;
        }
    }
    pma_blas_multiply(&LOOPS, m, n, k, -0.7, block(x.A), block(x.B), transposed, beta, block(x.C));
    CHECK_BITS(NEXT * NEXT, x.C, x.expected);
}

static void products_of_all_sizes_are_sums_in_order(void)
{
    uint64_t seed = 3;
    for (size_t m = 0; m <= MOST; m++) {
        for (size_t n = 0; n <= 9; n++) {
            check_product(m, n, (m + n) % 7, true, 1.0, &seed);
            check_product(m, n, 5, false, 1.0, &seed);
            check_product(m, n, 3, true, 0.0, &seed);
        }
    }
}

static void what_is_overwritten_is_not_read(void)
{
    blocks x;
    uint64_t seed = 5;
    draw_blocks(&seed, &x);
    for (size_t i = 0; i < NEXT * NEXT; i++)
        x.C[i] = (double)NAN;
    pma_blas_multiply(&LOOPS, 9, 5, 3, 1.0, block(x.A), block(x.B), true, 0.0, block(x.C));
    for (size_t j = 0; j < 5; j++) {
        for (size_t i = 0; i < 9; i++)
            CHECK(isfinite(x.C[j * NEXT + i]));
    }
}

/* X L^T = B: the product of what was found is B, but for the rounding of at most n + 1 operations
 * in terms whose sizes are added */
static void check_quotient(size_t m, size_t n, bool unit, uint64_t *seed)
{
    blocks x;
    draw_blocks(seed, &x);
    for (size_t j = 0; j < n; j++)
        x.A[j * NEXT + j] += 2.0;
    pma_blas_divide(&LOOPS, m, n, block(x.A), unit, block(x.C));
    for (size_t j = 0; j < n; j++) {
        for (size_t i = 0; i < m; i++) {
            double sum = 0.0, size = fabs(x.expected[j * NEXT + i]);
            for (size_t l = 0; l <= j; l++) {
                const double entry = l == j && unit ? 1.0 : x.A[l * NEXT + j];
                sum += x.C[l * NEXT + i] * entry;
                size += fabs(x.C[l * NEXT + i] * entry);
            }
            CHECK_NEAR(sum, x.expected[j * NEXT + i], (double)(n + 1) * EPS * size);
            x.expected[j * NEXT + i] = x.C[j * NEXT + i];
        }
    }
    CHECK_BITS(NEXT * NEXT, x.C, x.expected); /* nothing else was written */
}

static void quotients_of_all_sizes_multiply_back(void)
{
    uint64_t seed = 7;
    for (size_t m = 0; m <= 9; m++) {
        for (size_t n = 0; n <= MOST; n++) {
            check_quotient(m, n, false, &seed);
            check_quotient(m, n, true, &seed);
        }
    }
}

/* ---- which of the two ------------------------------------------------------------------------ */

static size_t products, quotients;

static void count_product(char *of_a, char *of_b, int *m, int *n, int *k, double *alpha, double *a,
                          int *lda, double *b, int *ldb, double *beta, double *c, int *ldc)
{
    products++;
    NAIVE_BLAS.dgemm(of_a, of_b, m, n, k, alpha, a, lda, b, ldb, beta, c, ldc);
}

static void count_quotient(char *side, char *part, char *of_a, char *diagonal, int *m, int *n,
                           double *alpha, double *a, int *lda, double *b, int *ldb)
{
    quotients++;
    NAIVE_BLAS.dtrsm(side, part, of_a, diagonal, m, n, alpha, a, lda, b, ldb);
}

/* 4 * 3 * 5 and 4 * 4 * 4 multiplications: from 60 and from 64 on */
static void large_ones_are_those_of_blas(void)
{
    blocks x;
    uint64_t seed = 9;
    draw_blocks(&seed, &x);
    for (size_t from = 60; from <= 65; from++) {
        const pma_blas blas = {count_product, count_quotient, from};
        products = quotients = 0;
        pma_blas_multiply(&blas, 4, 3, 5, 1.0, block(x.A), block(x.B), true, 1.0, block(x.C));
        pma_blas_divide(&blas, 4, 4, block(x.A), true, block(x.C));
        CHECK(products == (from == 60));
        CHECK(quotients == (from <= 64));
    }
}

const test BLAS_TESTS[] = {
    TEST(products_of_all_sizes_are_sums_in_order),
    TEST(what_is_overwritten_is_not_read),
    TEST(quotients_of_all_sizes_multiply_back),
    TEST(large_ones_are_those_of_blas),
    END_OF_TESTS,
};
