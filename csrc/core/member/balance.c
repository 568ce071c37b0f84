#include "member/balance.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "algebra/lanes.h"
#include "object.h"

#define INLINE __attribute__((always_inline)) static inline

/* Of the largest energy of the motion, from which on what was added is reported; of all work, below
 * which it is an error of the steps that does not grow; of sum |r| |ut|, below which it is
 * rounding; of a kinetic energy, below which it is no larger than the last one. */
#define REPORTED 0.1
#define SHARE 0.01
#define ROUNDING 1e-9
#define EQUAL 1e-9

/* From this multiple of the first kinetic energy on there is no motion any more. */
#define BROKEN 1e200

/* Up to a time level: the work along the path of the evaluations but for what springs store, that
 * of what acts, and that of
 * what has come to act since the start; the work of the resultant; the sum of the sizes of the
 * works, and the largest force times displacement; of (B13) the numerator and the denominator. */
typedef struct {
    double path, work, since, resultant, gross, size, excess, inertia;
} sums;

/* At a time level: where forces were evaluated and what they were, how far from there the state is,
 * the forces as they act, M w, displacement, velocity, the extrapolated one, and what springs
 * remember. */
typedef struct {
    double *ut, *r, *x, *acting, *inertia, *u, *v, *vs, *springs;
    double *iterated;              /* the forces that are evaluated at the state, */
    double *functions, *stiffness; /* ... and of functions among them */
    bool bends;                    /* the stiffness is known */
    double t;
    sums *sums; /* of each lane */
} level;

enum { ARRAYS = 8 }; /* of n numbers in a level */

/* What macro time levels so far have shown, of a lane. */
typedef struct {
    double start, stored;  /* kinetic energy where the sums begin, and that of the springs, */
    double first, largest; /* ... the first one that is not zero, the largest one, */
    double last;           /* ... and the last one */
    double since;          /* the time from which on the gain has exceeded what is reported */
    bool exceeds;          /* ... as it does now */
    pma_gain gain;         /* t > 0: it did so at two macro levels */
} judgement;

struct pma_balance {
    pma_balance_parts parts;
    level present;
    level *work; /* time level j > 0 in work[(j - 1) % kept] */
    size_t kept;
    double *opened;            /* 2 x 2 n: ut and r of substeps that are open */
    double *product, *scratch; /* n each */
    double *inertia;           /* n: M w at the end of a substep */
    double *start;             /* n: what acts at the time level at which the sums begin */
    pma_first_forces first;    /* at the next start */
    double *stored, *excess;   /* of the springs of each lane: energy, and in a substep, */
    double bent;               /* ... and of functions */
    bool has_stored;           /* the energy is that of the level that is judged */
    bool begun;                /* the present is known */
    bool is_passive;           /* the path is not known */
    judgement *judged;         /* of each lane */
    double *numbers;           /* of all levels, */
    sums *sums;                /* ... and their sums */
};

/* All arrays of a level but the sums, with forces that are iterated, and the stiffness of functions
 * among them. */
static size_t level_size(const pma_balance_parts *p)
{
    const size_t iterated = p->iterates ? p->n : 0;
    const size_t functions = p->ptr ? p->n + (size_t)p->ptr[p->n] : 0;
    return ARRAYS * p->n + pma_springs_numbers(p->springs) + iterated + functions;
}

static level take_level(const pma_balance *b, size_t number)
{
    const pma_balance_parts *p = &b->parts;
    double *x = b->numbers + number * level_size(p);
    double *springs = x + ARRAYS * p->n, *iterated = springs + pma_springs_numbers(p->springs);
    double *functions = iterated + (p->iterates ? p->n : 0);
    return (level){.ut = x,
                   .r = x + p->n,
                   .x = x + 2 * p->n,
                   .acting = x + 3 * p->n,
                   .inertia = x + 4 * p->n,
                   .u = x + 5 * p->n,
                   .v = x + 6 * p->n,
                   .vs = x + 7 * p->n,
                   .springs = springs,
                   .iterated = iterated,
                   .functions = functions,
                   .stiffness = functions + p->n,
                   .sums = b->sums + number * p->lanes};
}

