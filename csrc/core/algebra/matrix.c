#include "algebra/matrix.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "algebra/kernel.h"
#include "algebra/lanes.h"
#include "algebra/lists.h"

static size_t rows_of(const pma_strips *S, size_t s)
{
    return (size_t)(S->first[s + 1] - S->first[s]);
}

static size_t columns_of(const pma_strips *S, size_t s)
{
    return (size_t)(S->ptr[s + 1] - S->ptr[s]);
}

/* ---- strips --------------------------------------------------------------------------------- */

/* Four whose last is three above the first are read at one go. */
static bool four_are_right(const int32_t *index)
{
    return index[3] - index[0] != 3 || (index[1] - index[0] == 1 && index[2] - index[0] == 2);
}

pma_status pma_strips_check(const pma_strips *S, size_t n)
{
    if (S->first[0] != 0 || S->ptr[0] != 0 || S->start[0] != 0 || S->first[S->count] != (int64_t)n)
        return PMA_BAD_INDEX;
    for (size_t s = 0; s < S->count; s++) {
        if (S->first[s + 1] <= S->first[s] || S->first[s + 1] > (int64_t)n ||
            rows_of(S, s) > PMA_STRIP_ROWS || S->ptr[s + 1] < S->ptr[s] ||
            columns_of(S, s) % 4 != 0 ||
            S->start[s + 1] - S->start[s] != (int64_t)(rows_of(S, s) * columns_of(S, s)))
            return PMA_BAD_INDEX;
    }
    if (!pma_are_within(n, S->ptr[S->count], S->index))
        return PMA_BAD_INDEX;
    for (int64_t k = 0; k < S->ptr[S->count]; k += 4) {
        if (!four_are_right(S->index + k))
            return PMA_BAD_INDEX;
    }
    return PMA_OK;
}

/* ---- strips from rows ------------------------------------------------------------------------ */

static int64_t padded(int64_t columns)
{
    return (columns + 3) / 4 * 4;
}

static int64_t bytes_of(int64_t rows, int64_t columns)
{
    return (8 * rows + 4) * padded(columns) + 24;
}

size_t pma_strips_group(size_t n, const int64_t *ptr, const int32_t *index, int64_t *first,
                        int64_t *columns, int64_t *mark)
{
    size_t count = 0;
    for (size_t i = 0; i < n; i++)
        mark[i] = -1;
    for (size_t i = 0; i < n; i++) {
        const int64_t row = (int64_t)i, length = ptr[i + 1] - ptr[i], open = (int64_t)count - 1;
        int64_t more = 0; /* columns that the open strip does not have */
        for (int64_t k = ptr[i]; k < ptr[i + 1]; k++)
            more += open < 0 || mark[index[k]] != open;
        const int64_t rows = open < 0 ? PMA_STRIP_ROWS : row - first[open];
        const bool joins =
            rows < PMA_STRIP_ROWS && bytes_of(rows + 1, columns[open] + more) <=
                                         bytes_of(rows, columns[open]) + bytes_of(1, length);
        if (!joins) {
            first[count] = row;
            columns[count++] = length;
        } else {
            columns[open] += more;
        }
        for (int64_t k = ptr[i]; k < ptr[i + 1]; k++)
            mark[index[k]] = (int64_t)count - 1;
    }
    first[count] = (int64_t)n;
    for (size_t s = 0; s < count; s++)
        columns[s] = padded(columns[s]);
    return count;
}

static void reverse(int32_t *list, size_t count)
{
    for (size_t k = 0; 2 * k + 1 < count; k++) {
        const int32_t kept = list[k];
        list[k] = list[count - 1 - k];
        list[count - 1 - k] = kept;
    }
}

/* Moves the places begin..end-1 of a list to place `to` before them; all keep their order. */
static void move_forward(int32_t *list, size_t to, size_t begin, size_t end)
{
    reverse(list + to, begin - to);
    reverse(list + begin, end - begin);
    reverse(list + to, end - to);
}

