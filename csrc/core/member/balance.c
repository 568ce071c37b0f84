#include "member/balance.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "object.h"

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

/* Up to a time level: the work of the forces and the energy added so far, and the sum of their
 * sizes; the work from the predictor to the state; that of the forces at the start. */
typedef struct {
    double work, added, gross, size, rest, start;
} sums;

/* Contact: the stiffness rises by this factor between two increments, and the work of the rise is
 * this multiple of the largest energy so far; friction and noise are below. Friction that turns
 * around has less than this part of the work.                                             (B11) */
#define CLOSES 10.0
#define IMPACT 4.0
#define TURNS 0.25

/* A later contact is taken where it is stiffer by this factor. */
#define STIFFER 4.0

/* Forces alternate: over this number of steps each change opposes the one before by more than this
 * part, and is this part of the largest force so far; noise is below.                     (B13) */
enum { ALTERNATIONS = 12 };
#define OPPOSED 0.5
#define LARGE 0.5

/* At a time level: where forces were evaluated and what they were, how far from there the state is,
 * the forces as they act, the velocity, the extrapolated one, and what springs remember. */
typedef struct {
    double *ut, *r, *x, *acting, *v, *vs, *springs;
    double *functions, *stiffness; /* of those that are iterated */
    bool bends;                    /* the stiffness is known */
    sums *sums;                    /* of each lane */
} level;

enum { ARRAYS = 6 }; /* of n numbers in a level */

/* What macro time levels so far have shown, of a lane. */
typedef struct {
    double least_work, least_added;
    double motion; /* largest energy without what was added */
    double gains[LASTS];
    double gain;
} judgement;

struct pma_balance {
    pma_balance_parts parts;
    level present;
    level *work; /* time level j > 0 in work[(j - 1) % kept] */
    size_t kept;
    double *opened;            /* 2 x 2 n: ut and r of substeps that are open */
    double *product, *scratch; /* n each */
    double *excess;            /* of the springs of each lane, in a substep, */
    double bent;               /* ... and of functions */
    bool begun;                /* the present is known */
    judgement *judged;         /* of each lane */
    double seen;               /* stiffness of the last increment */
    pma_impact impact;
    double *change; /* n: of the forces in the last step, */
    double largest; /* ... the square of the largest ones so far, */
    int turns;      /* ... and the steps in which they alternated */
    double alternates;
    double *numbers; /* of all levels, */
    sums *sums;      /* ... and their sums */
};

/* All arrays of a level but the sums, with force and stiffness of functions that are iterated. */
static size_t level_size(const pma_balance_parts *p)
{
    const size_t functions = p->ptr ? p->n + (size_t)p->ptr[p->n] : 0;
    return ARRAYS * p->n + pma_springs_numbers(p->springs) + functions;
}

static level take_level(const pma_balance *b, size_t number)
{
    const pma_balance_parts *p = &b->parts;
    double *x = b->numbers + number * level_size(p);
    double *springs = x + ARRAYS * p->n, *functions = springs + pma_springs_numbers(p->springs);
    return (level){.ut = x,
                   .r = x + p->n,
                   .x = x + 2 * p->n,
                   .acting = x + 3 * p->n,
                   .v = x + 4 * p->n,
                   .vs = x + 5 * p->n,
                   .springs = springs,
                   .functions = functions,
                   .stiffness = functions + p->n,
                   .sums = b->sums + number * p->lanes};
}

