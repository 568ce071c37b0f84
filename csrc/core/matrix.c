#include "matrix.h"

#include "kernel.h"

pma_status pma_matrix_check(const pma_matrix *A)
{
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
    case PMA_SPARSE:
        return (size_t)A->ptr[A->n];
    default:
        return 0;
    }
}

static void subtract_diagonal(const pma_matrix *A, const double *x, double *y)
{
    for (size_t i = 0; i < A->n; i++)
        y[i] -= A->values[i] * x[i];
}

static void subtract_sparse(const pma_matrix *A, const double *x, double *y)
{
    for (size_t i = 0; i < A->n; i++) {
        double sum = 0.0;
        for (int64_t k = A->ptr[i]; k < A->ptr[i + 1]; k++)
            sum += A->values[k] * x[A->index[k]];
        y[i] -= sum;
    }
}

void pma_matrix_subtract(const pma_matrix *A, const double *x, double *y)
{
    switch (A->form) {
    case PMA_DIAGONAL:
        subtract_diagonal(A, x, y);
        break;
    case PMA_DENSE:
        pma_kernel_best()->subtract(A->values, A->n, A->n, A->n, x, y); /* column j is row j */
        break;
    case PMA_SPARSE:
        subtract_sparse(A, x, y);
        break;
    default: /* zero */
        break;
    }
}