/* Of an ascending list, four columns at a time that follow one another come first: they are read
 * at one go. */
static void fours_first(int32_t *list, size_t count)
{
    size_t fours = 0;
    for (size_t k = 0; k + 4 <= count;) {
        if (list[k + 3] - list[k] != 3) {
            k++;
            continue;
        }
        move_forward(list, fours, k, k + 4);
        fours += 4;
        k += 4;
    }
}

void pma_strips_fill(const pma_strips *S, size_t n, const int64_t *ptr, const int32_t *index,
                     const double *entries, int64_t *mark, int32_t *strip_index,
                     double *strip_values)
{
    for (size_t j = 0; j < n; j++)
        mark[j] = -1;
    for (size_t s = 0; s < S->count; s++) {
        int32_t *list = strip_index + S->ptr[s];
        const int64_t rows = (int64_t)rows_of(S, s);
        size_t have = 0;
        for (int64_t k = ptr[S->first[s]]; k < ptr[S->first[s + 1]]; k++) {
            if (mark[index[k]] < S->ptr[s]) { /* not of this strip yet */
                mark[index[k]] = S->ptr[s];
                list[have++] = index[k];
            }
        }
        qsort(list, have, sizeof *list, pma_ascending);
        fours_first(list, have);
        for (size_t k = 0; k < have; k++)
            mark[list[k]] = S->ptr[s] + (int64_t)k;
        for (size_t k = have; k < columns_of(S, s); k++)
            list[k] = list[have / 4 * 4]; /* no four that seem to follow one another */
        for (int64_t i = S->first[s]; i < S->first[s + 1]; i++) {
            double *row = strip_values + S->start[s] + 4 * (i - S->first[s]);
            for (int64_t k = ptr[i]; k < ptr[i + 1]; k++) {
                const int64_t place = mark[index[k]] - S->ptr[s];
                row[place / 4 * 4 * rows + place % 4] += entries[k];
            }
        }
    }
}

/* ---- any matrix ------------------------------------------------------------------------------ */

