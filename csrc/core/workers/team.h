/* team.h - threads that wait for work. The caller is worker 0 and does its own share.
 *
 * Work is given to a worker by number, so that it can be decided once which worker does what. A
 * worker looks for work for some microseconds and then sleeps. Worker 0 alone may call these
 * functions. */
#ifndef PMA_TEAM_H
#define PMA_TEAM_H

#include <stdbool.h>
#include <stddef.h>

#include "status.h"

typedef void (*pma_work)(void *ctx, size_t worker);

typedef struct pma_team pma_team;

/* More workers are never of use; a multiple of this number does not overflow. */
#define PMA_MOST_WORKERS ((size_t)1024)

/* A team of 1..PMA_MOST_WORKERS workers; no thread is made yet. */
pma_status pma_team_create(size_t workers, pma_team **out);

/* Ends the threads, which have to be idle; NULL is allowed. */
void pma_team_destroy(pma_team *t);

size_t pma_team_workers(const pma_team *t);

/* Makes the threads if they are not there: at first use, or in a process forked off since.
 * PMA_NO_THREADS when the system refuses; the team is as before then. */
pma_status pma_team_gather(pma_team *t);

/* From now on the caller does what it posts itself, at once, in place of the workers; or not. */
void pma_team_let_alone(pma_team *t, bool alone);
bool pma_team_is_alone(const pma_team *t);

/* Worker 1, 2, ... begins with work(ctx, worker), having finished what it was given before. */
void pma_team_post(pma_team *t, size_t worker, pma_work work, void *ctx);

/* Returns when the worker has finished what it was given, at once if that was nothing. While it
 * takes long, look(ctx) is called about every 20 ms; NULL: it is not. */
void pma_team_await(pma_team *t, size_t worker, void (*look)(void *ctx), void *ctx);

/* Is this what the worker was given last? */
bool pma_team_is_at(const pma_team *t, size_t worker, pma_work work);

#endif
