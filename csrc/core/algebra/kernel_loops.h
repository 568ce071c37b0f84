/* kernel_loops.h - the loops of a kernel, compiled once for each kind of processor.
 *
 * Included by a source that defines `piece`, a vector of as many numbers as its registers hold,
 * WIDTH of them, TARGET, the attribute of its functions, and GATHERED(x, at), the numbers of
 * x at a piece of an index. An entry is the same sum in the same order for any of them. */
#include <stdbool.h>
#include <stdint.h>

#include "algebra/kernel.h"
#include "algebra/lanes.h"

/* Columns that share a pass over x. With four of them backward, solids took 1.05 times as long. */
enum { GROUP = 8 };

/* Four numbers are some pieces. */
enum { STRIP = PMA_STRIP_ROWS, PIECES = 4 / WIDTH };

PMA_INLINE const piece *pieces_at(const double *x)
{
    return (const piece *)x;
}

PMA_INLINE double sum_of_four(const piece *x)
{
    return (x[0][0] + x[0][1]) + (x[2 / WIDTH][2 % WIDTH] + x[3 / WIDTH][3 % WIDTH]);
}

/* clang-format off: attributes are long, and a name begins its line */

/* ---- one vector ------------------------------------------------------------------------------ */

/* A number of some entries from A, to be fetched only: it may be outside of the array. */
PMA_INLINE const void *beyond(const double *A, intptr_t entries)
{
    return (const void *)((uintptr_t)A + (uintptr_t)entries * sizeof *A);
}

/* Four rows of some columns at a time: as many numbers of the columns that a sweep reads next are
 * fetched meanwhile, in the order of memory. To the loads of a processor the columns are several
 * short streams, of which it recognises each too late. */
PMA_INLINE void fetch(const double *A, intptr_t next, size_t row, const size_t columns)
{
#pragma GCC unroll 4
    for (size_t k = 0; k < columns / 2; k++)
        __builtin_prefetch(beyond(A, next + (intptr_t)(row * columns + 8 * k)), 0, 2);
}

/* y_i -= sum over the columns of A_ij x_j */
PMA_INLINE void subtract_columns(const double *A, size_t ld, size_t rows, const size_t columns,
                                 const double *x, double *restrict y)
{
    size_t i = 0;
    for (; i + 4 <= rows; i += 4) {
        piece sum[PIECES];
#pragma GCC unroll 2
        for (size_t h = 0; h < PIECES; h++)
            sum[h] = pieces_at(y + i)[h];
#pragma GCC unroll 8
        for (size_t j = 0; j < columns; j++) {
#pragma GCC unroll 2
            for (size_t h = 0; h < PIECES; h++)
                sum[h] -= pieces_at(A + j * ld + i)[h] * x[j];
        }
#pragma GCC unroll 2
        for (size_t h = 0; h < PIECES; h++)
            ((piece *)(y + i))[h] = sum[h];
        fetch(A, (intptr_t)(columns * ld), i, columns);
    }
    for (; i < rows; i++) {
        double sum = y[i];
#pragma GCC unroll 8
        for (size_t j = 0; j < columns; j++)
            sum -= A[j * ld + i] * x[j];
        y[i] = sum;
    }
}

/* x_j -= sum over the rows of A_ij y_i, with 4 partial sums for each column */
PMA_INLINE void subtract_products(const double *A, size_t ld, size_t rows, const size_t columns,
                                  const double *y, double *x)
{
    piece sum[GROUP][PIECES] = {{{0.0}}};
    double rest[GROUP] = {0.0};
    size_t i = 0;
    for (; i + 4 <= rows; i += 4) {
#pragma GCC unroll 8
        for (size_t j = 0; j < columns; j++) {
#pragma GCC unroll 2
            for (size_t h = 0; h < PIECES; h++)
                sum[j][h] += pieces_at(A + j * ld + i)[h] * pieces_at(y + i)[h];
        }
        fetch(A, -(intptr_t)(GROUP * ld), i, columns);
    }
    for (; i < rows; i++) {
#pragma GCC unroll 8
        for (size_t j = 0; j < columns; j++)
            rest[j] += A[j * ld + i] * y[i];
    }
#pragma GCC unroll 8
    for (size_t j = 0; j < columns; j++)
        x[j] -= sum_of_four(sum[j]) + rest[j];
}

