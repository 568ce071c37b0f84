#include "algebra/fold.h"

#include <math.h>
#include <string.h>

/* Unknowns of both ends. */
typedef double two __attribute__((vector_size(16), aligned(8), may_alias));

static size_t least(size_t a, size_t b)
{
    return a < b ? a : b;
}

static size_t most(size_t a, size_t b)
{
    return a > b ? a : b;
}

static const two *pair_at(const double *x)
{
    return (const two *)x;
}

static void store(two pair, double *x)
{
    *(two *)x = pair;
}

/* ---- product -------------------------------------------------------------------------------- */

static void subtract_row(size_t n, const double *diagonal, const double *above, const double *below,
                         size_t i, const double *x, double *y)
{
    double sum = y[i] - diagonal[i] * x[i];
    if (i + 1 < n)
        sum -= above[i] * x[pma_fold_next(n, i)];
    if (i > 0 && i + 1 == n)
        sum -= below[i - 1] * x[i - 1];
    if (i >= 2)
        sum -= below[i - 2] * x[i - 2];
    y[i] = sum;
}

void pma_fold_subtract(size_t n, const double *diagonal, const double *above, const double *below,
                       size_t begin, size_t end, const double *x, double *restrict y)
{
    const size_t first = least(most(begin, 2), end), last = most(least(end + 2, n) - 2, first);
    for (size_t i = begin; i < first; i++)
        subtract_row(n, diagonal, above, below, i, x, y);
    for (size_t i = first; i < last; i++)
        y[i] = y[i] - diagonal[i] * x[i] - above[i] * x[i + 2] - below[i - 2] * x[i - 2];
    for (size_t i = last; i < end; i++)
        subtract_row(n, diagonal, above, below, i, x, y);
}

/* ---- sweeps --------------------------------------------------------------------------------- */

/* The columns from `first` on of which two at a time couple with the two that follow. */
static size_t end_of_pairs(size_t n, size_t first, size_t last)
{
    const size_t end = least(last + 2, n) - 2;
    return end > first ? end - (end - first) % 2 : first;
}

void pma_fold_eliminate(size_t n, const double *R, size_t first, size_t last, double *x)
{
    const size_t paired = end_of_pairs(n, first, last), end = least(last, n - 1);
    if (paired > first) {
        two pair = *pair_at(x);
        for (size_t j = first; j < paired; j += 2) {
            pair = *pair_at(x + j + 2 - first) - *pair_at(R + j) * pair;
            store(pair, x + j + 2 - first);
        }
    }
    for (size_t j = paired; j < end; j++)
        x[pma_fold_next(n, j) - first] -= R[j] * x[j - first];
}

void pma_fold_substitute(size_t n, const double *Q, const double *inverse, size_t first,
                         size_t last, double *x)
{
    const size_t paired = end_of_pairs(n, first, last);
    for (size_t j = last; j-- > paired;) {
        const double xj = x[j - first] * inverse[j];
        x[j - first] = j + 1 < n ? xj - Q[j] * x[pma_fold_next(n, j) - first] : xj;
    }
    if (paired == first)
        return;
    two pair = *pair_at(x + paired - first);
    for (size_t j = paired; j > first; j -= 2) {
        pair = *pair_at(x + j - 2 - first) * *pair_at(inverse + j - 2) - *pair_at(Q + j - 2) * pair;
        store(pair, x + j - 2 - first);
    }
}

/* ---- factor --------------------------------------------------------------------------------- */

pma_status pma_fold_factor(size_t n, const double *diagonal, double lost, double growth, double *R,
                           double *Q, double *inverse, size_t *column)
{
    memcpy(inverse, diagonal, n * sizeof *inverse);
    for (size_t j = 0; j < n; j++) {
        const double pivot = inverse[j], reciprocal = 1.0 / pivot;
        *column = j;
        if (!((Q ? fabs(pivot) : pivot) > lost * fabs(diagonal[j]) && isfinite(reciprocal)))
            return PMA_NOT_DEFINITE;
        inverse[j] = reciprocal;
        if (j + 1 == n)
            break;

        /* D_i -= A_ij A_ji / D_j */
        const size_t i = pma_fold_next(n, j);
        const double product = R[j] * (Q ? Q[j] : R[j]) / pivot;
        *column = i;
        if (Q && !(fabs(product) <= growth * fabs(diagonal[i])))
            return PMA_NOT_DEFINITE;
        inverse[i] -= product;
        R[j] *= reciprocal;
        if (Q)
            Q[j] *= reciprocal;
    }
    return PMA_OK;
}
