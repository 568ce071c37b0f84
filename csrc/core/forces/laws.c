#include "forces/laws.h"

#include <math.h>
#include <stdbool.h>

#include "algebra/processors.h"

#define INLINE __attribute__((always_inline)) static inline

/* ---- (H1)  f = k d + k3 d^3 ----------------------------------------------------------------- */

INLINE void go_cubic(const pma_law_path *s)
{
    const double *k = s->P[0], *k3 = s->P[1], *d = s->d;
    double *f = s->f;
#pragma omp simd
    for (size_t i = 0; i < s->count; i++)
        f[i] = d[i] * (k[i] + k3[i] * d[i] * d[i]);
}

static double cubic_tangent(const pma_law_end *e)
{
    return e->P[0][e->i] + 3.0 * e->P[1][e->i] * e->d * e->d;
}

static double cubic_energy(const pma_law_end *e)
{
    return 0.5 * e->d * e->d * (e->P[0][e->i] + 0.5 * e->P[1][e->i] * e->d * e->d);
}

/* ---- (H14)  f = k d + k3 d^3 + c d' ---------------------------------------------------------- */

INLINE void go_damped_cubic(const pma_law_path *s)
{
    const double *k = s->P[0], *k3 = s->P[1], *c = s->P[2], *d = s->d, *rate = s->rate;
    double *f = s->f;
#pragma omp simd
    for (size_t i = 0; i < s->count; i++)
        f[i] = d[i] * (k[i] + k3[i] * d[i] * d[i]) + c[i] * rate[i];
}

static double damped_cubic_dashpot(const pma_law_end *e)
{
    return e->P[2][e->i];
}

/* ---- (H2)  f = k (d - gap), if that is positive --------------------------------------------- */

/* A d that is not finite stays to be seen. */
INLINE void go_gap(const pma_law_path *s)
{
    const double *k = s->P[0], *gap = s->P[1], *d = s->d;
    double *f = s->f;
#pragma omp simd
    for (size_t i = 0; i < s->count; i++) {
        const double closed = k[i] * (d[i] - gap[i]);
        f[i] = d[i] <= gap[i] ? 0.0 : closed;
    }
}

static double gap_tangent(const pma_law_end *e)
{
    return e->d <= e->P[1][e->i] ? 0.0 : e->P[0][e->i];
}

static double gap_energy(const pma_law_end *e)
{
    const double closed = e->d - e->P[1][e->i];
    return e->d <= e->P[1][e->i] ? 0.0 : 0.5 * e->P[0][e->i] * closed * closed;
}

/* ---- (H13)  f = k (d - gap) + c d', if d is above the gap and that is positive --------------- */

INLINE void go_damped_gap(const pma_law_path *s)
{
    const double *k = s->P[0], *gap = s->P[1], *c = s->P[2], *d = s->d, *rate = s->rate;
    double *f = s->f;
#pragma omp simd
    for (size_t i = 0; i < s->count; i++) {
        const double closed = k[i] * (d[i] - gap[i]) + c[i] * rate[i];
        f[i] = d[i] <= gap[i] || closed <= 0.0 ? 0.0 : closed;
    }
}

static double damped_gap_tangent(const pma_law_end *e)
{
    return e->f > 0.0 ? e->P[0][e->i] : 0.0;
}

static double damped_gap_dashpot(const pma_law_end *e)
{
    return e->f > 0.0 ? e->P[2][e->i] : 0.0;
}

/* ---- (H3)  p goes along when |d - p| would pass d_y;  f = k_hard d + k_soft (d - p) --------- */

INLINE void go_bilinear(const pma_law_path *s)
{
    const double *hard = s->P[0], *soft = s->P[1], *d_y = s->P[2], *d = s->d, *p0 = s->inner0;
    double *p1 = s->inner1, *f = s->f;
#pragma omp simd
    for (size_t i = 0; i < s->count; i++) {
        const double e = d[i] - p0[i], up = d[i] - d_y[i], down = d[i] + d_y[i];
        const double below = e < -d_y[i] ? down : p0[i];
        const double p = e > d_y[i] ? up : below;
        p1[i] = p;
        f[i] = hard[i] * d[i] + soft[i] * (d[i] - p);
    }
}

static double bilinear_tangent(const pma_law_end *e)
{
    return e->P[0][e->i] + (fabs(e->d - *e->inner0) > e->P[2][e->i] ? 0.0 : e->P[1][e->i]);
}

static double bilinear_energy(const pma_law_end *e)
{
    const double elastic = e->d - *e->inner1;
    return 0.5 * (e->P[0][e->i] * e->d * e->d + e->P[1][e->i] * elastic * elastic);
}