/* One row after the other of each piece columns, which is their order in memory. */
PMA_INLINE void multiply_rows(const double *values, const size_t rows, size_t columns,
                              const int32_t *index, const double *x, double *product)
{
    piece part[STRIP][PIECES] = {{{0.0}}};
    for (size_t k = 0; k < columns; k += 4) {
        const int32_t *at = index + k;
        const bool follow = at[3] - at[0] == 3; /* one another */
        piece xk[PIECES];
#pragma GCC unroll 2
        for (size_t h = 0; h < PIECES; h++)
            xk[h] = follow ? pieces_at(x + at[0])[h] : GATHERED(x, at + WIDTH * h);
#pragma GCC unroll 6
        for (size_t r = 0; r < rows; r++) {
#pragma GCC unroll 2
            for (size_t h = 0; h < PIECES; h++)
                part[r][h] += pieces_at(values + k * rows + 4 * r)[h] * xk[h];
        }
    }
#pragma GCC unroll 6
    for (size_t r = 0; r < rows; r++)
        product[r] = sum_of_four(part[r]);
}

PMA_INLINE void subtract_strip(const pma_strips *S, size_t s, const size_t rows, const double *x,
                               double *y)
{
    double product[STRIP];
    multiply_rows(S->values + S->start[s], rows, (size_t)(S->ptr[s + 1] - S->ptr[s]),
                  S->index + S->ptr[s], x, product);
#pragma GCC unroll 6
    for (size_t r = 0; r < rows; r++)
        y[r] -= product[r];
}

PMA_INLINE void subtract_strips(const pma_strips *S, size_t begin, size_t end, const double *x,
                                double *y)
{
    for (size_t s = begin; s < end; s++) {
        const size_t rows = (size_t)(S->first[s + 1] - S->first[s]);
        switch (rows) { /* each with its own loop, the sums in registers */
        case 1:
            subtract_strip(S, s, 1, x, y);
            break;
        case 2:
            subtract_strip(S, s, 2, x, y);
            break;
        case 3:
            subtract_strip(S, s, 3, x, y);
            break;
        case 4:
            subtract_strip(S, s, 4, x, y);
            break;
        case 5:
            subtract_strip(S, s, 5, x, y);
            break;
        default:
            subtract_strip(S, s, 6, x, y);
            break;
        }
        y += rows;
    }
}

/* Diagonal by diagonal, which is vectorised. */
PMA_INLINE void subtract_band(const double *above, const double *below, size_t n, size_t width,
                              size_t begin, size_t end, const double *x, double *restrict y)
{
    for (size_t i = begin; i < end; i++)
        y[i] -= above[i] * x[i];
    for (size_t d = 1; d <= width; d++) {
        const double *right = above + d * n, *left = below + d * n;
        const size_t first = begin > d ? begin : d, last = end < n - d ? end : n - d;
        for (size_t i = begin; i < last; i++)
            y[i] -= right[i] * x[i + d];
        for (size_t i = first; i < end; i++)
            y[i] -= left[i - d] * x[i - d];
    }
}

/* ---- the same with vectors in lanes ---------------------------------------------------- */

/* Rows that share a pass over the columns, so that what is read of x serves all of them. The loops
 * wait for the arithmetic, not for memory, if the columns that come next are fetched meanwhile. */
enum { PARTS = PMA_LANES / WIDTH, ROWS = WIDTH, LANE_PIECE = 128, LANE_COLUMNS = 32 };

PMA_INLINE const piece *lanes_at(const double *x, size_t i)
{
    return pieces_at(x + i * PMA_LANES);
}

/* y_i -= sum over the columns of A_ij x_j */
PMA_INLINE void subtract_rows_lanes(const double *A, size_t ld, const size_t rows, size_t columns,
                                    const double *x, double *y)
{
    piece sum[ROWS][PARTS];
#pragma GCC unroll 4
    for (size_t r = 0; r < rows; r++) {
#pragma GCC unroll 4
        for (size_t h = 0; h < PARTS; h++)
            sum[r][h] = lanes_at(y, r)[h];
    }
#pragma GCC unroll 1
    for (size_t j = 0; j < columns; j++) {
        if (rows == ROWS)
            __builtin_prefetch(beyond(A, (intptr_t)((j + GROUP) * ld)));
#pragma GCC unroll 4
        for (size_t h = 0; h < PARTS; h++) {
            const piece xj = lanes_at(x, j)[h];
#pragma GCC unroll 4
            for (size_t r = 0; r < rows; r++)
                sum[r][h] -= A[j * ld + r] * xj;
        }
    }
#pragma GCC unroll 4
    for (size_t r = 0; r < rows; r++) {
#pragma GCC unroll 4
        for (size_t h = 0; h < PARTS; h++)
            ((piece *)(y + r * PMA_LANES))[h] = sum[r][h];
    }
}

