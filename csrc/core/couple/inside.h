/* inside.h - the coupler from inside: what its files share.
 *
 * coupler.c is the object and its macro steps, stages.c what schedules share, fine.c the schedule
 * with an interface problem in every fine step ("pm", "gc"), contact.c the same with contacts,
 * macro.c those with one in a macro step; iterated_fine.c and shooting.c are fine.c and macro.c
 * with internal forces; recorder.c what is recorded, executors.c who does the work besides:
 * look_ahead.c beside the fine steps, exchange.c in several processes. */
#ifndef PMA_COUPLE_INSIDE_H
#define PMA_COUPLE_INSIDE_H

#include <assert.h>
#include <stdatomic.h>

#include "couple/clock.h"
#include "couple/coupler.h"
#include "couple/iteration.h"
#include "workers/roster.h"
#include "workers/team.h"
#include "workers/trial.h"

/* What a worker beside the fine steps is assigned to do with one subdomain, until it is awaited. */
typedef struct {
    bool closes, opens;
    pma_substep closed, opened;
    const pma_selection *selection; /* where the end of `closed` is recorded */
    size_t row;                     /* ... or PMA_NO_ROW */
    pma_status status;              /* of the closing, or of the opening */
} pma_assignment;

/* A member in a coupler, and where it is in the macro step. */
typedef struct {
    pma_member member;
    size_t ratio;               /* fine steps in a substep */
    int64_t first_double;       /* number of the first substep that is a double step */
    pma_moment now;             /* at the end of the fine step at hand */
    pma_substep step;           /* ... and the substep that it is in */
    size_t worker;              /* that has it */
    const pma_workers *workers; /* who share it, or NULL */
    bool in_stages;             /* fine steps are stages of some member */
    bool ahead;                 /* with look-ahead: its next substep may be open already */
    pma_status status;          /* of the last open or close; written when it is not PMA_OK */
    pma_assignment assigned;
    double *lam; /* p: what it is closed with beside the fine steps, or in a run; else NULL */
} pma_coupled;

/* A macro time level, `number` macro steps after the origin of the clock: multipliers, prescribed
 * velocities and what these have moved since t = 0 (p each). */
typedef struct {
    int64_t number;
    double *lam, *g, *moved;
} pma_macro_level;

static inline void pma_macro_level_swap(pma_macro_level *a, pma_macro_level *b)
{
    const pma_macro_level kept = *a;
    *a = *b;
    *b = kept;
}

typedef struct pma_exchange pma_exchange;

/* Work to be done with one subdomain, on whatever worker has it. */
typedef pma_status (*pma_task)(pma_coupler *c, pma_coupled *m);
typedef bool (*pma_due)(const pma_coupled *m);

struct pma_coupler {
    pma_coupler_parts parts;
    pma_coupled *coupled;          /* one for each member */
    pma_coupled *own, *end_of_own; /* those of this process */
    size_t fine;                   /* interface problems in a macro step */
    size_t k;                      /* fine steps since the present, with the one at hand */
    size_t entries;                /* read by the members in a fine step, on average */
    pma_origin origin;             /* where macro steps are counted from */

    /* The present is committed. All members have arrived at `reached`, which waits to be committed
     * while it has another number. `working` is that of the fine step at hand, without a number. */
    pma_macro_level present, reached, working;

    /* of the call at hand */
    int64_t end;              /* macro step at which it ends */
    const pma_record *record; /* or NULL */
    int64_t recorded;         /* with `every`, the macro step of the present or next row */
    const pma_poll *poll;     /* or NULL */
    pma_pace *pace;           /* or NULL */
    size_t unpolled;          /* entries read since the last poll */
    atomic_bool stopped;      /* by the poll */
    size_t failed;
    bool started;
    bool has_executors;       /* beside the caller and the team: other processes, look-ahead */
    bool staged;              /* fine steps are stages of some member */
    bool evaluates, observed; /* some member has a restoring force; is observed */

