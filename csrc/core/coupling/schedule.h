/* schedule.h - the coupler from inside: what its files share.
 *
 * coupler.c is the object and the schedules with an interface problem at every fine instant, "pm"
 * and "gc"; ahead.c and split.c what several threads do in them besides sharing the subdomains;
 * macro.c the schedule with one in a macro step. */
#ifndef PMA_SCHEDULE_H
#define PMA_SCHEDULE_H

#include <stdatomic.h>

#include "coupling/coupler.h"
#include "workers/roster.h"
#include "workers/team.h"

/* What a worker beside the fine steps has been given to do with one subdomain. Worker 0 writes it
 * before and reads it after, not meanwhile. */
typedef struct {
    bool running;
    bool closes, opens; /* the step to own node j; the one to own node j + 2 */
    size_t j;
    double t1;          /* of own node j + 2 */
    int64_t step;
    const pma_record_nodes *nodes;
    size_t row;         /* where own node j is recorded, or PMA_NO_ROW */
    pma_status status;  /* of the closing */
} pma_job;

/* Where a subdomain stands inside the macro step. */
typedef struct {
    pma_subdomain *subdomain;
    size_t substeps, ratio; /* own steps in a macro step, fine steps in an own step */
    size_t j;               /* own node at or before this instant */
    size_t phase;           /* fine steps since that node: 0..ratio */
    size_t entries;         /* matrix entries read by one own step */
    bool doubled, mine;     /* takes double steps; belongs to worker 0, the caller */
    bool split;             /* all workers of the fine steps do it together */
    pma_status status;      /* what the last open or close said; written when it is not PMA_OK */
    size_t opened;          /* own node up to which steps have been opened, or are being */
    bool late;              /* the step to this node is being closed beside the fine steps */
    pma_job job;
    double *lam;            /* p: what it is closed with; NULL for those that are never late */
} pma_place;

/* Work to be done with one subdomain, on whatever worker has it. */
typedef pma_status (*pma_task)(const pma_coupler *c, pma_place *at);

/* A macro step of macro coupling while it is made; all but `stopped` is worker 0's to change. */
typedef struct {
    const pma_record *record;
    const pma_poll *poll;
    size_t unpolled;     /* entries read since the last poll */
    atomic_bool stopped; /* by the poll: everybody stops before the next own step */
} pma_run;

struct pma_coupler {
    pma_coupler_parts parts;
    pma_place *places;  /* one for each subdomain */
    size_t fine;        /* interface problems in a macro step */
    int64_t step_count; /* macro steps done */
    int64_t end;        /* macro step at which the call at hand ends */
    size_t k;           /* fine steps since the present, of the one at hand */
    bool restored;      /* somebody has a restoring force */
    bool pending;       /* the macro step before is not committed yet: nodes are counted on */
    const pma_record *record; /* of the call at hand, or NULL */
    bool started;
    size_t failed;
    size_t unpolled;    /* entries read since the last poll */
    size_t interface_entries; /* read by one interface solve */
    double *lam;        /* p: multipliers of the present */
    double *lam_work;   /* p: of the fine step at hand */
    double *g;          /* p: prescribed velocities of the present, zero where none is */
    double *g_work;     /* p: of the fine step at hand */
    double *lam_reached, *g_reached; /* p: of the macro step that is pending */
    double *lam_late;   /* what is closed late is closed with */
    double *motion;     /* p: scratch */
    double *dlam;       /* p: under macro coupling, how far the multipliers go */
    double *block;
    pma_roster roster;  /* who has which subdomains */
    pma_team *team;     /* NULL when the caller is alone */
    pma_task task;      /* what the team is at */
    bool (*due)(const pma_place *);
    pma_run *run;       /* macro coupling: the macro step at hand */
    atomic_bool not_finite; /* some rows of the subdomain that is split were not */
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

/* The own step that begins at own node at->j, counted from the start of the run. */
static inline int64_t pma_own_step(const pma_coupler *c, const pma_place *at)
{
    return c->step_count * (int64_t)at->substeps + (int64_t)at->j;
}

/* The row of own node j of `nodes` in a macro step, or PMA_NO_ROW; j may go on beyond them. */
static inline size_t pma_row(const pma_coupler *c, size_t j, size_t nodes)
{
    const int64_t macro = c->step_count + (j > nodes);
    return pma_record_row(c->record, macro, j > nodes ? j - nodes : j, nodes);
}

/* g (p) of interface problem k = 1..fine of the macro step into g_work */
void pma_coupler_prescribe(pma_coupler *c, size_t k);

/* H lam_work := lam_work. PMA_NOT_FINITE, with the subdomain at fault found. */
pma_status pma_coupler_solve(pma_coupler *c);

/* Every worker does `task` with those it has that are `due`, worker 0 too; all wait for the last.
 * What went wrong with the first subdomain, in order, with which it did. */
pma_status pma_coupler_share(pma_coupler *c, pma_task task, bool (*due)(const pma_place *));

/* Everybody has arrived at interface instant c->k: what is wanted of it. */
void pma_coupler_record(const pma_coupler *c, const pma_record *record);

/* A macro step of macro coupling, as far as commit; in macro.c */
pma_status pma_macro_step(pma_coupler *c, const pma_record *record, const pma_poll *poll);

/* The nodes at the end of the macro step become the present. Cannot fail. */
void pma_coupler_commit(pma_coupler *c);

/* ---- beside the fine steps: ahead.c ---------------------------------------------------------- */

/* Those that stand at a node with one step opened begin to open the next. */
void pma_ahead_open(pma_coupler *c);

/* Those that reach a node are awaited, take the multipliers and are sent on; at the end of a call
 * they are left to be closed as the others are. PMA_NOT_FINITE when what is awaited was not. */
pma_status pma_ahead_close(pma_coupler *c);

/* Is a step that ended at this instant still being closed? */
bool pma_ahead_is_late(const pma_coupler *c);

/* All is awaited after what ended the fine step at hand with this status. A failure that belongs
 * to an earlier instant is the one that is named, and the macro step before committed if it can. */
pma_status pma_ahead_settle(pma_coupler *c, pma_status status);

/* ---- one subdomain by all workers of the fine steps: split.c ----------------------------------- */

/* open and close of a subdomain that is split. */
pma_status pma_split_open(pma_coupler *c, pma_place *at);
pma_status pma_split_close(pma_coupler *c, pma_place *at);

/* Looks at the poll when enough entries were read since the last time. */
bool pma_coupler_asked_to_stop(pma_coupler *c, const pma_poll *poll);

#endif
