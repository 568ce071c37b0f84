#include "workers/trial.h"

#include <assert.h>

/* A turn takes a millisecond at least, so that a thread is not just being woken; the share of time
 * that goes to trials is one in LEAST at first, and one in MOST in the end. What is new has to be
 * faster by a twentieth, more than two turns differ without a cause. */
enum { TURN = 1000000, LEAST = 16, MOST = 256 };
static const double FASTER = 0.95;

void pma_trial_begin(pma_trial *t, int64_t now)
{
    t->last = now;
}

/* The one in the middle: a thread that lost its processor in one turn decides nothing. */
static double median(const double *x)
{
    const double low = x[0] < x[1] ? x[0] : x[1], high = x[0] < x[1] ? x[1] : x[0];
    return x[2] < low ? low : x[2] > high ? high : x[2];
}

static void choose(pma_trial *t)
{
    const double present = median(t->cost[t->chosen]), other = median(t->cost[!t->chosen]);
    const bool changes = other < FASTER * present;
    t->chosen = changes ? !t->chosen : t->chosen;
    t->patience = changes || t->patience == 0 ? LEAST : 2 * t->patience;
    t->patience = t->patience > MOST ? MOST : t->patience;
    t->rest = t->patience * t->tried;
    t->tried = 0;
    t->turns = 0;
    t->alone = t->chosen;
}

static void end_turn(pma_trial *t)
{
    t->cost[t->alone][t->turns / 2] = (double)t->spent / (double)t->pieces;
    t->tried += t->spent;
    t->alone = !t->alone;
    if (++t->turns == (size_t)2 * PMA_TURNS)
        choose(t);
}

void pma_trial_end_piece(pma_trial *t, int64_t now)
{
    assert(now >= t->last);
    t->spent += now - t->last;
    t->pieces++;
    t->last = now;
    if (t->spent < (t->rest > TURN ? t->rest : TURN))
        return;
    if (t->rest > 0)
        t->rest = 0; /* the next trial begins, with the way that was taken */
    else
        end_turn(t);
    t->spent = 0;
    t->pieces = 0;
}
