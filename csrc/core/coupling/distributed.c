/* distributed.c - the schedules "pm" and "gc" with members in other processes.
 *
 * To be read with fine.c: between the stages of a fine step the processes meet. Members beside the
 * fine steps (look_ahead.c) work on meanwhile, but all have arrived at the end of a macro step
 * before the processes agree to commit it. */
#include "coupling/schedule.h"

size_t pma_fine_pieces(const pma_coupled *m, pma_piece *pieces)
{
    pieces[0] = (pma_piece){.kind = PMA_FREE_VELOCITY, .j = m->now.j + 1};
    return m->now.phase == 1 ? 1 : 0;
}

static size_t interface_pieces(const pma_coupler *c, const pma_coupled *m, size_t round,
                               pma_piece *pieces)
{
    (void)c, (void)round;
    return pma_fine_pieces(m, pieces);
}

static pma_status fine_step(pma_coupler *c)
{
    pma_status status = pma_fine_begin(c);
    if (status == PMA_OK)
        status = pma_exchange_interface(c);
    if (status == PMA_OK)
        status = pma_fine_solve(c);
    if (status == PMA_OK && pma_look_ahead_is_used(c))
        status = pma_look_ahead_await(c);
    if (status == PMA_OK)
        status = pma_fine_end(c);
    if (status == PMA_OK)
        status = pma_exchange_jumps(c);
    return status;
}

/* What failed beside the fine steps is known before the processes meet again. */
static pma_status fine_steps(pma_coupler *c)
{
    const pma_status status = pma_fine_steps(c, fine_step);
    return status == PMA_OK ? PMA_OK : pma_look_ahead_end(c, status);
}

const pma_schedule pma_distributed_schedule = {.check = pma_fine_check,
                                               .instants = pma_fine_instants,
                                               .duty = pma_fine_duty_aside,
                                               .step = fine_steps,
                                               .interface_pieces = interface_pieces,
                                               .move_to = pma_coupler_move_to,
                                               .rebases = true};
