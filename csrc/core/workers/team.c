#define _POSIX_C_SOURCE 200809L
#include "workers/team.h"

#include <assert.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

/* How often a waiting thread looks before it sleeps: some ten to a hundred microseconds. */
enum { LOOKS = 2000 };

/* How long the caller sleeps before it is woken to look at something else. */
enum { LOOK_NANOSECONDS = 20000000 };

/* Informs the processor that a thread is only waiting. */
#if defined(__x86_64__) || defined(__i386__)
static void pause_briefly(void)
{
    __builtin_ia32_pause();
}
#elif defined(__aarch64__)
static void pause_briefly(void)
{
    __asm__ volatile("yield");
}
#else
static void pause_briefly(void)
{
}
#endif

/* Where work is posted for one worker. `posted` is written by worker 0, `finished` by the worker,
 * each after what it announces; work is outstanding while they differ. */
typedef struct {
    atomic_uint posted, finished;
    atomic_bool worker_sleeps, caller_sleeps;
    pma_work work; /* NULL: the thread ends */
    void *ctx;
    size_t worker;
    pthread_mutex_t mutex; /* for sleeping alone */
    pthread_cond_t changed;
    pthread_t thread;
    char apart[128]; /* no two workers look at the same cache line */
} seat;

struct pma_team {
    size_t workers;
    size_t made;   /* seats with a thread, from worker 1 on */
    pid_t process; /* in which they live */
    seat *seats;   /* of worker 1, 2, ... */
};

pma_status pma_team_create(size_t workers, pma_team **out)
{
    *out = NULL;
    if (workers < 1 || workers > PMA_MOST_WORKERS)
        return PMA_BAD_SIZE;
    pma_team *t = calloc(1, sizeof *t);
    if (!t)
        return PMA_NO_MEMORY;
    t->workers = workers;
    t->seats = calloc(workers, sizeof *t->seats);
    if (!t->seats) {
        free(t);
        return PMA_NO_MEMORY;
    }
    *out = t;
    return PMA_OK;
}

/* ---- waiting -------------------------------------------------------------------------------- */

/* What a waiting thread waits for: that *count is (not) `value`. */
typedef struct {
    atomic_uint *count;
    unsigned value;
    bool equal;
} event;

static bool has_happened(const event *e, memory_order order)
{
    return (atomic_load_explicit(e->count, order) == e->value) == e->equal;
}

static bool spin(const event *e)
{
    for (int i = 0; i < LOOKS; i++) {
        if (has_happened(e, memory_order_acquire))
            return true;
        pause_briefly();
    }
    return false;
}

/* The thread that changes the count looks at *sleeps afterwards: of the two stores and two loads,
 * all sequentially consistent, one side sees the other. */
static void sleep_until(seat *s, const event *e, atomic_bool *sleeps)
{
    pthread_mutex_lock(&s->mutex);
    atomic_store(sleeps, true);
    while (!has_happened(e, memory_order_seq_cst))
        pthread_cond_wait(&s->changed, &s->mutex);
    atomic_store(sleeps, false);
    pthread_mutex_unlock(&s->mutex);
}

/* The same for at most LOOK_NANOSECONDS: has it happened? */
static bool sleep_briefly(seat *s, const event *e, atomic_bool *sleeps)
{
    struct timespec end;
    int waited = 0;
    clock_gettime(CLOCK_REALTIME, &end);
    end.tv_nsec += LOOK_NANOSECONDS;
    end.tv_sec += end.tv_nsec / 1000000000;
    end.tv_nsec %= 1000000000;
    pthread_mutex_lock(&s->mutex);
    atomic_store(sleeps, true);
    while (!has_happened(e, memory_order_seq_cst) && waited == 0)
        waited = pthread_cond_timedwait(&s->changed, &s->mutex, &end);
    atomic_store(sleeps, false);
    pthread_mutex_unlock(&s->mutex);
    return has_happened(e, memory_order_seq_cst);
}

