#define _POSIX_C_SOURCE 200809L
#include "workers/thread.h"

#if defined(_WIN32)

#include <process.h>

static unsigned __stdcall begin(void *arg)
{
    const pma_thread *t = arg;
    t->run(t->ctx);
    return 0;
}

bool pma_thread_start(pma_thread *t, void (*run)(void *ctx), void *ctx)
{
    *t = (pma_thread){.run = run, .ctx = ctx, .lock = SRWLOCK_INIT};
    InitializeConditionVariable(&t->changed);
    t->thread = (HANDLE)_beginthreadex(NULL, 0, begin, t, 0, NULL);
    return t->thread != NULL;
}

void pma_thread_join(pma_thread *t)
{
    WaitForSingleObject(t->thread, INFINITE);
    CloseHandle(t->thread);
}

void pma_thread_lock(pma_thread *t)
{
    AcquireSRWLockExclusive(&t->lock);
}

void pma_thread_unlock(pma_thread *t)
{
    ReleaseSRWLockExclusive(&t->lock);
}

void pma_thread_sleep(pma_thread *t)
{
    SleepConditionVariableSRW(&t->changed, &t->lock, INFINITE, 0);
}

void pma_thread_doze(pma_thread *t, unsigned milliseconds)
{
    SleepConditionVariableSRW(&t->changed, &t->lock, milliseconds, 0);
}

void pma_thread_wake(pma_thread *t)
{
    WakeAllConditionVariable(&t->changed);
}

void pma_thread_yield(void)
{
    SwitchToThread();
}

void pma_thread_rest(void)
{
    Sleep(1); /* the least there is */
}

long pma_thread_process(void)
{
    return (long)GetCurrentProcessId();
}

uintptr_t pma_thread_number(void)
{
    return GetCurrentThreadId();
}

#else

#include <sched.h>
#include <signal.h>
#include <stddef.h>
#include <time.h>
#include <unistd.h>

static void *begin(void *arg)
{
    const pma_thread *t = arg;
    t->run(t->ctx);
    return NULL;
}

/* All signals except of a fault of the thread itself, so that a handler can report it. */
static void pick_signals(sigset_t *blocked)
{
    static const int faults[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGTRAP, SIGSYS};
    sigfillset(blocked);
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++)
        sigdelset(blocked, faults[i]);
}

/* The new thread inherits the mask; the caller's is as before. */
static int create(pma_thread *t)
{
    sigset_t blocked, before;
    pick_signals(&blocked);
    pthread_sigmask(SIG_SETMASK, &blocked, &before);
    const int failed = pthread_create(&t->thread, NULL, begin, t);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return failed;
}

bool pma_thread_start(pma_thread *t, void (*run)(void *ctx), void *ctx)
{
    t->run = run;
    t->ctx = ctx;
    if (pthread_mutex_init(&t->lock, NULL) != 0)
        return false;
    if (pthread_cond_init(&t->changed, NULL) != 0) {
        pthread_mutex_destroy(&t->lock);
        return false;
    }
    if (create(t) == 0)
        return true;
    pthread_cond_destroy(&t->changed);
    pthread_mutex_destroy(&t->lock);
    return false;
}

void pma_thread_join(pma_thread *t)
{
    pthread_join(t->thread, NULL);
    pthread_cond_destroy(&t->changed);
    pthread_mutex_destroy(&t->lock);
}

void pma_thread_lock(pma_thread *t)
{
    pthread_mutex_lock(&t->lock);
}

void pma_thread_unlock(pma_thread *t)
{
    pthread_mutex_unlock(&t->lock);
}

void pma_thread_sleep(pma_thread *t)
{
    pthread_cond_wait(&t->changed, &t->lock);
}

void pma_thread_doze(pma_thread *t, unsigned milliseconds)
{
    struct timespec end;
    clock_gettime(CLOCK_REALTIME, &end);
    end.tv_sec += milliseconds / 1000;
    end.tv_nsec += milliseconds % 1000 * 1000000L;
    end.tv_sec += end.tv_nsec / 1000000000;
    end.tv_nsec %= 1000000000;
    pthread_cond_timedwait(&t->changed, &t->lock, &end);
}

void pma_thread_wake(pma_thread *t)
{
    pthread_cond_broadcast(&t->changed);
}

void pma_thread_yield(void)
{
    sched_yield();
}

void pma_thread_rest(void)
{
    nanosleep(&(struct timespec){.tv_nsec = 50000}, NULL);
}

long pma_thread_process(void)
{
    return (long)getpid();
}

uintptr_t pma_thread_number(void)
{
    return (uintptr_t)pthread_self();
}

#endif

/* ---- sleeping until a time ------------------------------------------------------------------ */

#if defined(_WIN32)

int64_t pma_timer_now(void)
{
    LARGE_INTEGER count, second;
    QueryPerformanceCounter(&count);
    QueryPerformanceFrequency(&second);
    return (int64_t)(1e9 * ((double)count.QuadPart / (double)second.QuadPart));
}

#if !defined(CREATE_WAITABLE_TIMER_HIGH_RESOLUTION) /* of Windows 10, 1803 */
#define CREATE_WAITABLE_TIMER_HIGH_RESOLUTION 2
#endif

/* Sleep would wake at the next tick of the system, every 15.6 ms as a rule. */
void pma_timer_sleep(int64_t until)
{
    const int64_t left = until - pma_timer_now();
    const LARGE_INTEGER due = {.QuadPart = -(left / 100)}; /* from now on, in 100 ns */
    if (left <= 0)
        return;
    HANDLE timer =
        CreateWaitableTimerExW(NULL, NULL, CREATE_WAITABLE_TIMER_HIGH_RESOLUTION, TIMER_ALL_ACCESS);
    if (timer && SetWaitableTimer(timer, &due, 0, NULL, NULL, FALSE))
        WaitForSingleObject(timer, INFINITE);
    else
        Sleep((DWORD)((left + 999999) / 1000000));
    if (timer)
        CloseHandle(timer);
}

#else

#include <time.h>

enum { SECOND = 1000000000 };

int64_t pma_timer_now(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * SECOND + now.tv_nsec;
}

#if defined(__APPLE__) /* has no clock_nanosleep */

void pma_timer_sleep(int64_t until)
{
    const int64_t left = until - pma_timer_now();
    if (left > 0)
        nanosleep(&(struct timespec){.tv_sec = left / SECOND, .tv_nsec = left % SECOND}, NULL);
}

#else

/* An absolute time: what happens between reading the clock and sleeping is not added. */
void pma_timer_sleep(int64_t until)
{
    const struct timespec end = {.tv_sec = until / SECOND, .tv_nsec = until % SECOND};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &end, NULL);
}

#endif

#endif