pma_status pma_balance_create(const pma_balance_parts *parts, pma_balance **out)
{
    const size_t n = parts->n, lanes = parts->lanes;
    const size_t entries = parts->ptr ? (size_t)parts->ptr[n] : 0;
    const size_t kept = parts->has_responses ? parts->substeps : 1;
    const pma_array arrays[] = {
        PMA_ARRAY(pma_balance, work, kept),
        PMA_ARRAY(pma_balance, judged, lanes),
        PMA_ARRAY(pma_balance, sums, (kept + 1) * lanes),
        PMA_ARRAY(pma_balance, opened, 4 * n),
        PMA_ARRAY(pma_balance, product, n),
        PMA_ARRAY(pma_balance, scratch, n),
        PMA_ARRAY(pma_balance, inertia, n),
        PMA_ARRAY(pma_balance, start, n),
        PMA_ARRAY(pma_balance, first.once, n),
        PMA_ARRAY(pma_balance, first.iterated, n),
        PMA_ARRAY(pma_balance, first.stiffness, entries),
        PMA_ARRAY(pma_balance, stored, lanes),
        PMA_ARRAY(pma_balance, excess, lanes),
        {offsetof(pma_balance, numbers), kept + 1, level_size(parts) * sizeof(double)},
        {0}};
    *out = NULL;
    if (parts->M.n != n || parts->K.n != n || (parts->K_r.form != PMA_ZERO && parts->K_r.n != n))
        return PMA_BAD_SIZE;
    PMA_TRY(pma_matrix_check(&parts->M));
    PMA_TRY(pma_matrix_check(&parts->K_r));
    pma_balance *b = pma_object_create(sizeof *b, arrays);
    if (!b)
        return PMA_NO_MEMORY;
    b->parts = *parts;
    b->kept = kept;
    b->present = take_level(b, 0);
    for (size_t k = 0; k < kept; k++)
        b->work[k] = take_level(b, k + 1);
    *out = b;
    return PMA_OK;
}

void pma_balance_destroy(pma_balance *b)
{
    free(b);
}

const pma_balance_parts *pma_balance_get_parts(const pma_balance *b)
{
    return &b->parts;
}

/* product := - A x */
static void multiply(pma_balance *b, const pma_matrix *A, const double *x)
{
    memset(b->product, 0, b->parts.n * sizeof(double));
    pma_matrix_subtract(A, x, b->product);
}

/* x . A x / 2 of a lane, with that product */
static double half_square(const pma_balance *b, const double *x, size_t lane)
{
    double sum = 0.0;
    for (size_t i = lane; i < b->parts.n; i += b->parts.lanes)
        sum -= x[i] * b->product[i];
    return 0.5 * sum;
}

/* The same of each lane, as the last kinetic energy. */
static void half_squares(pma_balance *b, const double *x)
{
    double sum[PMA_LANES] = {0.0};
    for (size_t i = 0; i < b->parts.n; i += PMA_LANES) {
#pragma omp simd
        for (size_t l = 0; l < PMA_LANES; l++)
            sum[l] -= x[i + l] * b->product[i + l];
    }
    for (size_t l = 0; l < PMA_LANES; l++)
        b->judged[l].last = 0.5 * sum[l];
}

void pma_balance_begin(pma_balance *b)
{
    b->begun = false;
    b->is_passive = b->parts.is_passive;
    for (size_t l = 0; l < b->parts.lanes; l++) {
        b->present.sums[l] = (sums){0};
        b->judged[l] = (judgement){0};
    }
}

double *pma_balance_open(pma_balance *b, int64_t number, const double *ut)
{
    const size_t n = b->parts.n;
    double *opened = b->opened + (number & 1) * 2 * (int64_t)n;
    memcpy(opened, ut, n * sizeof(double));
    memset(opened + n, 0, n * sizeof(double));
    return opened + n;
}

static level *level_at(pma_balance *b, size_t j)
{
    return j == 0 ? &b->present : &b->work[(j - 1) % b->kept];
}

