/* test_narrow.c - factors of narrow patterns, which are made as a band. */
#include <stdint.h>
#include <string.h>

#include "check.h"
#include "factor/numeric.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"

/* R without what is further than `width` below the diagonal */
static triple make_narrow(size_t n, size_t width, uint64_t *seed)
{
    triple t = make_triple(n, 0.8, seed);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j + width < i; j++)
            t.R[i * n + j] = 0.0;
    }
    return t;
}

/* A = R D R^T: multiples of 2^-8 below 64, so that every sum is exact */
static compressed multiply(const triple *t)
{
    const size_t n = t->n;
    double A[SIZE * SIZE];
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) {
            A[i * n + j] = 0.0;
            for (size_t k = 0; k < n; k++)
                A[i * n + j] += t->R[i * n + k] * t->D[k] * t->R[j * n + k];
        }
    }
    return compress(n, A);
}

/* Panels of one column each, with all rows below: a structure for every pattern. */
typedef struct {
    int64_t first[SIZE + 1], row_ptr[SIZE + 1], start[SIZE + 1], owner[SIZE];
    int32_t rows[SIZE * SIZE];
} columns;

static pma_numeric_parts make_parts(const compressed *A, size_t n, size_t nb, columns *c)
{
    int64_t row = 0, entry = 0;
    for (size_t j = 0; j <= n; j++) {
        c->first[j] = (int64_t)j;
        c->row_ptr[j] = row;
        c->start[j] = entry;
        for (size_t i = j + 1; i < n; i++)
            c->rows[row++] = (int32_t)i;
        entry += (int64_t)(n - j);
        if (j < n)
            c->owner[j] = (int64_t)j;
    }
    return (pma_numeric_parts){.n = n,
                               .nb = nb,
                               .ptr = A->ptr,
                               .index = A->index,
                               .panels = {.count = n,
                                          .first = c->first,
                                          .row_ptr = c->row_ptr,
                                          .rows = c->rows,
                                          .start = c->start},
                               .owner = c->owner};
}

static pma_status factor(pma_numeric *f, const compressed *A, size_t *column)
{
    memcpy(f->values, A->values, (size_t)A->ptr[f->parts.n] * sizeof *f->values);
    return pma_numeric_factor(f, column);
}

/* What is known of the factor is found again without rounding; sweeps solve with it. */
static void check_narrow(size_t n, size_t nb, size_t width, uint64_t *seed)
{
    const triple t = make_narrow(n, width, seed);
    const compressed A = multiply(&t);
    if ((size_t)A.ptr[n] == n)
        return; /* a diagonal by chance */
    columns c;
    pma_numeric f;
    size_t column;
    const pma_numeric_parts parts = make_parts(&A, n, nb, &c);
    CHECK_STATUS(pma_numeric_create(&parts, &f), PMA_OK);
    CHECK_INT(f.factor.form, PMA_BAND);
    CHECK(f.factor.width <= width);
    CHECK_STATUS(factor(&f, &A, &column), PMA_OK);
    CHECK_BITS(n, f.factor.inverse, t.inverse);
    for (size_t j = 0; j < n; j++) {
        for (size_t k = 0; k < f.factor.width; k++) {
            const size_t i = j + 1 + k;
            CHECK(f.factor.values[j * f.factor.width + k] == (i < n ? t.R[i * n + j] : 0.0));
        }
    }
    check_sweeps(&t, &f.factor, seed);
    pma_numeric_destroy(&f);
}

static void a_narrow_matrix_is_factored_as_a_band_without_rounding_where_there_is_none(void)
{
    uint64_t seed = 41;
    for (size_t n = 2; n <= SIZE; n++) {
        for (size_t width = 1; width < n; width++) {
            for (size_t nb = 0; nb <= n; nb++)
                check_narrow(n, nb, width, &seed);
        }
    }
}

static void negative_pivots_are_found_and_the_column_of_one_that_is_zero_is_named(void)
{
    enum { N = 7, WIDTH = 3 };
    uint64_t seed = 43;
    const triple good = make_narrow(N, WIDTH, &seed);
    const compressed A = multiply(&good);
    columns c;
    pma_numeric f;
    size_t column;
    const pma_numeric_parts parts = make_parts(&A, N, 0, &c);
    CHECK_STATUS(pma_numeric_create(&parts, &f), PMA_OK);
    for (size_t bad = 0; bad < N; bad++) {
        for (int zero = 0; zero < 2; zero++) {
            triple t = good;
            t.D[bad] = zero ? 0.0 : -t.D[bad];
            t.inverse[bad] = 1.0 / t.D[bad];
            const compressed B = multiply(&t);
            if (B.ptr[N] != A.ptr[N])
                continue; /* an entry of A has cancelled: another pattern */
            CHECK_STATUS(factor(&f, &B, &column), zero ? PMA_NOT_DEFINITE : PMA_OK);
            if (zero)
                CHECK_INT(column, bad);
            else
                CHECK_BITS(N, f.factor.inverse, t.inverse);
        }
    }
    CHECK_STATUS(factor(&f, &A, &column), PMA_OK);
    CHECK_BITS(N, f.factor.inverse, good.inverse);
    check_sweeps(&good, &f.factor, &seed);
    pma_numeric_destroy(&f);
}

const test NARROW_TESTS[] = {
    TEST(a_narrow_matrix_is_factored_as_a_band_without_rounding_where_there_is_none),
    TEST(negative_pivots_are_found_and_the_column_of_one_that_is_zero_is_named),
    END_OF_TESTS,
};
