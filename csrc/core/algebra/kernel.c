#include "algebra/kernel.h"

/* One register of AVX2, two of SSE2 or NEON. */
typedef double four __attribute__((vector_size(32), aligned(8), may_alias));

/* Columns that share a pass over x. Forward x is read and written, so that more of them pay. */
enum { FORWARD = 8, BACKWARD = 4 };

/* Most rows of a strip. */
enum { STRIP = 6 };

/* clang-format off: attributes are long, and a name begins its line */

/* ---- the loops, to be compiled for each kind of processor ----------------------------------- */

/* y_i -= sum over the columns of A_ij x_j */
__attribute__((always_inline)) static inline void
subtract_columns(const double *A, size_t ld, size_t rows, const size_t columns, const double *x,
                 double *restrict y)
{
    for (size_t i = 0; i < rows; i++) {
        double sum = y[i];
#pragma GCC unroll 8
        for (size_t j = 0; j < columns; j++)
            sum -= A[j * ld + i] * x[j];
        y[i] = sum;
    }
}

/* x_j -= sum over the rows of A_ij y_i, with a vector of four partial sums for each column */
__attribute__((always_inline)) static inline void
subtract_products(const double *A, size_t ld, size_t rows, const size_t columns, const double *y,
                  double *x)
{
    four sum[BACKWARD] = {{0.0}};
    double rest[BACKWARD] = {0.0};
    size_t i = 0;
    for (; i + 4 <= rows; i += 4) {
#pragma GCC unroll 4
        for (size_t j = 0; j < columns; j++)
            sum[j] += *(const four *)(A + j * ld + i) * *(const four *)(y + i);
    }
    for (; i < rows; i++) {
#pragma GCC unroll 4
        for (size_t j = 0; j < columns; j++)
            rest[j] += A[j * ld + i] * y[i];
    }
#pragma GCC unroll 4
    for (size_t j = 0; j < columns; j++)
        x[j] -= ((sum[j][0] + sum[j][1]) + (sum[j][2] + sum[j][3])) + rest[j];
}

/* Columns j..j+columns-1: their triangle, then all rows below it at once. */
__attribute__((always_inline)) static inline void eliminate_group(const double *panel, size_t ld,
                                                                  size_t height, size_t j,
                                                                  const size_t columns, double *x)
{
    const double *diagonal = panel + j * ld + j;
    double own[FORWARD];
#pragma GCC unroll 8
    for (size_t k = 0; k < columns; k++) {
        own[k] = x[j + k];
#pragma GCC unroll 8
        for (size_t l = 0; l < k; l++)
            own[k] -= diagonal[l * ld + k] * own[l];
        x[j + k] = own[k];
    }
    subtract_columns(diagonal + columns, ld, height - j - columns, columns, own, x + j + columns);
}

__attribute__((always_inline)) static inline void substitute_group(const double *panel, size_t ld,
                                                                   size_t height, size_t j,
                                                                   const size_t columns, double *x)
{
    const double *diagonal = panel + j * ld + j;
    double *own = x + j;
    subtract_products(diagonal + columns, ld, height - j - columns, columns, own + columns, own);
#pragma GCC unroll 4
    for (size_t l = columns; l-- > 0;) {
#pragma GCC unroll 4
        for (size_t k = columns; k-- > l + 1;)
            own[l] -= diagonal[l * ld + k] * own[k];
    }
}

__attribute__((always_inline)) static inline void eliminate(const double *panel, size_t ld,
                                                            size_t height, size_t width, double *x)
{
    size_t j = 0;
    for (; j + 8 <= width; j += 8)
        eliminate_group(panel, ld, height, j, 8, x);
    if (width & 4)
        eliminate_group(panel, ld, height, j, 4, x);
    j += width & 4;
    if (width & 2)
        eliminate_group(panel, ld, height, j, 2, x);
    j += width & 2;
    if (width & 1)
        eliminate_group(panel, ld, height, j, 1, x);
}

__attribute__((always_inline)) static inline void substitute(const double *panel, size_t ld,
                                                             size_t height, size_t width, double *x)
{
    size_t j = width - (width & 1);
    if (width & 1)
        substitute_group(panel, ld, height, j, 1, x);
    j -= width & 2;
    if (width & 2)
        substitute_group(panel, ld, height, j, 2, x);
    while (j > 0) {
        j -= 4;
        substitute_group(panel, ld, height, j, 4, x);
    }
}

__attribute__((always_inline)) static inline void
subtract(const double *A, size_t ld, size_t rows, size_t columns, const double *x, double *y)
{
    size_t j = 0;
    for (; j + 8 <= columns; j += 8)
        subtract_columns(A + j * ld, ld, rows, 8, x + j, y);
    for (; j < columns; j++)
        subtract_columns(A + j * ld, ld, rows, 1, x + j, y);
}