/* product := K_r (u1 - ut) + D_r (v1 - vs), subtracted from zero                           (R2) */
static void correct_forces(pma_balance *b, const double *vs, const double *v, const double *x)
{
    const size_t n = b->parts.n;
    memset(b->product, 0, n * sizeof(double));
    if (b->parts.D_r.form != PMA_ZERO) {
        for (size_t i = 0; i < n; i++)
            b->scratch[i] = v[i] - vs[i];
        pma_matrix_subtract(&b->parts.D_r, b->scratch, b->product);
    }
    if (b->parts.K_r.form != PMA_ZERO)
        pma_matrix_subtract(&b->parts.K_r, x, b->product);
}

/* du . K du */
static double bending(const pma_balance *b, const double *K, const double *du)
{
    double sum = 0.0;
    for (size_t i = 0; i < b->parts.n; i++) {
        for (int64_t k = b->parts.ptr[i]; k < b->parts.ptr[i + 1]; k++)
            sum += du[i] * K[k] * du[b->parts.index[k]];
    }
    return sum;
}

/* (B12)  The work of du . f beyond the mean of its ends, `change` apart, with the slopes k0 and k1
 * there: that of one bend at the share s of the path, or where the slope between them has been
 * neither, of a cubic */
static double work_of_bend(double change, double k0, double k1)
{
    const double s = (k1 - change) / (k1 - k0), inside = fmin(fmax(s, 0.0), 1.0);
    const double share = fabs(s - 0.5) > 1.0 ? 1.0 / 6.0 : inside * (1.0 - inside);
    const double work = 0.5 * (k0 - k1) * share;
    return isfinite(work) ? work : 0.0;
}

void pma_balance_iterate(pma_balance *b, const pma_substep *step, const double *r)
{
    memcpy(level_at(b, step->j + 1)->iterated, r, b->parts.n * sizeof(double));
}

void pma_balance_bend(pma_balance *b, const pma_substep *step, const double *u, const double *f,
                      const double *K)
{
    const level *from = level_at(b, step->j);
    level *to = level_at(b, step->j + 1);
    b->bent = 0.0;
    if (K && from->bends && (step->j > 0 || b->begun)) {
        double *du = b->scratch, change = 0.0;
        for (size_t i = 0; i < b->parts.n; i++) {
            du[i] = u[i] - from->u[i];
            change += du[i] * (f[i] - from->functions[i]);
        }
        b->bent = work_of_bend(change, bending(b, from->stiffness, du), bending(b, K, du));
    }
    memcpy(to->functions, f, b->parts.n * sizeof(double));
    to->bends = K != NULL;
    if (K)
        memcpy(to->stiffness, K, (size_t)b->parts.ptr[b->parts.n] * sizeof(double));
}

/* The work of forces that are iterated is that on the path of u, not of ut: the difference. */
static double work_to_state(const pma_balance *b, const level *from, const level *to,
                            const double *ut)
{
    double sum = 0.0;
    for (size_t i = 0; b->parts.iterates && i < b->parts.n; i++)
        sum += 0.5 * (from->iterated[i] + to->iterated[i]) *
               (ut[i] + to->x[i] - from->u[i] - (ut[i] - from->ut[i]));
    return sum;
}

/* (B13)  al1 dut . (K_r dut - dr) and dut . M dut from one level to the next, of one lane */
static void add_estimate(pma_balance *b, const level *from, level *to, double al1, const double *ut,
                         const double *r)
{
    double *dut = b->scratch, held = 0.0;
    for (size_t i = 0; i < b->parts.n; i++) {
        dut[i] = ut[i] - from->ut[i];
        held += dut[i] * (r[i] - from->r[i]);
    }
    multiply(b, &b->parts.K_r, dut);
    const double estimate = 2.0 * half_square(b, dut, 0);
    multiply(b, &b->parts.M, dut);
    to->sums->excess = from->sums->excess + al1 * (estimate - held);
    to->sums->inertia = from->sums->inertia + 2.0 * half_square(b, dut, 0);
}

/* What (B8) adds from one level to the next. */
typedef struct {
    double path, work, start, resultant, size;
} work_of_step;

/* Number i of the levels, whose x is known, with r - r_a in the product; the two levels may be the
 * same. */