PMA_INLINE void subtract_columns_lanes(const double *A, size_t ld, size_t rows, size_t columns,
                                       const double *x, double *y)
{
    size_t i = 0;
    for (; i + ROWS <= rows; i += ROWS)
        subtract_rows_lanes(A + i, ld, ROWS, columns, x, y + i * PMA_LANES);
    for (; i < rows; i++)
        subtract_rows_lanes(A + i, ld, 1, columns, x, y + i * PMA_LANES);
}

/* part_k += the sum over every fourth row, from the k-th on, of a_i y_i, for each of some columns;
 * rows is a multiple of 4. What is read of y serves all columns. */
PMA_INLINE void add_products_lanes(const double *A, size_t ld, size_t rows, const size_t columns,
                                   const size_t k, const double *y, piece (*part)[4][PARTS])
{
    piece sum[ROWS][PARTS];
#pragma GCC unroll 4
    for (size_t j = 0; j < columns; j++) {
#pragma GCC unroll 4
        for (size_t h = 0; h < PARTS; h++)
            sum[j][h] = part[j][k][h];
    }
#pragma GCC unroll 1
    for (size_t i = k; i < rows; i += 4) {
        __builtin_prefetch(beyond(A, (intptr_t)((k % columns) * ld + i) - (intptr_t)(GROUP * ld)));
#pragma GCC unroll 4
        for (size_t h = 0; h < PARTS; h++) {
            const piece yi = lanes_at(y, i)[h];
#pragma GCC unroll 4
            for (size_t j = 0; j < columns; j++)
                sum[j][h] += A[j * ld + i] * yi;
        }
    }
#pragma GCC unroll 4
    for (size_t j = 0; j < columns; j++) {
#pragma GCC unroll 4
        for (size_t h = 0; h < PARTS; h++)
            part[j][k][h] = sum[j][h];
    }
}

/* The sums of the piece parts, of rows that are a multiple of 4; some rows for all columns at a
 * time, so that they stay in the cache */
PMA_INLINE void sum_products_lanes(const double *A, size_t ld, size_t rows, const size_t columns,
                                   const double *y, piece (*sum)[PARTS])
{
    piece part[GROUP][4][PARTS] = {{{{0.0}}}};
    const size_t together = columns < ROWS ? columns : ROWS;
    for (size_t begin = 0; begin < rows; begin += LANE_PIECE) {
        const size_t size = rows - begin < LANE_PIECE ? rows - begin : LANE_PIECE;
        for (size_t j = 0; j < columns; j += together) {
            for (size_t k = 0; k < 4; k++)
                add_products_lanes(A + j * ld + begin, ld, size, together, k, y + begin * PMA_LANES,
                                   part + j);
        }
    }
    for (size_t j = 0; j < columns; j++) {
        for (size_t h = 0; h < PARTS; h++)
            sum[j][h] = (part[j][0][h] + part[j][1][h]) + (part[j][2][h] + part[j][3][h]);
    }
}

/* x_j -= sum over the rows of A_ij y_i, with partial sums as for one vector */
PMA_INLINE void subtract_products_lanes(const double *A, size_t ld, size_t rows,
                                        const size_t columns, const double *y, double *x)
{
    const piece zero = {0.0};
    piece sum[GROUP][PARTS];
    const size_t whole = rows / 4 * 4;
    if (whole > 0)
        sum_products_lanes(A, ld, whole, columns, y, sum);
    for (size_t h = 0; h < PARTS; h++) {
        piece rest[GROUP];
#pragma GCC unroll 8
        for (size_t j = 0; j < columns; j++)
            rest[j] = zero;
        for (size_t i = whole; i < rows; i++) {
            const piece yi = lanes_at(y, i)[h];
#pragma GCC unroll 8
            for (size_t j = 0; j < columns; j++)
                rest[j] += A[j * ld + i] * yi;
        }
#pragma GCC unroll 8
        for (size_t j = 0; j < columns; j++)
            ((piece *)(x + j * PMA_LANES))[h] -= (whole > 0 ? sum[j][h] : zero) + rest[j];
    }
}

