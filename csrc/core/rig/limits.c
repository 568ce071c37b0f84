#include "rig/limits.h"

#include <math.h>
#include <string.h>

#include "memory.h"
#include "object.h"
#include "state.h"

/* Commands of the last substeps, and those before a macro step that may be taken again; vectors of
 * all, with that of the initial values, and of a drive. */
enum { RING = 4, KEPT = 2, COMMANDS = RING + KEPT + 1, VECTORS = 2 * COMMANDS + 3 };

typedef struct {
    int64_t number; /* of the substep, or PMA_NO_SUBSTEP */
    double *u, *r;  /* command and force, n each */
    double work;    /* of the forces since the first one */
    bool measured;
} command;

#define BEFORE (-1) /* the first substep of a run has number 0 */

/* The last command by the clock, and the one before it from which its rate is taken: the rate of
 * the specimen, n each, and times in ns. */
typedef struct {
    bool known;
    int64_t t, t_before;
    double *u, *before, *rate;
} drive;

struct pma_limits {
    pma_limits_parts parts;
    pma_limits_clock clock;                /* without a function: none */
    command ring[RING], kept[KEPT], start; /* start: of the initial values, until they begin */
    command *last;
    drive drive;
    double t; /* of the last command */
    pma_breach breach;
    double *numbers; /* of all commands */
};

pma_status pma_limits_create(const pma_limits_parts *parts, pma_limits **out)
{
    const size_t n = parts->n;
    const pma_array arrays[] = {{offsetof(pma_limits, numbers), n, VECTORS * sizeof(double)}, {0}};
    *out = NULL;
    if (!(parts->h > 0.0))
        return PMA_BAD_STEP;
    pma_limits *l = pma_object_create(sizeof *l, arrays);
    if (!l)
        return PMA_NO_MEMORY;
    l->parts = *parts;
    for (size_t i = 0; i < COMMANDS; i++) {
        command *x = i < RING ? &l->ring[i] : i < RING + KEPT ? &l->kept[i - RING] : &l->start;
        x->u = l->numbers + 2 * i * n;
        x->r = x->u + n;
    }
    l->drive.u = l->numbers + (size_t)(2 * COMMANDS) * n;
    l->drive.before = l->drive.u + n;
    l->drive.rate = l->drive.before + n;
    l->start.number = PMA_NO_SUBSTEP;
    pma_limits_begin(l);
    *out = l;
    return PMA_OK;
}

void pma_limits_destroy(pma_limits *l)
{
    pma_memory_release(l);
}

void pma_limits_begin(pma_limits *l)
{
    for (size_t i = 0; i < RING; i++)
        l->ring[i].number = PMA_NO_SUBSTEP;
    for (size_t i = 0; i < KEPT; i++)
        l->kept[i].number = PMA_NO_SUBSTEP;
    l->last = &l->ring[0];
    l->drive.known = false;
}

void pma_limits_pace(pma_limits *l, const pma_limits_clock *clock)
{
    l->clock = clock ? *clock : (pma_limits_clock){0};
}

const pma_breach *pma_limits_breach(const pma_limits *l)
{
    return &l->breach;
}

/* ---- commands by number --------------------------------------------------------------------- */

static command *slot(pma_limits *l, int64_t number)
{
    return &l->ring[number & (RING - 1)];
}

static void copy(const pma_limits *l, const command *from, command *to)
{
    memcpy(to->u, from->u, l->parts.n * sizeof(double));
    memcpy(to->r, from->r, l->parts.n * sizeof(double));
    to->number = from->number;
    to->work = from->work;
    to->measured = from->measured;
}

/* Those before a macro step are kept, or taken again when it is. */
static void keep(pma_limits *l, int64_t number)
{
    for (int64_t k = 0; k < KEPT; k++) {
        command *before = slot(l, number - 1 - k), *kept = &l->kept[k];
        if (before->number == number - 1 - k)
            copy(l, before, kept);
        else if (kept->number == number - 1 - k)
            copy(l, kept, before);
    }
}

/* A motion at the velocity v0 up to u0, before the first command */
static void assume(pma_limits *l, int64_t number, const double *u0, const double *v0)
{
    for (int64_t k = 1; k <= KEPT; k++) {
        command *x = slot(l, number - k);
        for (size_t i = 0; i < l->parts.n; i++)
            x->u[i] = u0[i] - (double)(k - 1) * l->parts.h * v0[i];
        x->number = number - k;
        x->work = 0.0;
        x->measured = false;
    }
}

/* ---- limits --------------------------------------------------------------------------------- */

static bool breaks(pma_limits *l, pma_limited what, size_t i, double value, double limit)
{
    if (fabs(value) <= limit)
        return false;
    l->breach =
        (pma_breach){.what = what, .position = i, .value = value, .limit = limit, .t = l->t};
    return true;
}

/* Is u within the limits of the time of the problem, and v? */
static bool is_allowed(pma_limits *l, const double *u1, const double *u2, const double *u,
                       const double *v)
{
    const pma_limits_parts *p = &l->parts;
    for (size_t i = 0; i < p->n; i++) {
        const double rate = (u[i] - u1[i]) / p->h, rate_before = (u1[i] - u2[i]) / p->h;
        const double acceleration = (rate - rate_before) / p->h;
        if ((p->displacement && breaks(l, PMA_OF_DISPLACEMENT, i, u[i], p->displacement[i])) ||
            (p->velocity && breaks(l, PMA_OF_VELOCITY, i, rate, p->velocity[i])) ||
            (p->velocity && v && breaks(l, PMA_OF_VELOCITY, i, v[i], p->velocity[i])) ||
            (p->acceleration &&
             breaks(l, PMA_OF_ACCELERATION, i, acceleration, p->acceleration[i])))
            return false;
    }
    return true;
}

