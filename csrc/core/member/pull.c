#include "member/pull.h"

/* Substeps of (H4) at most: where rate * x is beyond, z has come to rest at its limit. */
enum { MOST_STEPS = 256 };

/* clang-format off: attributes are long, and a name begins its line */

/* (H1)  f = k d + k3 d^3 */
__attribute__((always_inline)) static inline void
pull_cubic(size_t count, const double *k, const double *k3, const double *d, double *f)
{
#pragma omp simd
    for (size_t i = 0; i < count; i++)
        f[i] = d[i] * (k[i] + k3[i] * d[i] * d[i]);
}

/* (H2)  f = k (d - gap), if that is positive; a d that is not finite stays to be seen */
__attribute__((always_inline)) static inline void
pull_gap(size_t count, const double *k, const double *gap, const double *d, double *f)
{
#pragma omp simd
    for (size_t i = 0; i < count; i++) {
        const double closed = k[i] * (d[i] - gap[i]);
        f[i] = d[i] <= gap[i] ? 0.0 : closed;
    }
}

/* (H3)  p goes along when |d - p| would pass d_y;  f = k_hard d + k_soft (d - p) */
__attribute__((always_inline)) static inline void
pull_bilinear(size_t count, const double *hard, const double *soft, const double *d_y,
              const double *d, const double *p0, double *p1, double *f)
{
#pragma omp simd
    for (size_t i = 0; i < count; i++) {
        const double e = d[i] - p0[i], up = d[i] - d_y[i], down = d[i] + d_y[i];
        const double below = e < -d_y[i] ? down : p0[i];
        const double p = e > d_y[i] ? up : below;
        p1[i] = p;
        f[i] = hard[i] * d[i] + soft[i] * (d[i] - p);
    }
}

/* Springs that follow their paths together, since each waits for one number after the other. */
enum { BLOCK = 8 };

typedef struct {
    const double *n, *beta, *gamma;
    double z[BLOCK], x[BLOCK], sign[BLOCK], steps[BLOCK], h[BLOCK];
} paths;

/* A step of the classical Runge-Kutta rule for spring i, if it has one left. */
__attribute__((always_inline)) static inline void follow(paths *p, size_t i, double done,
                                                         bool whole)
{
    const double z = p->z[i], sign = p->sign[i], h = p->h[i];
    const double n = p->n[i], beta = p->beta[i], gamma = p->gamma[i];
    const double a = pma_pull_slope(z, sign, n, beta, gamma, whole);
    const double b = pma_pull_slope(z + 0.5 * h * a, sign, n, beta, gamma, whole);
    const double c = pma_pull_slope(z + 0.5 * h * b, sign, n, beta, gamma, whole);
    const double d = pma_pull_slope(z + h * c, sign, n, beta, gamma, whole);
    const double next = z + h / 6.0 * (a + 2.0 * b + 2.0 * c + d);
    p->z[i] = done < p->steps[i] ? next : z;
}

__attribute__((always_inline)) static inline void follow_all(paths *p, size_t count, double done)
{
    for (size_t i = 0; i < count; i++)
        follow(p, i, done, false);
}

/* Whole exponents alone, so that all springs are in vectors. */
__attribute__((always_inline)) static inline void follow_whole(paths *p, size_t count, double done)
{
#pragma omp simd
    for (size_t i = 0; i < count; i++)
        follow(p, i, done, true);
}

/* Steps with rate * h <= 1/2 along paths of the lengths |x|; returns the largest number of them. */
__attribute__((always_inline)) static inline double divide(paths *p, size_t count,
                                                           const double *rate)
{
    double most = 0.0;
#pragma omp simd reduction(max : most)
    for (size_t i = 0; i < count; i++) {
        const double length = fabs(p->x[i]), wanted = 2.0 * rate[i] * length;
        const bool follows = wanted < MOST_STEPS; /* NaN does not */
        const double steps = follows ? 1.0 + (double)(int)(follows ? wanted : 0.0) : MOST_STEPS;
        p->sign[i] = p->x[i] < 0.0 ? -1.0 : 1.0;
        p->steps[i] = steps;
        p->h[i] = (follows ? length : 0.5) / (follows ? steps : rate[i]);
        most = steps > most ? steps : most;
    }
    return most;
}

