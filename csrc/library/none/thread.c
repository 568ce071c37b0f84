/* thread.c - a system without threads, in place of core/workers/thread.c: none is ever started. */
#include "workers/thread.h"

bool pma_thread_start(pma_thread *t, void (*run)(void *ctx), void *ctx)
{
    (void)t, (void)run, (void)ctx;
    return false;
}

void pma_thread_join(pma_thread *t)
{
    (void)t;
}

void pma_thread_lock(pma_thread *t)
{
    (void)t;
}

void pma_thread_unlock(pma_thread *t)
{
    (void)t;
}

void pma_thread_sleep(pma_thread *t)
{
    (void)t;
}

void pma_thread_doze(pma_thread *t, unsigned milliseconds)
{
    (void)t, (void)milliseconds;
}

void pma_thread_wake(pma_thread *t)
{
    (void)t;
}

void pma_thread_yield(void)
{
}

void pma_thread_rest(void)
{
}

long pma_thread_process(void)
{
    return 0;
}

uintptr_t pma_thread_number(void)
{
    return 0;
}

int64_t pma_timer_now(void)
{
    return 0;
}

void pma_timer_sleep(int64_t until)
{
    (void)until;
}