/* ---- (H4)  f = k_hard d + f_soft z ---------------------------------------------------------- */

/* Substeps of (H4) at most: where rate * x is beyond, z has come to rest at its limit. */
enum { MOST_STEPS = 256 };

/* dz/dx on a path on which d moves one way, sign = +-1, and x = |d - d0| / d_y grows; with `whole`
 * n is 1 or 2 */
INLINE double slope_of_path(double z, double sign, double n, double beta, double gamma, bool whole)
{
    const double size = fabs(z), square = size * size;
    const double power = n == 1.0 ? size : whole || n == 2.0 ? square : pow(size, n);
    return sign * (1.0 - power * (gamma + (sign * z < 0.0 ? -beta : beta)));
}

/* Springs that follow their paths together, since each waits for one number after the other. */
enum { BLOCK = 8 };

typedef struct {
    const double *n, *beta, *gamma;
    double z[BLOCK], x[BLOCK], sign[BLOCK], steps[BLOCK], h[BLOCK];
} paths;

/* A step of the classical Runge-Kutta rule for spring i, if it has one left. */
INLINE void follow(paths *p, size_t i, double done, bool whole)
{
    const double z = p->z[i], sign = p->sign[i], h = p->h[i];
    const double n = p->n[i], beta = p->beta[i], gamma = p->gamma[i];
    const double a = slope_of_path(z, sign, n, beta, gamma, whole);
    const double b = slope_of_path(z + 0.5 * h * a, sign, n, beta, gamma, whole);
    const double c = slope_of_path(z + 0.5 * h * b, sign, n, beta, gamma, whole);
    const double d = slope_of_path(z + h * c, sign, n, beta, gamma, whole);
    const double next = z + h / 6.0 * (a + 2.0 * b + 2.0 * c + d);
    p->z[i] = done < p->steps[i] ? next : z;
}

INLINE void follow_all(paths *p, size_t count, double done)
{
    for (size_t i = 0; i < count; i++)
        follow(p, i, done, false);
}

/* Whole exponents alone, so that all springs are in vectors. */
INLINE void follow_whole(paths *p, size_t count, double done)
{
#pragma omp simd
    for (size_t i = 0; i < count; i++)
        follow(p, i, done, true);
}

/* Steps with rate * h <= 1/2 along paths of the lengths |x|; returns the largest number of them. */
INLINE double divide(paths *p, size_t count, const double *rate)
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

