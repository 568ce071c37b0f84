#include "workers/team.h"

#include <assert.h>
#include <stdatomic.h>

#include "memory.h"
#include "object.h"
#include "workers/denormals.h"
#include "workers/thread.h"

/* How often a waiting thread looks before it sleeps: for some ten microseconds, and then as long
 * again or longer between which others can run. To be woken takes as long. */
enum { LOOKS = 2000, YIELDS = 300 };

/* How long the caller sleeps before it is woken to look at something else. */
enum { LOOK_MILLISECONDS = 20 };

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
    pma_thread thread; /* its lock is for sleeping alone */
    char apart[128];   /* no two workers look at the same cache line */
} seat;

struct pma_team {
    size_t workers;
    size_t made;      /* seats with a thread, from worker 1 on */
    long process;     /* in which they live */
    uintptr_t caller; /* the thread that is worker 0 since it has gathered them */
    bool alone;       /* the caller does all itself */
    seat *seats;      /* of worker 1, 2, ... */
};

pma_status pma_team_create(size_t workers, pma_team **out)
{
    const pma_array arrays[] = {PMA_ARRAY(pma_team, seats, workers), {0}};
    *out = NULL;
    if (workers < 1 || workers > PMA_MOST_WORKERS)
        return PMA_BAD_SIZE;
    *out = pma_object_create(sizeof **out, arrays);
    if (!*out)
        return PMA_NO_MEMORY;
    (*out)->workers = workers;
    return PMA_OK;
}

size_t pma_team_workers(const pma_team *t)
{
    return t->workers;
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
    for (int i = 0; i < LOOKS + YIELDS; i++) {
        if (has_happened(e, memory_order_acquire))
            return true;
        if (i < LOOKS)
            pause_briefly();
        else
            pma_thread_yield();
    }
    return false;
}

/* The thread that changes the count looks at *sleeps afterwards: of the two stores and two loads,
 * all sequentially consistent, one side sees the other. */
static void sleep_until(seat *s, const event *e, atomic_bool *sleeps)
{
    pma_thread_lock(&s->thread);
    atomic_store(sleeps, true);
    while (!has_happened(e, memory_order_seq_cst))
        pma_thread_sleep(&s->thread);
    atomic_store(sleeps, false);
    pma_thread_unlock(&s->thread);
}

/* The same for at most LOOK_MILLISECONDS: has it happened? */
static bool sleep_briefly(seat *s, const event *e, atomic_bool *sleeps)
{
    pma_thread_lock(&s->thread);
    atomic_store(sleeps, true);
    if (!has_happened(e, memory_order_seq_cst))
        pma_thread_doze(&s->thread, LOOK_MILLISECONDS);
    atomic_store(sleeps, false);
    pma_thread_unlock(&s->thread);
    return has_happened(e, memory_order_seq_cst);
}

static void change(seat *s, atomic_uint *count, unsigned value, atomic_bool *sleeps)
{
    atomic_store(count, value);
    if (!atomic_load(sleeps))
        return;
    pma_thread_lock(&s->thread);
    pma_thread_wake(&s->thread);
    pma_thread_unlock(&s->thread);
}

static void serve(void *ctx)
{
    seat *s = ctx;
    (void)pma_denormals_flush();
    for (unsigned done = 0;; done++) {
        const event posted = {&s->posted, done, false};
        if (!spin(&posted))
            sleep_until(s, &posted, &s->worker_sleeps);
        if (!s->work)
            return;
        s->work(s->ctx, s->worker);
        change(s, &s->finished, done + 1, &s->caller_sleeps);
    }
}

/* ---- threads -------------------------------------------------------------------------------- */

/* In a process forked off the threads do not exist, and what they left in their seats is void. */
static void dismiss(pma_team *t)
{
    if (t->process == pma_thread_process()) {
        for (size_t i = 0; i < t->made; i++)
            pma_team_post(t, i + 1, NULL, NULL);
        for (size_t i = 0; i < t->made; i++)
            pma_thread_join(&t->seats[i].thread);
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
    return pma_thread_start(&s->thread, serve, s);
}

pma_status pma_team_gather(pma_team *t)
{
    t->caller = pma_thread_number();
    if (t->made > 0 && t->process == pma_thread_process())
        return PMA_OK;
    t->made = 0;
    t->process = pma_thread_process();
    while (t->made + 1 < t->workers && make_thread(&t->seats[t->made], t->made + 1))
        t->made++;
    if (t->made + 1 == t->workers)
        return PMA_OK;
    dismiss(t);
    return PMA_NO_THREADS;
}

void pma_team_destroy(pma_team *t)
{
    if (t) {
        t->caller = pma_thread_number();
        dismiss(t);
    }
    pma_memory_release(t);
}

/* ---- work ----------------------------------------------------------------------------------- */

void pma_team_let_alone(pma_team *t, bool alone)
{
    t->alone = alone;
}

bool pma_team_is_alone(const pma_team *t)
{
    return t->alone;
}

void pma_team_post(pma_team *t, size_t worker, pma_work work, void *ctx)
{
    assert(worker >= 1 && worker <= t->made && t->caller == pma_thread_number());
    seat *s = &t->seats[worker - 1];
    pma_team_await(t, worker, NULL, NULL);
    s->work = work;
    s->ctx = ctx;
    if (t->alone && work) {
        work(ctx, worker);
        return;
    }
    const unsigned posted = atomic_load_explicit(&s->posted, memory_order_relaxed);
    change(s, &s->posted, posted + 1, &s->worker_sleeps);
}

void pma_team_await(pma_team *t, size_t worker, void (*look)(void *ctx), void *ctx)
{
    assert(worker >= 1 && worker <= t->made && t->caller == pma_thread_number());
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
    assert(worker >= 1 && worker < t->workers);
    return t->seats[worker - 1].work == work;
}