    pma_motion *motions;
    double *scratch;    /* p */
    double *dlam;       /* p: macro coupling: Lam_{n+1} - Lam_n */
    double *lam_end;    /* p: mean coupling: multipliers at the present, */
    double *lam_before; /* ... and those before the last ones */
    double *lengths;    /* 2: ... of the last two macro steps; 0 where there was none */
    double *sums;       /* p: scratch */
    double *lam_deferred;

    pma_exchange *exchange;   /* with members in other processes, else NULL */
    pma_iteration *iteration; /* with members that have internal forces, else NULL */
    pma_contact *contact;     /* of the schedule with contacts, else NULL */

    pma_roster roster;   /* which worker has which subdomains */
    pma_coupled *split;  /* the one that all workers of the fine steps do together, or NULL */
    pma_workers workers; /* ... these */
    pma_team *team;      /* NULL when the caller is alone */
    pma_trial trial;     /* of the team, where its size is not the user's choice */
    pma_task task;       /* what the team does, and with which members */
    pma_due due;
    atomic_bool has_failed; /* the task, with some member */
    struct {                /* work on the member that is split, by each of them */
        bool (*work)(void *self, size_t worker);
        void *self;
        atomic_bool failed; /* with one of them it returned false */
    } shared;
};

/* What is tied at the end of a macro step, and by which multipliers. */
typedef struct {
    pma_interface_kind kind;
    bool ramps; /* they grow linearly from those of the present, by what is solved for; else that is
                   all of them, in all of the macro step */
    /* right (p) := what the interface problem is solved for, without members that shoot */
    void (*right_side)(pma_coupler *c, double *right);
    /* What a member responds to them, added. */
    pma_task link_response;
    /* After everything else of the macro step was recorded; NULL if there is nothing. */
    void (*end)(pma_coupler *c);
} pma_tie;
extern const pma_tie pma_velocity_tie, pma_displacement_tie;

struct pma_schedule {
    /* Are these numbers of substeps possible? PMA_BAD_SIZE if not. */
    pma_status (*check)(const pma_coupler_parts *parts);
    /* Interface problems in a macro step. */
    size_t (*instants)(const pma_coupler_parts *parts);
    /* What there is to do for one member. */
    pma_duty (*duty)(const pma_member *member);
    /* A macro step, up to where all have arrived at its end; `working` is then that of its end. */
    pma_status (*step)(pma_coupler *c);
    /* ... of fine steps (pma_fine_steps): one of them, before it is recorded */
    pma_status (*fine_step)(pma_coupler *c);
    /* ... what is done before the first and after the last of them; NULL if nothing */
    void (*begin)(pma_coupler *c);
    void (*end)(pma_coupler *c);
    /* What it needs more, to iterate say; NULL if nothing. */
    pma_status (*prepare)(pma_coupler *c, const pma_iteration_parts *parts);
    /* Records the accelerations that no state has, of the present; NULL if there are none. */
    void (*record_present)(const pma_coupler *c, const pma_record *record);
    /* Members in other processes: what a round (1, 2, ... in a macro step) needs of a member, their
     * number returned: one for each interface problem; every member where it is in round k; does
     * (S3) apply? */
    size_t (*interface_pieces)(const pma_coupler *c, const pma_coupled *m, size_t round,
                               pma_piece *pieces);
    void (*move_to)(pma_coupler *c, size_t k);
    bool rebases;
    const pma_tie *tie; /* of macro steps with one interface problem, else NULL */
    /* May members have steps that are iterated, or in macro steps internal forces at all? */
    bool iterates, internal;
};

/* Has some member a scheme of two stages? */
static inline bool pma_parts_are_staged(const pma_coupler_parts *parts)
{
    for (size_t i = 0; i < parts->count; i++) {
        if (parts->members[i].staged)
            return true;
    }
    return false;
}

/* ---- clock ---------------------------------------------------------------------------------- */

static inline pma_substep pma_substep_of(const pma_coupler *c, const pma_coupled *m, size_t j)
{
    return pma_clock_substep(c->origin.t, c->parts.dt, c->present.number, m->member.substeps, j,
                             m->first_double, m->member.staged);
}

