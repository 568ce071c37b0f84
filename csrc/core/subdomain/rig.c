
#include "subdomain/rig.h"

#include <assert.h>
#include <string.h>

#include "memory.h"
#include "object.h"
#include "subdomain/inside.h"
#include "subdomain/subdomain.h"

struct pma_rig {
    const pma_subdomain *of;
    pma_limits *commands;      /* limits of those of the structure, or NULL */
    pma_limits **compensators; /* the same of what each compensator makes of them, or NULL */
    double *compensation;      /* 2 n: command of one and its velocity */
    int64_t *position;         /* n: ours of each dof of the user; of compensators */
    const double *u, *v;       /* n: the last command of the structure, with compensators */
    const pma_limits *breach;  /* which of them was exceeded last */
    const pma_substep *step;   /* whose forces are being evaluated, else NULL */
    pma_stamp *stamp;          /* in a paced run, else NULL */
};

/* ---- making --------------------------------------------------------------------------------- */

static size_t compensators_of(const pma_rig *rig)
{
    return rig->compensators ? rig->of->parts.restoring.compensators : 0;
}

void pma_rig_destroy(pma_rig *rig)
{
    if (!rig)
        return;
    pma_cell *cell = rig->of->parts.restoring.cell;
    if (rig->compensators && cell->self == rig) {
        cell->self = NULL;
        cell->allows = NULL;
    }
    for (size_t i = 0; i < compensators_of(rig); i++)
        pma_limits_destroy(rig->compensators[i]);
    pma_limits_destroy(rig->commands);
    pma_memory_release(rig);
}

static pma_rig *create_rig(const pma_subdomain *s, size_t compensators)
{
    const pma_array arrays[] = {
        PMA_ARRAY(pma_rig, compensation, compensators > 0 ? 2 * s->parts.n : 0),
        PMA_ARRAY(pma_rig, compensators, compensators),
        PMA_ARRAY(pma_rig, position, compensators > 0 ? s->parts.n : 0),
        {0}};
    pma_rig *rig = pma_object_create(sizeof *rig, arrays);
    if (!rig)
        return NULL;
    rig->of = s;
    if (compensators == 0)
        rig->compensators = NULL;
    for (size_t k = 0; compensators > 0 && k < s->parts.n; k++)
        rig->position[s->parts.restoring.order[k]] = (int64_t)k;
    return rig;
}

static pma_status create_limits(pma_rig *rig, const pma_limits_parts *parts)
{
    PMA_TRY(pma_limits_create(parts, &rig->commands));
    for (size_t i = 0; i < compensators_of(rig); i++)
        PMA_TRY(pma_limits_create(parts, &rig->compensators[i]));
    return PMA_OK;
}

/* ---- what compensators make of a command ---------------------------------------------------- */

static bool is_within(pma_rig *rig, pma_limits *limits, const pma_substep *step, const double *u,
                      const double *v)
{
    const pma_subdomain *s = rig->of;
    const pma_state *from = pma_levels_at(&s->levels, step->j);
    rig->breach = limits;
    return pma_limits_command(limits, step->number, step->j % s->parts.substeps == 0, step->t1,
                              from->u, from->v, u, v);
}

/* May compensator i give this command of these dofs (width)? Those of the others are the
 * structure's, and so are the first one, of the initial values, and v where it is NULL. */
static bool allows(void *self, size_t i, const int64_t *dofs, size_t width, const double *u,
                   const double *v)
{
    pma_rig *rig = self;
    if (!rig->step)
        return true;
    const size_t n = rig->of->parts.n;
    double *own_u = rig->compensation, *own_v = own_u + n;
    memcpy(own_u, rig->u, n * sizeof(double));
    memcpy(own_v, rig->v, n * sizeof(double));
    for (size_t k = 0; k < width; k++) {
        const int64_t position = rig->position[dofs ? dofs[k] : (int64_t)k];
        own_u[position] = u[k];
        if (v)
            own_v[position] = v[k];
    }
    return is_within(rig, rig->compensators[i], rig->step, own_u, own_v);
}

/* ---- commands and replies ------------------------------------------------------------------- */

pma_status pma_rig_command(pma_rig *rig, const pma_substep *step, const pma_state *to)
{
    const pma_subdomain *s = rig->of;
    const double *v = s->parts.restoring.function ? s->vs : NULL;
    pma_stamp *stamp = rig->stamp;
    rig->step = NULL;
    if (rig->commands && !is_within(rig, rig->commands, step, to->u, v))
        return PMA_LIMITED;
    rig->step = step;
    rig->u = to->u;
    rig->v = v;
    if (!stamp)
        return PMA_OK;
    for (size_t k = 0; k < stamp->count; k++)
        stamp->command[k] = to->u[stamp->position[k]];
    stamp->commanded = stamp->now(stamp->ctx);
    return PMA_OK;
}

