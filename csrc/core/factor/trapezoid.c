#include "factor/trapezoid.h"

#include <math.h>
#include <stddef.h>

#include "algebra/lists.h"

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

void pma_trapezoid_multiply(pma_block G, size_t width, double alpha, pma_block X, size_t m,
                            pma_block Y, size_t columns, double beta, pma_block C,
                            const pma_blas *blas)
{
    for (size_t j = 0, some = 0; j < width; j += some) {
        some = alike(G.values, j, width, G.next);
        const double signed_alpha = copysign(1.0, G.values[j * G.next + j]) * alpha;
        pma_blas_multiply(blas, m, columns, some, signed_alpha, pma_block_at(X, 0, j),
                          pma_block_at(Y, 0, j), true, j == 0 ? beta : 1.0, C);
    }
}

/* Of what is right of a block, the triangle below the diagonal and all rows below it: the columns
 * of X S X^T are subtracted in blocks, without what is above these. */
static void subtract_right(pma_block G, size_t columns, pma_block X, size_t m, size_t right,
                           pma_block C, const pma_blas *blas)
{
    for (size_t begin = 0; begin < right; begin += BLOCK) {
        const pma_block below = pma_block_at(X, begin, 0);
        pma_trapezoid_multiply(G, columns, -1.0, below, m - begin, below,
                               pma_least(right - begin, BLOCK), 1.0, pma_block_at(C, begin, begin),
                               blas);
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
    const pma_block all = {panel, height};
    for (size_t begin = 0; begin < width; begin += BLOCK) {
        const size_t columns = pma_least(width - begin, BLOCK), end = begin + columns;
        const size_t m = height - end;
        const pma_block block = pma_block_at(all, begin, begin);
        const pma_block below = pma_block_at(block, columns, 0);
        const size_t good =
            factor_block(block.values, columns, height, diagonal + begin, lost, indefinite);
        if (good < columns)
            return begin + good;
        pma_blas_divide(blas, m, columns, block, false, below); /* G S */
        change_signs(block.values, columns, height, below.values, m);
        subtract_right(block, columns, below, m, width - end, pma_block_at(all, end, end), blas);
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
    const pma_block of_R = {R, height}, of_Q = {Q, height};
    for (size_t begin = 0; begin < width; begin += BLOCK) {
        const size_t columns = pma_least(width - begin, BLOCK), end = begin + columns;
        const size_t m = height - end, right = width - end;
        const pma_block r = pma_block_at(of_R, begin, begin), q = pma_block_at(of_Q, begin, begin);
        const pma_block r_below = pma_block_at(r, columns, 0),
                        q_below = pma_block_at(q, columns, 0);
        const size_t good =
            factor_block_pair(r.values, q.values, columns, height, diagonal + begin, lost);
        if (good < columns)
            return begin + good;
        pma_blas_divide(blas, m, columns, q, false, r_below);
        pma_blas_divide(blas, m, columns, r, true, q_below);
        pma_blas_multiply(blas, m, right, columns, -1.0, r_below, q_below, true, 1.0,
                          pma_block_at(of_R, end, end));
        pma_blas_multiply(blas, m, right, columns, -1.0, q_below, r_below, true, 1.0,
                          pma_block_at(of_Q, end, end));
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
