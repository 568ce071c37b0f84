/* command.c - the command of a substep that is not open yet, for loops outside. */

#include "subdomain/subdomain.h"

#include "subdomain/inside.h"

void pma_subdomain_command(const pma_subdomain *s, const pma_substep *step, size_t i, double *c)
{
    const pma_operator *op = pma_operator_at(s, step);
    const pma_state *x = pma_levels_origin(&s->levels, step);
    const pma_state from = {.u = x->u + i, .v = x->v + i, .w = x->w + i, .a = x->a + i};
    double numbers[4];
    const pma_state to = {.u = numbers, .v = numbers + 1, .w = numbers + 2, .a = numbers + 3};
    s->update->predict(&op->step, 0, 1, &from, &to);
    c[0] = numbers[0];
    c[1] = x->v[i] + op->step.h * x->w[i];
    c[2] = x->w[i];
}

/* The functions, on a copy of what they remember; y (n) is scratch. */
static pma_status ask(const pma_subdomain *s, const pma_substep *step, const double *u,
                      const double *v, double *y, double *memory)
{
    const pma_restoring *restoring = &s->parts.restoring;
    const size_t springs = pma_springs_numbers(&s->parts.springs);
    const pma_state *last = pma_levels_at(&s->levels, step->j);
    int code;
    pma_restoring_accelerate(restoring, pma_levels_origin(&s->levels, step)->w,
                             step->twice ? 2.0 : 1.0);
    const pma_status status = pma_restoring_subtract(restoring, step->t1, u, v,
                                                     last->springs + springs, memory, y, &code);
    return status == PMA_LIMITED ? status : PMA_OK;
}

pma_status pma_subdomain_admit(const pma_subdomain *s, const pma_substep *step, double *u,
                               double *v)
{
    const size_t n = s->parts.n;
    const pma_operator *op = pma_operator_at(s, step);
    const pma_state *from = pma_levels_origin(&s->levels, step);
    const pma_state to = {.u = u, .v = u + n, .w = u + 2 * n, .a = u + 3 * n};
    s->update->predict(&op->step, 0, n, from, &to);
    pma_substep_extrapolate(op->step.h, n, from, v);
    if (s->rig && !pma_rig_admits(s->rig, step, u, v))
        return PMA_LIMITED;
    const pma_status status =
        s->parts.restoring.memory > 0 ? ask(s, step, u, v, to.w, u + 4 * n) : PMA_OK;
    if (s->rig)
        pma_rig_command_first(s->rig); /* no substep is open */
    return status;
}