INLINE work_of_step sum_up_row(const pma_balance *b, const level *from, const level *to,
                               const double *ut, const double *r, size_t i)
{
    const double acting = r[i] - b->product[i], u = ut[i] + to->x[i], du = u - from->u[i];
    const work_of_step row = {.path = 0.5 * (from->r[i] + r[i]) * (ut[i] - from->ut[i]),
                              .work = 0.5 * (from->acting[i] + acting) * du,
                              .start = b->start[i] * du,
                              .resultant = 0.5 * (from->inertia[i] + b->inertia[i]) * du,
                              .size = fabs(r[i] * ut[i])};
    to->ut[i] = ut[i];
    to->r[i] = r[i];
    to->acting[i] = acting;
    to->inertia[i] = b->inertia[i];
    to->u[i] = u;
    return row;
}

INLINE void add_to_sums(const pma_balance *b, const level *from, level *to, size_t lane,
                        work_of_step all)
{
    const sums before = from->sums[lane];
    to->sums[lane] = (sums){.path = before.path + all.path + b->excess[lane],
                            .work = before.work + all.work,
                            .since = before.since + (all.work - all.start),
                            .resultant = before.resultant + all.resultant,
                            .gross = before.gross + fabs(all.work - all.start),
                            .size = fmax(before.size, all.size),
                            .excess = to->sums[lane].excess,
                            .inertia = to->sums[lane].inertia};
}

static void sum_up(const pma_balance *b, const level *from, level *to, const double *ut,
                   const double *r)
{
    double path = 0.0, work = 0.0, start = 0.0, resultant = 0.0, size = 0.0;
#pragma omp simd reduction(+ : path, work, start, resultant, size)
    for (size_t i = 0; i < b->parts.n; i++) {
        const work_of_step row = sum_up_row(b, from, to, ut, r, i);
        path += row.path;
        work += row.work;
        start += row.start;
        resultant += row.resultant;
        size += row.size;
    }
    add_to_sums(b, from, to, 0, (work_of_step){path, work, start, resultant, size});
}

/* The same for all lanes. */
INLINE void sum_up_lanes(const pma_balance *balance, const level *from, level *to, const double *ut,
                         const double *r)
{
    const pma_balance b = *balance; /* or they would be read again after each number */
    const level before = *from, after = *to;
    double path[PMA_LANES] = {0.0}, work[PMA_LANES] = {0.0}, start[PMA_LANES] = {0.0};
    double resultant[PMA_LANES] = {0.0}, size[PMA_LANES] = {0.0};
    for (size_t i = 0; i < b.parts.n; i += PMA_LANES) {
#pragma omp simd
        for (size_t l = 0; l < PMA_LANES; l++) {
            const work_of_step row = sum_up_row(&b, &before, &after, ut, r, i + l);
            path[l] += row.path;
            work[l] += row.work;
            start[l] += row.start;
            resultant[l] += row.resultant;
            size[l] += row.size;
        }
    }
    for (size_t l = 0; l < PMA_LANES; l++)
        add_to_sums(balance, from, to, l,
                    (work_of_step){path[l], work[l], start[l], resultant[l], size[l]});
}

PMA_COMPILED(void, sum_up_lanes,
             (const pma_balance *b, const level *from, level *to, const double *ut,
              const double *r),
             sum_up_lanes(b, from, to, ut, r);)

/* The energy of the springs of each lane */
static void store(pma_balance *b, const double *springs)
{
    memset(b->stored, 0, b->parts.lanes * sizeof(double));
    pma_springs_add_energy(b->parts.springs, b->parts.lanes, springs, b->stored);
}

/* The sums begin at this level, the first one whose forces are known. */
static void begin_sums(pma_balance *b, level *at, const double *springs)
{
    memcpy(b->start, at->acting, b->parts.n * sizeof(double));
    multiply(b, &b->parts.M, at->v);
    store(b, springs);
    for (size_t l = 0; l < b->parts.lanes; l++) {
        at->sums[l] = (sums){.size = at->sums[l].size};
        b->judged[l].start = half_square(b, at->v, l);
        b->judged[l].stored = b->stored[l];
    }
}

