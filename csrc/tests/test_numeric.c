/* test_numeric.c - a factor that is made again and again in its place, from one pattern. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "algebra/factor.h"
#include "check.h"
#include "factor/numeric.h"
#include "inner.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"
#include "workers/team.h"
#include "workers/thread.h"

/* ---- patterns -------------------------------------------------------------------------------- */

typedef enum { DIAGONAL, BAND, ARROW, RANDOM, FULL, PATTERNS } kind;

static bool is_tied(kind k, size_t n, size_t i, size_t j, uint64_t *seed)
{
    switch (k) {
    case BAND:
        return i - j <= 2;
    case ARROW:
        return i == n - 1 || j == n / 2;
    case RANDOM:
        return draw(seed, 4) == 0;
    case FULL:
        return true;
    default:
        return false;
    }
}

/* Numbers of the pattern of m->A, where the diagonal dominates. */
static void draw_values(structure *m, uint64_t *seed)
{
    const size_t n = m->n;
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < i; j++) {
            if (m->A[i * n + j] != 0.0)
                m->A[i * n + j] = m->A[j * n + i] = 0.25 + draw_eighth(seed) / 8.0;
        }
    }
    for (size_t i = 0; i < n; i++) {
        double sum = 0.125;
        for (size_t j = 0; j < n; j++)
            sum += i == j ? 0.0 : fabs(m->A[i * n + j]);
        m->A[i * n + i] = sum;
    }
}

/* Some diagonal entries become negative. They still dominate: so many pivots are negative. */
static void flip_diagonal(structure *m, uint64_t *seed)
{
    for (size_t i = 0; i < m->n; i++)
        m->A[i * m->n + i] *= draw(seed, 3) == 0 ? -1.0 : 1.0;
}

static size_t count_negative(size_t n, const double *x, size_t stride)
{
    size_t count = 0;
    for (size_t i = 0; i < n; i++)
        count += x[i * stride] < 0.0;
    return count;
}

static void draw_pattern(structure *m, kind k, size_t n, size_t nb, uint64_t *seed)
{
    *m = (structure){.n = n, .nb = nb};
    for (size_t i = 0; i < n; i++) {
        m->A[i * n + i] = 1.0;
        for (size_t j = 0; j < i; j++)
            m->A[i * n + j] = m->A[j * n + i] = is_tied(k, n, i, j, seed);
    }
    draw_values(m, seed);
    analyse(m);
    list_ascending(m);
}

static pma_numeric_parts describe_numeric(const structure *m)
{
    return (pma_numeric_parts){.n = m->n,
                               .nb = m->nb,
                               .ptr = m->ptr,
                               .index = m->index,
                               .panels = m->panels,
                               .owner = m->owner,
                               .blas = NAIVE_BLAS};
}

/* ---- factors --------------------------------------------------------------------------------- */

static void write_values(const pma_numeric *f, const structure *m)
{
    for (size_t i = 0; i < m->n; i++) {
        for (size_t j = 0; j < m->n; j++) {
            const size_t entry = pma_numeric_entry(&f->parts, i, j);
            CHECK((entry == SIZE_MAX) == (m->A[i * m->n + j] == 0.0));
            if (entry != SIZE_MAX)
                f->values[entry] = m->A[i * m->n + j];
        }
    }
}

/* A x = b by the factor, and A x by the values */
static void check_solves(const pma_numeric *f, const structure *m, uint64_t *seed)
{
    const size_t n = m->n;
    double b[UNKNOWNS], x[UNKNOWNS], y[UNKNOWNS];
    double *work = take_scratch(&f->factor);
    draw_vector(n, seed, b);
    memcpy(x, b, n * sizeof(double));
    pma_factor_solve(&f->factor, x, work);
    check_definite_residual(m, x, b);
    return_scratch(&f->factor, work);

    draw_vector(n, seed, y);
    for (size_t i = 0; i < n; i++)
        b[i] = y[i];
    pma_numeric_multiply(f, x, b);
    for (size_t i = 0; i < n; i++) {
        double sum = y[i], size = y[i];
        for (size_t j = 0; j < n; j++) {
            sum += m->A[i * n + j] * x[j];
            size += fabs(m->A[i * n + j] * x[j]);
        }
        CHECK_NEAR(b[i], sum, 2.0 * (double)(n + 1) * EPS * size);
    }
}

/* Dominant diagonals of at least 1/8 in sums below n: a condition below 16 n, and naive_solve is
 * exact up to n roundings. */
static void check_like_naive(const pma_numeric *f, const structure *m, uint64_t *seed)
{
    double b[LARGEST], x[LARGEST];
    const size_t n = m->n;
    double *work = take_scratch(&f->factor);
    draw_vector(n, seed, b);
    memcpy(x, b, n * sizeof(double));
    pma_factor_solve(&f->factor, x, work);
    return_scratch(&f->factor, work);
    naive_solve(n, m->A, b);
    for (size_t i = 0; i < n; i++)
        CHECK_NEAR(x[i], b[i], 16.0 * (double)(n * n * n) * EPS * 8.0);
}

