/* schedule.h - the coupler from inside: what its files share.
 *
 * coupler.c is the object and the schedules with an interface problem at every fine instant, "pm"
 * and "gc"; macro.c the schedule with one in a macro step. */
#ifndef PMA_SCHEDULE_H
#define PMA_SCHEDULE_H

#include "coupler.h"

/* Where a subdomain stands inside the macro step. */
typedef struct {
    pma_subdomain *subdomain;
    size_t substeps, ratio; /* own steps in a macro step, fine steps in an own step */
    size_t j;               /* own node at or before this instant */
    size_t phase;           /* fine steps since that node: 0..ratio */
    size_t entries;         /* matrix entries read by one own step */
    bool doubled;
} pma_place;

struct pma_coupler {
    pma_coupler_parts parts;
    pma_place *places;  /* one for each subdomain */
    size_t fine;        /* interface problems in a macro step */
    int64_t step_count; /* macro steps done */
    bool started;
    size_t unstable;
    size_t unpolled;    /* entries read since the last poll */
    size_t interface_entries; /* read by one interface solve */
    double *lam;        /* p: multipliers of the present */
    double *lam_work;   /* p: of the fine step at hand */
    double *g;          /* p: prescribed velocities of the present, zero where none is */
    double *g_work;     /* p: of the fine step at hand */
    double *motion;     /* p: scratch */
    double *block;
};

/* Double steps are taken from the second macro step on: they are not self-starting. */
static inline bool pma_is_double(const pma_coupler *c, const pma_place *at)
{
    return at->doubled && c->step_count > 0;
}

/* (T1)  t = (k / nodes) dt with node k counted from 0, in this order: equal instants, equal bits,
 * whatever the number of nodes in a macro step */
static inline double pma_instant(const pma_coupler *c, size_t k, size_t nodes)
{
    const double count = (double)c->step_count * (double)nodes + (double)k;
    return count / (double)nodes * c->parts.dt;
}

/* g (p) of interface problem k = 1..fine of the macro step into g_work */
void pma_coupler_prescribe(pma_coupler *c, size_t k);

/* H lam_work := lam_work. PMA_NOT_FINITE, with the subdomain at fault found. */
pma_status pma_coupler_solve(pma_coupler *c);

/* Looks at the poll when enough entries were read since the last time. */
bool pma_coupler_asked_to_stop(pma_coupler *c, const pma_poll *poll);

#endif