/* ---- by the clock --------------------------------------------------------------------------- */

/* The motion of the problem, at the pace of the clock, before the first command of a paced run */
static void begin_drive(pma_limits *l, int64_t t, const double *u1, const double *u2)
{
    drive *d = &l->drive;
    for (size_t i = 0; i < l->parts.n; i++) {
        d->u[i] = d->before[i] = u1[i];
        d->rate[i] = (u1[i] - u2[i]) / (1e-9 * l->clock.period);
    }
    d->t = d->t_before = t - (int64_t)ceil(l->clock.period);
    d->known = true;
}

/* Is u at time t within the limits of a specimen that takes a period to move to a command, and
 * then stands still?  w_k = (d_k - d_a) / T,  b_k = (w_k - w_(k-1)) / T                (Y12) */
static bool can_be_given(pma_limits *l, int64_t t, const double *u)
{
    const pma_limits_parts *p = &l->parts;
    drive *d = &l->drive;
    const double T = 1e-9 * l->clock.period;
    const bool stood = (double)(t - d->t) >= 2.0 * l->clock.period;
    const bool follows = (double)(t - d->t_before) >= l->clock.period;
    const double *before = follows ? d->u : d->before;
    for (size_t i = 0; i < p->n; i++) {
        const double rate = (u[i] - before[i]) / T;
        const double acceleration = (rate - (stood ? 0.0 : d->rate[i])) / T;
        if ((p->velocity && breaks(l, PMA_OF_VELOCITY, i, rate, p->velocity[i])) ||
            (p->acceleration &&
             breaks(l, PMA_OF_ACCELERATION, i, acceleration, p->acceleration[i]))) {
            l->breach.by_clock = true;
            return false;
        }
    }
    if (follows) {
        memcpy(d->before, d->u, p->n * sizeof(double));
        d->t_before = d->t;
    }
    for (size_t i = 0; i < p->n; i++)
        d->rate[i] = (u[i] - d->before[i]) / T;
    memcpy(d->u, u, p->n * sizeof(double));
    d->t = t;
    return true;
}

/* ---- commands and forces -------------------------------------------------------------------- */

bool pma_limits_command(pma_limits *l, int64_t number, bool first, double t, const double *u0,
                        const double *v0, const double *u, const double *v)
{
    if (first)
        keep(l, number);
    if (slot(l, number - 1)->number != number - 1 || slot(l, number - 2)->number != number - 2)
        assume(l, number, u0, v0);
    const double *u1 = slot(l, number - 1)->u, *u2 = slot(l, number - 2)->u;
    l->t = t;
    if (!is_allowed(l, u1, u2, u, v))
        return false;
    if (l->clock.now) {
        const int64_t now = l->clock.now(l->clock.ctx);
        if (!l->drive.known)
            begin_drive(l, now, u1, u2);
        if (!can_be_given(l, now, u))
            return false;
    } else {
        l->drive.known = false; /* a command of which no clock knows */
    }
    l->last = slot(l, number);
    memcpy(l->last->u, u, l->parts.n * sizeof(double));
    l->last->number = number;
    l->last->measured = false;
    return true;
}

double *pma_limits_force(pma_limits *l)
{
    return l->last->r;
}

double *pma_limits_first(pma_limits *l, const double *u)
{
    memcpy(l->start.u, u, l->parts.n * sizeof(double));
    l->start.number = BEFORE;
    return l->start.r;
}

static bool force_within(pma_limits *l, const double *r)
{
    for (size_t i = 0; l->parts.force && i < l->parts.n; i++) {
        if (breaks(l, PMA_OF_FORCE, i, r[i], l->parts.force[i]))
            return false;
    }
    return true;
}

bool pma_limits_measure_first(pma_limits *l, double t)
{
    l->t = t;
    if (force_within(l, l->start.r))
        return true;
    l->start.number = PMA_NO_SUBSTEP;
    return false;
}

void pma_limits_begin_first(pma_limits *l, const double *v)
{
    pma_limits_begin(l);
    if (l->start.number == PMA_NO_SUBSTEP)
        return;
    assume(l, BEFORE + 1, l->start.u, v);
    memcpy(slot(l, BEFORE)->r, l->start.r, l->parts.n * sizeof(double));
    slot(l, BEFORE)->measured = true;
    l->start.number = PMA_NO_SUBSTEP;
}

bool pma_limits_measure(pma_limits *l)
{
    const pma_limits_parts *p = &l->parts;
    command *at = l->last;
    const command *before = slot(l, at->number - 1);
    const double *r = at->r;
    at->work = before->work;
    at->measured = true;
    if (!force_within(l, r))
        return false;
    for (size_t i = 0; before->measured && i < p->n; i++)
        at->work += 0.5 * (before->r[i] + r[i]) * (at->u[i] - before->u[i]);
    return !breaks(l, PMA_OF_ENERGY, 0, fmax(-at->work, 0.0), p->energy);
}