static void change(seat *s, atomic_uint *count, unsigned value, atomic_bool *sleeps)
{
    atomic_store(count, value);
    if (!atomic_load(sleeps))
        return;
    pthread_mutex_lock(&s->mutex);
    pthread_cond_broadcast(&s->changed);
    pthread_mutex_unlock(&s->mutex);
}

static void *serve(void *arg)
{
    seat *s = arg;
    for (unsigned done = 0;; done++) {
        const event posted = {&s->posted, done, false};
        if (!spin(&posted))
            sleep_until(s, &posted, &s->worker_sleeps);
        if (!s->work)
            return NULL;
        s->work(s->ctx, s->worker);
        change(s, &s->finished, done + 1, &s->caller_sleeps);
    }
}

/* ---- threads -------------------------------------------------------------------------------- */

/* In a process forked off the threads do not exist, and what they left in their seats is void. */
static void dismiss(pma_team *t)
{
    if (t->process == getpid()) {
        for (size_t i = 0; i < t->made; i++)
            pma_team_post(t, i + 1, NULL, NULL);
        for (size_t i = 0; i < t->made; i++) {
            pthread_join(t->seats[i].thread, NULL);
            pthread_cond_destroy(&t->seats[i].changed);
            pthread_mutex_destroy(&t->seats[i].mutex);
        }
    }
    t->made = 0;
}

static bool make_thread(seat *s, size_t worker)
{
    atomic_init(&s->posted, 0);
    atomic_init(&s->finished, 0);
    atomic_init(&s->worker_sleeps, false);
    atomic_init(&s->caller_sleeps, false);
    s->worker = worker;
    if (pthread_mutex_init(&s->mutex, NULL) != 0)
        return false;
    if (pthread_cond_init(&s->changed, NULL) != 0) {
        pthread_mutex_destroy(&s->mutex);
        return false;
    }
    if (pthread_create(&s->thread, NULL, serve, s) == 0)
        return true;
    pthread_cond_destroy(&s->changed);
    pthread_mutex_destroy(&s->mutex);
    return false;
}

/* All signals except of a fault of the thread itself, so that a handler can report it. */
static void pick_signals(sigset_t *blocked)
{
    static const int faults[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGTRAP, SIGSYS};
    sigfillset(blocked);
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++)
        sigdelset(blocked, faults[i]);
}

pma_status pma_team_gather(pma_team *t)
{
    sigset_t all, before;
    if (t->made > 0 && t->process == getpid())
        return PMA_OK;
    t->made = 0;
    t->process = getpid();
    pick_signals(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before); /* signals are the caller's; threads inherit it */
    while (t->made + 1 < t->workers && make_thread(&t->seats[t->made], t->made + 1))
        t->made++;
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (t->made + 1 == t->workers)
        return PMA_OK;
    dismiss(t);
    return PMA_NO_THREADS;
}

void pma_team_destroy(pma_team *t)
{
    if (!t)
        return;
    dismiss(t);
    free(t->seats);
    free(t);
}

/* ---- work ----------------------------------------------------------------------------------- */

void pma_team_post(pma_team *t, size_t worker, pma_work work, void *ctx)
{
    assert(worker >= 1 && worker <= t->made);
    seat *s = &t->seats[worker - 1];
    pma_team_await(t, worker, NULL, NULL);
    s->work = work;
    s->ctx = ctx;
    const unsigned posted = atomic_load_explicit(&s->posted, memory_order_relaxed);
    change(s, &s->posted, posted + 1, &s->worker_sleeps);
}

void pma_team_await(pma_team *t, size_t worker, void (*look)(void *ctx), void *ctx)
{
    seat *s = &t->seats[worker - 1];
    const unsigned posted = atomic_load_explicit(&s->posted, memory_order_relaxed);
    const event finished = {&s->finished, posted, true};
    if (spin(&finished))
        return;
    if (!look) {
        sleep_until(s, &finished, &s->caller_sleeps);
        return;
    }
    while (!sleep_briefly(s, &finished, &s->caller_sleeps))
        look(ctx);
}

bool pma_team_is_at(const pma_team *t, size_t worker, pma_work work)
{
    return t->seats[worker - 1].work == work;
}
