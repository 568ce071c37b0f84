/* matrices.c - see matrices.h; random matrices and what a solve with them has to leave. */
#include "matrices.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "algebra/lanes.h"
#include "check.h"
#include "factor/symbolic.h"

/* ---- rows without zeros --------------------------------------------------------------------- */

compressed compress(size_t n, const double *rows)
{
    compressed s = {.ptr = {0}};
    int64_t k = 0;
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) {
            if (rows[i * n + j] == 0.0)
                continue;
            s.index[k] = (int32_t)j;
            s.values[k++] = rows[i * n + j];
        }
        s.ptr[i + 1] = k;
    }
    return s;
}

/* ---- matrices whose factor is known --------------------------------------------------------- */

triple make_triple(size_t n, double density, uint64_t *seed)
{
    triple t = {.n = n};
    double below[SIZE * SIZE] = {0.0}; /* column j of R below the diagonal, as a row */
    for (size_t j = 0; j < n; j++) {
        t.D[j] = ldexp(1.0, (int)draw(seed, 5) - 2);
        t.inverse[j] = 1.0 / t.D[j];
        for (size_t i = 0; i < n; i++) {
            if (i > j && draw(seed, 1000) < 1000.0 * density)
                below[j * n + i] = draw_eighth(seed);
            t.R[i * n + j] = i == j ? 1.0 : below[j * n + i];
            t.columns[j * n + i] = i > j ? below[j * n + i] : (double)NAN;
        }
    }
    t.sparse = compress(n, below);
    return t;
}

void make_unsymmetric(triple *t, uint64_t *seed)
{
    memcpy(t->Q, t->R, sizeof t->Q);
    t->unsymmetric = true;
    for (size_t i = 0; i < t->n; i++) {
        for (size_t j = 0; j < i; j++) {
            if (t->R[i * t->n + j] != 0.0)
                t->Q[i * t->n + j] = draw_eighth(seed);
        }
    }
}

/* A (n*n) := R D Q^T and size := |R| |D| |Q^T| for the unknowns from `first` on: from 0 on it is
 * the matrix itself, from n - nb on the Schur complement S (F3) */
static void multiply_out(const triple *t, size_t first, double *A, double *size)
{
    const size_t n = t->n;
    const double *Q = t->unsymmetric ? t->Q : t->R;
    for (size_t i = first; i < n; i++) {
        for (size_t j = first; j < n; j++) {
            double sum = 0.0, sum_of_sizes = 0.0;
            for (size_t k = first; k < n; k++) {
                const double term = t->R[i * n + k] * t->D[k] * Q[j * n + k];
                sum += term;
                sum_of_sizes += fabs(term);
            }
            *A++ = sum;
            *size++ = sum_of_sizes;
        }
    }
}

/* Two triangular solves leave |b - A x| <= 2 n eps |R| |D| |Q^T| |x|, entry by entry; as much again
 * for the rounding of this loop. */
static void check_residual(const triple *t, size_t first, const double *x, const double *b)
{
    double A[SIZE * SIZE], size[SIZE * SIZE];
    const size_t n = t->n - first;
    multiply_out(t, first, A, size);
    for (size_t i = 0; i < n; i++) {
        double residual = b[i], scale = 0.0;
        for (size_t j = 0; j < n; j++) {
            residual -= A[i * n + j] * x[j];
            scale += size[i * n + j] * fabs(x[j]);
        }
        CHECK_NEAR(residual, 0.0, 4.0 * (double)n * EPS * scale);
    }
}

static const double UNTOUCHED = 7.0;

double *take_scratch(const pma_factor *f)
{
    const size_t count = pma_factor_scratch(f);
    double *work = malloc((count + 1) * sizeof *work);
    for (size_t i = 0; i < count; i++)
        work[i] = (double)NAN;
    work[count] = UNTOUCHED;
    return work;
}

void return_scratch(const pma_factor *f, double *work)
{
    CHECK(work[pma_factor_scratch(f)] == UNTOUCHED);
    free(work);
}

/* ---- vectors in lanes ----------------------------------------------------------------------- */

/* Lane l of x (n), and back */
static void take_lane(size_t n, size_t l, const double *x, double *out)
{
    for (size_t i = 0; i < n; i++)
        out[i] = x[i * PMA_LANES + l];
}

static void draw_lanes(size_t n, uint64_t *seed, double *x)
{
    draw_vector(n * PMA_LANES, seed, x);
    for (size_t i = 0; i < n; i++)
        x[i * PMA_LANES + PMA_LANES - 1] = (double)NAN;
}

