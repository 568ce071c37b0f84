/* trial.h - is a team faster than its caller alone? Both are timed in turn, again and again, since
 * it depends on what else the machine does.
 *
 * Work comes in pieces that cost about the same. A turn is some pieces of one way; after three
 * turns of each the faster way is taken, for a time that grows while the answer stays the same. */
#ifndef PMA_TRIAL_H
#define PMA_TRIAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { PMA_TURNS = 3 };

/* All zero before the first piece. Times in ns. */
typedef struct {
    bool alone;                    /* how the next piece is to be done */
    bool chosen;                   /* the way that was faster last: alone? */
    size_t turns;                  /* of the trial at hand that are over */
    double cost[2][PMA_TURNS];     /* of a piece: by the team, alone */
    int64_t last;                  /* the end of the last piece */
    int64_t spent, pieces;         /* in the turn at hand, or since the trial */
    int64_t tried, rest, patience; /* the time of a trial; until the next one; multiple of it */
} pma_trial;

/* Pieces begin, or go on after a break. */
void pma_trial_begin(pma_trial *t, int64_t now);

/* A piece has ended. */
void pma_trial_end_piece(pma_trial *t, int64_t now);

#endif