/* Every member where it is at the end of fine step k, counted from the present. */
void pma_coupler_move_to(pma_coupler *c, size_t k);

static inline bool pma_is_ending(const pma_coupled *m)
{
    return m->now.phase == m->ratio;
}

/* Number i of the roster, which has the members of this process. */
static inline pma_coupled *pma_member_of(const pma_coupler *c, size_t i)
{
    return &c->own[c->roster.order[i]];
}

static inline bool pma_is_doubled(const pma_coupled *m)
{
    return m->member.doubling != PMA_SINGLE;
}

/* Is this true of some member, of any process? */
static inline bool pma_coupler_has(const pma_coupler *c, bool (*is)(const pma_coupled *m))
{
    for (size_t i = 0; i < c->parts.count; i++) {
        if (is(&c->coupled[i]))
            return true;
    }
    return false;
}

/* For a task of all members. */
static inline bool pma_is_any(const pma_coupled *m)
{
    (void)m;
    return true;
}

/* sum (p) += L of all values of this kind at a macro time level: 0 is the present, 1 the end of the
 * first macro step */
static inline void pma_coupler_gather(const pma_coupler *c, pma_interface_kind kind, size_t macro,
                                      double *sum)
{
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_member *member = &c->coupled[i].member;
        pma_member_gather(member, kind, macro * member->substeps, 1.0, sum);
    }
}

/* sum (p) += scale L vf where it is in its substep                                        (15) */
static inline void pma_add_free_velocity(const pma_coupled *m, double scale, double *sum)
{
    if (pma_is_ending(m)) {
        pma_member_gather(&m->member, PMA_FREE_VELOCITY, m->now.j + 1, scale, sum);
    } else {
        const double theta = pma_clock_fraction(m->now.phase, m->ratio, m->in_stages);
        pma_member_free_velocity(&m->member, m->now.j, theta, scale, sum);
    }
}

/* The macro step before is not committed yet. */
static inline bool pma_is_pending(const pma_coupler *c)
{
    return c->reached.number > c->present.number;
}

/* ---- stages of a macro step: fine.c, stages.c ----------------------------------------------- */

/* working.g (p) := g of interface problem k, working.moved its integral up to there       (G2);
 * once for each, if there are motions */
void pma_coupler_prescribe(pma_coupler *c);

/* working.lam := H^-1 working.lam. PMA_NOT_FINITE, with the member at fault found. */
pma_status pma_coupler_solve(pma_coupler *c);

/* Sleeps until the fine step at hand is due, and takes it. */
pma_status pma_coupler_take_paced(pma_coupler *c);

/* The end of the macro step that all have reached becomes the present. Cannot fail. */
void pma_coupler_commit(pma_coupler *c);

/* Stop? Calls the poll if enough entries were read since the last time. */
bool pma_coupler_poll(pma_coupler *c);
static inline bool pma_coupler_is_stopped(pma_coupler *c)
{
    if (atomic_load_explicit(&c->stopped, memory_order_relaxed))
        return true;
    return c->poll && c->unpolled >= c->poll->entries && pma_coupler_poll(c);
}

/* Contacts: contact.c */
void pma_contact_destroy(pma_contact *x); /* NULL is allowed */
pma_state_array pma_contact_array(pma_coupler *c);

/* ---- members in other processes: exchange.c ------------------------------------------------- */

pma_status pma_exchange_create(pma_coupler *c, const pma_exchange_parts *parts);
void pma_exchange_destroy(pma_exchange *x); /* NULL is allowed */

/* Rounds in which all processes meet. Each returns PMA_ELSEWHERE when another one has failed:
 * before the first macro step of a call, where the status is what happened here so far; before an
 * interface problem; before its jumps are recorded, if they are. */
