#include "observe/balance.h"

#include <assert.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "algebra/lanes.h"
#include "memory.h"
#include "object.h"
#include "observe/passage.h"
#include "observe/ring.h"

#define INLINE __attribute__((always_inline)) static inline

/* Of the largest energy of the motion, from which on what was added is reported; of all work, below
 * which it is an error of the steps that does not grow; of sum |r| |u|, below which it is
 * rounding; of a kinetic energy, below which it is no larger than the last one. */
#define REPORTED 0.1
#define SHARE 0.01
#define ROUNDING 1e-9
#define EQUAL 1e-9

/* Macro time levels in turn at which forces are stiffer than the step allows, and by how much the
 * kinetic energy grows over them, from which on that is reported: noise does so once or twice. */
enum { LEVELS_OF_STIFF = 3 };
#define GROWTH_OF_STIFF 10.0

/* Stiffness over that at the first of these levels from which on it grows with the motion. */
#define HARDENS 4.0

/* From this multiple of the first kinetic energy on there is no motion any more. */
#define BROKEN 1e200

/* Up to a time level: the work along the path of functions that are iterated, that of what acts,
 * and that of what has come to act since the start; the work of the resultant; the sum of the sizes
 * of the works, and the largest force times displacement; of (B13) the numerator and the
 * denominator. What springs take along their path is what they store, and what they keep. */
typedef struct {
    double path, work, since, resultant, gross, size, excess, inertia;
    double kinetic;       /* twice the energy there, where matrices are diagonal */
    double start, stored; /* kinetic energy where the sums begin, and that of the springs */
} sums;

/* At a time level: the forces as they act, M w and the displacement. Where what follows is used:
 * where forces were evaluated and what they were, how far from there the state is, velocity, the
 * extrapolated one, and what springs remember. */
typedef struct {
    double *ut, *r, *x, *u, *acting, *inertia, *v, *vs, *springs; /* u to inertia: a passage */
    double *iterated;              /* the forces that are evaluated at the state, */
    double *functions, *stiffness; /* ... and of functions among them */
    bool bends;                    /* the stiffness is known */
    bool is_known;                 /* ... and the forces, since the sums begin */
    double t;
    sums *sums; /* of each lane */
} level;

enum { ARRAYS = 8 }; /* of n numbers in a level */

/* What macro time levels so far have shown, of a lane. */
typedef struct {
    double first, largest; /* kinetic energy: the first one that is not zero, the largest one, */
    double last;           /* ... and the last one */
    size_t stiff_levels;   /* in turn, at which forces were stiffer than the step allows, */
    double stiff_first;    /* ... and the kinetic energy at the first of them, */
    double stiff_since;    /* ... its time, and what was found there */
    pma_excess first_excess;
    pma_stiff stiff;
    double since;  /* the time from which on the gain has exceeded what is reported */
    bool exceeds;  /* ... as it does now */
    pma_gain gain; /* t > 0: it did so at two macro levels */
} judgement;

/* Substeps whose evaluations are kept: two that are open, and those from which they go on. */
enum { OPENED = 4 };

struct pma_balance {
    pma_balance_parts parts;
    level *levels;
    pma_ring ring;    /* of them */
    bool is_diagonal; /* M and K_r are, and nothing else corrects the forces */
    double *opened;   /* of the last substeps ut and r, and what else functions are shown */
    int64_t opened_number[OPENED]; /* those substeps */
    pma_substep closed;            /* the last one */
    pma_stiffness stiffness;
    bool measures;             /* some forces are evaluated once */
    bool keeps;                /* what is opened, in the time level: summed or completed later */
    double *product, *scratch; /* n each */
    double *differences;       /* 3 n */
    double *w;                 /* n: at the end of a substep, of which it is found later */
    double *start;             /* n: what acts at the time level at which the sums begin; */
                               /* ... after it the diagonals of K_r and M, if is_diagonal */
    pma_first_forces first;    /* at the next start */
    double *stored;            /* energy of the springs of each lane */
    double bent;               /* (B12) of a substep */
    bool has_stored;           /* the energy is that of the level that is judged */
    bool is_broken;            /* it is no motion any more */
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
                   .u = x + 3 * p->n,
                   .acting = x + 4 * p->n,
                   .inertia = x + 5 * p->n,
                   .v = x + 6 * p->n,
                   .vs = x + 7 * p->n,
                   .springs = springs,
                   .iterated = iterated,
                   .functions = functions,
                   .stiffness = functions + p->n,
                   .sums = b->sums + number * p->lanes};
}

