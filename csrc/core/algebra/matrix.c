#include "algebra/matrix.h"

#include "algebra/kernel.h"
#include "algebra/loops.h"

pma_status pma_matrix_check(const pma_matrix *A)
{
    if (A->form == PMA_BAND)
        return A->width < A->n ? PMA_OK : PMA_BAD_SIZE;
    if (A->form == PMA_STRIPS)
        return pma_strips_check(&A->strips, A->n);
    if (A->form != PMA_SPARSE)
        return PMA_OK;
    if (A->ptr[0] != 0)
        return PMA_BAD_INDEX;
    for (size_t i = 0; i < A->n; i++) {
        if (A->ptr[i + 1] < A->ptr[i])
            return PMA_BAD_INDEX;
    }
    for (int64_t k = 0; k < A->ptr[A->n]; k++) {
        if (A->index[k] < 0 || (size_t)A->index[k] >= A->n)
            return PMA_BAD_INDEX;
    }
    return PMA_OK;
}

size_t pma_matrix_entries(const pma_matrix *A)
{
    switch (A->form) {
    case PMA_DIAGONAL:
        return A->n;
    case PMA_DENSE:
        return A->n * A->n;
    case PMA_BAND:
        return (A->width + 1) * A->n + (A->below > 0 ? A->width * A->n : 0);
    case PMA_SPARSE:
        return (size_t)A->ptr[A->n];
    case PMA_STRIPS:
        return (size_t)A->strips.start[A->strips.count];
    case PMA_IN_LANES:
        return pma_matrix_entries(A->each);
    default:
        return 0;
    }
}

static size_t reach_of_rows(const pma_matrix *A)
{
    size_t reach = 0;
    for (size_t i = 0; i < A->n; i++) {
        for (int64_t k = A->ptr[i]; k < A->ptr[i + 1]; k++) {
            const size_t j = (size_t)A->index[k], distance = j > i ? j - i : i - j;
            reach = distance > reach ? distance : reach;
        }
    }
    return reach;
}

size_t pma_matrix_reach(const pma_matrix *A)
{
    switch (A->form) {
    case PMA_BAND:
        return A->width;
    case PMA_DENSE:
        return A->n - 1;
    case PMA_SPARSE:
        return reach_of_rows(A);
    case PMA_STRIPS:
        return pma_strips_reach(&A->strips);
    case PMA_IN_LANES:
        return PMA_LANES * pma_matrix_reach(A->each);
    default:
        return 0;
    }
}

/* ---- y -= A x in some rows, for each form ---------------------------------------------------- */

static void subtract_zero(const pma_matrix *A, size_t begin, size_t end, const double *x, double *y)
{
    (void)A, (void)begin, (void)end, (void)x, (void)y;
}

static void subtract_diagonal(const pma_matrix *A, size_t begin, size_t end, const double *x,
                              double *restrict y)
{
    for (size_t i = begin; i < end; i++)
        y[i] -= A->values[i] * x[i];
}

static void subtract_sparse(const pma_matrix *A, size_t begin, size_t end, const double *x,
                            double *y)
{
    for (size_t i = begin; i < end; i++) {
        double sum = 0.0;
        for (int64_t k = A->ptr[i]; k < A->ptr[i + 1]; k++)
            sum += A->values[k] * x[A->index[k]];
        y[i] -= sum;
    }
}

/* Up to this size a product is shorter than the preparations of the kernel, whose order it has. */
enum { FEW = 4 };

static void subtract_few(const pma_matrix *A, size_t begin, size_t end, const double *x, double *y)
{
    const size_t n = A->n;
    const double *row = A->values + begin;
    for (size_t i = begin; i < end; i++, row++) {
        double sum = y[i];
#pragma omp simd simdlen(1)
        for (size_t j = 0; j < n; j++)
            sum -= row[j * n] * x[j];
        y[i] = sum;
    }
}

static void subtract_few_of_chain(const pma_matrix *A, size_t begin, size_t end, const double *x,
                                  double *y)
{
    const size_t last = A->n - 1;
    const double *diagonal = A->values, *right = diagonal + A->n, *left = right + A->below;
    for (size_t i = begin; i < end; i++) {
        double sum = y[i] - diagonal[i] * x[i];
        if (i < last)
            sum -= right[i] * x[i + 1];
        if (i > 0)
            sum -= left[i - 1] * x[i - 1];
        y[i] = sum;
    }
}