bool pma_rig_admits(pma_rig *rig, const pma_substep *step, const double *u, const double *v)
{
    rig->step = rig->commands ? step : NULL;
    rig->u = u;
    rig->v = v;
    return !rig->commands || is_within(rig, rig->commands, step, u, v);
}

static void read_stamp(const pma_restoring *restoring, pma_stamp *stamp)
{
    stamp->returned = stamp->now(stamp->ctx);
    for (size_t k = 0; k < stamp->count; k++)
        stamp->force[k] = pma_restoring_force(restoring, (size_t)stamp->position[k]);
}

pma_status pma_rig_reply(pma_rig *rig, const pma_state *to)
{
    assert(rig->step);
    const pma_parts *p = &rig->of->parts;
    rig->step = NULL;
    if (rig->stamp)
        read_stamp(&p->restoring, rig->stamp);
    if (!rig->commands)
        return PMA_OK;
    double *r = pma_limits_force(rig->commands);
    memset(r, 0, p->n * sizeof(double));
    pma_springs_add(&p->springs, to->springs, r);
    for (size_t i = 0; p->restoring.function && i < p->n; i++)
        r[i] += pma_restoring_force(&p->restoring, i);
    rig->breach = rig->commands;
    return pma_limits_measure(rig->commands) ? PMA_OK : PMA_LIMITED;
}

void pma_rig_command_first(pma_rig *rig)
{
    rig->step = NULL; /* one whose function failed has had no reply */
}

/* Of springs that were never loaded before, and of functions as evaluated last */
pma_status pma_rig_reply_first(pma_rig *rig, double t, const double *u, const double *v)
{
    const pma_parts *p = &rig->of->parts;
    if (!rig->commands)
        return PMA_OK;
    double *r = pma_limits_first(rig->commands, u);
    memset(r, 0, p->n * sizeof(double));
    PMA_TRY(pma_springs_subtract_first(&p->springs, u, v, r));
    for (size_t i = 0; i < p->n; i++)
        r[i] = (p->restoring.function ? pma_restoring_force(&p->restoring, i) : 0.0) - r[i];
    rig->breach = rig->commands;
    return pma_limits_measure_first(rig->commands, t) ? PMA_OK : PMA_LIMITED;
}

void pma_rig_begin(pma_rig *rig, const double *v)
{
    if (!rig->commands)
        return;
    pma_limits_begin(rig->commands);
    for (size_t i = 0; i < compensators_of(rig); i++)
        pma_limits_begin(rig->compensators[i]);
    if (v)
        pma_limits_begin_first(rig->commands, v);
}

/* ---- of a subdomain ------------------------------------------------------------------------- */

static void replace_rig(pma_subdomain *s, pma_rig *rig)
{
    pma_rig_destroy(s->rig);
    s->rig = rig;
}

pma_status pma_subdomain_limit(pma_subdomain *s, const pma_limits_parts *parts)
{
    if (parts->n != s->parts.n)
        return PMA_BAD_SIZE;
    pma_rig *rig = create_rig(s, s->parts.restoring.compensators);
    if (!rig)
        return PMA_NO_MEMORY;
    const pma_status status = create_limits(rig, parts);
    if (status != PMA_OK) {
        pma_rig_destroy(rig);
        return status;
    }
    rig->stamp = s->rig ? s->rig->stamp : NULL;
    replace_rig(s, rig);
    if (rig->compensators) {
        s->parts.restoring.cell->self = rig;
        s->parts.restoring.cell->allows = allows;
    }
    return PMA_OK;
}

pma_breach pma_subdomain_breach(const pma_subdomain *s)
{
    return *pma_limits_breach(s->rig->breach);
}

pma_status pma_subdomain_time(pma_subdomain *s, pma_stamp *stamp, const pma_limits_clock *clock)
{
    if (!s->rig && stamp)
        s->rig = create_rig(s, 0);
    if (!s->rig)
        return stamp ? PMA_NO_MEMORY : PMA_OK;
    s->rig->stamp = stamp;
    if (!s->rig->commands) {
        if (!stamp)
            replace_rig(s, NULL);
        return PMA_OK;
    }
    pma_limits_pace(s->rig->commands, clock);
    for (size_t i = 0; i < compensators_of(s->rig); i++)
        pma_limits_pace(s->rig->compensators[i], clock);
    return PMA_OK;
}
