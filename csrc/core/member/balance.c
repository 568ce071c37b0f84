#include "member/balance.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Macro steps over which a gain has to last: at a sudden load all energy of the first steps is that
 * of the scheme. */
enum { LASTS = 4 };

/* Below this share of all work it is an error of the steps that does not grow, and below that of
 * sum |r| |ut| rounding. */
#define SHARE 0.01
#define ROUNDING 1e-9

/* From this gain on a motion has left all bounds: stable linear forces stay below it up to 0.9975
 * of their critical step. */
#define BROKEN 200.0

/* At a time level: where forces were evaluated and what they were, as they act, the velocity, the
 * extrapolated one, and what springs remember; the work of the forces and the energy added so far,
 * and the sum of their sizes; the work from the predictor to the state. */
typedef struct {
    double *ut, *r, *acting, *v, *vs, *springs;
    double work, added, gross, size, rest, start;
} level;

struct pma_balance {
    pma_balance_parts parts;
    level present, last;
    double *opened[2];              /* 2 n each: ut and r of substeps that are open */
    double *product;                /* n: scratch */
    bool begun;                     /* the present is known */
    double least_work, least_added; /* at the presents so far */
    double motion;                  /* largest energy without what was added */
    double gains[LASTS];
    double gain;
    double *block;
};

static size_t spring_numbers(const pma_balance_parts *p)
{
    return pma_springs_numbers(p->springs);
}

static void take_level(double **next, const pma_balance_parts *p, level *at)
{
    double *x = *next;
    *at = (level){.ut = x,
                  .r = x + p->n,
                  .acting = x + 2 * p->n,
                  .v = x + 3 * p->n,
                  .vs = x + 4 * p->n,
                  .springs = x + 5 * p->n};
    *next = at->springs + spring_numbers(p);
}

pma_status pma_balance_create(const pma_balance_parts *parts, pma_balance **out)
{
    const size_t n = parts->n;
    *out = NULL;
    if (parts->M.n != n)
        return PMA_BAD_SIZE;
    pma_status status = pma_matrix_check(&parts->M);
    if (status == PMA_OK && parts->K_r.form != PMA_ZERO)
        status = parts->K_r.n == n ? pma_matrix_check(&parts->K_r) : PMA_BAD_SIZE;
    if (status != PMA_OK)
        return status;
    /* 15 n + 2 numbers of springs: no overflow below this size */
    if (n + spring_numbers(parts) > SIZE_MAX / (16 * sizeof(double)))
        return PMA_NO_MEMORY;
    pma_balance *b = calloc(1, sizeof *b);
    if (!b)
        return PMA_NO_MEMORY;
    b->parts = *parts;
    b->block = calloc(15 * n + 2 * spring_numbers(parts), sizeof(double));
    if (!b->block) {
        free(b);
        return PMA_NO_MEMORY;
    }
    double *next = b->block;
    take_level(&next, parts, &b->present);
    take_level(&next, parts, &b->last);
    b->opened[0] = next;
    b->opened[1] = next + 2 * n;
    b->product = next + 4 * n;
    *out = b;
    return PMA_OK;
}

void pma_balance_destroy(pma_balance *b)
{
    if (b)
        free(b->block);
    free(b);
}

/* v . M v / 2 */
static double kinetic(pma_balance *b, const double *v)
{
    double sum = 0.0;
    memset(b->product, 0, b->parts.n * sizeof(double));
    pma_matrix_subtract(&b->parts.M, v, b->product);
    for (size_t i = 0; i < b->parts.n; i++)
        sum -= v[i] * b->product[i];
    return 0.5 * sum;
}

void pma_balance_begin(pma_balance *b, const double *v)
{
    b->begun = false;
    b->present.work = b->present.added = b->present.gross = b->present.size = 0.0;
    b->least_work = b->least_added = b->gain = 0.0;
    b->motion = kinetic(b, v);
    memset(b->gains, 0, sizeof b->gains);
}

double *pma_balance_open(pma_balance *b, int64_t number, const double *ut)
{
    const size_t n = b->parts.n;
    double *opened = b->opened[number & 1];
    memcpy(opened, ut, n * sizeof(double));
    memset(opened + n, 0, n * sizeof(double));
    return opened + n;
}