static void check_each_lane(size_t n, const double *x, const double *b,
                            void (*check)(const void *of, const double *x, const double *b),
                            const void *of)
{
    double x_l[UNKNOWNS], b_l[UNKNOWNS];
    for (size_t l = 0; l + 1 < PMA_LANES; l++) {
        take_lane(n, l, x, x_l);
        take_lane(n, l, b, b_l);
        check(of, x_l, b_l);
    }
}

/* Every lane of a sweep is bitwise that of one vector: of x and of what is on the interface. */
static void check_lane_bits(const pma_factor *f, const double *b, const double *f_b,
                            const double *solved, const double *opened, const double *x_b,
                            const double *closed)
{
    double one[UNKNOWNS], on_b[UNKNOWNS], force[UNKNOWNS], lane[UNKNOWNS], before[UNKNOWNS];
    double *work = malloc((pma_factor_scratch(f) + 1) * sizeof *work);
    for (size_t l = 0; l + 1 < PMA_LANES; l++) {
        take_lane(f->n, l, b, before);
        take_lane(f->nb, l, f_b, force);
        memcpy(one, before, f->n * sizeof *one);
        pma_factor_solve(f, one, work);
        take_lane(f->n, l, solved, lane);
        CHECK_BITS(f->n, lane, one);
        memcpy(one, before, f->n * sizeof *one);
        pma_factor_open(f, one, on_b, work);
        take_lane(f->n, l, opened, lane);
        CHECK_BITS(f->n, lane, one);
        take_lane(f->nb, l, x_b, lane);
        CHECK_BITS(f->nb, lane, on_b);
        pma_factor_close(f, force, one, work);
        take_lane(f->n, l, closed, lane);
        CHECK_BITS(f->n, lane, one);
    }
    free(work);
}

void check_lanes(const pma_factor *f,
                 void (*check)(const void *of, const double *x, const double *b), const void *of,
                 uint64_t *seed)
{
    const size_t scratch = pma_factor_scratch(f) * PMA_LANES, on_b = f->nb * PMA_LANES;
    const pma_factor lanes = pma_factor_in_lanes(f);
    const size_t interior = (f->n - f->nb) * PMA_LANES;
    static double b[UNKNOWNS * PMA_LANES], x[UNKNOWNS * PMA_LANES], x_b[UNKNOWNS * PMA_LANES],
        f_b[UNKNOWNS * PMA_LANES], solved[UNKNOWNS * PMA_LANES], opened[UNKNOWNS * PMA_LANES];
    double *work = malloc((scratch + 1) * sizeof *work);
    for (size_t i = 0; i < scratch; i++)
        work[i] = (double)NAN;
    work[scratch] = UNTOUCHED;

    draw_lanes(f->n, seed, b);
    memcpy(x, b, f->n * PMA_LANES * sizeof *x);
    pma_factor_solve(&lanes, x, work);
    check_each_lane(f->n, x, b, check, of);
    memcpy(solved, x, sizeof x);

    draw_lanes(f->nb, seed, f_b);
    memcpy(x, b, f->n * PMA_LANES * sizeof *x);
    pma_factor_open(&lanes, x, x_b, work);
    memcpy(opened, b, sizeof opened);
    pma_factor_open_interior(&lanes, opened, work);
    pma_factor_close(&lanes, f_b, x, work);
    check_lane_bits(f, b, f_b, solved, opened, x_b, x);
    for (size_t k = 0; k < on_b; k++)
        b[interior + k] += f_b[k];
    check_each_lane(f->n, x, b, check, of);

    /* what is opened and what the interface adds is the whole; of small numbers */
    pma_factor_interface(&lanes, f_b, work);
    for (size_t k = 0; k < on_b; k++) {
        const double size = fabs(x_b[k]) + fabs(f_b[k]) + 1.0;
        if (k % PMA_LANES + 1 < PMA_LANES)
            CHECK_NEAR(x_b[k] + f_b[k], x[interior + k], 1e-9 * size);
    }
    CHECK(work[scratch] == UNTOUCHED);
    free(work);
}

