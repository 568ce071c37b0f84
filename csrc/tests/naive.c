/* naive.c - see naive.h; nothing here knows the core. */
#define _POSIX_C_SOURCE 200809L
#include "naive.h"

#include <math.h>
#include <string.h>
#include <time.h>

/* ---- random numbers that are the same everywhere -------------------------------------------- */

uint32_t draw(uint64_t *seed, uint32_t below)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(*seed >> 33) % below;
}

double draw_eighth(uint64_t *seed)
{
    return ((double)draw(seed, 17) - 8.0) / 8.0;
}

void draw_vector(size_t n, uint64_t *seed, double *x)
{
    for (size_t i = 0; i < n; i++)
        x[i] = 1.0 / (1.0 + draw(seed, 1000));
}

/* ---- naive algebra -------------------------------------------------------------------------- */

void naive_solve(size_t n, const double *A, double *b)
{
    double T[LARGEST][LARGEST + 1];
    for (size_t i = 0; i < n; i++) {
        memcpy(T[i], A + i * n, n * sizeof(double));
        T[i][n] = b[i];
    }
    for (size_t j = 0; j < n; j++) {
        size_t best = j;
        for (size_t i = j + 1; i < n; i++)
            best = fabs(T[i][j]) > fabs(T[best][j]) ? i : best;
        for (size_t k = 0; k <= n; k++) {
            const double kept = T[j][k];
            T[j][k] = T[best][k];
            T[best][k] = kept;
        }
        for (size_t i = j + 1; i < n; i++) {
            const double factor = T[i][j] / T[j][j];
            for (size_t k = j; k <= n; k++)
                T[i][k] -= factor * T[j][k];
        }
    }
    for (size_t j = n; j-- > 0;) {
        b[j] = T[j][n];
        for (size_t k = j + 1; k < n; k++)
            b[j] -= T[j][k] * b[k];
        b[j] /= T[j][j];
    }
}

void naive_factor(size_t n, const double *A, double *R, double *inverse)
{
    double T[LARGEST * LARGEST];
    memcpy(T, A, n * n * sizeof(double));
    for (size_t j = 0; j < n; j++) {
        inverse[j] = 1.0 / T[j * n + j];
        for (size_t i = 0; i < n; i++)
            R[j * n + i] = i < j ? 0.0 : T[i * n + j] * inverse[j];
        for (size_t i = j + 1; i < n; i++) {
            for (size_t k = j + 1; k < n; k++)
                T[i * n + k] -= R[j * n + i] * T[j * n + k];
        }
    }
}

/* ---- stop ----------------------------------------------------------------------------------- */

bool poll_stopper(void *ctx)
{
    stopper *s = ctx;
    s->polled++;
    return s->polled == s->stop_at;
}

bool poll_interrupter(void *ctx)
{
    interrupter *i = ctx;
    if (i->stop_at == 0 || atomic_load(&i->called) < i->stop_at)
        return false;
    atomic_store(&i->polled, true);
    return true;
}

void interrupt(interrupter *i, bool waits)
{
    const bool stops = atomic_fetch_add(&i->called, 1) + 1 == i->stop_at;
    while (stops && waits && !atomic_load(&i->polled))
        nanosleep(&(struct timespec){0, 100000}, NULL); /* the one that polls needs a processor */
}