/* From level j to the next one, which has x and v, with the acceleration w */
static void sum_up_level(pma_balance *b, size_t j, double al1, const double *ut, const double *r,
                         const double *w, const double *springs)
{
    const level *from = level_at(b, j);
    level *to = level_at(b, j + 1);
    const bool known = j > 0 || b->begun;
    if (b->parts.estimates && known)
        add_estimate(b, from, to, al1, ut, r);
    multiply(b, &b->parts.M, w);
    for (size_t i = 0; i < b->parts.n; i++)
        b->inertia[i] = -b->product[i];
    correct_forces(b, known ? from->vs : to->v, to->v, to->x);
    memset(b->excess, 0, b->parts.lanes * sizeof(double));
    pma_springs_subtract_work(b->parts.springs, b->parts.lanes, from->springs, springs, b->excess);
    b->excess[0] += b->bent + work_to_state(b, from, to, ut);
    if (b->parts.lanes == 1)
        sum_up(b, from, to, ut, r);
    else
        (pma_has_avx2() ? sum_up_lanes_avx2 : sum_up_lanes_plain)(b, from, to, ut, r);
    if (!known)
        begin_sums(b, to, springs);
}

/* What the next substep evaluates its forces with: v + h w */
static void add_extrapolated(pma_balance *b, const double *v, const double *w, double *vs)
{
    const size_t n = b->parts.D_r.form == PMA_ZERO ? 0 : b->parts.n;
    for (size_t i = 0; i < n; i++)
        vs[i] += v[i] + b->parts.h * w[i];
}

pma_first_forces *pma_balance_first(pma_balance *b)
{
    return &b->first;
}

void pma_balance_start(pma_balance *b, const pma_state *x)
{
    const size_t n = b->parts.n, bytes = n * sizeof(double);
    const pma_first_forces *first = &b->first;
    level *at = &b->present;
    for (size_t i = 0; i < n; i++)
        at->r[i] = first->once[i] + first->iterated[i];
    pma_springs_add(b->parts.springs, x->springs, at->r);
    memcpy(at->ut, x->u, bytes);
    memcpy(at->u, x->u, bytes);
    memcpy(at->v, x->v, bytes);
    memcpy(at->acting, at->r, bytes);
    memset(at->x, 0, bytes);
    memset(at->vs, 0, bytes);
    add_extrapolated(b, x->v, x->w, at->vs);
    memcpy(at->springs, x->springs, pma_springs_numbers(b->parts.springs) * sizeof(double));
    if (b->parts.iterates)
        memcpy(at->iterated, b->parts.iterates_springs ? at->r : first->iterated, bytes);
    at->bends = b->parts.ptr != NULL;
    if (at->bends) {
        memcpy(at->functions, first->iterated, bytes);
        memcpy(at->stiffness, first->stiffness, (size_t)b->parts.ptr[n] * sizeof(double));
    }
    multiply(b, &b->parts.M, x->w);
    for (size_t i = 0; i < n; i++)
        at->inertia[i] = -b->product[i];
    begin_sums(b, at, x->springs);
    multiply(b, &b->parts.K, x->u);
    for (size_t l = 0; l < b->parts.lanes; l++) {
        judgement *j = &b->judged[l];
        j->largest = j->start;
        j->gain.energy = j->start + half_square(b, x->u, l);
    }
    b->begun = true;
}

void pma_balance_close(pma_balance *b, const pma_substep *step, double al1, const double *v,
                       const double *w, const double *springs)
{
    const size_t n = b->parts.n, j = step->j;
    level *to = level_at(b, j + 1);
    const double *ut = b->opened + (step->number & 1) * 2 * (int64_t)n, *r = ut + n;
    const double share = b->parts.has_responses && !b->parts.corrects ? 0.0 : al1;
    for (size_t i = 0; i < n; i++)
        to->x[i] = share * w[i];
    memcpy(to->v, v, n * sizeof(double));
    to->t = step->t1;
    if (b->parts.has_responses) {
        memcpy(to->ut, ut, n * sizeof(double));
        memcpy(to->r, r, n * sizeof(double));
        memcpy(to->inertia, w, n * sizeof(double)); /* until the link response is known */
    } else {
        sum_up_level(b, j, al1, ut, r, w, springs);
    }
    memcpy(to->springs, springs, pma_springs_numbers(b->parts.springs) * sizeof(double));
    memset(to->vs, 0, n * sizeof(double));
    add_extrapolated(b, v, w, to->vs);
}