static void subtract_band(const pma_matrix *A, size_t begin, size_t end, const double *x, double *y)
{
    if (A->width == 1 && A->n <= FEW)
        subtract_few_of_chain(A, begin, end, x, y);
    else
        pma_kernel_best()->subtract_band(A->values, A->values + A->below, A->n, A->width, begin,
                                         end, x, y);
}

static void subtract_dense(const pma_matrix *A, size_t begin, size_t end, const double *x,
                           double *y)
{
    if (A->n <= FEW)
        subtract_few(A, begin, end, x, y);
    else
        pma_kernel_best()->subtract(A->values + begin, A->n, end - begin, A->n, x, y + begin);
}

static void subtract_strips(const pma_matrix *A, size_t begin, size_t end, const double *x,
                            double *y)
{
    pma_strips_subtract(&A->strips, begin, end, x, y);
}

static void subtract_lanes(const pma_matrix *A, size_t begin, size_t end, const double *x,
                           double *y)
{
    pma_loops_subtract_rows(A->each, begin / PMA_LANES, end / PMA_LANES, x, y);
}

/* A table: in a switch, every form would save the registers of all. */
void pma_matrix_subtract_rows(const pma_matrix *A, size_t begin, size_t end, const double *x,
                              double *y)
{
    static void (*const SUBTRACT[])(const pma_matrix *A, size_t begin, size_t end, const double *x,
                                    double *y) = {
        [PMA_ZERO] = subtract_zero,      [PMA_DIAGONAL] = subtract_diagonal,
        [PMA_BAND] = subtract_band,      [PMA_DENSE] = subtract_dense,
        [PMA_SPARSE] = subtract_sparse,  [PMA_STRIPS] = subtract_strips,
        [PMA_IN_LANES] = subtract_lanes,
    };
    SUBTRACT[A->form](A, begin, end, x, y);
}

/* Rows at a time, so that what is read again stays in the cache. */
enum { PIECE = 1024 };

void pma_matrix_subtract(const pma_matrix *A, const double *x, double *y)
{
    for (size_t begin = 0; begin < A->n; begin += PIECE) {
        const size_t end = A->n - begin < PIECE ? A->n : begin + PIECE;
        pma_matrix_subtract_rows(A, begin, end, x, y);
    }
}

bool pma_is_finite(size_t n, const double *x)
{
    double zero = 0.0;
#pragma omp simd reduction(+ : zero)
    for (size_t i = 0; i < n; i++)
        zero += 0.0 * x[i];
    return zero == 0.0;
}

/* ---- in another order ------------------------------------------------------------------------ */

/* Shell's sort with the gaps 1, 4, 13, 40, ...: rows are short, and mostly in ascending pieces. */
void pma_matrix_sort_row(int64_t count, int32_t *index, double *values)
{
    int64_t gap = 1;
    while (3 * gap + 1 < count)
        gap = 3 * gap + 1;
    for (; gap > 0; gap /= 3) {
        for (int64_t e = gap; e < count; e++) {
            const int32_t own = index[e];
            const double value = values[e];
            int64_t at = e;
            for (; at >= gap && index[at - gap] > own; at -= gap) {
                index[at] = index[at - gap];
                values[at] = values[at - gap];
            }
            index[at] = own;
            values[at] = value;
        }
    }
}

void pma_matrix_permute(size_t n, const int64_t *ptr, const int32_t *index, const double *values,
                        const int64_t *order, const int32_t *position, int64_t *B_ptr,
                        int32_t *B_index, double *B_values)
{
    int64_t count = 0;
    for (size_t k = 0; k < n; k++) {
        B_ptr[k] = count;
        for (int64_t e = ptr[order[k]]; e < ptr[order[k] + 1]; e++, count++) {
            B_index[count] = position[index[e]];
            B_values[count] = values[e];
        }
        pma_matrix_sort_row(count - B_ptr[k], B_index + B_ptr[k], B_values + B_ptr[k]);
    }
    B_ptr[n] = count;
}