/* (H4)  f = k_hard d + f_soft z, of up to BLOCK springs */
__attribute__((always_inline)) static inline void
pull_block(size_t count, const double *const P[], const double *d0, const double *d,
           const double *z0, double *z1, double *f)
{
    paths p; /* set as far as it is used: zeros first would take as long as a step */
    bool whole = true;
    p.n = P[3];
    p.beta = P[4];
    p.gamma = P[5];
    for (size_t i = 0; i < count; i++) {
        p.x[i] = (d[i] - d0[i]) * P[2][i];
        p.z[i] = z0[i];
        whole = whole && (p.n[i] == 1.0 || p.n[i] == 2.0);
    }
    const double most = divide(&p, count, P[6]);
    for (size_t done = 0; (double)done < most; done++) {
        if (whole)
            follow_whole(&p, count, (double)done);
        else
            follow_all(&p, count, (double)done);
    }
    for (size_t i = 0; i < count; i++) {
        z1[i] = p.z[i];
        f[i] = P[0][i] * d[i] + P[1][i] * z1[i];
    }
}

__attribute__((always_inline)) static inline void
pull_bouc_wen(size_t count, const double *const P[], const double *d0, const double *d,
              const double *z0, double *z1, double *f)
{
    for (size_t i = 0; i < count; i += BLOCK) {
        const double *of_block[PMA_SPRING_PARAMETERS];
        for (size_t k = 0; k < PMA_SPRING_PARAMETERS; k++)
            of_block[k] = P[k] + i;
        const size_t m = count - i < BLOCK ? count - i : BLOCK;
        pull_block(m, of_block, d0 + i, d + i, z0 + i, z1 + i, f + i);
    }
}

/* ---- all laws -------------------------------------------------------------------------------- */

__attribute__((always_inline)) static inline void
pull(const pma_spring_set *set, size_t begin, size_t count, const double *d0, const double *d,
     const double *inner0, double *inner1, double *f)
{
    const double *P[PMA_SPRING_PARAMETERS] = {NULL};
    for (size_t k = 0; k < pma_spring_parameters[set->law]; k++)
        P[k] = set->parameters[k] + begin;
    switch (set->law) {
    case PMA_CUBIC:
        pull_cubic(count, P[0], P[1], d, f);
        break;
    case PMA_GAP:
        pull_gap(count, P[0], P[1], d, f);
        break;
    case PMA_BILINEAR:
        pull_bilinear(count, P[0], P[1], P[2], d, inner0, inner1, f);
        break;
    case PMA_BOUC_WEN:
        pull_bouc_wen(count, P, d0, d, inner0, inner1, f);
        break;
    }
}

/* ---- for each kind of processor ------------------------------------------------------------- */

static void pull_plain(const pma_spring_set *set, size_t begin, size_t count, const double *d0,
                       const double *d, const double *inner0, double *inner1, double *f)
{
    pull(set, begin, count, d0, d, inner0, inner1, f);
}

pma_pull *pma_pull_plain(void)
{
    return pull_plain;
}

#if defined(__x86_64__)

/* AVX2 alone: with fused multiply-adds the digits would depend on the processor. */
__attribute__((target("avx2"))) static void
pull_avx2(const pma_spring_set *set, size_t begin, size_t count, const double *d0, const double *d,
          const double *inner0, double *inner1, double *f)
{
    pull(set, begin, count, d0, d, inner0, inner1, f);
}

pma_pull *pma_pull_best(void)
{
    return __builtin_cpu_supports("avx2") ? pull_avx2 : pull_plain;
}

#else

pma_pull *pma_pull_best(void)
{
    return pull_plain;
}

#endif
