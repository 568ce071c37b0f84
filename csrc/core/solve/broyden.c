#include "solve/broyden.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "algebra/lanes.h"

/* The state: a matrix by rows; or the number of corrections ever made, and for each that is kept a
 * pair (a, s): x += a (s . x). */

static bool is_dense(size_t p)
{
    return p <= PMA_BROYDEN_DENSE;
}

size_t pma_broyden_size(size_t p)
{
    return is_dense(p) ? p * p : 1 + (size_t)2 * PMA_BROYDEN_KEPT * p;
}

/* That of corrections */
size_t pma_broyden_counts(size_t p)
{
    return is_dense(p) ? 0 : 1;
}

void pma_broyden_begin(const pma_broyden *b, double *scratch)
{
    memset(b->state, 0, pma_broyden_size(b->p) * sizeof(double));
    for (size_t k = 0; is_dense(b->p) && k < b->p; k++) {
        memset(scratch, 0, b->p * sizeof(double));
        scratch[k] = 1.0;
        pma_interface_solve(b->start, scratch);
        for (size_t i = 0; i < b->p; i++)
            b->state[i * b->p + k] = scratch[i];
    }
}

/* ---- limited memory ------------------------------------------------------------------------- */

/* The oldest pair that is kept when this number of them was made. */
static size_t first_of(size_t made)
{
    return made > PMA_BROYDEN_KEPT ? made - PMA_BROYDEN_KEPT : 0;
}

static double *pair_of(const pma_broyden *b, size_t number)
{
    return b->state + 1 + 2 * b->p * (number % PMA_BROYDEN_KEPT);
}

static void apply_pairs(const pma_broyden *b, size_t first, double *x)
{
    for (size_t k = first; k < (size_t)b->state[0]; k++) {
        const double *a = pair_of(b, k), *s = a + b->p;
        const double share = pma_dot(b->p, 1, 0, s, x);
        for (size_t i = 0; i < b->p; i++)
            x[i] += a[i] * share;
    }
}

/* ---- both ----------------------------------------------------------------------------------- */

/* x := B r; `more`: without the pair that has to be given up if one more is made */
static void apply(const pma_broyden *b, bool more, const double *r, double *x)
{
    if (is_dense(b->p)) {
        for (size_t i = 0; i < b->p; i++)
            x[i] = pma_dot(b->p, 1, 0, b->state + i * b->p, r);
        return;
    }
    memcpy(x, r, b->p * sizeof(double));
    pma_interface_solve(b->start, x);
    apply_pairs(b, first_of((size_t)b->state[0] + more), x);
}

void pma_broyden_apply(const pma_broyden *b, const double *r, double *x)
{
    assert(b->state && r != x);
    apply(b, false, r, x);
}

/* B += (s - B y) (s^T B) / (s . B y)                                                      (N15) */
void pma_broyden_learn(const pma_broyden *b, const double *s, const double *y, double *scratch)
{
    const size_t p = b->p;
    double *By = scratch, *left = scratch + p, *sB = scratch + 2 * p;
    apply(b, true, y, By);
    const double share = pma_dot(p, 1, 0, s, By);
    if (!(fabs(share) > DBL_EPSILON * pma_dot(p, 1, 0, s, s)) || !isfinite(share))
        return;
    for (size_t i = 0; i < p; i++)
        left[i] = (s[i] - By[i]) / share;
    if (!is_dense(p)) {
        double *pair = pair_of(b, (size_t)b->state[0]);
        memcpy(pair, left, p * sizeof(double));
        memcpy(pair + p, s, p * sizeof(double));
        b->state[0] += 1.0;
        return;
    }
    memset(sB, 0, p * sizeof(double));
    for (size_t i = 0; i < p; i++) {
        for (size_t k = 0; k < p; k++)
            sB[k] += s[i] * b->state[i * p + k];
    }
    for (size_t i = 0; i < p; i++) {
        for (size_t k = 0; k < p; k++)
            b->state[i * p + k] += left[i] * sB[k];
    }
}