void check_lane_product(const pma_matrix *A, uint64_t *seed)
{
    double *x = malloc((4 * PMA_LANES + 2) * A->n * sizeof *x), *y = x + PMA_LANES * A->n;
    double *before = y + PMA_LANES * A->n, *one = before + PMA_LANES * A->n, *y_one = one + A->n;
    for (size_t k = 0; k < PMA_LANES * A->n; k++) {
        x[k] = k % PMA_LANES + 1 < PMA_LANES ? 1.0 / (1 + draw(seed, 100)) : (double)NAN;
        y[k] = before[k] = 1.0 / (1 + draw(seed, 100));
    }
    const pma_matrix lanes = pma_matrix_in_lanes(A);
    pma_matrix_subtract(&lanes, x, y);
    for (size_t l = 0; l + 1 < PMA_LANES; l++) {
        double *lane = y_one + A->n;
        take_lane(A->n, l, x, one);
        take_lane(A->n, l, before, y_one);
        take_lane(A->n, l, y, lane);
        pma_matrix_subtract(A, one, y_one);
        CHECK_BITS(A->n, lane, y_one);
    }
    free(x);
}

static void check_triple(const void *of, const double *x, const double *b)
{
    check_residual(of, 0, x, b);
}

void check_sweeps(const triple *t, const pma_factor *f, uint64_t *seed)
{
    const size_t interior = f->n - f->nb;
    double b[SIZE] = {0.0}, x[SIZE], x_b[SIZE], f_b[SIZE];
    CHECK_STATUS(pma_factor_check(f), PMA_OK);
    double *work = take_scratch(f);

    draw_vector(f->n, seed, b);
    draw_vector(f->nb, seed, f_b);
    memcpy(x, b, sizeof x);
    pma_factor_open(f, x, x_b, work);
    double apart[SIZE];
    memcpy(apart, b, sizeof apart);
    pma_factor_open_interior(f, apart, work);
    CHECK_BITS(f->n, apart, x);
    double unloaded[SIZE], unused[SIZE] = {0.0};
    memcpy(unloaded, x, sizeof x);
    pma_factor_close(f, unused, unloaded, work);
    check_residual(t, 0, unloaded, b);
    CHECK_BITS(f->nb, unloaded + interior, x_b);
    for (size_t i = 0; i < f->nb; i++)
        b[interior + i] += f_b[i];
    pma_factor_close(f, f_b, x, work);
    check_residual(t, 0, x, b);
    memcpy(x, b, sizeof x);
    pma_factor_solve(f, x, work);
    check_residual(t, 0, x, b);

    draw_vector(f->nb, seed, b);
    memcpy(x_b, b, sizeof x_b);
    pma_factor_interface(f, x_b, work);
    check_residual(t, interior, x_b, b);
    return_scratch(f, work);
    check_lanes(f, check_triple, t, seed);
}

/* ---- matrices on their way to a factor in panels -------------------------------------------- */

/* C := alpha A B^T + beta C, A (m*k), B (n*k), or with B (k*n) in place of B^T; C is not read when
 * beta is zero */
static void naive_dgemm(char *trans_a, char *trans_b, int *m, int *n, int *k, double *alpha,
                        double *A, int *lda, double *B, int *ldb, double *beta, double *C, int *ldc)
{
    const bool transposed = *trans_b == 'T';
    CHECK(*trans_a == 'N' && (transposed || *trans_b == 'N'));
    CHECK(*lda >= *m && *ldb >= (transposed ? *n : *k) && *ldc >= *m);
    for (int j = 0; j < *n; j++) {
        for (int i = 0; i < *m; i++) {
            double sum = 0.0;
            for (int l = 0; l < *k; l++)
                sum += A[i + l * *lda] * (transposed ? B[j + l * *ldb] : B[l + j * *ldb]);
            double *c = &C[i + j * *ldc];
            *c = *beta == 0.0 ? *alpha * sum : *alpha * sum + *beta * *c;
        }
    }
}

/* B (m*n) := alpha B T^-T, T lower triangular, with ones on its diagonal if it is unit */
static void naive_dtrsm(char *side, char *half, char *trans, char *unit, int *m, int *n,
                        double *alpha, double *T, int *ldt, double *B, int *ldb)
{
    CHECK(*side == 'R' && *half == 'L' && *trans == 'T' && (*unit == 'N' || *unit == 'U'));
    for (int j = 0; j < *n; j++) {
        for (int i = 0; i < *m; i++) {
            double sum = *alpha * B[i + j * *ldb];
            for (int l = 0; l < j; l++)
                sum -= B[i + l * *ldb] * T[j + l * *ldt];
            B[i + j * *ldb] = *unit == 'U' ? sum : sum / T[j + j * *ldt];
        }
    }
}

const pma_blas NAIVE_BLAS = {naive_dgemm, naive_dtrsm, 0};

