/* coupler.h - any number of subdomains, advanced together: GC-alpha, PM-alpha and macro coupling.
 *
 * The first two differ in which subdomains take double steps, the third in how often the interface
 * problem is solved: in every fine step or once in a macro step. The macro step is the unit of
 * commit: whatever ends an advance early, the coupler is then at the last whole macro step. */
#ifndef PMA_COUPLER_H
#define PMA_COUPLER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "couple/contact.h"
#include "couple/exchange.h"
#include "couple/iteration.h"
#include "forces/load.h"
#include "observe/record.h"
#include "rig/pace.h"
#include "solve/interface.h"
#include "status.h"
#include "subdomain/member.h"

/* When the interface problem is solved, and what the subdomains do in between. */
typedef struct pma_schedule pma_schedule;

extern const pma_schedule pma_fine_schedule;  /* pm and gc: in every fine step */
extern const pma_schedule pma_mean_schedule;  /* once in a macro step, displacements; H of (K4) */
extern const pma_schedule pma_macro_schedule; /* once in a macro step, any substeps; H of (M4) */

extern const pma_schedule pma_contact_schedule; /* pm and gc with unilateral contacts */

/* The same with members that have internal forces, whose steps are iterated by Newton's method. */
extern const pma_schedule pma_iterated_schedule;      /* pm and gc */
extern const pma_schedule pma_shooting_schedule;      /* macro */
extern const pma_schedule pma_mean_shooting_schedule; /* mean */

/* Prescribed velocities: sum_i L_i v_i = g(t) in some rows, 0 in the others.                 (G1)
 * Arrays of the caller, which have to outlive it. */
typedef struct {
    const int64_t *rows; /* load.n rows, each in 0..p-1 */
    pma_load load; /* g(t), as a load on these rows, for every interface problem; not called */
} pma_motion;

/* What a coupler is made of. Members and arrays are the caller's and have to outlive it. */
typedef struct {
    size_t count;              /* subdomains */
    const pma_member *members; /* copied */
    size_t p;                  /* constraints */
    pma_interface H_start;     /* (18), single steps alone: the first macro step */
    pma_interface H;           /* (18), double steps where they are taken: from the second on */
    pma_matrix doubled;        /* mean coupling: the part of H of members with double steps */
    const pma_schedule *schedule;
    const pma_iteration_parts *iteration; /* of the last two schedules, else NULL; copied */
    const pma_exchange_parts *exchange;   /* with members in other processes, else NULL; copied */
    const pma_contact_parts *contact;     /* of the schedule with contacts, else NULL; copied */
    size_t motion_count;
    const pma_motion *motions; /* copied */

    /* options, of the table below */
    double dt;       /* macro step */
    bool rebased;    /* (S3) after the first macro step, else the plain start */
    size_t threads;  /* maximum number, including the caller; 0 stands for 1 */
    bool worthwhile; /* fewer of them where they would not pay, see roster.h */
} pma_coupler_parts;

/* Each option by its name, as a binding is given it. */
typedef struct {
    const char *name;
    enum { PMA_NUMBER, PMA_COUNT, PMA_FLAG } kind; /* double, size_t, bool */
    size_t at;
} pma_option;

static const pma_option PMA_COUPLER_OPTIONS[] = {
    {"dt", PMA_NUMBER, offsetof(pma_coupler_parts, dt)},
    {"rebased", PMA_FLAG, offsetof(pma_coupler_parts, rebased)},
    {"threads", PMA_COUNT, offsetof(pma_coupler_parts, threads)},
    {"worthwhile", PMA_FLAG, offsetof(pma_coupler_parts, worthwhile)}};

/* Called between fine steps (between substeps in macro coupling), when about `entries` matrix
 * entries were read since, and about every 20 ms while the caller waits for another thread; true:
 * stop. It is then not called again in that advance. */
typedef struct {
    bool (*stop)(void *ctx);
    void *ctx;
    size_t entries;
} pma_poll;

typedef struct pma_coupler pma_coupler;

/* Substeps of a run that can be counted: up to here a double counts them exactly too. */
#define PMA_MOST_STEPS ((int64_t)1 << 53)

/* What pma_coupler_failed returns when it was the interface problem itself. */
#define PMA_INTERFACE SIZE_MAX

/* PMA_BAD_SIZE when numbers of constraints or substeps do not agree or the schedule cannot have
 * them, PMA_BAD_STEP when h of a member is not dt / substeps, PMA_BAD_INDEX for a bad motion. Not
 * while a member is stepped by another coupler. */
pma_status pma_coupler_create(const pma_coupler_parts *parts, pma_coupler **out);
void pma_coupler_destroy(pma_coupler *c); /* NULL is allowed */

/* Another g(t) for a prescribed motion, on as many rows as before. */
void pma_coupler_set_motion(pma_coupler *c, size_t i, pma_load load);

/* Macro steps are counted and times taken from macro step `number` at time t, before the next start
 * and until it is set again; from 0 and 0.0 unless it is set. Loads in tables are counted from
 * there too, and the macro step that begins there is the first one of H_start. */
void pma_coupler_set_origin(pma_coupler *c, int64_t number, double t);

/* Fine steps ("pm", "gc") begin at times of a clock from now on, PMA_LATE as pace.h says, and the
 * poll is called before each; NULL: as soon as they can. The pace is the caller's. */
