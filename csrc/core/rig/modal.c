#include "rig/modal.h"

void pma_modal_rest(const pma_modal *f, const double *u, double *z)
{
    for (size_t i = 0; i < f->states; i++) {
        z[i] = 0.0;
        for (size_t j = 0; j < f->inputs; j++)
            z[i] += f->rest[i * f->inputs + j] * u[j];
    }
}

void pma_modal_filter(const pma_modal *f, const double *u, double *z, double *y)
{
    for (size_t i = 0; i < f->outputs; i++) {
        const double *C = f->C + i * f->states, *D = f->D + i * f->inputs;
        double even = 0.0, odd = 0.0;
        for (size_t j = 0; j < f->states; j += 2) {
            even += C[j] * z[j];
            odd += C[j + 1] * z[j + 1];
        }
        for (size_t j = 0; j < f->inputs; j++)
            even += D[j] * u[j];
        y[i] = even + odd;
    }
    for (size_t i = 0; i < f->states; i += 2) {
        const double *A = f->A + 2 * i, *B = f->B + i * f->inputs;
        const double first = z[i], second = z[i + 1];
        z[i] = A[0] * first + A[1] * second;
        z[i + 1] = A[2] * second + A[3] * first;
        for (size_t j = 0; j < f->inputs; j++) {
            z[i] += B[j] * u[j];
            z[i + 1] += B[f->inputs + j] * u[j];
        }
    }
}