void list_ascending(structure *m)
{
    int64_t k = 0;
    m->ptr[0] = 0;
    for (size_t i = 0; i < m->n; i++) {
        for (size_t j = 0; j < m->n; j++) {
            if (m->A[i * m->n + j] != 0.0)
                m->index[k++] = (int32_t)j;
        }
        m->ptr[i + 1] = k;
    }
}

void list_entries(structure *m)
{
    int64_t k = 0;
    m->ptr[0] = 0;
    for (size_t i = 0; i < m->n; i++) {
        for (size_t j = m->n; j-- > 0;) {
            if (m->A[i * m->n + j] == 0.0)
                continue;
            m->index[k] = (int32_t)j;
            m->entries[k++] = m->A[i * m->n + j];
        }
        m->ptr[i + 1] = k;
    }
}

void draw_definite(structure *m, size_t n, size_t nb, uint32_t one_in, uint64_t *seed)
{
    m->n = n;
    m->nb = nb;
    memset(m->A, 0, sizeof m->A);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < i; j++) {
            if (draw(seed, one_in) == 0)
                m->A[i * n + j] = m->A[j * n + i] = draw(seed, 2) ? 0.5 : -1.0;
        }
    }
    for (size_t i = 0; i < n; i++) {
        double sum = 0.125;
        for (size_t j = 0; j < n; j++)
            sum += fabs(m->A[i * n + j]);
        m->A[i * n + i] = sum;
    }
}

void draw_grid(structure *m)
{
    *m = (structure){.n = UNKNOWNS, .nb = GRID};
    for (size_t i = 0; i < UNKNOWNS; i++) {
        m->A[i * UNKNOWNS + i] = 4.125;
        if (i % GRID > 0)
            m->A[i * UNKNOWNS + i - 1] = m->A[(i - 1) * UNKNOWNS + i] = -1.0;
        if (i >= GRID)
            m->A[i * UNKNOWNS + i - GRID] = m->A[(i - GRID) * UNKNOWNS + i] = -1.0;
    }
}

void count_entries(structure *m)
{
    pma_symbolic_count(m->n, m->ptr, m->index, m->parent, m->integers, m->count);
}

static bool never(void *ctx)
{
    (void)ctx;
    return false;
}

const pma_patience NEVER = {.stop = never};

pma_status make_numbers(structure *m, double lost, const pma_patience *patience, size_t *column)
{
    const pma_panels_input input = {
        .n = m->n, .ptr = m->ptr, .index = m->index, .values = m->entries, .lost = lost};
    pma_elimination *e;
    CHECK_STATUS(pma_elimination_create(&m->panels, m->n, m->owner, &NAIVE_BLAS, 1, &e), PMA_OK);
    const pma_status status = pma_elimination_run(e, &input, m->inverse, patience, column);
    pma_elimination_destroy(e);
    return status;
}

void reorder(structure *m)
{
    static double A[UNKNOWNS * UNKNOWNS];
    memcpy(A, m->A, sizeof A);
    for (size_t i = 0; i < m->n; i++) {
        for (size_t j = 0; j < m->n; j++)
            m->A[i * m->n + j] = A[(size_t)m->order[i] * m->n + (size_t)m->order[j]];
    }
}

void analyse(structure *m)
{
    list_entries(m);
    count_entries(m);
    pma_symbolic_postorder(m->n, m->nb, m->parent, m->count, m->integers, m->order);
    reorder(m);
    list_entries(m);
    count_entries(m);
    const size_t s =
        pma_symbolic_supernodes(m->n, m->nb, m->parent, m->count, m->integers, m->first);
    pma_symbolic_lay_out(s, m->first, m->count, m->row_ptr, m->start);
    pma_symbolic_rows(m->n, m->ptr, m->index, s, m->first, m->row_ptr, m->owner, m->integers,
                      m->integers + m->n, m->integers + m->n + s, m->rows);
    m->panels = (pma_panels){s, m->first, m->row_ptr, m->rows, m->start, m->values, 0};
}

void check_definite_residual(const structure *m, const double *x, const double *b)
{
    const size_t n = m->n;
    for (size_t i = 0; i < n; i++) {
        double residual = b[i], scale = 0.0;
        for (size_t j = 0; j < n; j++) {
            residual -= m->A[i * n + j] * x[j];
            scale += sqrt(fabs(m->A[i * n + i] * m->A[j * n + j])) * fabs(x[j]);
        }
        CHECK_NEAR(residual, 0.0, 8.0 * (double)(n + 1) * EPS * scale);
    }
}