PMA_INLINE void multiply_strip_lanes(const double *values, size_t rows, size_t columns,
                                     const int32_t *index, const double *x, double *product)
{
    /* two pieces of the lanes at a time, whose sums are in registers */
    for (size_t r = 0; r < rows; r++) {
        for (size_t h = 0; h < PARTS; h += 2) {
            piece part[4][2] = {{{0.0}}};
            for (size_t k = 0; k < columns; k += 4) {
                const double *a = values + k * rows + 4 * r;
#pragma GCC unroll 4
                for (size_t c = 0; c < 4; c++) {
                    const piece *xk = lanes_at(x, (size_t)index[k + c]) + h;
                    part[c][0] += a[c] * xk[0];
                    part[c][1] += a[c] * xk[1];
                }
            }
            piece *out = (piece *)(product + r * PMA_LANES) + h;
            out[0] = (part[0][0] + part[1][0]) + (part[2][0] + part[3][0]);
            out[1] = (part[0][1] + part[1][1]) + (part[2][1] + part[3][1]);
        }
    }
}

/* The unknowns of some columns, whose triangle is in registers: a piece of the lanes at a time. */
PMA_INLINE void eliminate_triangle_lanes(const double *diagonal, size_t ld, const size_t columns,
                                         double *x)
{
#pragma GCC unroll 1
    for (size_t h = 0; h < PARTS; h++) {
        piece own[GROUP];
#pragma GCC unroll 8
        for (size_t k = 0; k < columns; k++) {
            own[k] = lanes_at(x, k)[h];
#pragma GCC unroll 8
            for (size_t l = 0; l < k; l++)
                own[k] -= diagonal[l * ld + k] * own[l];
            ((piece *)(x + k * PMA_LANES))[h] = own[k];
        }
    }
}

PMA_INLINE void substitute_triangle_lanes(const double *diagonal, size_t ld, const size_t columns,
                                          double *x)
{
#pragma GCC unroll 1
    for (size_t h = 0; h < PARTS; h++) {
        piece own[GROUP];
#pragma GCC unroll 8
        for (size_t l = columns; l-- > 0;) {
            own[l] = lanes_at(x, l)[h];
#pragma GCC unroll 8
            for (size_t k = columns; k-- > l + 1;)
                own[l] -= diagonal[l * ld + k] * own[k];
            ((piece *)(x + l * PMA_LANES))[h] = own[l];
        }
    }
}

/* ---- columns of a panel, of one vector (lanes = 1) or of those in lanes ---------------------- */

/* Columns j..j+columns-1: their triangle, then all rows below it at once. */
PMA_INLINE void eliminate_group(const double *panel, size_t ld, size_t height, size_t j,
                                const size_t columns, const size_t lanes, double *x)
{
    const double *diagonal = panel + j * ld + j;
    const size_t below = height - j - columns;
    if (lanes > 1) {
        double *first = x + j * lanes;
        eliminate_triangle_lanes(diagonal, ld, columns, first);
        subtract_columns_lanes(diagonal + columns, ld, below, columns, first,
                               first + columns * lanes);
        return;
    }
    double own[GROUP];
#pragma GCC unroll 8
    for (size_t k = 0; k < columns; k++) {
        own[k] = x[j + k];
#pragma GCC unroll 8
        for (size_t l = 0; l < k; l++)
            own[k] -= diagonal[l * ld + k] * own[l];
        x[j + k] = own[k];
    }
    subtract_columns(diagonal + columns, ld, below, columns, own, x + j + columns);
}

PMA_INLINE void substitute_group(const double *panel, size_t ld, size_t height, size_t j,
                                 const size_t columns, const size_t lanes, double *x)
{
    const double *diagonal = panel + j * ld + j;
    const size_t below = height - j - columns;
    double *own = x + j * lanes;
    if (lanes > 1) {
        if (below > 0)
            subtract_products_lanes(diagonal + columns, ld, below, columns, own + columns * lanes,
                                    own);
        substitute_triangle_lanes(diagonal, ld, columns, own);
        return;
    }
    subtract_products(diagonal + columns, ld, below, columns, own + columns, own);
#pragma GCC unroll 8
    for (size_t l = columns; l-- > 0;) {
#pragma GCC unroll 8
        for (size_t k = columns; k-- > l + 1;)
            own[l] -= diagonal[l * ld + k] * own[k];
    }
}