/* One row after the other of each four columns, which is their order in memory. */
__attribute__((always_inline)) static inline void
multiply_rows(const double *values, const size_t rows, size_t columns, const int32_t *index,
              const double *x, double *product)
{
    four part[STRIP] = {{0.0}};
    for (size_t k = 0; k < columns; k += 4) {
        const int32_t *at = index + k;
        four xk;
        if (at[3] - at[0] == 3) /* they follow one another */
            xk = *(const four *)(x + at[0]);
        else
            xk = (four){x[at[0]], x[at[1]], x[at[2]], x[at[3]]};
#pragma GCC unroll 6
        for (size_t r = 0; r < rows; r++)
            part[r] += *(const four *)(values + k * rows + 4 * r) * xk;
    }
#pragma GCC unroll 6
    for (size_t r = 0; r < rows; r++)
        product[r] = (part[r][0] + part[r][1]) + (part[r][2] + part[r][3]);
}

__attribute__((always_inline)) static inline void
multiply_strip(const double *values, size_t rows, size_t columns, const int32_t *index,
               const double *x, double *product)
{
    switch (rows) { /* each with its own loop, the sums in registers */
    case 1:
        multiply_rows(values, 1, columns, index, x, product);
        break;
    case 2:
        multiply_rows(values, 2, columns, index, x, product);
        break;
    case 3:
        multiply_rows(values, 3, columns, index, x, product);
        break;
    case 4:
        multiply_rows(values, 4, columns, index, x, product);
        break;
    case 5:
        multiply_rows(values, 5, columns, index, x, product);
        break;
    default:
        multiply_rows(values, 6, columns, index, x, product);
        break;
    }
}

/* Diagonal by diagonal, which is vectorised; A_i,i-d is stored as A_i-d,i. */
__attribute__((always_inline)) static inline void
subtract_band(const double *values, size_t n, size_t width, size_t begin, size_t end,
              const double *x, double *restrict y)
{
    for (size_t i = begin; i < end; i++)
        y[i] -= values[i] * x[i];
    for (size_t d = 1; d <= width; d++) {
        const double *diagonal = values + d * n;
        const size_t first = begin > d ? begin : d, last = end < n - d ? end : n - d;
        for (size_t i = begin; i < last; i++)
            y[i] -= diagonal[i] * x[i + d];
        for (size_t i = first; i < end; i++)
            y[i] -= diagonal[i - d] * x[i - d];
    }
}

/* ---- for each kind of processor ------------------------------------------------------------- */

static void eliminate_plain(const double *panel, size_t ld, size_t height, size_t width, double *x)
{
    eliminate(panel, ld, height, width, x);
}

static void substitute_plain(const double *panel, size_t ld, size_t height, size_t width, double *x)
{
    substitute(panel, ld, height, width, x);
}

static void subtract_plain(const double *A, size_t ld, size_t rows, size_t columns, const double *x,
                           double *y)
{
    subtract(A, ld, rows, columns, x, y);
}

static void multiply_strip_plain(const double *values, size_t rows, size_t columns,
                                 const int32_t *index, const double *x, double *product)
{
    multiply_strip(values, rows, columns, index, x, product);
}

static void subtract_band_plain(const double *values, size_t n, size_t width, size_t begin,
                                size_t end, const double *x, double *y)
{
    subtract_band(values, n, width, begin, end, x, y);
}

/* clang-format on */

static const pma_kernel PLAIN = {
    .eliminate = eliminate_plain,
    .substitute = substitute_plain,
    .subtract = subtract_plain,
    .multiply_strip = multiply_strip_plain,
    .subtract_band = subtract_band_plain,
};

const pma_kernel *pma_kernel_plain(void)
{
    return &PLAIN;
}

#if defined(__x86_64__)

/* clang-format off */

/* AVX2 alone: with fused multiply-adds the digits would depend on the processor. */
__attribute__((target("avx2"))) static void
eliminate_avx2(const double *panel, size_t ld, size_t height, size_t width, double *x)
{
    eliminate(panel, ld, height, width, x);
}

__attribute__((target("avx2"))) static void
substitute_avx2(const double *panel, size_t ld, size_t height, size_t width, double *x)
{
    substitute(panel, ld, height, width, x);
}

__attribute__((target("avx2"))) static void
subtract_avx2(const double *A, size_t ld, size_t rows, size_t columns, const double *x, double *y)
{
    subtract(A, ld, rows, columns, x, y);
}

__attribute__((target("avx2"))) static void
multiply_strip_avx2(const double *values, size_t rows, size_t columns, const int32_t *index,
                    const double *x, double *product)
{
    multiply_strip(values, rows, columns, index, x, product);
}

__attribute__((target("avx2"))) static void
subtract_band_avx2(const double *values, size_t n, size_t width, size_t begin, size_t end,
                    const double *x, double *y)
{
    subtract_band(values, n, width, begin, end, x, y);
}

/* clang-format on */

static const pma_kernel AVX2 = {
    .eliminate = eliminate_avx2,
    .substitute = substitute_avx2,
    .subtract = subtract_avx2,
    .multiply_strip = multiply_strip_avx2,
    .subtract_band = subtract_band_avx2,
};

const pma_kernel *pma_kernel_best(void)
{
    return __builtin_cpu_supports("avx2") ? &AVX2 : &PLAIN;
}

#else

const pma_kernel *pma_kernel_best(void)
{
    return &PLAIN;
}

#endif