pma_status pma_balance_create(const pma_balance_parts *parts, pma_balance **out)
{
    const size_t n = parts->n, lanes = parts->lanes;
    const size_t kept = parts->has_responses ? parts->substeps : 1;
    const pma_array arrays[] = {
        PMA_ARRAY(pma_balance, work, kept),
        PMA_ARRAY(pma_balance, judged, lanes),
        PMA_ARRAY(pma_balance, sums, (kept + 1) * lanes),
        PMA_ARRAY(pma_balance, opened, 4 * n),
        PMA_ARRAY(pma_balance, product, n),
        PMA_ARRAY(pma_balance, scratch, n),
        PMA_ARRAY(pma_balance, change, n),
        PMA_ARRAY(pma_balance, excess, lanes),
        {offsetof(pma_balance, numbers), kept + 1, level_size(parts) * sizeof(double)},
        {0}};
    *out = NULL;
    if (parts->M.n != n || (parts->K_r.form != PMA_ZERO && parts->K_r.n != n))
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

/* product := - M v */
static void multiply_mass(pma_balance *b, const double *v)
{
    memset(b->product, 0, b->parts.n * sizeof(double));
    pma_matrix_subtract(&b->parts.M, v, b->product);
}

/* v . M v / 2 of a lane, with that product */
static double kinetic(const pma_balance *b, const double *v, size_t lane)
{
    double sum = 0.0;
    for (size_t i = lane; i < b->parts.n; i += b->parts.lanes)
        sum -= v[i] * b->product[i];
    return 0.5 * sum;
}

void pma_balance_begin(pma_balance *b, const double *v)
{
    b->begun = false;
    b->seen = INFINITY;
    b->impact = (pma_impact){0};
    b->largest = b->alternates = 0.0;
    b->turns = 0;
    memset(b->change, 0, b->parts.n * sizeof(double));
    multiply_mass(b, v);
    for (size_t l = 0; l < b->parts.lanes; l++) {
        b->present.sums[l] = (sums){0};
        b->judged[l] = (judgement){.motion = kinetic(b, v, l)};
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

/* (B8)  s (r + r_a) . w / 2 with s from 0, where K_r has changed little of `whole` r . w, to 1
 * where it has taken back half of it: `taken` (r - r_a) . w */
static double rest_of(double whole, double taken)
{
    if (whole == 0.0)
        return 0.0;
    const double share = fmin(fmax(2.0 * taken / whole, 0.0), 1.0);
    return share * (whole - 0.5 * taken);
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

/* (B12)  The work of du . f beyond the mean of its ends, `change` apart, if its slope is k0 up to
 * the share s of the path and k1 from there on */
static double work_of_bend(double change, double k0, double k1)
{
    const double s = fmin(fmax((k1 - change) / (k1 - k0), 0.0), 1.0);
    const double work = 0.5 * (k0 - k1) * s * (1.0 - s);
    return isfinite(work) ? work : 0.0;
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
            du[i] = u[i] - from->ut[i];
            change += du[i] * (f[i] - from->functions[i]);
        }
        b->bent = work_of_bend(change, bending(b, from->stiffness, du), bending(b, K, du));
    }
    memcpy(to->functions, f, b->parts.n * sizeof(double));
    to->bends = K != NULL;
    if (K)
        memcpy(to->stiffness, K, (size_t)b->parts.ptr[b->parts.n] * sizeof(double));
}

/* (B8), (B9) of a lane, from one level to the next, whose x is known; they may be the same */
static void sum_up(pma_balance *b, bool known, const level *from, level *to, const double *ut,
                   const double *r, const double *v, size_t lane)
{
    double path = 0.0, seen = 0.0, size = 0.0, whole = 0.0, taken = 0.0, jump = 0.0;
    for (size_t i = lane; i < b->parts.n; i += b->parts.lanes) {
        const double acting = r[i] - b->product[i];
        path += (from->r[i] + r[i]) * (ut[i] - from->ut[i]);
        jump += (r[i] - from->r[i]) * (ut[i] - from->ut[i]);
        seen += (from->acting[i] + acting) * (from->v[i] + v[i]);
        size += fabs(r[i] * ut[i]);
        whole += r[i] * to->x[i];
        taken += (r[i] - acting) * to->x[i];
        to->ut[i] = ut[i];
        to->r[i] = r[i];
        to->acting[i] = acting;
        to->v[i] = v[i];
    }
    const sums before = from->sums[lane];
    sums *now = &to->sums[lane];
    now->rest = rest_of(whole, taken);
    if (b->parts.jumps && from == &b->present) /* the work of functions is not known better */
        path -= fabs(jump);
    path = 0.5 * path + b->excess[lane] + now->rest - before.rest;
    seen *= 0.25 * b->parts.h;
    now->work = before.work + (known ? path : 0.0);
    now->added = before.added + (known ? path - seen : 0.0);
    now->gross = before.gross + (known ? fabs(path) + fabs(seen) : 0.0);
    now->size = fmax(before.size, size);
    /* the forces that there are at the start have done work before it */
    now->start = known ? before.start : 0.5 * size;
}

/* From level j to the next one */
static void sum_up_lanes(pma_balance *b, size_t j, const double *ut, const double *r,
                         const double *v, const double *springs)
{
    const level *from = level_at(b, j);
    level *to = level_at(b, j + 1);
    memset(b->excess, 0, b->parts.lanes * sizeof(double));
    pma_springs_add_excess(b->parts.springs, b->parts.lanes, from->springs, springs, b->excess);
    b->excess[0] += b->bent;
    for (size_t l = 0; l < b->parts.lanes; l++)
        sum_up(b, j > 0 || b->begun, from, to, ut, r, v, l);
}

/* (B11)  Does the increment from a level to (ut, r) close a contact? */
static void look_for_contact(pma_balance *b, const level *from, const double *ut, const double *r,
                             double t)
{
    double *du = b->scratch, work = 0.0, back = 0.0;
    for (size_t i = 0; i < b->parts.n; i++) {
        du[i] = ut[i] - from->ut[i];
        work += du[i] * (r[i] - from->r[i]);
        back += du[i] * from->r[i];
    }
    if (back < -TURNS * work)
        return;
    const double mass = pma_matrix_square(&b->parts.M, du, b->product), before = fabs(b->seen);
    b->seen = mass > 0.0 ? work / mass : 0.0;
    if (!(b->seen > CLOSES * before && work > IMPACT * b->judged[0].motion) ||
        !(b->seen > STIFFER * b->impact.square))
        return;
    const bool known = b->parts.K_r.form != PMA_ZERO;
    const double estimated = known ? pma_matrix_square(&b->parts.K_r, du, b->product) / work : 0.0;
    b->impact = (pma_impact){.square = b->seen, .share = estimated, .t = t};
}

/* (B13)  Do the forces r, evaluated with the velocity vs, alternate with it? */
static void look_for_alternation(pma_balance *b, const level *from, const double *r, double t)
{
    double turn = 0.0, before = 0.0, square = 0.0, power = 0.0, size = 0.0;
    for (size_t i = 0; i < b->parts.n; i++) {
        const double change = r[i] - from->r[i];
        turn += change * b->change[i];
        before += b->change[i] * b->change[i];
        square += change * change;
        power += r[i] * from->vs[i];
        size += r[i] * r[i];
        b->change[i] = change;
    }
    b->largest = fmax(b->largest, size);
    const bool opposed = turn < -OPPOSED * sqrt(square) * sqrt(before);
    b->turns = opposed && power > 0.0 && square > LARGE * LARGE * b->largest ? b->turns + 1 : 0;
    if (b->turns == ALTERNATIONS && b->alternates == 0.0)
        b->alternates = t;
}

/* What the next substep evaluates its forces with: v + h w */
static void add_extrapolated(pma_balance *b, const double *v, const double *w, double *vs)
{
    for (size_t i = 0; i < b->parts.n; i++)
        vs[i] += v[i] + b->parts.h * w[i];
}

void pma_balance_close(pma_balance *b, const pma_substep *step, double al1, const double *v,
                       const double *w, const double *springs)
{
    const size_t n = b->parts.n, j = step->j;
    level *to = level_at(b, j + 1);
    const double *ut = b->opened + (step->number & 1) * 2 * (int64_t)n, *r = ut + n;
    if (b->parts.looks && (j > 0 || b->begun))
        look_for_contact(b, level_at(b, j), ut, r, step->t1);
    if (b->parts.functions && (j > 0 || b->begun))
        look_for_alternation(b, level_at(b, j), r, step->t1);
    const double share = b->parts.has_responses && !b->parts.corrects ? 0.0 : al1;
    for (size_t i = 0; i < n; i++)
        to->x[i] = share * w[i];
    if (b->parts.has_responses) {
        memcpy(to->ut, ut, n * sizeof(double));
        memcpy(to->r, r, n * sizeof(double));
        memcpy(to->v, v, n * sizeof(double));
    } else {
        correct_forces(b, j > 0 || b->begun ? level_at(b, j)->vs : v, v, to->x);
        sum_up_lanes(b, j, ut, r, v, springs);
    }
    memcpy(to->springs, springs, pma_springs_numbers(b->parts.springs) * sizeof(double));
    memset(to->vs, 0, n * sizeof(double));
    add_extrapolated(b, v, w, to->vs);
}

void pma_balance_advance_response(pma_balance *b, size_t j, double al1, const pma_state *link)
{
    level *to = level_at(b, j);
    const double share = b->parts.corrects ? 0.0 : al1;
    for (size_t i = 0; i < b->parts.n; i++) {
        to->x[i] += link->u[i] - share * link->w[i];
        to->v[i] += link->v[i];
    }
    correct_forces(b, j > 1 || b->begun ? level_at(b, j - 1)->vs : to->v, to->v, to->x);
    sum_up_lanes(b, j - 1, to->ut, to->r, to->v, to->springs);
    if (j == b->parts.substeps) /* the state at the end, not that of the free run */
        add_extrapolated(b, link->v, link->w, to->vs);
}

/* (B10) */
static double gain_at(const pma_balance *b, const level *at, size_t lane)
{
    judgement *so_far = &b->judged[lane];
    const sums *now = &at->sums[lane];
    so_far->least_work = fmin(so_far->least_work, now->work);
    so_far->least_added = fmin(so_far->least_added, now->added);
    const double added = now->added - so_far->least_added;
    const double energy = kinetic(b, at->v, lane) + now->work - so_far->least_work;
    double motion = fmax(so_far->motion, fmax(energy - added, ROUNDING * now->size));
    motion = fmax(motion, now->start);
    so_far->motion = motion;
    /* what was added and dissipated at once does no harm */
    return added > SHARE * now->gross ? fmin(added, energy) / motion : 0.0;
}

static void judge(const pma_balance *b, const level *at, size_t lane)
{
    judgement *so_far = &b->judged[lane];
    memmove(so_far->gains, so_far->gains + 1, (LASTS - 1) * sizeof(double));
    so_far->gains[LASTS - 1] = gain_at(b, at, lane);
    double least = so_far->gains[0];
    for (size_t i = 1; i < LASTS; i++)
        least = fmin(least, so_far->gains[i]);
    so_far->gain = fmax(so_far->gain, least);
}

void pma_balance_commit(pma_balance *b)
{
    const level *first = level_at(b, 1);
    multiply_mass(b, first->v);
    for (size_t l = 0; l < b->parts.lanes; l++)
        judge(b, first, l);
    level *last = level_at(b, b->parts.substeps);
    const level before = b->present;
    b->present = *last;
    *last = before;
    b->begun = true;
}

double pma_balance_gain(const pma_balance *b)
{
    double most = 0.0;
    for (size_t l = 0; l < b->parts.lanes; l++)
        most = fmax(most, b->judged[l].gain);
    return most;
}

pma_impact pma_balance_impact(const pma_balance *b)
{
    return b->impact;
}

double pma_balance_alternates(const pma_balance *b)
{
    return b->alternates;
}

bool pma_balance_is_broken(const pma_balance *b)
{
    return pma_balance_gain(b) > BROKEN;
}