PMA_INLINE void eliminate(const double *panel, size_t ld, size_t height, size_t width,
                          const size_t lanes, double *x)
{
    size_t j = 0;
    for (; j + GROUP <= width; j += GROUP)
        eliminate_group(panel, ld, height, j, GROUP, lanes, x);
    if (width & 4)
        eliminate_group(panel, ld, height, j, 4, lanes, x);
    j += width & 4;
    if (width & 2)
        eliminate_group(panel, ld, height, j, 2, lanes, x);
    j += width & 2;
    if (width & 1)
        eliminate_group(panel, ld, height, j, 1, lanes, x);
}

PMA_INLINE void substitute(const double *panel, size_t ld, size_t height, size_t width,
                           const size_t lanes, double *x)
{
    size_t j = width - (width & 1);
    if (width & 1)
        substitute_group(panel, ld, height, j, 1, lanes, x);
    j -= width & 2;
    if (width & 2)
        substitute_group(panel, ld, height, j, 2, lanes, x);
    j -= width & 4;
    if (width & 4)
        substitute_group(panel, ld, height, j, 4, lanes, x);
    while (j > 0) {
        j -= GROUP;
        substitute_group(panel, ld, height, j, GROUP, lanes, x);
    }
}

PMA_INLINE void subtract(const double *A, size_t ld, size_t rows, size_t columns,
                         const size_t lanes, const double *x, double *y)
{
    for (size_t j = 0, some; j < columns; j += some) {
        some = j + GROUP <= columns ? GROUP : 1;
        if (lanes > 1) {
            some = columns - j < LANE_COLUMNS ? columns - j : LANE_COLUMNS;
            subtract_columns_lanes(A + j * ld, ld, rows, some, x + j * lanes, y);
        } else if (some == GROUP) {
            subtract_columns(A + j * ld, ld, rows, GROUP, x + j, y);
        } else {
            subtract_columns(A + j * ld, ld, rows, 1, x + j, y);
        }
    }
}

/* clang-format on */

/* ---- the kernel ------------------------------------------------------------------------------ */

#define PANEL (const double *panel, size_t ld, size_t height, size_t width, double *x)
#define BLOCK (const double *A, size_t ld, size_t rows, size_t columns, const double *x, double *y)

TARGET static void eliminate_one PANEL
{
    eliminate(panel, ld, height, width, 1, x);
}

TARGET static void substitute_one PANEL
{
    substitute(panel, ld, height, width, 1, x);
}

TARGET static void subtract_one BLOCK
{
    subtract(A, ld, rows, columns, 1, x, y);
}

TARGET static void eliminate_lanes PANEL
{
    eliminate(panel, ld, height, width, PMA_LANES, x);
}

TARGET static void substitute_lanes PANEL
{
    substitute(panel, ld, height, width, PMA_LANES, x);
}

TARGET static void subtract_lanes BLOCK
{
    subtract(A, ld, rows, columns, PMA_LANES, x, y);
}

TARGET static void strips(const pma_strips *S, size_t begin, size_t end, const double *x, double *y)
{
    subtract_strips(S, begin, end, x, y);
}

TARGET static void band(const double *above, const double *below, size_t n, size_t width,
                        size_t begin, size_t end, const double *x, double *y)
{
    subtract_band(above, below, n, width, begin, end, x, y);
}

TARGET static void strip_lanes(const double *values, size_t rows, size_t columns,
                               const int32_t *index, const double *x, double *product)
{
    multiply_strip_lanes(values, rows, columns, index, x, product);
}

static const pma_kernel KERNEL = {
    .eliminate = eliminate_one,
    .substitute = substitute_one,
    .subtract = subtract_one,
    .subtract_strips = strips,
    .subtract_band = band,
    .eliminate_lanes = eliminate_lanes,
    .substitute_lanes = substitute_lanes,
    .subtract_lanes = subtract_lanes,
    .multiply_strip_lanes = strip_lanes,
};
