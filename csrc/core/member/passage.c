#include "member/passage.h"

#include <math.h>
#include <string.h>

#include "algebra/lanes.h"

PMA_INLINE void sum_one(size_t n, const pma_passage *p, double *terms)
{
    const pma_passage x = *p; /* or it would be read again after each number that is stored */
    double work = 0.0, start = 0.0, resultant = 0.0, size = 0.0, kinetic = 0.0;
#pragma omp simd reduction(+ : work, start, resultant, size, kinetic)
    for (size_t i = 0; i < n; i++) {
        const double u = x.u[i], du = u - x.u0[i];
        const double acting = x.f[i] + x.k[i] * (x.al1 * x.w[i]);
        const double inertia = x.q[i] + x.m[i] * x.w[i];
        work += (x.f0[i] + acting) * du;
        start += x.start[i] * du;
        resultant += (x.q0[i] + inertia) * du;
        size += fabs(x.r[i] * u);
        kinetic += x.v[i] * (x.m[i] * x.v[i]);
        x.u1[i] = u;
        x.f1[i] = acting;
        x.q1[i] = inertia;
    }
    terms[PMA_PASSAGE_WORK] = 0.5 * work;
    terms[PMA_PASSAGE_START] = start;
    terms[PMA_PASSAGE_RESULTANT] = 0.5 * resultant;
    terms[PMA_PASSAGE_SIZE] = size;
    terms[PMA_PASSAGE_KINETIC] = kinetic;
}

PMA_INLINE void sum_lanes(size_t n, const pma_passage *p, double *terms)
{
    const pma_passage x = *p;
    double sum[PMA_PASSAGE_TERMS][PMA_LANES] = {{0.0}};
    for (size_t i = 0; i < n; i += PMA_LANES) {
#pragma omp simd
        for (size_t l = 0; l < PMA_LANES; l++) {
            const size_t at = i + l;
            const double u = x.u[at], f = x.f[at], q = x.q[at], du = u - x.u0[at];
            sum[PMA_PASSAGE_WORK][l] += 0.5 * (x.f0[at] + f) * du;
            sum[PMA_PASSAGE_START][l] += x.start[at] * du;
            sum[PMA_PASSAGE_RESULTANT][l] += 0.5 * (x.q0[at] + q) * du;
            sum[PMA_PASSAGE_SIZE][l] += fabs(x.r[at] * u);
            x.u1[at] = u;
            x.f1[at] = f;
            x.q1[at] = q;
        }
    }
    memcpy(terms, sum, sizeof sum);
}

PMA_COMPILED(void, one, (size_t n, const pma_passage *p, double *terms), sum_one(n, p, terms);)

PMA_COMPILED(void, eight, (size_t n, const pma_passage *p, double *terms), sum_lanes(n, p, terms);)

void pma_passage_sum(size_t n, size_t lanes, const pma_passage *p, double *terms)
{
    if (lanes > 1)
        (pma_has_avx2() ? eight_avx2 : eight_plain)(n, p, terms);
    else
        (pma_has_avx2() ? one_avx2 : one_plain)(n, p, terms);
}