static void check_made_again(structure *m, uint64_t *seed)
{
    pma_numeric f;
    const pma_numeric_parts parts = describe_numeric(m);
    size_t column;
    CHECK_STATUS(pma_numeric_create(&parts, &f), PMA_OK);
    CHECK_STATUS(pma_factor_check(&f.factor), PMA_OK);
    const pma_factor first = f.factor;
    for (size_t k = 0; k < 3; k++) {
        write_values(&f, m);
        CHECK_STATUS(pma_numeric_factor(&f, &column), PMA_OK);
        CHECK(f.factor.inverse == first.inverse && f.factor.panels.values == first.panels.values);
        CHECK_INT(count_negative(m->n, f.inverse, 1), count_negative(m->n, m->A, m->n + 1));
        check_solves(&f, m, seed);
        if (m->n <= LARGEST)
            check_like_naive(&f, m, seed);
        draw_values(m, seed);
        flip_diagonal(m, seed);
    }
    pma_numeric_destroy(&f);
}

static void a_factor_made_again_solves_with_the_last_values(void)
{
    static structure m;
    uint64_t seed = 41;
    for (kind k = DIAGONAL; k < PATTERNS; k++) {
        for (size_t n = 0; n <= 24; n++) {
            draw_pattern(&m, k, n, draw(&seed, (uint32_t)n + 1), &seed);
            check_made_again(&m, &seed);
        }
        draw_pattern(&m, k, UNKNOWNS, 7, &seed);
        check_made_again(&m, &seed);
    }
}

/* After other values and after a failure it is made again. */
static void a_factor_of_the_same_values_is_kept(void)
{
    static structure m;
    uint64_t seed = 44;
    for (kind k = DIAGONAL; k < PATTERNS; k++) {
        pma_numeric f;
        size_t column;
        draw_pattern(&m, k, 12, 3, &seed);
        const pma_numeric_parts parts = describe_numeric(&m);
        const size_t entry = pma_numeric_entry(&parts, 5, 5);
        const double factors[5] = {1.0, 1.0, 2.0, NAN, 2.0};
        const size_t made[5] = {1, 1, 2, 2, 3};
        CHECK_STATUS(pma_numeric_create(&parts, &f), PMA_OK);
        for (size_t i = 0; i < 5; i++) {
            write_values(&f, &m);
            f.values[entry] *= factors[i];
            const pma_status status = pma_numeric_factor(&f, &column);
            CHECK_STATUS(status, factors[i] > 0.0 ? PMA_OK : PMA_NOT_DEFINITE);
            CHECK_INT(f.made, made[i]);
        }
        pma_numeric_destroy(&f);
    }
}

/* Before the first one it is that of the unit matrix. */
static void a_factor_that_was_never_made_changes_nothing(void)
{
    static structure m;
    uint64_t seed = 42;
    for (kind k = DIAGONAL; k < PATTERNS; k++) {
        double x[12], expected[12];
        pma_numeric f;
        draw_pattern(&m, k, 12, 3, &seed);
        const pma_numeric_parts parts = describe_numeric(&m);
        CHECK_STATUS(pma_numeric_create(&parts, &f), PMA_OK);
        double *work = take_scratch(&f.factor);
        draw_vector(12, &seed, x);
        memcpy(expected, x, sizeof x);
        pma_factor_solve(&f.factor, x, work);
        CHECK_BITS(12, x, expected);
        return_scratch(&f.factor, work);
        pma_numeric_destroy(&f);
    }
}

/* The spoilt pivot is the first to fail; and the next factor, of good values, is good. */
static void a_column_whose_pivot_is_lost_is_named_and_the_next_factor_is_good(void)
{
    static structure m;
    uint64_t seed = 43;
    const double bad[2] = {0.0, NAN};
    for (kind k = DIAGONAL; k < PATTERNS; k++) {
        pma_numeric f;
        draw_pattern(&m, k, 12, 3, &seed);
        const pma_numeric_parts parts = describe_numeric(&m);
        CHECK_STATUS(pma_numeric_create(&parts, &f), PMA_OK);
        for (size_t i = 0; i < 12; i++) {
            size_t column = SIZE_MAX;
            write_values(&f, &m);
            f.values[pma_numeric_entry(&parts, i, i)] = bad[i % 2];
            CHECK_STATUS(pma_numeric_factor(&f, &column), PMA_NOT_DEFINITE);
            CHECK_INT(column, i);
            write_values(&f, &m);
            CHECK_STATUS(pma_numeric_factor(&f, &column), PMA_OK);
            check_solves(&f, &m, &seed);
        }
        pma_numeric_destroy(&f);
    }
}

/* ---- by several workers --------------------------------------------------------------------- */

static void work(void *ctx, size_t worker)
{
    pma_elimination_work(ctx, worker);
}

static void work_together(void *ctx, pma_elimination *e)
{
    pma_team *team = ctx;
    const size_t workers = pma_team_workers(team);
    for (size_t w = 1; w < workers; w++)
        pma_team_post(team, w, work, e);
    pma_elimination_work(e, 0);
    for (size_t w = 1; w < workers; w++)
        pma_team_await(team, w, NULL, NULL);
}

