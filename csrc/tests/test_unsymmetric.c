/* test_unsymmetric.c - factors R D Q^T, and matrices that are not symmetric. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "algebra/factor.h"
#include "algebra/matrix.h"
#include "check.h"
#include "factor/numeric.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"

/* ---- sweeps over given factors --------------------------------------------------------------- */

/* R and Q by columns, NaN where nothing is read */
static pma_factor dense_pair(const triple *t, size_t nb, double *values)
{
    const size_t n = t->n;
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) {
            values[j * n + i] = i > j ? t->R[i * n + j] : (double)NAN;
            values[n * n + j * n + i] = i > j ? t->Q[i * n + j] : (double)NAN;
        }
    }
    return (pma_factor){
        .form = PMA_DENSE, .n = n, .nb = nb, .inverse = t->inverse, .values = values, .Q = n * n};
}

static pma_factor sparse_pair(const triple *t, size_t nb, double *values)
{
    const compressed *s = &t->sparse;
    const size_t count = (size_t)s->ptr[t->n];
    memcpy(values, s->values, count * sizeof(double));
    for (size_t j = 0; j < t->n; j++) {
        for (int64_t k = s->ptr[j]; k < s->ptr[j + 1]; k++)
            values[count + (size_t)k] = t->Q[(size_t)s->index[k] * t->n + j];
    }
    return (pma_factor){.form = PMA_SPARSE,
                        .n = t->n,
                        .nb = nb,
                        .inverse = t->inverse,
                        .values = values,
                        .ptr = s->ptr,
                        .index = s->index,
                        .Q = count};
}

/* Both cut off below `width`. */
static pma_factor band_pair(triple *t, size_t nb, size_t width, double *values)
{
    const size_t n = t->n;
    memset(values, 0, 2 * n * width * sizeof(double));
    for (size_t j = 0; j < n; j++) {
        for (size_t i = j + 1; i < n; i++) {
            if (i > j + width)
                t->R[i * n + j] = t->Q[i * n + j] = 0.0;
            else {
                values[j * width + i - j - 1] = t->R[i * n + j];
                values[(n + j) * width + i - j - 1] = t->Q[i * n + j];
            }
        }
    }
    return (pma_factor){.form = PMA_BAND,
                        .n = n,
                        .nb = nb,
                        .inverse = t->inverse,
                        .values = values,
                        .width = width,
                        .Q = n * width};
}

static void unsymmetric_factors_solve_for_every_size_of_interface(void)
{
    uint64_t seed = 61;
    double values[2 * SIZE * SIZE];
    for (size_t n = 1; n <= SIZE; n++) {
        for (size_t nb = 0; nb <= n; nb++) {
            triple t = make_triple(n, n % 2 ? 0.9 : 0.4, &seed);
            make_unsymmetric(&t, &seed);
            const pma_factor dense = dense_pair(&t, nb, values);
            check_sweeps(&t, &dense, &seed);
            const pma_factor sparse = sparse_pair(&t, nb, values);
            check_sweeps(&t, &sparse, &seed);
            for (size_t width = 1; width < n; width++) {
                triple narrow = t;
                const pma_factor band = band_pair(&narrow, nb, width, values);
                check_sweeps(&narrow, &band, &seed);
            }
        }
    }
}

/* ---- factors that are made ------------------------------------------------------------------- */

/* A band, an arrow, a forest, a few of all pairs, and all of them. */
typedef enum { BAND, ARROW, FOREST, RANDOM, FULL, PATTERNS } kind;

static bool is_tied(kind k, size_t n, size_t i, size_t j, uint64_t *seed)
{
    switch (k) {
    case BAND:
        return i - j <= 2;
    case ARROW:
        return i == n - 1 || j == n / 2;
    case FOREST:
        return i % 3 == 2 && i - j <= 2;
    case RANDOM:
        return draw(seed, 4) == 0;
    default:
        return true;
    }
}

/* A dominates in rows and columns, so that |R| |D| |Q^T| is below (2 n - 1) |A| in the row sums;
 * half of the diagonal entries are negative. */
static void draw_unsymmetric(structure *m, kind k, size_t n, size_t nb, uint64_t *seed)
{
    *m = (structure){.n = n, .nb = nb};
    double sums[UNKNOWNS] = {0.0};
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < i; j++) {
            if (!is_tied(k, n, i, j, seed))
                continue;
            m->A[i * n + j] = 0.125 + 0.5 * draw(seed, 8);
            m->A[j * n + i] = draw(seed, 2) ? -m->A[i * n + j] : 0.0625;
            sums[i] += fmax(fabs(m->A[i * n + j]), fabs(m->A[j * n + i]));
            sums[j] += fmax(fabs(m->A[i * n + j]), fabs(m->A[j * n + i]));
        }
    }
    for (size_t i = 0; i < n; i++)
        m->A[i * n + i] = (draw(seed, 2) ? 1.0 : -1.0) * (sums[i] + 0.125);
    analyse(m);
    int64_t entry = 0; /* the entries of each row, ascending */
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) {
            if (m->A[i * n + j] != 0.0)
                m->index[entry++] = (int32_t)j;
        }
        m->ptr[i + 1] = entry;
    }
}

