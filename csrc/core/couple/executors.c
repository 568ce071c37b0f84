/* executors.c - who does the work of a fine step besides the caller and its team: workers in
 * parallel, which take double steps, and other processes. */
#include "couple/inside.h"

/* Double steps after the next are opened in parallel; processes meet before the multipliers. */
pma_status pma_executors_begun(pma_coupler *c)
{
    if (pma_look_ahead_is_used(c))
        pma_look_ahead_open(c);
    return c->exchange ? pma_exchange_interface(c) : PMA_OK;
}

/* Double steps that end here are awaited, and the macro step before is committed as soon as it is
 * known to be finite in all of them; in several processes, which agree first, at its end. */
static pma_status await_double_steps(pma_coupler *c)
{
    PMA_TRY(pma_look_ahead_await(c));
    if (c->exchange || !pma_is_pending(c) || pma_look_ahead_is_busy(c))
        return PMA_OK;
    pma_recorder_complete(c);
    pma_coupler_commit(c);
    pma_coupler_move_to(c, c->k);
    return PMA_OK;
}

/* Double steps in parallel are awaited, and those that end here deferred. */
pma_status pma_executors_solved(pma_coupler *c)
{
    if (!pma_look_ahead_is_used(c))
        return PMA_OK;
    PMA_TRY(await_double_steps(c));
    pma_look_ahead_defer(c);
    return PMA_OK;
}

pma_status pma_executors_ended(pma_coupler *c)
{
    return c->exchange ? pma_exchange_jumps(c) : PMA_OK;
}
