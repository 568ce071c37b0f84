#include "rig/signals.h"

#include <math.h>

double pma_delay_sum(const pma_delay *delay, const double *ring, size_t now)
{
    double sum = 0.0;
    for (size_t i = 0; i < delay->taps; i++)
        sum +=
            delay->weight[i] * ring[(now + delay->length - (size_t)delay->lag[i]) % delay->length];
    return sum;
}

/* Equidistributed in (0, 1): a hash of a counter, so that nothing else is remembered of it. */
static double uniform(uint64_t seed, uint64_t number)
{
    uint64_t z = seed + (number + 1) * UINT64_C(0x9E3779B97F4A7C15);
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    z ^= z >> 31;
    return ((double)(z >> 12) + 0.5) * 0x1p-52;
}

/* Box and Muller */
double pma_noise_normal(uint64_t seed, uint64_t number)
{
    const double two_pi = 6.283185307179586;
    return sqrt(-2.0 * log(uniform(seed, 2 * number))) *
           cos(two_pi * uniform(seed, 2 * number + 1));
}

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
