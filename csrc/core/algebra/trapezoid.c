#include "algebra/trapezoid.h"

#include <math.h>

/* Columns of a dense factor made before what is right of them is updated. */
enum { BLOCK = 48 };

/* G of a small block, column by column; `columns` or the first that fails */
static size_t factor_block(double *block, size_t columns, size_t ld, const double *diagonal,
                           double lost, bool indefinite)
{
    for (size_t j = 0; j < columns; j++) {
        double *column = block + j * ld;
        const double size = indefinite ? fabs(column[j]) : column[j];
        if (!(size > lost * fabs(diagonal[j])))
            return j;
        const double root = sqrt(size), sign = copysign(1.0, column[j]);
        column[j] = sign * root;
        for (size_t i = j + 1; i < columns; i++)
            column[i] /= root;
        for (size_t k = j + 1; k < columns; k++) {
            const double factor = sign * column[k];
            for (size_t i = k; i < columns; i++)
                block[k * ld + i] -= column[i] * factor;
        }
    }
    return columns;
}

/* Columns from j on whose pivots have one sign. */
static size_t alike(const double *G, size_t j, size_t width, size_t ld)
{
    size_t end = j + 1;
    while (end < width && signbit(G[end * ld + end]) == signbit(G[j * ld + j]))
        end++;
    return end - j;
}

void pma_trapezoid_multiply(const double *G, size_t width, size_t ld, double alpha, double *X,
                            size_t m, double *Y, size_t columns, double beta, double *C,
                            size_t ld_C, const pma_blas *blas)
{
    int rows = (int)m, count = (int)columns, ldx = (int)ld, ldc = (int)ld_C;
    double one = 1.0;
    for (size_t j = 0, some = 0; j < width; j += some) {
        some = alike(G, j, width, ld);
        int k = (int)some;
        double signed_alpha = copysign(1.0, G[j * ld + j]) * alpha;
        blas->dgemm("N", "T", &rows, &count, &k, &signed_alpha, X + j * ld, &ldx, Y + j * ld, &ldx,
                    j == 0 ? &beta : &one, C, &ldc);
    }
}

/* X := X S */
static void change_signs(const double *G, size_t columns, size_t ld, double *X, size_t m)
{
    for (size_t j = 0; j < columns; j++) {
        for (size_t i = 0; signbit(G[j * ld + j]) && i < m; i++)
            X[j * ld + i] = -X[j * ld + i];
    }
}

size_t pma_trapezoid_factor(double *panel, size_t width, size_t height, const double *diagonal,
                            double lost, bool indefinite, const pma_blas *blas)
{
    double one = 1.0;
    int ld = (int)height;
    for (size_t begin = 0; begin < width; begin += BLOCK) {
        const size_t columns = width - begin < BLOCK ? width - begin : BLOCK;
        const size_t end = begin + columns;
        double *block = panel + begin * height + begin, *below = block + columns;
        const size_t good =
            factor_block(block, columns, height, diagonal + begin, lost, indefinite);
        int m = (int)(height - end), k = (int)columns;
        if (good < columns)
            return begin + good;
        if (m == 0)
            continue;
        blas->dtrsm("R", "L", "T", "N", &m, &k, &one, block, &ld, below, &ld); /* G S */
        change_signs(block, columns, height, below, height - end);
        if (width > end)
            pma_trapezoid_multiply(block, columns, height, -1.0, below, height - end, below,
                                   width - end, 1.0, panel + end * height + end, height, blas);
    }
    return width;
}

void pma_trapezoid_scale(double *panel, size_t width, size_t height, double *inverse)
{
    for (size_t j = 0; j < width; j++) {
        double *column = panel + j * height;
        const double root = column[j];
        inverse[j] = 1.0 / (root * fabs(root));
        column[j] = 1.0;
        for (size_t i = j + 1; i < height; i++)
            column[i] /= root;
    }
}

/* ---- unsymmetric ---------------------------------------------------------------------------- */

/* R and D Q of a small block, column by column, D on the diagonal of both; `columns`, or the first
 * that fails with its pivot in its diagonal entry */
static size_t factor_block_pair(double *R, double *Q, size_t columns, size_t ld, double *diagonal,
                                double lost)
{
    for (size_t j = 0; j < columns; j++) {
        double *r = R + j * ld, *q = Q + j * ld;
        const double pivot = q[j];
        if (!(fabs(pivot) > lost * fabs(diagonal[j]))) {
            diagonal[j] = pivot;
            return j;
        }
        for (size_t i = j + 1; i < columns; i++)
            r[i] /= pivot;
        for (size_t k = j + 1; k < columns; k++) {
            for (size_t i = k; i < columns; i++) {
                R[k * ld + i] -= r[i] * q[k];
                Q[k * ld + i] -= q[i] * r[k];
            }
        }
    }
    return columns;
}

size_t pma_trapezoid_factor_pair(double *R, double *Q, size_t width, size_t height,
                                 double *diagonal, double lost, const pma_blas *blas)
{
    double one = 1.0, minus = -1.0;
    int ld = (int)height;
    for (size_t begin = 0; begin < width; begin += BLOCK) {
        const size_t columns = width - begin < BLOCK ? width - begin : BLOCK;
        const size_t end = begin + columns, at = begin * height + begin;
        double *r = R + at, *q = Q + at, *r_below = r + columns, *q_below = q + columns;
        const size_t good = factor_block_pair(r, q, columns, height, diagonal + begin, lost);
        int m = (int)(height - end), k = (int)columns, right = (int)(width - end);
        if (good < columns)
            return begin + good;
        if (m == 0)
            continue;
        blas->dtrsm("R", "L", "T", "N", &m, &k, &one, q, &ld, r_below, &ld);
        blas->dtrsm("R", "L", "T", "U", &m, &k, &one, r, &ld, q_below, &ld);
        if (right == 0)
            continue;
        blas->dgemm("N", "T", &m, &right, &k, &minus, r_below, &ld, q_below, &ld, &one,
                    R + end * height + end, &ld);
        blas->dgemm("N", "T", &m, &right, &k, &minus, q_below, &ld, r_below, &ld, &one,
                    Q + end * height + end, &ld);
    }
    return width;
}

void pma_trapezoid_scale_pair(double *R, double *Q, size_t width, size_t height, double *inverse)
{
    for (size_t j = 0; j < width; j++) {
        double *q = Q + j * height;
        inverse[j] = 1.0 / q[j];
        R[j * height + j] = q[j] = 1.0;
        for (size_t i = j + 1; i < height; i++)
            q[i] *= inverse[j];
    }
}