void pma_coupler_set_pace(pma_coupler *c, pma_pace *pace);

/* The present is macro step `step_count` with lam and the prescribed velocities g (p each, 0 where
 * none is), not before the origin. At 0 the subdomains have been started with the same lam; later
 * their time levels have been written. */
void pma_coupler_start(pma_coupler *c, int64_t step_count, const double *lam, const double *g);

/* `steps` macro steps, recorded if record is not NULL. PMA_NOT_READY before a start,
 * PMA_NOT_FINITE, PMA_FORCE_FAILED, PMA_RESTORING_FAILED, PMA_INTERNAL_FAILED, PMA_UNSYMMETRIC,
 * PMA_NOT_CONVERGED and PMA_SINGULAR (pma_coupler_failed says where), PMA_NO_IMPULSES (it is the
 * row of a contact), PMA_STOPPED (possibly with all steps done), PMA_ELSEWHERE (all processes are
 * at the same macro step), and PMA_NO_THREADS before the first step. Does not allocate, but for the
 * threads when they are not there yet. Denormal numbers are zero meanwhile (denormals.h), also in
 * functions of the user, in all threads. */
pma_status pma_coupler_advance(pma_coupler *c, int64_t steps, const pma_record *record,
                               const pma_poll *poll);

/* Writes the present into row 0 of every array of the record. */
void pma_coupler_record_present(const pma_coupler *c, const pma_record *record);

/* ---- a loop outside, which takes one fine step after the other ------------------------------- */

/* A fine step; under macro and mean coupling a macro step. Bitwise those of pma_coupler_advance, of
 * a coupler with one thread, in this process alone. After a failure the present is that of the last
 * macro step. Does not allocate. */
pma_status pma_coupler_take(pma_coupler *c);

/* What is open of the macro step at hand is given up. */
void pma_coupler_discard(pma_coupler *c);

/* The number of fine steps since the present, and the time after them. */
size_t pma_coupler_fine_done(const pma_coupler *c);
double pma_coupler_time(const pma_coupler *c);

/* The substep of member i that the next of these steps is in; true if it begins with it. */
bool pma_coupler_coming(const pma_coupler *c, size_t i, pma_substep *out);

/* What closed with the last of these steps, into row 0 of the record, which may have no jumps. */
void pma_coupler_record_taken(const pma_coupler *c, const pma_record *record);

#define PMA_ALL_WORKERS SIZE_MAX

/* Interface problems in a macro step: the largest number of substeps; one in macro coupling. */
size_t pma_coupler_instants(const pma_coupler *c);
int64_t pma_coupler_step_count(const pma_coupler *c);
int64_t pma_coupler_origin(const pma_coupler *c); /* the macro step at the origin of the clock */
/* The largest number of macro steps in which all substeps can be counted. */
int64_t pma_coupler_most_steps(const pma_coupler *c);
size_t pma_coupler_threads(const pma_coupler *c); /* that share the work, at least 1 */
/* The worker of subdomain i, 0 the caller; PMA_ALL_WORKERS where a range of rows belongs to each of
 * several. */
size_t pma_coupler_worker(const pma_coupler *c, size_t i);
const double *pma_coupler_multipliers(const pma_coupler *c); /* p, of the present */
const double *pma_coupler_prescribed(const pma_coupler *c);  /* p, g of the present */
/* The subdomain whose function failed, or where a value was first not finite; of several in the
 * same fine step, the first in order. */
size_t pma_coupler_failed(const pma_coupler *c);
/* After PMA_ELSEWHERE: the rank in which something failed; this one when the exchange did. */
size_t pma_coupler_failed_rank(const pma_coupler *c);
/* With members in other processes, in all of them: before pma_coupler_record_present, and in place
 * of pma_coupler_advance where that cannot be called. Another status than PMA_OK ends the
 * others. */
pma_status pma_coupler_meet(pma_coupler *c, pma_status status);
/* What belongs to the state beside the arrays of subdomains, to be read, or written after a start:
 *   multipliers, prescribed   p each
 *   moved                     p: what the prescribed velocities have moved since t = 0, if any
 *   end_multipliers           mean coupling: those at the present, from which accelerations are
 *                             recorded, and those before the last ones (p each), and the lengths of
 *                             the last two macro steps (2), 0 where there was none
 *   shooting                  what iterations keep from one macro step to the next, if any
 *   contact                   the last impulses (rows), the obstacles at the present (2 contacts)
 *                             and the sums of impulses since they were recorded last (rows), if any
 * Their number is returned. */
enum { PMA_COUPLER_ARRAYS = 6 };
size_t pma_coupler_arrays(pma_coupler *c, pma_state_array out[PMA_COUPLER_ARRAYS]);
/* Contacts: W (rows x rows) by columns of the first macro step or of the later ones; another
 * obstacle, for as many contacts; and how often the last impulses without friction were solved
 * for. */
const double *pma_coupler_contact_compliance(const pma_coupler *c, bool start, size_t *rows);
const pma_load *pma_coupler_obstacle(const pma_coupler *c); /* NULL without contacts */
void pma_coupler_set_obstacle(pma_coupler *c, pma_load load);
size_t pma_coupler_contacts(const pma_coupler *c);
size_t pma_coupler_contact_turns(const pma_coupler *c);
/* As given, but without the list of members; the motions as they were set last. */
const pma_coupler_parts *pma_coupler_get_parts(const pma_coupler *c);

#endif