/* product := K_r (u1 - ut) + D_r (v1 - vs), subtracted from zero; u1 - ut = al1 w        (R2) */
static void correct_forces(pma_balance *b, const level *from, double al1, const double *v,
                           const double *w)
{
    const size_t n = b->parts.n;
    double *scratch = b->last.vs; /* written last */
    memset(b->product, 0, n * sizeof(double));
    if (b->parts.D_r.form != PMA_ZERO && b->begun) {
        for (size_t i = 0; i < n; i++)
            scratch[i] = v[i] - from->vs[i];
        pma_matrix_subtract(&b->parts.D_r, scratch, b->product);
    }
    if (b->parts.K_r.form != PMA_ZERO && al1 != 0.0) {
        for (size_t i = 0; i < n; i++)
            scratch[i] = al1 * w[i];
        pma_matrix_subtract(&b->parts.K_r, scratch, b->product);
    }
}

/* (B8)  s (r + r_a) . w / 2 with s from 0, where K_r has changed little of `whole` r . w, to 1
 * where it has taken back half of it: `taken` (r - r_a) . w */
static double rest_of(double whole, double taken)
{
    if (whole == 0.0)
        return 0.0;
    const double share = fmin(fmax(2.0 * taken / whole, 0.0), 1.0);
    return share * (whole - 0.5 * taken);
}

void pma_balance_close(pma_balance *b, int64_t number, size_t j, double al1, const double *v,
                       const double *w, const double *springs)
{
    const size_t n = b->parts.n;
    const level *from = j == 0 ? &b->present : &b->last;
    level *to = &b->last;
    const double *ut = b->opened[number & 1], *r = ut + n;
    double path = 0.0, seen = 0.0, size = 0.0, whole = 0.0, taken = 0.0;
    correct_forces(b, from, al1, v, w);
    for (size_t i = 0; i < n; i++) {
        const double acting = r[i] - b->product[i];
        path += (from->r[i] + r[i]) * (ut[i] - from->ut[i]);
        seen += (from->acting[i] + acting) * (from->v[i] + v[i]);
        size += fabs(r[i] * ut[i]);
        whole += r[i] * w[i];
        taken += (r[i] - acting) * w[i];
        to->ut[i] = ut[i];
        to->r[i] = r[i];
        to->acting[i] = acting;
        to->v[i] = v[i];
        to->vs[i] = v[i] + b->parts.h * w[i];
    }
    /* (B8), (B9) */
    const double rest_before = from->rest; /* from and to may be the same */
    const bool known = j > 0 || b->begun;
    to->rest = al1 * rest_of(whole, taken);
    path = 0.5 * path + pma_springs_excess(b->parts.springs, from->springs, springs) + to->rest -
           rest_before;
    seen *= 0.25 * b->parts.h;
    to->work = from->work + (known ? path : 0.0);
    to->added = from->added + (known ? path - seen : 0.0);
    to->gross = from->gross + (known ? fabs(path) + fabs(seen) : 0.0);
    to->size = fmax(from->size, size);
    if (!known) /* the forces that there are at the start have done work before it */
        to->start = 0.5 * size;
    else
        to->start = from->start;
    memcpy(to->springs, springs, spring_numbers(&b->parts) * sizeof(double));
}

/* (B10) */
static double gain_at(pma_balance *b, const double *v)
{
    const level *at = &b->present;
    b->least_work = fmin(b->least_work, at->work);
    b->least_added = fmin(b->least_added, at->added);
    const double added = at->added - b->least_added;
    const double energy = kinetic(b, v) + at->work - b->least_work;
    b->motion = fmax(b->motion, fmax(energy - added, ROUNDING * at->size));
    b->motion = fmax(b->motion, at->start);
    /* what was added and dissipated at once does no harm */
    return added > SHARE * at->gross ? fmin(added, energy) / b->motion : 0.0;
}

void pma_balance_commit(pma_balance *b, const double *v)
{
    const level before = b->present;
    b->present = b->last;
    b->last = before;
    b->begun = true;
    memmove(b->gains, b->gains + 1, (LASTS - 1) * sizeof(double));
    b->gains[LASTS - 1] = gain_at(b, v);
    double least = b->gains[0];
    for (size_t i = 1; i < LASTS; i++)
        least = fmin(least, b->gains[i]);
    b->gain = fmax(b->gain, least);
}

double pma_balance_gain(const pma_balance *b)
{
    return b->gain;
}

bool pma_balance_is_broken(const pma_balance *b)
{
    return b->gain > BROKEN;
}