static void work_alone(void *ctx, pma_elimination *e)
{
    (void)ctx;
    pma_elimination_work(e, 0);
}

/* Good values, indefinite ones, then such that fail. */
static void check_crew(structure *m, const pma_crew *crew, uint64_t *seed)
{
    pma_numeric f, alone;
    pma_numeric_parts parts = describe_numeric(m);
    CHECK_STATUS(pma_numeric_create(&parts, &alone), PMA_OK);
    parts.crew = *crew;
    CHECK_STATUS(pma_numeric_create(&parts, &f), PMA_OK);
    for (size_t k = 0; k < 3; k++) {
        size_t column = 0, failed = 0;
        const size_t bad = pma_numeric_entry(&parts, m->n / 2, m->n / 2);
        draw_values(m, seed);
        write_values(&f, m);
        f.values[bad] *= k == 0 ? 1.0 : k == 1 ? -1.0 : (double)NAN;
        memcpy(alone.values, f.values, (size_t)parts.ptr[m->n] * sizeof(double));
        CHECK_STATUS(pma_numeric_factor(&f, &column), k == 2 ? PMA_NOT_DEFINITE : PMA_OK);
        CHECK_STATUS(pma_numeric_factor(&alone, &failed), k == 2 ? PMA_NOT_DEFINITE : PMA_OK);
        CHECK_INT(column, failed);
        if (k == 2)
            continue;
        CHECK_BITS(m->n, f.inverse, alone.inverse);
        if (f.factor.form == PMA_PANELS)
            CHECK_BITS((size_t)m->panels.start[m->panels.count], f.numbers, alone.numbers);
    }
    pma_numeric_destroy(&f);
    pma_numeric_destroy(&alone);
}

static void a_factor_made_again_by_a_crew_is_bitwise_that_of_one(void)
{
    static structure m;
    uint64_t seed = 45;
    for (size_t workers = 1; workers <= 4; workers++) {
        pma_team *team;
        CHECK_STATUS(pma_team_create(workers, &team), PMA_OK);
        CHECK_STATUS(pma_team_gather(team), PMA_OK);
        const pma_crew together = {workers, work_together, pma_thread_rest, team},
                       alone = {workers, work_alone, NULL, NULL};
        for (kind k = DIAGONAL; k < PATTERNS; k++) {
            draw_pattern(&m, k, UNKNOWNS, 7, &seed);
            check_crew(&m, &together, &seed);
            check_crew(&m, &alone, &seed);
        }
        pma_team_destroy(team);
    }
}

/* ---- patterns that are refused --------------------------------------------------------------- */

static pma_status status_of(size_t n, size_t nb, const int64_t *ptr, const int32_t *index)
{
    full_pattern pattern;
    pma_numeric f;
    pma_numeric_parts parts = describe_full(&pattern, 2, 1);
    parts.n = n;
    parts.nb = nb;
    parts.ptr = ptr ? ptr : parts.ptr;
    parts.index = index ? index : parts.index;
    const pma_status status = pma_numeric_create(&parts, &f);
    CHECK((f.values != NULL) == (status == PMA_OK));
    pma_numeric_destroy(&f); /* an empty one too */
    return status;
}

static void patterns_that_cannot_be_are_refused(void)
{
    CHECK_STATUS(status_of(2, 1, NULL, NULL), PMA_OK);
    CHECK_STATUS(status_of(2, 0, NULL, NULL), PMA_OK); /* a break too many is none too few */
    CHECK_STATUS(status_of(1, 1, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(status_of(2, 1, NULL, (int32_t[]){0, 2, 0, 1}), PMA_BAD_INDEX);
    CHECK_STATUS(status_of(2, 1, NULL, (int32_t[]){0, -1, 0, 1}), PMA_BAD_INDEX);
    CHECK_STATUS(status_of(2, 1, NULL, (int32_t[]){1, 0, 0, 1}), PMA_BAD_INDEX); /* descends */
    CHECK_STATUS(status_of(2, 1, NULL, (int32_t[]){0, 0, 0, 1}), PMA_BAD_INDEX);
    CHECK_STATUS(status_of(2, 1, (int64_t[]){0, 2, 3}, NULL), PMA_BAD_INDEX); /* no diagonal */
    CHECK_STATUS(status_of(2, 1, (int64_t[]){0, 1, 2}, (int32_t[]){0, 1}), PMA_OK);
    CHECK_STATUS(status_of(2, 1, (int64_t[]){0, 1, 2}, (int32_t[]){1, 0}), PMA_BAD_INDEX);
}

const test NUMERIC_TESTS[] = {
    TEST(a_factor_made_again_solves_with_the_last_values),
    TEST(a_factor_that_was_never_made_changes_nothing),
    TEST(a_factor_of_the_same_values_is_kept),
    TEST(a_column_whose_pivot_is_lost_is_named_and_the_next_factor_is_good),
    TEST(a_factor_made_again_by_a_crew_is_bitwise_that_of_one),
    TEST(patterns_that_cannot_be_are_refused),
    END_OF_TESTS,
};