/* Springs alone need no sum, and of functions that are evaluated once the path is not known. */
static bool sums_path(const pma_balance_parts *p)
{
    return p->ptr && !p->is_passive;
}

static bool is_diagonal(const pma_balance_parts *p)
{
    return p->lanes == 1 && !p->has_responses && p->M.form == PMA_DIAGONAL &&
           (p->K_r.form == PMA_ZERO || p->K_r.form == PMA_DIAGONAL) && p->D_r.form == PMA_ZERO;
}

/* Numbers of a substep that is opened. */
static size_t opened_size(const pma_balance_parts *p)
{
    return (p->has_functions ? 4 : 2) * p->n;
}

pma_status pma_balance_create(const pma_balance_parts *parts, pma_balance **out)
{
    const size_t n = parts->n, lanes = parts->lanes;
    const size_t entries = parts->ptr ? (size_t)parts->ptr[n] : 0;
    const pma_ring ring = pma_ring_of(parts->substeps, parts->doubled, parts->has_responses);
    const size_t levels = ring.kept + 2, used = parts->doubled ? levels : levels - 1;
    const pma_array arrays[] = {
        PMA_ARRAY(pma_balance, levels, levels),
        PMA_ARRAY(pma_balance, ring.at, levels),
        PMA_ARRAY(pma_balance, judged, lanes),
        PMA_ARRAY(pma_balance, sums, levels * lanes),
        PMA_ARRAY(pma_balance, opened, OPENED * opened_size(parts)),
        PMA_ARRAY(pma_balance, product, n),
        PMA_ARRAY(pma_balance, scratch, n),
        PMA_ARRAY(pma_balance, differences, 3 * n),
        PMA_ARRAY(pma_balance, w, parts->has_responses ? n : 0),
        PMA_ARRAY(pma_balance, start, 3 * n),
        PMA_ARRAY(pma_balance, first.once, n),
        PMA_ARRAY(pma_balance, first.iterated, n),
        PMA_ARRAY(pma_balance, first.stiffness, entries),
        PMA_ARRAY(pma_balance, stored, lanes),
        {offsetof(pma_balance, numbers), used, level_size(parts) * sizeof(double)},
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
    b->keeps = sums_path(parts) || parts->estimates || parts->has_responses;
    b->measures = parts->has_functions || !parts->iterates;
    b->is_diagonal = is_diagonal(parts);
    for (size_t i = 0; i < n && b->is_diagonal; i++) {
        b->start[n + i] = parts->K_r.form == PMA_DIAGONAL ? parts->K_r.values[i] : 0.0;
        b->start[2 * n + i] = parts->M.values[i];
    }
    for (size_t k = 0; k < used; k++)
        b->levels[k] = take_level(b, k);
    pma_ring_fill(&b->ring, &ring, b->levels, sizeof *b->levels);
    b->stiffness = (pma_stiffness){.n = n,
                                   .lanes = lanes,
                                   .is_explicit = parts->is_explicit,
                                   .M = parts->M,
                                   .K = parts->K,
                                   .K_r = parts->K_r,
                                   .D_r = parts->D_r};
    *out = b;
    return PMA_OK;
}

void pma_balance_destroy(pma_balance *b)
{
    pma_memory_release(b);
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

/* fmax and fmin are calls */
INLINE double larger(double a, double b)
{
    return b > a ? b : a;
}

INLINE double smaller(double a, double b)
{
    return b < a ? b : a;
}

/* x . A x / 2 of a lane, with that product */
static double half_square(const pma_balance *b, const double *x, size_t lane)
{
    return -0.5 * pma_dot(b->parts.n, b->parts.lanes, lane, x, b->product);
}

void pma_balance_begin(pma_balance *b)
{
    level *present = pma_ring_at(&b->ring, 0), *before = pma_ring_before(&b->ring, 0);
    present->is_known = before->is_known = false;
    for (size_t k = 0; k < OPENED; k++)
        b->opened_number[k] = PMA_NO_SUBSTEP;
    b->closed.number = PMA_NO_SUBSTEP;
    b->is_passive = b->parts.is_passive;
    b->is_broken = false;
    for (size_t l = 0; l < b->parts.lanes; l++) {
        present->sums[l] = (sums){0};
        b->judged[l] = (judgement){0};
    }
}

static size_t slot_of_number(int64_t number)
{
    return (size_t)number % OPENED;
}

static double *opened_at(const pma_balance *b, int64_t number)
{
    return b->opened + slot_of_number(number) * opened_size(&b->parts);
}

pma_evaluated_forces pma_balance_open(pma_balance *b, int64_t number, const double *ut)
{
    assert(number >= 0);
    const size_t n = b->parts.n;
    double *opened = opened_at(b, number);
    memcpy(opened, ut, n * sizeof(double));
    b->opened_number[slot_of_number(number)] = number;
    return (pma_evaluated_forces){.r = opened + n,
                                  .total = b->parts.has_functions ? opened + 2 * n : NULL,
                                  .vs = b->parts.has_rates ? opened + 3 * n : NULL};
}

/* The time level from which the sums go on to the end of a substep                         (B3) */
static const level *origin_of(const pma_balance *b, size_t j, bool twice)
{
    const level *before = twice ? pma_ring_before(&b->ring, j) : NULL;
    return before && before->is_known ? before : pma_ring_at(&b->ring, j);
}

static const pma_step_limits *limits_of(const pma_balance *b, bool twice)
{
    return twice ? &b->parts.twice : &b->parts.single;
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
    assert(b->parts.ptr);
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
    assert(b->parts.iterates);
    level *to = pma_ring_at(&b->ring, step->j + 1);
    memcpy(to->iterated, r, b->parts.n * sizeof(double));
}

void pma_balance_bend(pma_balance *b, const pma_substep *step, const double *u, const double *f,
                      const double *K)
{
    const level *from = origin_of(b, step->j, step->twice);
    level *to = pma_ring_at(&b->ring, step->j + 1);
    b->bent = 0.0;
    if (K && from->bends && from->is_known) {
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

/* (B13)  al1 dut . (K_r dut - dr) and dut . M dut from one level to the next, of one lane */
static void add_estimate(pma_balance *b, const level *from, level *to, double al1)
{
    double *dut = b->scratch, held = 0.0;
    for (size_t i = 0; i < b->parts.n; i++) {
        dut[i] = to->ut[i] - from->ut[i];
        held += dut[i] * (to->r[i] - from->r[i]);
    }
    multiply(b, &b->parts.K_r, dut);
    const double estimate = 2.0 * half_square(b, dut, 0);
    multiply(b, &b->parts.M, dut);
    to->sums->excess = from->sums->excess + al1 * (estimate - held);
    to->sums->inertia = from->sums->inertia + 2.0 * half_square(b, dut, 0);
}

/* (B8) of a lane */
INLINE void sum_up(const sums *before, const double *terms, size_t lanes, double path, sums *now)
{
    const double work = terms[PMA_PASSAGE_WORK * lanes],
                 since = work - terms[PMA_PASSAGE_START * lanes];
    now->path = before->path + path;
    now->work = before->work + work;
    now->since = before->since + since;
    now->resultant = before->resultant + terms[PMA_PASSAGE_RESULTANT * lanes];
    now->gross = before->gross + fabs(since);
    now->size = larger(before->size, terms[PMA_PASSAGE_SIZE * lanes]);
    now->kinetic = terms[PMA_PASSAGE_KINETIC * lanes];
    now->start = before->start;
    now->stored = before->stored;
}

/* Along the path of functions that are iterated, without what springs take there. The work of
 * forces that are iterated is that on the path of u, not of ut. */
static double work_of_path(const pma_balance *b, const level *from, const level *to,
                           const double *u)
{
    double sum = b->bent;
    for (size_t i = 0; i < b->parts.n; i++) {
        const double dut = to->ut[i] - from->ut[i];
        sum += 0.5 * (from->r[i] + to->r[i]) * dut;
        sum += 0.5 * (from->iterated[i] + to->iterated[i]) * (u[i] - from->u[i] - dut);
    }
    pma_springs_subtract_work(b->parts.springs, 1, from->springs, to->springs, &sum);
    return sum;
}

/* The energy of the springs of each lane */
static void store(pma_balance *b, const double *springs)
{
    memset(b->stored, 0, b->parts.lanes * sizeof(double));
    pma_springs_add_energy(b->parts.springs, b->parts.lanes, springs, b->stored);
}

/* The sums begin at this level, the first one whose forces are known. */
static void begin_sums(pma_balance *b, level *at, const double *v, const double *springs)
{
    memcpy(b->start, at->acting, b->parts.n * sizeof(double));
    multiply(b, &b->parts.M, v);
    store(b, springs);
    for (size_t l = 0; l < b->parts.lanes; l++) {
        at->sums[l] = (sums){.size = at->sums[l].size,
                             .kinetic = at->sums[l].kinetic,
                             .start = half_square(b, v, l),
                             .stored = b->stored[l]};
    }
}

/* What acts and the resultant where matrices are not diagonal, in the level at the end, which has
 * x = u - ut */
static void find_forces(pma_balance *b, const double *vs, level *to, const pma_passage *p)
{
    pma_matrix_multiply(&b->parts.M, p->w, to->inertia);
    correct_forces(b, vs, p->v, to->x);
    for (size_t i = 0; i < b->parts.n; i++)
        to->acting[i] = p->r[i] - b->product[i];
}

/* To level j + 1, where the substep ends with u, v, w; it has evaluated the forces r. */
static void come_to(pma_balance *b, size_t j, bool twice, const double *r, const pma_state *x)
{
    const size_t lanes = b->parts.lanes;
    const double al1 = limits_of(b, twice)->al1;
    const level *from = origin_of(b, j, twice);
    const bool known = from->is_known;
    level *to = pma_ring_at(&b->ring, j + 1);
    const pma_passage p = {.from = from->u,
                           .to = to->u,
                           .u = x->u,
                           .v = x->v,
                           .w = x->w,
                           .r = r,
                           .fixed = b->start,
                           .is_diagonal = b->is_diagonal,
                           .al1 = al1};
    double terms[PMA_PASSAGE_TERMS * PMA_LANES], path = 0.0;
    if (b->parts.estimates && known)
        add_estimate(b, from, to, al1);
    if (sums_path(&b->parts) && known)
        path = work_of_path(b, from, to, x->u);
    if (!b->is_diagonal)
        find_forces(b, known ? from->vs : x->v, to, &p);
    pma_passage_sum(b->parts.n, lanes, &p, terms);
    if (lanes == 1)
        sum_up(from->sums, terms, 1, path, to->sums);
    for (size_t l = 0; l < lanes && lanes > 1; l++)
        sum_up(&from->sums[l], terms + l, lanes, path, &to->sums[l]);
    if (!known)
        begin_sums(b, to, x->v, x->springs);
    to->is_known = true;
}

/* What the next substep evaluates its forces with, of which D_r is one: v + h w */
static void extrapolate(pma_balance *b, const double *v, const double *w, double *vs)
{
    for (size_t i = 0; i < b->parts.n && b->parts.D_r.form != PMA_ZERO; i++)
        vs[i] = v[i] + b->parts.single.h * w[i];
}

pma_first_forces *pma_balance_first(pma_balance *b)
{
    return &b->first;
}

void pma_balance_start(pma_balance *b, const pma_state *x)
{
    const size_t n = b->parts.n, bytes = n * sizeof(double);
    const pma_first_forces *first = &b->first;
    level *at = pma_ring_at(&b->ring, 0);
    for (size_t i = 0; i < n; i++)
        at->r[i] = first->once[i] + first->iterated[i];
    pma_springs_add(b->parts.springs, x->springs, at->r);
    memcpy(at->ut, x->u, bytes);
    memcpy(at->u, x->u, bytes);
    memcpy(at->acting, at->r, bytes);
    extrapolate(b, x->v, x->w, at->vs);
    memcpy(at->springs, x->springs, pma_springs_numbers(b->parts.springs) * sizeof(double));
    if (b->parts.iterates)
        memcpy(at->iterated, b->parts.iterates_springs ? at->r : first->iterated, bytes);
    at->bends = b->parts.ptr != NULL;
    if (at->bends) {
        memcpy(at->functions, first->iterated, bytes);
        memcpy(at->stiffness, first->stiffness, (size_t)b->parts.ptr[n] * sizeof(double));
    }
    pma_matrix_multiply(&b->parts.M, x->w, at->inertia);
    begin_sums(b, at, x->v, x->springs);
    multiply(b, &b->parts.K, x->u);
    for (size_t l = 0; l < b->parts.lanes; l++) {
        judgement *j = &b->judged[l];
        j->largest = at->sums[l].start;
        j->gain.energy = at->sums[l].start + half_square(b, x->u, l);
    }
    at->is_known = true;
}

void pma_balance_close(pma_balance *b, const pma_substep *step, const pma_state *x)
{
    const size_t n = b->parts.n, bytes = n * sizeof(double), j = step->j;
    const double al1 = limits_of(b, step->twice)->al1;
    level *to = pma_ring_at(&b->ring, j + 1);
    const double *ut = opened_at(b, step->number), *r = ut + n;
    to->t = step->t1;
    b->closed = *step;
    if (b->keeps) {
        memcpy(to->ut, ut, bytes);
        memcpy(to->r, r, bytes);
        memcpy(to->springs, x->springs, pma_springs_numbers(b->parts.springs) * sizeof(double));
    }
    if (b->is_diagonal) {
        come_to(b, j, step->twice, r, x);
        return;
    }
    const double share = b->parts.has_responses && !b->parts.corrects ? 0.0 : al1;
    for (size_t i = 0; i < n; i++)
        to->x[i] = share * x->w[i];
    if (b->parts.has_responses) { /* until the link response is known */
        memcpy(to->v, x->v, bytes);
        memcpy(to->inertia, x->w, bytes);
    } else {
        come_to(b, j, step->twice, r, x);
    }
    extrapolate(b, x->v, x->w, to->vs);
}

void pma_balance_advance_response(pma_balance *b, size_t j, bool twice, const pma_state *link)
{
    assert(j >= 1 && b->parts.has_responses);
    level *to = pma_ring_at(&b->ring, j);
    const double share = b->parts.corrects ? 0.0 : limits_of(b, twice)->al1;
    double *w = b->w;
    for (size_t i = 0; i < b->parts.n; i++) {
        to->x[i] += link->u[i] - share * link->w[i];
        to->v[i] += link->v[i];
        w[i] = to->inertia[i] + link->w[i];
        to->u[i] = to->ut[i] + to->x[i];
    }
    const pma_state x = {.u = to->u, .v = to->v, .w = w, .springs = to->springs};
    come_to(b, j - 1, twice, to->r, &x);
    if (j == b->parts.substeps) /* the state at the end, not that of the free run */
        extrapolate(b, to->v, w, to->vs);
}

/* (B9)  What the forces have given beyond what they took, less what the scheme dissipates. The
 * energy of springs can only make it less: it is evaluated where that decides, above `least`. */
static double added(pma_balance *b, const level *at, const double *springs, size_t lane,
                    double least)
{
    const sums *now = &at->sums[lane];
    const double given = b->is_passive ? smaller(-now->since, -now->work) : -now->work;
    const double lost = now->resultant - (b->judged[lane].last - now->start);
    const double dissipated = b->parts.is_pushed ? 0.0 : larger(lost, 0.0);
    if (b->is_passive || given - dissipated <= least)
        return given - dissipated;
    if (!b->has_stored)
        store(b, springs);
    b->has_stored = true;
    const double path = now->path + (b->stored[lane] - now->stored);
    return smaller(given, path - now->work) - dissipated;
}

/* (B10)  Does the gain exceed what is reported, where the motion is faster than ever before? */
static bool exceeds(pma_balance *b, const level *at, const double *springs, size_t lane)
{
    judgement *so_far = &b->judged[lane];
    pma_gain *gain = &so_far->gain;
    const sums *now = &at->sums[lane];
    const double kinetic = so_far->last;
    if (!isfinite(kinetic) || kinetic < (1.0 - EQUAL) * so_far->largest)
        return so_far->exceeds;
    so_far->largest = larger(so_far->largest, kinetic);
    const double least = larger(larger(SHARE * now->gross, ROUNDING * now->size), gain->added);
    const double energy = added(b, at, springs, lane, least);
    if (energy > least)
        gain->added = energy;
    if (!(gain->added > REPORTED * kinetic))
        return false;
    multiply(b, &b->parts.K, at->u);
    gain->energy = larger(gain->energy, kinetic + half_square(b, at->u, lane));
    return gain->added > REPORTED * gain->energy;
}

/* ---- forces that are too stiff --------------------------------------------------------------- */

/* What was evaluated once in a substep */
static pma_evaluation_at evaluation_of(const pma_balance *b, int64_t number)
{
    const size_t n = b->parts.n;
    const double *opened = opened_at(b, number);
    const bool functions = b->parts.has_functions;
    return (pma_evaluation_at){.ut = opened,
                               .total = functions ? opened + 2 * n : opened + n,
                               .vs = b->parts.has_rates ? opened + 3 * n : NULL};
}

/* (B15)  In the last substep, if it and that from which it goes on are known */
static pma_excess excess_of(pma_balance *b, size_t lane)
{
    const int64_t number = b->closed.number;
    const int64_t origin = number - (b->closed.twice ? 2 : 1);
    if (number == PMA_NO_SUBSTEP || b->opened_number[slot_of_number(origin)] != origin)
        return (pma_excess){.displacement = 0.0};
    const pma_evaluation_at from = evaluation_of(b, origin), to = evaluation_of(b, number);
    return pma_stiffness_excess(&b->stiffness, limits_of(b, b->closed.twice), &from, &to, lane,
                                b->differences);
}

/* Where the motion is faster than ever before */
static void judge_stiffness(pma_balance *b, const level *at, size_t lane)
{
    judgement *so_far = &b->judged[lane];
    const double kinetic = so_far->last;
    if (!b->measures || so_far->stiff.t > 0.0 || !(kinetic > 0.0) || !isfinite(kinetic) ||
        kinetic < (1.0 - EQUAL) * so_far->largest)
        return;
    const pma_excess excess = excess_of(b, lane);
    if (!(excess.displacement > 1.0)) {
        so_far->stiff_levels = 0;
        return;
    }
    if (so_far->stiff_levels++ == 0) {
        so_far->stiff_first = kinetic;
        so_far->stiff_since = at->t;
        so_far->first_excess = excess;
    }
    if (so_far->stiff_levels < LEVELS_OF_STIFF || kinetic <= GROWTH_OF_STIFF * so_far->stiff_first)
        return;
    const double hardens = HARDENS * so_far->first_excess.displacement;
    so_far->stiff =
        (pma_stiff){.excess = excess.displacement > hardens ? so_far->first_excess : excess,
                    .h = limits_of(b, b->closed.twice)->h,
                    .t = so_far->stiff_since};
}

static void judge(pma_balance *b, const level *at, const double *springs, size_t lane)
{
    judgement *so_far = &b->judged[lane];
    const bool before = so_far->exceeds;
    so_far->first = so_far->first > 0.0 ? so_far->first : so_far->last;
    judge_stiffness(b, at, lane);
    so_far->exceeds = exceeds(b, at, springs, lane);
    b->is_broken = b->is_broken || so_far->last > BROKEN * so_far->first;
    if (!before)
        so_far->since = at->t;
    else if (so_far->exceeds && !(so_far->gain.t > 0.0))
        so_far->gain.t = so_far->since;
}

void pma_balance_commit(pma_balance *b, const pma_state *x)
{
    const level *last = pma_ring_at(&b->ring, b->parts.substeps);
    if (!b->is_diagonal)
        multiply(b, &b->parts.M, x->v);
    for (size_t l = 0; l < b->parts.lanes; l++)
        b->judged[l].last = b->is_diagonal ? 0.5 * last->sums[l].kinetic : half_square(b, x->v, l);
    b->has_stored = false;
    for (size_t l = 0; l < b->parts.lanes; l++)
        judge(b, last, x->springs, l);
    pma_ring_commit(&b->ring);
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

pma_stiff pma_balance_stiff(const pma_balance *b)
{
    pma_stiff most = {.t = 0.0};
    for (size_t l = 0; l < b->parts.lanes; l++) {
        const pma_stiff own = b->judged[l].stiff;
        if (own.t > 0.0 && own.excess.displacement >= most.excess.displacement)
            most = own;
    }
    return most;
}

double pma_balance_added_mass(const pma_balance *b)
{
    const level *present = pma_ring_at(&b->ring, 0);
    const sums *now = present->sums;
    return now->inertia > 0.0 ? now->excess / now->inertia : 0.0;
}

bool pma_balance_is_broken(const pma_balance *b)
{
    return b->is_broken;
}
