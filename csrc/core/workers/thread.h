/* thread.h - a thread, the lock it sleeps on and a clock: all that the core needs of an operating
 * system.
 *
 * POSIX or Windows, or with PMA_ONE_THREAD none. No other file of the core includes a header that
 * C11 does not have. */
#ifndef PMA_THREAD_H
#define PMA_THREAD_H

#include <stdbool.h>
#include <stdint.h>

#if defined(PMA_ONE_THREAD)
/* nothing: library/none/thread.c starts none */
#elif defined(_WIN32)
#define WIN32_LEAN_AND_MEAN
#include <windows.h>
#else
#include <pthread.h>
#endif

typedef struct {
    void (*run)(void *ctx);
    void *ctx;
#if defined(PMA_ONE_THREAD)
#elif defined(_WIN32)
    HANDLE thread;
    SRWLOCK lock;
    CONDITION_VARIABLE changed;
#else
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t changed;
#endif
} pma_thread;

/* Calls run(ctx) in a new thread, which receives no signals but those of its own faults. False
 * where the system refuses; nothing is left to be released then. */
bool pma_thread_start(pma_thread *t, void (*run)(void *ctx), void *ctx);

/* Returns when run has returned; the thread is released. */
void pma_thread_join(pma_thread *t);

void pma_thread_lock(pma_thread *t);
void pma_thread_unlock(pma_thread *t);

/* With the lock, which is released meanwhile: sleeps until pma_thread_wake, or for the given time.
 * Can return earlier. */
void pma_thread_sleep(pma_thread *t);
void pma_thread_doze(pma_thread *t, unsigned milliseconds);

/* Wakes all that sleep on the lock. */
void pma_thread_wake(pma_thread *t);

/* Lets others run that wait for a processor; without such it returns at once. */
void pma_thread_yield(void);

/* Returns after some ten microseconds, in which others can run. */
void pma_thread_rest(void);

/* The number of this process: another one in a process forked off. */
long pma_thread_process(void);

/* Of the calling thread: the same for no other that is running. */
uintptr_t pma_thread_number(void);

/* ---- a clock that only goes forward, and sleep until a time of it ---------------------------- */

/* ns since some time; the same in all threads. Needs no lock and, where the system maps its clock,
 * no call of it. */
int64_t pma_timer_now(void);

/* Returns at that time, or earlier when a signal arrives. */
void pma_timer_sleep(int64_t until);

#endif
