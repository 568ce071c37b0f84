/* test_team.c - threads that wait for work: all of it is done, once each, and they end. */
#define _POSIX_C_SOURCE 200809L
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <time.h>

#if !defined(_WIN32)
#include <pthread.h>
#include <signal.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>
#endif

#include "check.h"
#include "tests.h"
#include "workers/team.h"

enum { WORKERS = 4, ROUNDS = 2000 };

/* Plain numbers: what a worker writes, the caller may read after it has awaited it, and the other
 * way round. ThreadSanitizer watches. */
typedef struct {
    size_t round, done[WORKERS], seen[WORKERS];
} board;

static void count(void *ctx, size_t worker)
{
    board *b = ctx;
    b->done[worker]++;
    b->seen[worker] = b->round;
}

static void sleep_a_little(void)
{
    nanosleep(&(struct timespec){0, 2000000}, NULL);
}

static void check_round(pma_team *t, board *b)
{
    b->round++;
    for (size_t w = 1; w < WORKERS; w++)
        pma_team_post(t, w, count, b);
    for (size_t w = 1; w < WORKERS; w++)
        pma_team_await(t, w, NULL, NULL);
    for (size_t w = 1; w < WORKERS; w++) {
        CHECK_INT(b->done[w], b->round);
        CHECK_INT(b->seen[w], b->round);
    }
}

static void every_worker_does_all_that_is_posted_once(void)
{
    pma_team *t;
    board b = {0};
    CHECK_STATUS(pma_team_create(WORKERS, &t), PMA_OK);
    CHECK_STATUS(pma_team_gather(t), PMA_OK);
    CHECK_STATUS(pma_team_gather(t), PMA_OK);
    for (size_t round = 0; round < ROUNDS; round++)
        check_round(t, &b);
    pma_team_destroy(t);
}

static void workers_that_have_fallen_asleep_are_woken(void)
{
    pma_team *t;
    board b = {0};
    CHECK_STATUS(pma_team_create(WORKERS, &t), PMA_OK);
    CHECK_STATUS(pma_team_gather(t), PMA_OK);
    for (size_t round = 0; round < 10; round++) {
        check_round(t, &b);
        sleep_a_little();
    }
    pma_team_destroy(t);
}

static void work_slowly(void *ctx, size_t worker)
{
    sleep_a_little();
    count(ctx, worker);
}

/* Worker 1 has something long to do, the others are not held up by it. */
static void one_worker_is_awaited_apart_from_the_others(void)
{
    pma_team *t;
    board b = {0};
    CHECK_STATUS(pma_team_create(WORKERS, &t), PMA_OK);
    CHECK_STATUS(pma_team_gather(t), PMA_OK);
    pma_team_await(t, 1, NULL, NULL); /* nothing was posted */
    for (size_t k = 1; k <= 5; k++) {
        pma_team_post(t, 1, work_slowly, &b);
        pma_team_post(t, 2, count, &b);
        pma_team_post(t, 2, count, &b); /* waits for the first */
        pma_team_await(t, 2, NULL, NULL);
        CHECK_INT(b.done[2], 2 * k);
        pma_team_await(t, 1, NULL, NULL);
        CHECK_INT(b.done[1], k);
    }
    pma_team_destroy(t);
}

/* A caller that waited for this would never come to release it: it gives up after a minute, and
 * what the test checks then is false. */
static void work_until_released(void *ctx, size_t worker)
{
    (void)worker;
    for (int i = 0; i < 30000 && !atomic_load((atomic_bool *)ctx); i++)
        sleep_a_little();
}

static void a_worker_that_does_something_else_need_not_be_awaited(void)
{
    pma_team *t;
    board b = {0};
    atomic_bool released = false;
    CHECK_STATUS(pma_team_create(WORKERS, &t), PMA_OK);
    CHECK_STATUS(pma_team_gather(t), PMA_OK);
    CHECK(!pma_team_is_at(t, 1, count));
    pma_team_post(t, 1, work_until_released, &released);
    pma_team_post(t, 2, count, &b);
    CHECK(pma_team_is_at(t, 1, work_until_released));
    for (size_t w = 1; w < WORKERS; w++) {
        if (pma_team_is_at(t, w, count))
            pma_team_await(t, w, NULL, NULL);
    }
    CHECK_INT(b.done[2], 1);
    atomic_store(&released, true);
    CHECK(pma_team_is_at(t, 1, work_until_released));
    pma_team_await(t, 1, NULL, NULL);
    pma_team_destroy(t);
}

/* ---- looking at something else meanwhile ---------------------------------------------------- */

static void count_look(void *ctx)
{
    ++*(size_t *)ctx;
}

static void a_wait_for_work_that_is_finished_does_not_look(void)
{
    pma_team *t;
    board b = {0};
    size_t looks = 0;
    CHECK_STATUS(pma_team_create(2, &t), PMA_OK);
    CHECK_STATUS(pma_team_gather(t), PMA_OK);
    pma_team_await(t, 1, count_look, &looks); /* nothing was posted */
    for (size_t k = 0; k < 100; k++) {
        pma_team_post(t, 1, count, &b);
        pma_team_await(t, 1, NULL, NULL);
        pma_team_await(t, 1, count_look, &looks);
    }
    CHECK_INT(b.done[1], 100);
    CHECK_INT(looks, 0);
    pma_team_destroy(t);
}

/* Looks, of which the third releases the work: a wait without them would last a minute. */
typedef struct {
    atomic_bool released;
    size_t looks;
} releaser;

