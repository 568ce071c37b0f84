/* coupler.h - the schedule: GC-alpha, PM-alpha and macro coupling of any number of subdomains.
 *
 * The first two differ in who takes double steps, the third in when the interface is solved for:
 * at every fine instant or once in a macro step. The macro step is the unit of commit: whatever
 * ends an advance early, the coupler then stands at the last whole macro step. */
#ifndef PMA_COUPLER_H
#define PMA_COUPLER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/factor.h"
#include "coupling/record.h"
#include "member/load.h"
#include "member/subdomain.h"
#include "status.h"

/* Prescribed velocity: sum_i L_i v_i = g(t) in some rows, where the others have 0.        (G1) */
typedef struct {
    const int64_t *rows; /* load.n rows, each in 0..p-1 */
    pma_load load;       /* g(t), as a load on these rows, at every interface instant; not called */
} pma_motion;

/* What a coupler is made of. Subdomains and arrays are the caller's, who keeps them alive. */
typedef struct {
    size_t count;           /* subdomains */
    pma_subdomain **subdomains;
    size_t p;               /* interface conditions */
    pma_factor H_start;     /* (18), everybody single: the first macro step */
    pma_factor H;           /* (18), double steps where they are taken: from the second on */
    double dt;              /* macro step */
    bool rebased;           /* (S3) after the first macro step, else the plain start */
    bool macro;             /* macro coupling: any substeps; H of (M4); double without substeps */
    size_t motion_count;
    pma_motion *motions;
    size_t threads;         /* at most so many share the work; 0 stands for 1 */
    bool worthwhile;        /* fewer of them where they would not pay, see roster.h */
} pma_coupler_parts;

/* Asked between fine steps, when about `entries` matrix entries were read since; true: stop. */
typedef struct {
    bool (*stop)(void *ctx);
    void *ctx;
    size_t entries;
} pma_poll;

typedef struct pma_coupler pma_coupler;

/* Own steps of a run that can be counted: up to here a double counts them exactly too. */
#define PMA_MOST_STEPS ((int64_t)1 << 53)

/* What pma_coupler_failed returns when it was the interface problem itself. */
#define PMA_INTERFACE SIZE_MAX

pma_status pma_coupler_create(const pma_coupler_parts *parts, pma_coupler **out);
void pma_coupler_destroy(pma_coupler *c); /* NULL is allowed */

/* Another g(t) for a prescribed motion, on as many rows as before. */
void pma_coupler_set_motion(pma_coupler *c, size_t i, pma_load load);

/* Stands at macro step `step_count` with lam and the prescribed velocities g (p each, 0 where
 * none is). At 0 the subdomains have been started with the same lam; later their nodes have been
 * written. */
void pma_coupler_start(pma_coupler *c, int64_t step_count, const double *lam, const double *g);

/* `steps` macro steps, recorded if record is not NULL. PMA_NOT_READY before a start,
 * PMA_NOT_FINITE, PMA_FORCE_FAILED and PMA_RESTORING_FAILED (pma_coupler_failed says where),
 * PMA_STOPPED, and PMA_NO_THREADS before the first step. Does not allocate, but for the threads
 * when they are not there yet. */
pma_status pma_coupler_advance(pma_coupler *c, int64_t steps, const pma_record *record,
                               const pma_poll *poll);

/* Writes the present into row 0 of every array of the record. */
void pma_coupler_record_present(const pma_coupler *c, const pma_record *record);

/* Interface problems in a macro step: the largest number of substeps; one in macro coupling. */
size_t pma_coupler_instants(const pma_coupler *c);
int64_t pma_coupler_step_count(const pma_coupler *c);
/* So many macro steps that the own steps of nobody in them are more than can be counted. */
int64_t pma_coupler_most_steps(const pma_coupler *c);
size_t pma_coupler_threads(const pma_coupler *c); /* that share the work, at least 1 */
const double *pma_coupler_multipliers(const pma_coupler *c); /* p, of the present */
const double *pma_coupler_prescribed(const pma_coupler *c);  /* p, g of the present */
/* The subdomain whose function failed, or where a value was first not finite; of several in the
 * same fine step, the first in order. */
size_t pma_coupler_failed(const pma_coupler *c);
/* As given, but without the list of subdomains, which the coupler keeps in its own way. */
const pma_coupler_parts *pma_coupler_get_parts(const pma_coupler *c);

#endif
