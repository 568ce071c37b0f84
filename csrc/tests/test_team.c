/* test_team.c - threads that wait for work: all of it is done, once each, and they end. */
#define _POSIX_C_SOURCE 200809L
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "check.h"
#include "tests.h"
#include "workers/team.h"

enum { WORKERS = 4, ROUNDS = 5000 };

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
        pma_team_await(t, w);
    for (size_t w = 1; w < WORKERS; w++) {
        CHECK_INT(b->done[w], b->round);
        CHECK_INT(b->seen[w], b->round);
    }
}

static void everybody_does_all_that_is_posted_once(void)
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

static void those_who_have_fallen_asleep_are_woken(void)
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
    pma_team_await(t, 1); /* nothing was posted */
    for (size_t k = 1; k <= 5; k++) {
        pma_team_post(t, 1, work_slowly, &b);
        pma_team_post(t, 2, count, &b);
        pma_team_post(t, 2, count, &b); /* waits for the first */
        pma_team_await(t, 2);
        CHECK_INT(b.done[2], 2 * k);
        pma_team_await(t, 1);
        CHECK_INT(b.done[1], k);
    }
    pma_team_destroy(t);
}

/* A caller that waited for this would never come to tell it. */
static void work_until_told(void *ctx, size_t worker)
{
    (void)worker;
    while (!atomic_load((atomic_bool *)ctx))
        sleep_a_little();
}

static void who_does_something_else_is_not_waited_for(void)
{
    pma_team *t;
    board b = {0};
    atomic_bool told = false;
    CHECK_STATUS(pma_team_create(WORKERS, &t), PMA_OK);
    CHECK_STATUS(pma_team_gather(t), PMA_OK);
    pma_team_post(t, 1, work_until_told, &told);
    pma_team_post(t, 2, count, &b);
    for (size_t w = 1; w < WORKERS; w++)
        pma_team_await_if(t, w, count);
    CHECK_INT(b.done[2], 1);
    atomic_store(&told, true);
    pma_team_await_if(t, 1, work_until_told);
    pma_team_destroy(t);
}

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
            pma_team_await(t, w);
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

/* ---- all of them ----------------------------------------------------------------------------- */

const test TEAM_TESTS[] = {
    TEST(everybody_does_all_that_is_posted_once),
    TEST(those_who_have_fallen_asleep_are_woken),
    TEST(one_worker_is_awaited_apart_from_the_others),
    TEST(who_does_something_else_is_not_waited_for),
    TEST(a_team_of_no_workers_or_of_too_many_is_refused),
    TEST(a_process_forked_off_has_threads_of_its_own),
    END_OF_TESTS,
};
