#include "algebra/lu.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "algebra/matrix.h"

static const double AGREEMENT = 1e-9;

static bool is_below(const pma_matrix *L, size_t j, int64_t e)
{
    return L->index[e] > (int64_t)j && L->values[e] != 0.0;
}

void pma_lu_count(const pma_matrix *L, int64_t *ptr)
{
    ptr[0] = 0;
    for (size_t j = 0; j < L->n; j++) {
        ptr[j + 1] = ptr[j];
        for (int64_t e = L->ptr[j]; e < L->ptr[j + 1]; e++)
            ptr[j + 1] += is_below(L, j, e);
    }
}

static void take_lower(const pma_matrix *L, const int64_t *ptr, int32_t *index, double *values)
{
    for (size_t j = 0; j < L->n; j++) {
        int64_t at = ptr[j];
        for (int64_t e = L->ptr[j]; e < L->ptr[j + 1]; e++) {
            if (!is_below(L, j, e))
                continue;
            index[at] = L->index[e];
            values[at++] = L->values[e];
        }
        pma_matrix_sort_row(at - ptr[j], index + ptr[j], values + ptr[j]);
    }
}

/* D, and product = U x */
static void take_upper(const pma_matrix *U, const double *x, double *D, double *product)
{
    memset(D, 0, U->n * sizeof *D);
    memset(product, 0, U->n * sizeof *product);
    for (size_t j = 0; j < U->n; j++) {
        for (int64_t e = U->ptr[j]; e < U->ptr[j + 1]; e++) {
            product[U->index[e]] += U->values[e] * x[j];
            if ((size_t)U->index[e] == j)
                D[j] = U->values[e];
        }
    }
}

bool pma_lu_take(const pma_matrix *L, const pma_matrix *U, const int64_t *ptr, int32_t *index,
                 double *values, double *D, double *scratch)
{
    double *x = scratch, *product = scratch + L->n, largest = 0.0, difference = 0.0;
    for (size_t i = 0; i < L->n; i++)
        x[i] = cos((double)i);
    take_lower(L, ptr, index, values);
    take_upper(U, x, D, product);
    for (size_t j = 0; j < L->n; j++) {
        double sum = x[j], size = fabs(x[j]);
        for (int64_t e = ptr[j]; e < ptr[j + 1]; e++) {
            sum += values[e] * x[index[e]];
            size += fabs(values[e] * x[index[e]]);
        }
        largest = fmax(largest, fabs(D[j] * size));
        difference = fmax(difference, fabs(D[j] * sum - product[j]));
    }
    return !(difference > AGREEMENT * largest);
}
