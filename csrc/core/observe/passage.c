#include "observe/passage.h"

#include <math.h>
#include <string.h>

#include "algebra/lanes.h"

/* Dofs whose terms are summed side by side. */
enum { BLOCK = 4 };

/* The terms of dof i, added to number l of each sum. */
PMA_INLINE void add_dof(size_t n, const pma_passage *p, const bool is_diagonal, size_t i, size_t l,
                        double sum[PMA_PASSAGE_TERMS][BLOCK])
{
    const double *from = p->from, *fixed = p->fixed, w = p->w[i], v = p->v[i], u = p->u[i];
    double *to = p->to;
    const double du = u - from[i];
    const double acting = is_diagonal ? p->r[i] + fixed[n + i] * (p->al1 * w) : to[n + i];
    const double inertia = is_diagonal ? fixed[2 * n + i] * w : to[2 * n + i];
    sum[PMA_PASSAGE_WORK][l] += (from[n + i] + acting) * du;
    sum[PMA_PASSAGE_START][l] += fixed[i] * du;
    sum[PMA_PASSAGE_RESULTANT][l] += (from[2 * n + i] + inertia) * du;
    sum[PMA_PASSAGE_SIZE][l] += fabs(p->r[i] * u);
    if (is_diagonal)
        sum[PMA_PASSAGE_KINETIC][l] += v * (fixed[2 * n + i] * v);
    to[i] = u;
    to[n + i] = acting;
    to[2 * n + i] = inertia;
}

PMA_INLINE void sum_one(size_t n, const pma_passage *p, const bool is_diagonal, double *terms)
{
    const pma_passage x = *p; /* or it would be read again after each number that is stored */
    double sum[PMA_PASSAGE_TERMS][BLOCK] = {{0.0}};
    size_t i = 0;
    for (; i + BLOCK <= n; i += BLOCK) {
#pragma omp simd
        for (size_t l = 0; l < BLOCK; l++)
            add_dof(n, &x, is_diagonal, i + l, l, sum);
    }
    for (; i < n; i++)
        add_dof(n, &x, is_diagonal, i, 0, sum);
    for (size_t k = 0; k < PMA_PASSAGE_TERMS; k++)
        terms[k] = (sum[k][0] + sum[k][1]) + (sum[k][2] + sum[k][3]);
    terms[PMA_PASSAGE_WORK] *= 0.5;
    terms[PMA_PASSAGE_RESULTANT] *= 0.5;
}

PMA_INLINE void sum_lanes(size_t n, const pma_passage *p, double *terms)
{
    const pma_passage x = *p; /* or it would be read again after each number that is stored */
    double sum[PMA_PASSAGE_TERMS][PMA_LANES] = {{0.0}};
    for (size_t i = 0; i < n; i += PMA_LANES) {
#pragma omp simd
        for (size_t l = 0; l < PMA_LANES; l++) {
            const size_t at = i + l;
            const double u = x.u[at], f = x.to[n + at], q = x.to[2 * n + at], du = u - x.from[at];
            sum[PMA_PASSAGE_WORK][l] += 0.5 * (x.from[n + at] + f) * du;
            sum[PMA_PASSAGE_START][l] += x.fixed[at] * du;
            sum[PMA_PASSAGE_RESULTANT][l] += 0.5 * (x.from[2 * n + at] + q) * du;
            sum[PMA_PASSAGE_SIZE][l] += fabs(x.r[at] * u);
            x.to[at] = u;
        }
    }
    memcpy(terms, sum, sizeof sum);
}

PMA_COMPILED(void, diagonal, (size_t n, const pma_passage *p, double *terms),
             sum_one(n, p, true, terms);)

PMA_COMPILED(void, one, (size_t n, const pma_passage *p, double *terms),
             sum_one(n, p, false, terms);)

PMA_COMPILED(void, eight, (size_t n, const pma_passage *p, double *terms), sum_lanes(n, p, terms);)

void pma_passage_sum(size_t n, size_t lanes, const pma_passage *p, double *terms)
{
    if (lanes > 1)
        (pma_has_avx2() ? eight_avx2 : eight_plain)(n, p, terms);
    else if (p->is_diagonal)
        (pma_has_avx2() ? diagonal_avx2 : diagonal_plain)(n, p, terms);
    else
        (pma_has_avx2() ? one_avx2 : one_plain)(n, p, terms);
}