static void look_and_release(void *ctx)
{
    releaser *r = ctx;
    if (++r->looks == 3)
        atomic_store(&r->released, true);
}

static void a_long_wait_looks_at_something_else_which_can_end_the_work(void)
{
    pma_team *t;
    CHECK_STATUS(pma_team_create(2, &t), PMA_OK);
    CHECK_STATUS(pma_team_gather(t), PMA_OK);
    for (size_t k = 0; k < 2; k++) {
        releaser r = {false, 0};
        pma_team_post(t, 1, work_until_released, &r.released);
        pma_team_await(t, 1, look_and_release, &r);
        CHECK(atomic_load(&r.released));
    }
    pma_team_destroy(t);
}

/* ---- sizes ----------------------------------------------------------------------------------- */

static void a_team_of_no_workers_or_of_too_many_is_refused(void)
{
    pma_team *t;
    CHECK_STATUS(pma_team_create(0, &t), PMA_BAD_SIZE);
    CHECK(t == NULL);
    CHECK_STATUS(pma_team_create(PMA_MOST_WORKERS + 1, &t), PMA_BAD_SIZE);
    pma_team_destroy(NULL);
    CHECK_STATUS(pma_team_create(1, &t), PMA_OK); /* the caller alone */
    CHECK_STATUS(pma_team_gather(t), PMA_OK);
    pma_team_destroy(t);
    CHECK_STATUS(pma_team_create(2, &t), PMA_OK); /* never gathered */
    pma_team_destroy(t);
}

#if !defined(_WIN32)

/* ---- signals -------------------------------------------------------------------------------- */

static void read_mask(void *ctx, size_t worker)
{
    (void)worker;
    pthread_sigmask(SIG_BLOCK, NULL, ctx);
}

/* A signal for the process goes to the thread that called; one that a fault of a worker raises has
 * to reach the worker itself, or a handler that reports it is never run. */
static void workers_take_signals_of_their_own_faults_and_no_others(void)
{
    static const int faults[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL};
    static const int others[] = {SIGINT, SIGTERM, SIGALRM, SIGHUP, SIGCHLD};
    pma_team *t;
    sigset_t none, before, after, of_worker;
    sigemptyset(&none);
    pthread_sigmask(SIG_SETMASK, &none, &before);
    CHECK_STATUS(pma_team_create(2, &t), PMA_OK);
    CHECK_STATUS(pma_team_gather(t), PMA_OK);
    pthread_sigmask(SIG_SETMASK, &before, &after);
    pma_team_post(t, 1, read_mask, &of_worker);
    pma_team_await(t, 1, NULL, NULL);
    for (size_t i = 0; i < sizeof faults / sizeof faults[0]; i++)
        CHECK_INT(sigismember(&of_worker, faults[i]), 0);
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        CHECK_INT(sigismember(&of_worker, others[i]), 1);
        CHECK_INT(sigismember(&after, others[i]), 0); /* the caller's are as they were */
    }
    pma_team_destroy(t);
}

/* ---- processes ------------------------------------------------------------------------------- */

/* ThreadSanitizer does not know threads made after a fork. */
#if defined(__SANITIZE_THREAD__)
enum { THREADS_AFTER_FORK = 0 };
#else
enum { THREADS_AFTER_FORK = 1 };
#endif

/* The child: true if a team that was gathered before the fork works there, and can be destroyed. */
static bool works_after_fork(pma_team *t, bool gather)
{
    board b = {0};
    if (gather) {
        if (pma_team_gather(t) != PMA_OK)
            return false;
        for (size_t w = 1; w < WORKERS; w++)
            pma_team_post(t, w, count, &b);
        for (size_t w = 1; w < WORKERS; w++)
            pma_team_await(t, w, NULL, NULL);
    }
    pma_team_destroy(t);
    return b.done[1] == gather && b.done[WORKERS - 1] == gather;
}

static void a_process_forked_off_has_threads_of_its_own(void)
{
    for (int gather = 0; gather <= THREADS_AFTER_FORK; gather++) {
        pma_team *t;
        board b = {0};
        int status = -1;
        CHECK_STATUS(pma_team_create(WORKERS, &t), PMA_OK);
        CHECK_STATUS(pma_team_gather(t), PMA_OK);
        check_round(t, &b);
        const pid_t child = fork();
        if (child == 0) {
            alarm(60); /* a child that hangs ends */
            _exit(works_after_fork(t, gather) ? 7 : 1);
        }
        CHECK(waitpid(child, &status, 0) == child);
        CHECK(WIFEXITED(status) && WEXITSTATUS(status) == 7);
        check_round(t, &b); /* the parent goes on */
        pma_team_destroy(t);
    }
}

#endif

/* ---- all of them ---------------------------------------------------------------------------- */

const test TEAM_TESTS[] = {
    TEST(every_worker_does_all_that_is_posted_once),
    TEST(workers_that_have_fallen_asleep_are_woken),
    TEST(one_worker_is_awaited_apart_from_the_others),
    TEST(a_worker_that_does_something_else_need_not_be_awaited),
    TEST(a_wait_for_work_that_is_finished_does_not_look),
    TEST(a_long_wait_looks_at_something_else_which_can_end_the_work),
    TEST(a_team_of_no_workers_or_of_too_many_is_refused),
#if !defined(_WIN32)
    TEST(workers_take_signals_of_their_own_faults_and_no_others),
    TEST(a_process_forked_off_has_threads_of_its_own),
#endif
    END_OF_TESTS,
};