/* Up to BLOCK springs */
INLINE void go_block(size_t count, const double *const P[], const double *d0, const double *d,
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

INLINE void go_bouc_wen(const pma_law_path *s)
{
    enum { PARAMETERS = 7 };
    for (size_t i = 0; i < s->count; i += BLOCK) {
        const double *of_block[PARAMETERS];
        for (size_t k = 0; k < PARAMETERS; k++)
            of_block[k] = s->P[k] + i;
        const size_t m = s->count - i < BLOCK ? s->count - i : BLOCK;
        go_block(m, of_block, s->d0 + i, s->d + i, s->inner0 + i, s->inner1 + i, s->f + i);
    }
}

/* The slope of the path itself, which the Runge-Kutta rule follows to a few digits. */
static double bouc_wen_tangent(const pma_law_end *e)
{
    const double *const *P = e->P;
    const size_t i = e->i;
    const double sign = e->d < e->d0 ? -1.0 : 1.0;
    const double rise = sign * slope_of_path(*e->inner1, sign, P[3][i], P[4][i], P[5][i], false);
    return P[0][i] + P[1][i] * P[2][i] * rise;
}

static double bouc_wen_energy(const pma_law_end *e)
{
    const double z = *e->inner1;
    return 0.5 * (e->P[0][e->i] * e->d * e->d + e->P[1][e->i] / e->P[2][e->i] * z * z);
}

/* ---- (H9)  f = k d + sum k_e (d - p_e), each element as in (H3) ----------------------------- */

/* Parameters: k, then k_e and d_e of each element. */
INLINE void go_multilinear(const pma_law_path *s)
{
    for (size_t i = 0; i < s->count; i++)
        s->f[i] = s->P[0][i] * s->d[i];
    for (size_t e = 0; e < s->elements; e++) {
        const double *k = s->P[1 + 2 * e], *d_e = s->P[2 + 2 * e], *d = s->d;
        const double *p0 = s->inner0 + e * s->stride;
        double *p1 = s->inner1 + e * s->stride, *f = s->f;
#pragma omp simd
        for (size_t i = 0; i < s->count; i++) {
            const double x = d[i] - p0[i], up = d[i] - d_e[i], down = d[i] + d_e[i];
            const double below = x < -d_e[i] ? down : p0[i];
            const double p = x > d_e[i] ? up : below;
            p1[i] = p;
            f[i] += k[i] * (d[i] - p);
        }
    }
}

static double multilinear_tangent(const pma_law_end *s)
{
    double sum = s->P[0][s->i];
    for (size_t e = 0; e < s->elements; e++) {
        const double x = s->d - s->inner0[e * s->stride];
        sum += fabs(x) > s->P[2 + 2 * e][s->i] ? 0.0 : s->P[1 + 2 * e][s->i];
    }
    return sum;
}

static double multilinear_energy(const pma_law_end *s)
{
    double sum = 0.5 * s->P[0][s->i] * s->d * s->d;
    for (size_t e = 0; e < s->elements; e++) {
        const double x = s->d - s->inner1[e * s->stride];
        sum += 0.5 * s->P[1 + 2 * e][s->i] * x * x;
    }
    return sum;
}

/* ---- (H10)  f = k d + sum k_e min(max(d, -d_e), d_e) ----------------------------------------- */

INLINE void go_elastic(const pma_law_path *s)
{
    for (size_t i = 0; i < s->count; i++)
        s->f[i] = s->P[0][i] * s->d[i];
    for (size_t e = 0; e < s->elements; e++) {
        const double *k = s->P[1 + 2 * e], *d_e = s->P[2 + 2 * e], *d = s->d;
        double *f = s->f;
#pragma omp simd
        for (size_t i = 0; i < s->count; i++) {
            const double above = d[i] > d_e[i] ? d_e[i] : d[i];
            f[i] += k[i] * (above < -d_e[i] ? -d_e[i] : above);
        }
    }
}

static double elastic_tangent(const pma_law_end *s)
{
    double sum = s->P[0][s->i];
    for (size_t e = 0; e < s->elements; e++)
        sum += fabs(s->d) > s->P[2 + 2 * e][s->i] ? 0.0 : s->P[1 + 2 * e][s->i];
    return sum;
}

static double elastic_energy(const pma_law_end *s)
{
    double sum = 0.5 * s->P[0][s->i] * s->d * s->d;
    for (size_t e = 0; e < s->elements; e++) {
        const double d_e = s->P[2 + 2 * e][s->i], d = fabs(s->d);
        sum += s->P[1 + 2 * e][s->i] * (d > d_e ? d_e * (d - 0.5 * d_e) : 0.5 * d * d);
    }
    return sum;
}

/* ---- (H11)  d / d_y = g + alpha g |g|^(n-1), g = f / f_y, and branches of twice its size ----- */

/* Parameters: d_y, f_y, n, alpha. Inner variables: the number of reversals whose loops are open,
 * and deformation and force at each. When there are as many as there is room for, the smallest loop
 * is forgotten. */
enum { REVERSALS = 12, RAMBERG_OSGOOD = 1 + 2 * REVERSALS };

/* Corrections of Newton's method: 15 where n is below 1e6 and alpha in 1e-6..100, and no more than
 * 276 for any numbers of a file that were tried. */
enum { MOST_FALLS = 512 };

/* g of x: from above, where the convex curve lets Newton's method only go down; what is not finite
 * stays to be seen */
static double skeleton(double x, double n, double alpha)
{
    const double size = fabs(x), power = pow(size / alpha, 1.0 / n);
    double g = size < power ? size : power;
    bool falls = true;
    for (int k = 0; falls && k < MOST_FALLS; k++) {
        const double slope = alpha * pow(g, n - 1.0);
        const double next = g - (g + g * slope - size) / (1.0 + n * slope);
        falls = next < g;
        g = next > g ? g : next;
    }
    return x < 0.0 ? -g : g;
}

/* Where the branch at hand begins, and how large it is. */
typedef struct {
    double d, f, scale;
} branch;

static branch branch_of(const double *inner, size_t stride)
{
    const size_t open = (size_t)inner[0];
    if (open == 0)
        return (branch){.scale = 1.0};
    const double *last = inner + (2 * open - 1) * stride;
    return (branch){.d = last[0], .f = last[stride], .scale = 2.0};
}

/* Loops that are closed on the way to d are forgotten: at the reversal before the last one, or
 * opposite to the first one. */
static void close_loops(double *inner, size_t stride, double sign, double d)
{
    size_t open = (size_t)inner[0];
    while (open > 0) {
        const double end = open > 1 ? inner[(2 * open - 3) * stride] : -inner[stride];
        if (!(sign * (d - end) >= 0.0))
            break;
        open = open > 1 ? open - 2 : 0;
    }
    inner[0] = (double)open;
}

static void reverse(double *inner, size_t stride, double d, double f)
{
    const size_t before = (size_t)inner[0], open = before < REVERSALS ? before : before - 2;
    inner[(2 * open + 1) * stride] = d;
    inner[(2 * open + 2) * stride] = f;
    inner[0] = (double)(open + 1);
}

static void go_ramberg_osgood(const pma_law_path *s)
{
    for (size_t i = 0; i < s->count; i++) {
        double *inner = s->inner1 + i;
        const double d0 = s->d0[i], d = s->d[i], sign = d < d0 ? -1.0 : 1.0, f_y = s->P[1][i];
        for (size_t k = 0; k < RAMBERG_OSGOOD; k++)
            inner[k * s->stride] = s->inner0[k * s->stride + i];
        if (d != d0 && sign * (d0 - branch_of(inner, s->stride).d) < 0.0)
            reverse(inner, s->stride, d0, s->f0[i]);
        close_loops(inner, s->stride, sign, d);
        const branch b = branch_of(inner, s->stride);
        const double x = (d - b.d) / (b.scale * s->P[0][i]);
        s->f[i] = b.f + b.scale * f_y * skeleton(x, s->P[2][i], s->P[3][i]);
    }
}

static double ramberg_osgood_tangent(const pma_law_end *e)
{
    const double d_y = e->P[0][e->i], f_y = e->P[1][e->i], n = e->P[2][e->i];
    const branch b = branch_of(e->inner1, e->stride);
    const double g = fabs(e->f - b.f) / (b.scale * f_y);
    return f_y / d_y / (1.0 + n * e->P[3][e->i] * pow(g, n - 1.0));
}

/* (H12)  The complementary energy of the skeleton, and (d - d_r) (f + f_r) / 2 along branches */
static double ramberg_osgood_energy(const pma_law_end *e)
{
    const double d_y = e->P[0][e->i], f_y = e->P[1][e->i], n = e->P[2][e->i];
    const size_t open = (size_t)e->inner1[0];
    double d = open > 0 ? e->inner1[e->stride] : e->d;
    double f = open > 0 ? e->inner1[2 * e->stride] : e->f;
    const double g = fabs(f) / f_y;
    double sum = f_y * d_y * (0.5 * g * g + e->P[3][e->i] / (n + 1.0) * pow(g, n + 1.0));
    for (size_t k = 1; k <= open; k++) {
        const double *next = e->inner1 + (2 * k + 1) * e->stride;
        const double d1 = k < open ? next[0] : e->d, f1 = k < open ? next[e->stride] : e->f;
        sum += 0.5 * (d1 - d) * (f + f1);
        d = d1;
        f = f1;
    }
    return sum;
}

/* ---- for each kind of processor ------------------------------------------------------------- */

#define COMPILED(law) PMA_COMPILED(void, law, (const pma_law_path *path), go_##law(path);)
#define FORMS(law) .go = law##_avx2, .go_plain = law##_plain

COMPILED(cubic)
COMPILED(damped_cubic)
COMPILED(gap)
COMPILED(damped_gap)
COMPILED(bilinear)
COMPILED(bouc_wen)
COMPILED(multilinear)
COMPILED(elastic)

const pma_law pma_laws[PMA_SPRING_LAWS] = {
    [PMA_CUBIC] = {"cubic", 2, 0, 0, 0, FORMS(cubic), cubic_tangent, cubic_energy},
    [PMA_GAP] = {"gap", 2, 0, 0, 0, FORMS(gap), gap_tangent, gap_energy},
    [PMA_BILINEAR] = {"bilinear", 3, 1, 0, 0, FORMS(bilinear), bilinear_tangent, bilinear_energy},
    [PMA_BOUC_WEN] = {"Bouc-Wen", 7, 1, 0, 0, FORMS(bouc_wen), bouc_wen_tangent, bouc_wen_energy},
    [PMA_MULTILINEAR] = {"multilinear", 1, 0, 2, 1, FORMS(multilinear), multilinear_tangent,
                         multilinear_energy},
    [PMA_ELASTIC] = {"multilinear elastic", 1, 0, 2, 0, FORMS(elastic), elastic_tangent,
                     elastic_energy},
    [PMA_RAMBERG_OSGOOD] = {"Ramberg-Osgood", 4, RAMBERG_OSGOOD, 0, 0, go_ramberg_osgood,
                            go_ramberg_osgood, ramberg_osgood_tangent, ramberg_osgood_energy,
                            .most = REVERSALS},
    [PMA_DAMPED_GAP] = {"damped gap", 3, 0, 0, 0, FORMS(damped_gap), damped_gap_tangent, gap_energy,
                        damped_gap_dashpot},
    [PMA_DAMPED_CUBIC] = {"damped cubic", 3, 0, 0, 0, FORMS(damped_cubic), cubic_tangent,
                          cubic_energy, damped_cubic_dashpot},
};
