#include "factor.h"

pma_status pma_factor_check(const pma_factor *f)
{
    if (f->nb > f->n)
        return PMA_BAD_SIZE;
    if (f->form != PMA_SPARSE)
        return PMA_OK;
    if (f->ptr[0] != 0)
        return PMA_BAD_INDEX;
    for (size_t j = 0; j < f->n; j++) {
        if (f->ptr[j + 1] < f->ptr[j])
            return PMA_BAD_INDEX;
        for (int64_t k = f->ptr[j]; k < f->ptr[j + 1]; k++) {
            if (f->index[k] <= (int64_t)j || (size_t)f->index[k] >= f->n)
                return PMA_BAD_INDEX;
        }
    }
    return PMA_OK;
}

size_t pma_factor_entries(const pma_factor *f)
{
    switch (f->form) {
    case PMA_DENSE:
        return f->n * (f->n + 1) / 2;
    case PMA_SPARSE:
        return f->n + (size_t)f->ptr[f->n];
    default:
        return f->n;
    }
}

/* x_i -= R_ij x_j, i > j */
static void eliminate_dense(const double *column, size_t rows, double xj, double *restrict x)
{
    for (size_t i = 0; i < rows; i++)
        x[i] -= column[i] * xj;
}

/* sum over i > j of R_ij x_i, in four lanes so that it can be vectorised */
static double gather_dense(const double *column, size_t rows, const double *x)
{
    double lane[4] = {0.0, 0.0, 0.0, 0.0};
    size_t i = 0;
    for (; i + 4 <= rows; i += 4) {
        for (size_t l = 0; l < 4; l++)
            lane[l] += column[i + l] * x[i + l];
    }
    for (; i < rows; i++)
        lane[0] += column[i] * x[i];
    return (lane[0] + lane[1]) + (lane[2] + lane[3]);
}

/* Forward through the columns first..last-1; x[0] stands for unknown `first`. */
static void eliminate(const pma_factor *f, size_t first, size_t last, double *x)
{
    if (f->form == PMA_DENSE) {
        for (size_t j = first; j < last; j++) {
            const double *below = f->values + j * f->n + j + 1;
            eliminate_dense(below, f->n - j - 1, x[j - first], x + (j - first) + 1);
        }
    } else if (f->form == PMA_SPARSE) {
        for (size_t j = first; j < last; j++) {
            const double xj = x[j - first];
            for (int64_t k = f->ptr[j]; k < f->ptr[j + 1]; k++)
                x[(size_t)f->index[k] - first] -= f->values[k] * xj;
        }
    }
}

/* Backward through the columns last-1..first; x[0] stands for unknown `first`. */
static void substitute(const pma_factor *f, size_t first, size_t last, double *x)
{
    if (f->form == PMA_DIAGONAL) {
        for (size_t j = first; j < last; j++)
            x[j - first] *= f->inverse[j];
    } else if (f->form == PMA_DENSE) {
        for (size_t j = last; j-- > first;) {
            const double *below = f->values + j * f->n + j + 1;
            const double sum = gather_dense(below, f->n - j - 1, x + (j - first) + 1);
            x[j - first] = x[j - first] * f->inverse[j] - sum;
        }
    } else {
        for (size_t j = last; j-- > first;) {
            double sum = 0.0;
            for (int64_t k = f->ptr[j]; k < f->ptr[j + 1]; k++)
                sum += f->values[k] * x[(size_t)f->index[k] - first];
            x[j - first] = x[j - first] * f->inverse[j] - sum;
        }
    }
}

void pma_factor_forward(const pma_factor *f, double *x)
{
    eliminate(f, 0, f->n - f->nb, x);
}

void pma_factor_interface(const pma_factor *f, double *xb)
{
    eliminate(f, f->n - f->nb, f->n, xb);
    substitute(f, f->n - f->nb, f->n, xb);
}

void pma_factor_backward(const pma_factor *f, double *x)
{
    substitute(f, 0, f->n - f->nb, x);
}
