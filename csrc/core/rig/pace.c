#include "rig/pace.h"

#include <assert.h>
#include <math.h>

#include "workers/thread.h"

/* ns between two looks for signals */
enum { NAP = 50000000 };

static int64_t system_now(void *ctx)
{
    (void)ctx;
    return pma_timer_now();
}

static void system_sleep(void *ctx, int64_t until)
{
    (void)ctx;
    pma_timer_sleep(until);
}

const pma_pace_clock pma_pace_system_clock = {.now = system_now, .sleep = system_sleep};

static int64_t now(const pma_pace *p)
{
    return p->clock.now(p->clock.ctx);
}

static double seconds(const pma_pace *p, int64_t t)
{
    return 1e-9 * (double)(t - p->origin);
}

bool pma_pace_wait(pma_pace *p)
{
    assert(p->done < p->rows);
    const int64_t t = now(p);
    if (p->done == 0)
        p->origin = t;
    const int64_t due = p->origin + pma_pace_due(p, p->done);
    if (t >= due)
        return true;
    p->clock.sleep(p->clock.ctx, due - t > NAP ? t + NAP : due);
    return now(p) >= due;
}

void pma_pace_begin(pma_pace *p)
{
    assert(p->done < p->rows);
    for (size_t i = 0; i < p->stamp_count; i++)
        p->stamps[i].commanded = p->stamps[i].returned = PMA_NEVER;
    p->command = now(p);
    p->begun[p->done] = seconds(p, p->command);
    p->shifts[p->done] = 1e-9 * (double)p->shift;
}

/* The first command, the last force */
static void take_stamps(pma_pace *p)
{
    double commanded = NAN, returned = NAN, *values = p->values;
    if (p->columns > 0)
        values += p->done * p->columns;
    for (size_t i = 0; i < p->stamp_count; i++) {
        const pma_stamp *stamp = &p->stamps[i];
        if (stamp->returned != PMA_NEVER) {
            commanded = fmin(commanded, seconds(p, stamp->commanded));
            p->command = stamp->commanded > p->command ? stamp->commanded : p->command;
            returned = fmax(returned, seconds(p, stamp->returned));
            for (size_t k = 0; k < stamp->count; k++) {
                values[k] = stamp->command[k];
                values[stamp->count + k] = stamp->force[k];
            }
        }
        values += 2 * stamp->count;
    }
    p->commanded[p->done] = commanded;
    p->returned[p->done] = returned;
}

/* s += max(e, c + T) - t_(k+1)                                                          (Y11) */
static void shift(pma_pace *p, int64_t end)
{
    const int64_t next = p->command + (int64_t)ceil(p->period);
    p->shift += (next > end ? next : end) - p->origin - pma_pace_due(p, p->done);
}

pma_status pma_pace_end(pma_pace *p)
{
    assert(p->done < p->rows);
    const int64_t t = now(p);
    take_stamps(p);
    p->ended[p->done] = seconds(p, t);
    p->done++;
    if (t - p->origin <= pma_pace_due(p, p->done))
        return PMA_OK;
    if (p->stops)
        return PMA_LATE;
    shift(p, t);
    return PMA_OK;
}