void pma_balance_advance_response(pma_balance *b, size_t j, double al1, const pma_state *link)
{
    level *to = level_at(b, j);
    const double share = b->parts.corrects ? 0.0 : al1;
    double *w = to->inertia;
    for (size_t i = 0; i < b->parts.n; i++) {
        to->x[i] += link->u[i] - share * link->w[i];
        to->v[i] += link->v[i];
        w[i] += link->w[i];
    }
    sum_up_level(b, j - 1, al1, to->ut, to->r, w, to->springs);
    if (j == b->parts.substeps) /* the state at the end, not that of the free run */
        add_extrapolated(b, link->v, link->w, to->vs);
}

/* (B9)  What the forces have given beyond what they took, less what the scheme dissipates. The
 * energy of springs can only make it less: it is evaluated where that decides, above `least`. */
static double added(pma_balance *b, const level *at, size_t lane, double least)
{
    const judgement *so_far = &b->judged[lane];
    const sums *now = &at->sums[lane];
    const double passive = fmin(-now->since, -now->work);
    const double lost = now->resultant - (so_far->last - so_far->start);
    const double dissipated = b->parts.is_pushed ? 0.0 : fmax(lost, 0.0);
    if (b->is_passive || passive - dissipated <= least)
        return passive - dissipated;
    if (!b->has_stored)
        store(b, at->springs);
    b->has_stored = true;
    const double path = now->path + (b->stored[lane] - so_far->stored);
    return fmin(passive, path - now->work) - dissipated;
}

/* (B10)  Does the gain exceed what is reported, where the motion is faster than ever before? */
static bool exceeds(pma_balance *b, const level *at, size_t lane)
{
    judgement *so_far = &b->judged[lane];
    pma_gain *gain = &so_far->gain;
    const sums *now = &at->sums[lane];
    const double kinetic = so_far->last;
    if (!isfinite(kinetic) || kinetic < (1.0 - EQUAL) * so_far->largest)
        return so_far->exceeds;
    so_far->largest = fmax(so_far->largest, kinetic);
    const double least = fmax(fmax(SHARE * now->gross, ROUNDING * now->size), gain->added);
    const double energy = added(b, at, lane, least);
    if (energy > least)
        gain->added = energy;
    if (!(gain->added > REPORTED * kinetic))
        return false;
    multiply(b, &b->parts.K, at->u);
    gain->energy = fmax(gain->energy, kinetic + half_square(b, at->u, lane));
    return gain->added > REPORTED * gain->energy;
}

static void judge(pma_balance *b, const level *at, size_t lane)
{
    judgement *so_far = &b->judged[lane];
    const bool before = so_far->exceeds;
    so_far->first = so_far->first > 0.0 ? so_far->first : so_far->last;
    so_far->exceeds = exceeds(b, at, lane);
    if (!before)
        so_far->since = at->t;
    else if (so_far->exceeds && !(so_far->gain.t > 0.0))
        so_far->gain.t = so_far->since;
}

void pma_balance_commit(pma_balance *b)
{
    level *last = level_at(b, b->parts.substeps);
    multiply(b, &b->parts.M, last->v);
    if (b->parts.lanes == 1)
        b->judged->last = half_square(b, last->v, 0);
    else
        half_squares(b, last->v);
    b->has_stored = false;
    for (size_t l = 0; l < b->parts.lanes; l++)
        judge(b, last, l);
    const level before = b->present;
    b->present = *last;
    *last = before;
    b->begun = true;
}

pma_gain pma_balance_gain(const pma_balance *b)
{
    pma_gain most = {0};
    for (size_t l = 0; l < b->parts.lanes; l++) {
        const pma_gain own = b->judged[l].gain;
        if (b->judged[l].exceeds && own.t > 0.0 &&
            own.added * most.energy >= most.added * own.energy)
            most = own;
    }
    return most;
}

double pma_balance_added_mass(const pma_balance *b)
{
    const sums *now = b->present.sums;
    return now->inertia > 0.0 ? now->excess / now->inertia : 0.0;
}

bool pma_balance_is_broken(const pma_balance *b)
{
    for (size_t l = 0; l < b->parts.lanes; l++) {
        const judgement *x = &b->judged[l];
        if (x->last > BROKEN * x->first)
            return true;
    }
    return false;
}