pma_status pma_matrix_check(const pma_matrix *A)
{
    if (A->form == PMA_BAND)
        return A->width < A->n ? PMA_OK : PMA_BAD_SIZE;
    if (A->form == PMA_STRIPS)
        return pma_strips_check(&A->strips, A->n);
    if (A->form != PMA_SPARSE)
        return PMA_OK;
    const bool good = pma_are_starts(A->n, A->ptr) && pma_are_within(A->n, A->ptr[A->n], A->index);
    return good ? PMA_OK : PMA_BAD_INDEX;
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

/* ---- y -= A x in some rows, for each form ---------------------------------------------------- */

static void subtract_zero(const pma_matrix *A, size_t begin, size_t end, const double *x, double *y)
{
    (void)A, (void)begin, (void)end, (void)x, (void)y;
}

PMA_LOOP(subtract_diagonal,
         (const pma_matrix *A, size_t begin, size_t end, const double *x, double *y), {
             const number *from = (const number *)x;
             number *restrict to = (number *)y;
             for (size_t i = begin; i < end; i++)
                 PMA_SUBTRACT(A->values[i], &from[i], &to[i]);
         })

PMA_LOOP(subtract_sparse,
         (const pma_matrix *A, size_t begin, size_t end, const double *x, double *y), {
             const number *from = (const number *)x;
             number *to = (number *)y;
             for (size_t i = begin; i < end; i++) {
                 number sum = {0};
                 for (int64_t k = A->ptr[i]; k < A->ptr[i + 1]; k++)
                     PMA_ADD(A->values[k], &from[A->index[k]], &sum);
                 PMA_SUBTRACT(1.0, &sum, &to[i]);
             }
         })

/* Row by row */
PMA_LOOP(subtract_rows_of_band,
         (const pma_matrix *A, size_t begin, size_t end, const double *x, double *y), {
             const number *from = (const number *)x;
             number *to = (number *)y;
             for (size_t i = begin; i < end; i++) {
                 number sum = to[i];
                 PMA_SUBTRACT(A->values[i], &from[i], &sum);
                 for (size_t d = 1; d <= A->width; d++) {
                     const double *above = A->values + d * A->n;
                     if (i + d < A->n)
                         PMA_SUBTRACT(above[i], &from[i + d], &sum);
                     if (i >= d)
                         PMA_SUBTRACT(above[A->below + i - d], &from[i - d], &sum);
                 }
                 to[i] = sum;
             }
         })

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

/* Rows at a time, so that what is read for each diagonal again stays in the cache. */
enum { PIECE = 1024 };

static void subtract_diagonals(const pma_matrix *A, size_t begin, size_t end, const double *x,
                               double *y)
{
    for (size_t next; begin < end; begin = next) {
        next = end - begin < PIECE ? end : begin + PIECE;
        pma_kernel_best()->subtract_band(A->values, A->values + A->below, A->n, A->width, begin,
                                         next, x, y);
    }
}

static void subtract_band(const pma_matrix *A, size_t begin, size_t end, const double *x, double *y)
{
    if (A->width == 1 && A->n <= FEW)
        subtract_rows_of_band_one(A, begin, end, x, y);
    else
        subtract_diagonals(A, begin, end, x, y);
}

static void subtract_dense(const pma_matrix *A, size_t begin, size_t end, const double *x,
                           double *y)
{
    if (A->n <= FEW)
        subtract_few(A, begin, end, x, y);
    else
        pma_kernel_best()->subtract(A->values + begin, A->n, end - begin, A->n, x, y + begin);
}

/* ---- product of strips ----------------------------------------------------------------------- */

static size_t strip_at(const pma_strips *S, size_t row)
{
    return pma_start_of(S->first, S->count, row + 1) - 1;
}

/* Rows begin..end-1 of strip s, which has more. */
static void subtract_some(const pma_strips *S, size_t s, size_t begin, size_t end, const double *x,
                          double *y)
{
    double own[PMA_STRIP_ROWS] = {0.0};
    double *some = own + (begin - (size_t)S->first[s]);
    memcpy(some, y + begin, (end - begin) * sizeof *y);
    pma_kernel_best()->subtract_strips(S, s, s + 1, x, own);
    memcpy(y + begin, some, (end - begin) * sizeof *y);
}

static void subtract_strips(const pma_matrix *A, size_t begin, size_t end, const double *x,
                            double *y)
{
    const pma_strips *S = &A->strips;
    if (begin == end)
        return;
    size_t s = strip_at(S, begin), last = strip_at(S, end - 1);
    if (begin > (size_t)S->first[s]) {
        const size_t next = (size_t)S->first[s + 1];
        subtract_some(S, s++, begin, next < end ? next : end, x, y);
    }
    if (s <= last && end == (size_t)S->first[last + 1])
        last++;
    else if (s <= last)
        subtract_some(S, last, (size_t)S->first[last], end, x, y);
    if (s < last)
        pma_kernel_best()->subtract_strips(S, s, last, x, y + S->first[s]);
}

/* ---- in lanes: begin and end are unknowns --------------------------------------------------- */

pma_matrix pma_matrix_in_lanes(const pma_matrix *each)
{
    const pma_form form = each->form == PMA_ZERO ? PMA_ZERO : PMA_IN_LANES;
    return (pma_matrix){.form = form, .n = each->n * PMA_LANES, .each = each};
}

/* Rows at a time, so that what is read again stays in the cache. */
enum { LANE_PIECE = 256 };

static void subtract_dense_lanes(const pma_matrix *A, size_t begin, size_t end, const double *x,
                                 double *y)
{
    for (size_t i = begin; i < end; i += LANE_PIECE) {
        const size_t rows = end - i < LANE_PIECE ? end - i : LANE_PIECE;
        pma_kernel_best()->subtract_lanes(A->values + i, A->n, rows, A->n, x, y + i * PMA_LANES);
    }
}

static void subtract_strips_lanes(const pma_matrix *A, size_t begin, size_t end, const double *x,
                                  double *y)
{
    const pma_strips *S = &A->strips;
    double product[PMA_STRIP_ROWS * PMA_LANES];
    for (size_t s = strip_at(S, begin); s < S->count && (size_t)S->first[s] < end; s++) {
        const size_t first = (size_t)S->first[s], last = (size_t)S->first[s + 1];
        const size_t from = first > begin ? first : begin, to = last < end ? last : end;
        pma_kernel_best()->multiply_strip_lanes(S->values + S->start[s], last - first,
                                                columns_of(S, s), S->index + S->ptr[s], x, product);
        for (size_t k = from * PMA_LANES; k < to * PMA_LANES; k++)
            y[k] -= product[k - first * PMA_LANES];
    }
}

/* ---- each form ------------------------------------------------------------------------------ */

typedef void (*product)(const pma_matrix *A, size_t begin, size_t end, const double *x, double *y);

#define IN_LANES(kind)                          \
    {[PMA_DIAGONAL] = subtract_diagonal_##kind, \
     [PMA_BAND] = subtract_rows_of_band_##kind, \
     [PMA_DENSE] = subtract_dense_lanes,        \
     [PMA_SPARSE] = subtract_sparse_##kind,     \
     [PMA_STRIPS] = subtract_strips_lanes}

static void subtract_lanes(const pma_matrix *A, size_t begin, size_t end, const double *x,
                           double *y)
{
    static const product PLAIN[] = IN_LANES(plain), AVX2[] = IN_LANES(avx2);
    (pma_has_avx2() ? AVX2 : PLAIN)[A->each->form](A->each, begin / PMA_LANES, end / PMA_LANES, x,
                                                   y);
}

/* A table: in a switch, every form would save the registers of all. */
void pma_matrix_subtract_rows(const pma_matrix *A, size_t begin, size_t end, const double *x,
                              double *y)
{
    assert(begin <= end && end <= A->n);
    static const product SUBTRACT[] = {
        [PMA_ZERO] = subtract_zero,         [PMA_DIAGONAL] = subtract_diagonal_one,
        [PMA_BAND] = subtract_band,         [PMA_DENSE] = subtract_dense,
        [PMA_SPARSE] = subtract_sparse_one, [PMA_STRIPS] = subtract_strips,
        [PMA_IN_LANES] = subtract_lanes,
    };
    SUBTRACT[A->form](A, begin, end, x, y);
}

void pma_matrix_subtract(const pma_matrix *A, const double *x, double *y)
{
    pma_matrix_subtract_rows(A, 0, A->n, x, y);
}

void pma_matrix_multiply(const pma_matrix *A, const double *x, double *y)
{
    memset(y, 0, A->n * sizeof *y);
    pma_matrix_subtract(A, x, y);
    for (size_t i = 0; i < A->n; i++)
        y[i] = -y[i];
}

double pma_matrix_square(const pma_matrix *A, const double *x, double *product)
{
    double sum = 0.0;
    memset(product, 0, A->n * sizeof *product);
    pma_matrix_subtract(A, x, product);
    for (size_t i = 0; i < A->n; i++)
        sum -= x[i] * product[i];
    return sum;
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

/* The entries of one row in ascending order of their indices, which differ; Shell's sort with the
 * gaps 1, 4, 13, 40, ...: rows are short, and mostly in ascending pieces. */
static void sort_row(int64_t count, int32_t *index, double *values)
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
        sort_row(count - B_ptr[k], B_index + B_ptr[k], B_values + B_ptr[k]);
    }
    B_ptr[n] = count;
}
