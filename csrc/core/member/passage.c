#include "member/passage.h"

#include <math.h>
#include <string.h>

#include "algebra/lanes.h"

PMA_INLINE void sum_one(size_t n, const pma_passage *p, const bool is_diagonal, double *terms)
{
    const double *u0 = p->from, *f0 = u0 + n, *q0 = f0 + n;
    const double *start = p->fixed, *k = start + n, *m = k + n;
    const double *u1 = p->u, *v1 = p->v, *w1 = p->w, *r1 = p->r, al1 = p->al1;
    double *u = p->to, *f = u + n, *q = f + n;
    double work = 0.0, fixed = 0.0, resultant = 0.0, size = 0.0, kinetic = 0.0;
#pragma omp simd reduction(+ : work, fixed, resultant, size, kinetic)
    for (size_t i = 0; i < n; i++) {
        const double du = u1[i] - u0[i];
        const double acting = is_diagonal ? r1[i] + k[i] * (al1 * w1[i]) : f[i];
        const double inertia = is_diagonal ? m[i] * w1[i] : q[i];
        work += (f0[i] + acting) * du;
        fixed += start[i] * du;
        resultant += (q0[i] + inertia) * du;
        size += fabs(r1[i] * u1[i]);
        if (is_diagonal)
            kinetic += v1[i] * (m[i] * v1[i]);
        u[i] = u1[i];
        f[i] = acting;
        q[i] = inertia;
    }
    terms[PMA_PASSAGE_WORK] = 0.5 * work;
    terms[PMA_PASSAGE_START] = fixed;
    terms[PMA_PASSAGE_RESULTANT] = 0.5 * resultant;
    terms[PMA_PASSAGE_SIZE] = size;
    terms[PMA_PASSAGE_KINETIC] = kinetic;
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