static pma_numeric_parts describe_unsymmetric(const structure *m)
{
    return (pma_numeric_parts){.n = m->n,
                               .nb = m->nb,
                               .unsymmetric = true,
                               .ptr = m->ptr,
                               .index = m->index,
                               .panels = m->panels,
                               .owner = m->owner,
                               .blas = NAIVE_BLAS};
}

static void write_values(const pma_numeric *f, const structure *m)
{
    for (size_t i = 0; i < m->n; i++) {
        for (int64_t k = m->ptr[i]; k < m->ptr[i + 1]; k++)
            f->values[k] = m->A[i * m->n + (size_t)m->index[k]];
    }
}

/* |b - A x| of a solve with pivots on the diagonal is below 3 n eps |R| |D| |Q^T| |x| */
static void check_residual(const structure *m, const double *x, const double *b)
{
    const size_t n = m->n;
    double largest = 0.0, norm = 0.0;
    for (size_t i = 0; i < n; i++) {
        double sum = 0.0;
        for (size_t j = 0; j < n; j++)
            sum += fabs(m->A[i * n + j]);
        norm = fmax(norm, sum);
        largest = fmax(largest, fabs(x[i]));
    }
    for (size_t i = 0; i < n; i++) {
        double residual = b[i];
        for (size_t j = 0; j < n; j++)
            residual -= m->A[i * n + j] * x[j];
        CHECK_NEAR(residual, 0.0, 6.0 * (double)(n * n) * EPS * norm * largest);
    }
}

static void check_opened_and_closed(const pma_numeric *f, const structure *m, uint64_t *seed)
{
    const size_t n = m->n, interior = n - m->nb;
    double b[UNKNOWNS], x[UNKNOWNS], x_b[UNKNOWNS], f_b[UNKNOWNS], free[UNKNOWNS];
    double *work = take_scratch(&f->factor);
    draw_vector(n, seed, b);
    draw_vector(m->nb, seed, f_b);
    memcpy(x, b, n * sizeof(double));
    pma_factor_open(&f->factor, x, x_b, work);
    memcpy(free, b, n * sizeof(double));
    pma_factor_solve(&f->factor, free, work);
    CHECK_BITS(m->nb, x_b, free + interior);
    check_residual(m, free, b);
    for (size_t i = 0; i < m->nb; i++)
        b[interior + i] += f_b[i];
    pma_factor_close(&f->factor, f_b, x, work);
    check_residual(m, x, b);
    return_scratch(&f->factor, work);
}

static void unsymmetric_factors_that_are_made_again_solve(void)
{
    static structure m;
    uint64_t seed = 62;
    bool forms[PMA_PANELS + 1] = {false};
    for (kind k = BAND; k < PATTERNS; k++) {
        for (size_t n = 1; n <= UNKNOWNS; n += n < 12 ? 1 : 13) {
            pma_numeric f;
            size_t column;
            draw_unsymmetric(&m, k, n, draw(&seed, (uint32_t)n + 1), &seed);
            const pma_numeric_parts parts = describe_unsymmetric(&m);
            CHECK_STATUS(pma_numeric_create(&parts, &f), PMA_OK);
            CHECK_STATUS(pma_factor_check(&f.factor), PMA_OK);
            forms[f.factor.form] = true;
            for (size_t again = 0; again < 2; again++) {
                write_values(&f, &m);
                CHECK_STATUS(pma_numeric_factor(&f, &column), PMA_OK);
                check_opened_and_closed(&f, &m, &seed);
                for (size_t i = 0; i < n * n; i++)
                    m.A[i] *= i / n % 2 ? 1.5 : 1.0; /* rows */
            }
            pma_numeric_destroy(&f);
        }
    }
    CHECK(forms[PMA_BAND] && forms[PMA_PANELS]);
}

/* ---- what is refused ------------------------------------------------------------------------- */