pma_status pma_exchange_present(pma_coupler *c, pma_status status);
pma_status pma_exchange_interface(pma_coupler *c);
pma_status pma_exchange_jumps(pma_coupler *c);
/* What to return when all know that the macro step has failed in member c->failed: PMA_ELSEWHERE
 * unless it is one of this process; do all know of a failure? */
pma_status pma_exchange_fail(pma_coupler *c, pma_status status);
bool pma_exchange_is_ended(const pma_coupler *c);

/* Around a macro step: whatever happened in it, all return PMA_OK or none does. */
void pma_exchange_begin(pma_coupler *c);
pma_status pma_exchange_agree(pma_coupler *c, pma_status status);

/* ---- iterated steps in several processes -------------------------------------------------- */

/* The pieces of the interface problem; the round at the beginning of a fine step, where substeps
 * begin; which members have a factor that can be kept. */
size_t pma_messages_pieces(const pma_coupler *c, const pma_coupled *m, size_t round,
                           pma_piece *pieces);
pma_status pma_messages_begin(pma_coupler *c);
pma_status pma_messages_factors(pma_coupler *c);

/* After residuals, laws and corrections: what all members have, and whether some process failed in
 * making them. PMA_NOT_FINITE in all processes when a residual is not finite. */
pma_status pma_messages_residuals(pma_coupler *c, pma_status status);
pma_status pma_messages_laws(pma_coupler *c, pma_status status);
pma_status pma_messages_measures(pma_coupler *c);

/* After the runs of a pass of shooting: the ends of all runs, and their measures. */
pma_status pma_messages_runs(pma_coupler *c, pma_status status);

/* ---- one interface problem in a macro step: macro.c ----------------------------------------- */

/* Can all members do what macro coupling, mean coupling need, with internal forces or not?
 * PMA_BAD_SIZE if not. */
pma_status pma_macro_check(const pma_coupler_parts *parts);
pma_status pma_mean_check(const pma_coupler_parts *parts);
size_t pma_macro_instants(const pma_coupler_parts *parts); /* one */
pma_duty pma_macro_duty(const pma_member *member);

/* All are at the end of their last substep; k = 1. */
void pma_macro_move_to(pma_coupler *c, size_t k);

/* Members in other processes: what is tied at the end of the free run, and the present displacement
 * where mean coupling prescribes a velocity. */
size_t pma_macro_pieces(const pma_coupler *c, const pma_coupled *m, size_t round,
                        pma_piece *pieces);
size_t pma_mean_pieces(const pma_coupler *c, const pma_coupled *m, size_t round, pma_piece *pieces);

/* The substeps of a member, each taken by `take` and recorded. */
pma_status pma_macro_run(pma_coupler *c, pma_coupled *m,
                         pma_status (*take)(pma_coupler *c, pma_coupled *m, size_t j));

/* A macro step: the free runs, the interface problem, the link responses, recorded. */
pma_status pma_macro_step(pma_coupler *c, pma_status (*solve)(pma_coupler *c));

/* working.lam, and dlam: how they grow, from what was solved for (p) */
void pma_macro_take(pma_coupler *c, const double *found);

/* Is the run to be stopped? Before a substep, on any worker. */
bool pma_macro_is_stopped(pma_coupler *c, const pma_coupled *m);

/* The same as a callback, of a member in a coupler. */
typedef struct {
    pma_coupler *c;
    const pma_coupled *m;
} pma_stop_context;
bool pma_macro_stops(void *context);

/* Accelerations of mean coupling, which no state has, of the present (K5) */
void pma_mean_record_present(const pma_coupler *c, const pma_record *record);

/* ---- fine steps: fine.c --------------------------------------------------------------------- */

/* The largest number of substeps; PMA_BAD_SIZE unless it is a multiple of all others. */
size_t pma_fine_instants(const pma_coupler_parts *parts);
pma_status pma_fine_check(const pma_coupler_parts *parts);

/* The free problem of a substep, and the link problem under working.lam. */
pma_status pma_fine_open(pma_coupler *c, pma_coupled *m);
pma_status pma_fine_close(pma_coupler *c, pma_coupled *m);

