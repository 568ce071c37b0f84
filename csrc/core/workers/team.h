/* team.h - threads that wait for work. The caller is worker 0 and does its own share.
 *
 * Work is handed to a worker by number, so that who does what can be decided once. A worker looks
 * out for work for some microseconds and then sleeps. Worker 0 alone may call these functions. */
#ifndef PMA_TEAM_H
#define PMA_TEAM_H

#include <stdbool.h>
#include <stddef.h>

#include "status.h"

typedef void (*pma_work)(void *ctx, size_t worker);

typedef struct pma_team pma_team;

/* So many workers are never of use, and their number times anything fits. */
#define PMA_MOST_WORKERS ((size_t)1024)

/* A team of so many workers, 1..PMA_MOST_WORKERS; no thread is made yet. */
pma_status pma_team_create(size_t workers, pma_team **out);

/* Ends the threads, which have to be idle; NULL is allowed. */
void pma_team_destroy(pma_team *t);

/* Makes the threads if they are not there: at first use, or in a process forked off since.
 * PMA_NO_THREADS when the system refuses; the team is as before then. */
pma_status pma_team_gather(pma_team *t);

/* Worker 1, 2, ... begins with work(ctx, worker), having finished what it was given before. */
void pma_team_post(pma_team *t, size_t worker, pma_work work, void *ctx);

/* Returns when the worker has finished what it was given, at once if that was nothing. */
void pma_team_await(pma_team *t, size_t worker);

/* The same if this is what it was given last; one that does something else is not waited for. */
void pma_team_await_if(pma_team *t, size_t worker, pma_work work);

#endif