/* [[d, 1], [-1, 1]] has the pivots d and 1 + 1/d: where d is small, the 1 is lost (F11). */
static void pivots_that_lose_the_digits_of_the_diagonal_are_refused(void)
{
    const double diagonals[4] = {0.0, 1e-9, 1e-7, NAN};
    const size_t failed[4] = {0, 1, SIZE_MAX, 0};
    for (size_t n = 2; n <= UNKNOWNS; n += UNKNOWNS - 2) { /* a band, and panels */
        for (size_t k = 0; k < 4; k++) {
            static structure m;
            uint64_t seed = 63;
            pma_numeric f;
            size_t column = SIZE_MAX;
            draw_unsymmetric(&m, n == 2 ? BAND : FULL, n, 0, &seed);
            for (size_t i = 0; i < n; i++) {
                for (size_t j = 0; j < n; j++)
                    m.A[i * n + j] = i == j ? 1.0 : 1e-30; /* no zeros in the pattern */
            }
            m.A[0] = diagonals[k];
            m.A[1] = 1.0;
            m.A[n] = -1.0;
            const pma_numeric_parts parts = describe_unsymmetric(&m);
            CHECK_STATUS(pma_numeric_create(&parts, &f), PMA_OK);
            write_values(&f, &m);
            const pma_status status = pma_numeric_factor(&f, &column);
            CHECK_STATUS(status, failed[k] == SIZE_MAX ? PMA_OK : PMA_NOT_DEFINITE);
            if (status != PMA_OK)
                CHECK_INT(column, failed[k]);
            pma_numeric_destroy(&f);
        }
    }
}

static void a_pattern_that_is_not_symmetric_is_refused(void)
{
    static structure m;
    uint64_t seed = 64;
    double values[2 * UNKNOWNS * UNKNOWNS], inverse[UNKNOWNS];
    pma_elimination *e;
    size_t column;
    draw_unsymmetric(&m, FULL, 6, 2, &seed);
    for (int64_t k = 0; k < 36; k++)
        m.entries[k] = m.A[k];
    m.panels.values = values;
    m.panels.Q = (size_t)m.panels.start[m.panels.count];
    pma_panels_input input = {
        .n = 6, .ptr = m.ptr, .index = m.index, .values = m.entries, .lost = 1e-14, .growth = 1e8};
    CHECK_STATUS(pma_elimination_create(&m.panels, 6, m.owner, &NAIVE_BLAS, 1, &e), PMA_OK);
    CHECK_STATUS(pma_elimination_run(e, &input, inverse, &NEVER, &column), PMA_OK);
    m.index[6] = 1; /* row 1 begins with its diagonal: no entry across from that of row 0 */
    CHECK_STATUS(pma_elimination_run(e, &input, inverse, &NEVER, &column), PMA_BAD_INDEX);
    pma_elimination_destroy(e);
}

/* ---- matrices that are multiplied ------------------------------------------------------------ */

static void unsymmetric_matrices_multiply_like_two_loops(void)
{
    uint64_t seed = 65;
    for (size_t n = 1; n <= SIZE; n++) {
        for (size_t width = 0; width < n; width++) {
            double A[SIZE * SIZE], columns[SIZE * SIZE], band[2 * SIZE * SIZE];
            double x[SIZE], dense_y[SIZE], band_y[SIZE], expected[SIZE];
            draw_vector(n, &seed, x);
            for (size_t i = 0; i < n; i++) {
                expected[i] = dense_y[i] = band_y[i] = draw_eighth(&seed);
                for (size_t j = 0; j < n; j++) {
                    const size_t d = i > j ? i - j : j - i;
                    A[i * n + j] = columns[j * n + i] = d > width ? 0.0 : draw_eighth(&seed);
                    if (d <= width)
                        band[((j < i ? width + 1 : 0) + d) * n + (j < i ? j : i)] = A[i * n + j];
                }
            }
            for (size_t i = 0; i < n; i++) {
                for (size_t j = 0; j < n; j++)
                    expected[i] -= A[i * n + j] * x[j];
            }
            const pma_matrix dense = {.form = PMA_DENSE, .n = n, .values = columns};
            const pma_matrix narrow = {
                .form = PMA_BAND, .n = n, .values = band, .width = width, .below = (width + 1) * n};
            pma_matrix_subtract(&dense, x, dense_y);
            pma_matrix_subtract(&narrow, x, band_y);
            for (size_t i = 0; i < n; i++) { /* entries up to 1: n roundings of sums up to n + 1 */
                CHECK_NEAR(dense_y[i], expected[i], (double)(n * (n + 1)) * EPS);
                CHECK_NEAR(band_y[i], expected[i], (double)(n * (n + 1)) * EPS);
            }
        }
    }
}

const test UNSYMMETRIC_TESTS[] = {
    TEST(unsymmetric_factors_solve_for_every_size_of_interface),
    TEST(unsymmetric_factors_that_are_made_again_solve),
    TEST(pivots_that_lose_the_digits_of_the_diagonal_are_refused),
    TEST(a_pattern_that_is_not_symmetric_is_refused),
    TEST(unsymmetric_matrices_multiply_like_two_loops),
    END_OF_TESTS,
};