/* working.lam := g - sum_i L_i vf_i, vf_i interpolated in mid-step                     (15) (G1) */
void pma_fine_right_side(pma_coupler *c);

/* Stages of a fine step: the substeps that begin are opened, H Lam = g - sum_i L_i vf_i solved. */
pma_status pma_fine_begin(pma_coupler *c);
pma_status pma_fine_solve(pma_coupler *c);

/* Of a member in the fine steps, none of which is left beside them. */
pma_duty pma_fine_duty(const pma_member *member);

/* A macro step of fine steps, as the schedule has them. */
pma_status pma_fine_steps(pma_coupler *c);

/* The next fine step of a macro step alone, of a coupler without a team. */
pma_status pma_fine_take(pma_coupler *c);

/* ---- recorder.c ----------------------------------------------------------------------------- */

/* The row of time level j, counted from the present, of a grid of `levels` in a macro step. */
size_t pma_recorder_row(const pma_coupler *c, size_t j, size_t levels);

/* From the present on. Does the record have an array that is written? */
bool pma_recorder_begin(pma_coupler *c, const pma_record *record);

/* Records the end of the fine step at hand. */
void pma_recorder_write(pma_coupler *c);

/* What had to wait for members that were closed beside the fine steps: the jumps at `reached`. */
void pma_recorder_complete(const pma_coupler *c);

/* ---- several threads ------------------------------------------------------------------- */

/* Every worker does `task` with those of its members that are `due`, worker 0 too; all wait for the
 * last. What went wrong with the first member, in order, with which it did. (stages.c) */
pma_status pma_teamwork_do(pma_coupler *c, pma_task task, pma_due due);

/* The same in a loop of the caller's where there is no team. (fine.c) */
pma_status pma_share(pma_coupler *c, pma_task task, pma_due due);

/* Waits for a worker and calls the poll meanwhile; gives it work(c, worker). (stages.c) */
void pma_teamwork_await(pma_coupler *c, size_t worker);
void pma_teamwork_post(pma_coupler *c, size_t worker, pma_work work);

/* All workers of the fine steps, to share the work of one member. */
pma_workers pma_teamwork_workers(pma_coupler *c);

/* What executors do after the free problems, the interface problem and the link problems of a fine
 * step, if there are any. */
pma_status pma_executors_begun(pma_coupler *c);
pma_status pma_executors_solved(pma_coupler *c);
pma_status pma_executors_ended(pma_coupler *c);

/* Members beside the fine steps (look_ahead.c). Room for them; allocates. */
pma_status pma_look_ahead_create(pma_coupler *c);
/* Are there any? If not, nothing below has to be called. */
static inline bool pma_look_ahead_is_used(const pma_coupler *c)
{
    return c->roster.fine < c->roster.workers;
}
/* Is the substep from time level j open, or being opened? */
static inline bool pma_look_ahead_has_open(const pma_coupled *m, size_t j)
{
    return m->assigned.opens ? m->assigned.opened.j >= j
                             : m->member.table->opened(m->member.self) > j;
}
/* Is the closing of the substep that ends with this fine step under way? */
static inline bool pma_look_ahead_is_deferred(const pma_coupled *m)
{
    return m->assigned.closes && pma_is_ending(m);
}
/* Is anything under way, or did it fail? */
bool pma_look_ahead_is_busy(const pma_coupler *c);
/* Those that begin a substep, and have it open, begin to open the next one. */
void pma_look_ahead_open(pma_coupler *c);
/* Those that end a substep are awaited, and all if a macro step waits to be committed.
 * PMA_NOT_FINITE when what is awaited was not. */
pma_status pma_look_ahead_await(pma_coupler *c);
/* Those that end a substep have its closing deferred where that is possible. */
void pma_look_ahead_defer(pma_coupler *c);
/* All is awaited after what ended the fine step at hand with this status. A failure that belongs to
 * an earlier time is the one that is returned, and the macro step before committed if it can. */
pma_status pma_look_ahead_end(pma_coupler *c, pma_status status);

#endif
