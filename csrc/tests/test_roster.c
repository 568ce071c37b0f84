/* test_roster.c - which worker has which subdomain, from sizes alone. */
#include <stdbool.h>
#include <stddef.h>

#include "check.h"
#include "tests.h"
#include "workers/roster.h"

enum { MANY = 50 };

static pma_duty common(size_t entries, size_t substeps)
{
    return (pma_duty){.entries = entries, .substeps = substeps};
}

static pma_duty of_caller(size_t entries, size_t substeps)
{
    return (pma_duty){.entries = entries, .substeps = substeps, .by_caller = true};
}

static pma_duty parallel(size_t entries, size_t substeps)
{
    return (pma_duty){.entries = entries, .substeps = substeps, .parallel = true};
}

static pma_roster made(size_t count, const pma_duty *duties, size_t workers, bool worthwhile)
{
    pma_roster r;
    CHECK_STATUS(pma_roster_create(count, duties, workers, worthwhile, &r), PMA_OK);
    return r;
}

static size_t worker_of(const pma_roster *r, size_t subdomain)
{
    for (size_t w = 0; w < r->workers; w++) {
        for (size_t i = r->begin[w]; i < r->begin[w + 1]; i++) {
            if (r->order[i] == subdomain)
                return w;
        }
    }
    return r->workers;
}

static void every_subdomain_has_one_worker_and_every_worker_a_subdomain(void)
{
    pma_duty duties[MANY];
    for (size_t i = 0; i < MANY; i++)
        duties[i] = common(1 + (i * 17) % 23, 1 + i % 3);
    for (size_t workers = 1; workers <= MANY + 3; workers++) {
        pma_roster r = made(MANY, duties, workers, false);
        size_t times[MANY] = {0};
        CHECK_INT(r.workers, workers < MANY ? workers : MANY);
        CHECK_INT(r.begin[0], 0);
        CHECK_INT(r.begin[r.workers], MANY);
        for (size_t w = 0; w < r.workers; w++)
            CHECK(r.begin[w + 1] > r.begin[w]);
        for (size_t i = 0; i < MANY; i++)
            times[r.order[i]]++;
        for (size_t i = 0; i < MANY; i++)
            CHECK_INT(times[i], 1);
        pma_roster_destroy(&r);
    }
}

static void the_largest_subdomains_go_to_the_least_loaded_workers(void)
{
    /* 7 | 5; 5 + 4 | 7; 9 | 7 + 3 */
    const pma_duty duties[4] = {common(3, 2), common(5, 2), common(7, 2), common(4, 2)};
    pma_roster r = made(4, duties, 2, false);
    CHECK_INT(worker_of(&r, 2), 0);
    CHECK_INT(worker_of(&r, 0), 0);
    CHECK_INT(worker_of(&r, 1), 1);
    CHECK_INT(worker_of(&r, 3), 1);
    pma_roster_destroy(&r);
}

static void subdomains_with_the_finest_steps_are_balanced_among_themselves(void)
{
    /* by size alone the two fine ones would share a worker, in all fine steps but one */
    const pma_duty duties[3] = {common(1000, 1), common(10, 20), common(12, 20)};
    pma_roster r = made(3, duties, 2, false);
    CHECK(worker_of(&r, 1) != worker_of(&r, 2));
    CHECK_INT(worker_of(&r, 0), worker_of(&r, 1)); /* the smaller of them */
    pma_roster_destroy(&r);
}

static void subdomains_of_the_caller_are_worker_0s_and_the_rest_is_balanced_around_them(void)
{
    const pma_duty duties[4] = {common(9, 1), of_caller(3, 1), of_caller(4, 1), common(2, 1)};
    pma_roster r = made(4, duties, 2, false);
    CHECK_INT(worker_of(&r, 0), 1);
    CHECK_INT(worker_of(&r, 1), 0);
    CHECK_INT(worker_of(&r, 2), 0);
    CHECK_INT(worker_of(&r, 3), 0);
    pma_roster_destroy(&r);
}

static size_t number(size_t count, const pma_duty *duties, size_t workers)
{
    pma_roster r = made(count, duties, workers, true);
    const size_t workers_taken = r.workers;
    pma_roster_destroy(&r);
    return workers_taken;
}

static void several_workers_are_taken_where_they_save_a_fifth(void)
{
    /* (W1) two of e entries: e + meeting against 2 e, so from e = meeting / 0.6 on */
    const size_t border = (size_t)(PMA_MEETING / 0.6);
    const pma_duty below[2] = {common(border - 1, 5), common(border - 1, 5)};
    const pma_duty above[2] = {common(border + 1, 5), common(border + 1, 5)};
    CHECK_INT(number(2, below, 2), 1);
    CHECK_INT(number(2, above, 2), 2);
    CHECK_INT(number(2, above, 1), 1);
    CHECK_INT(number(2, above, 64), 2);
    /* nothing to share: one large, one small */
    const pma_duty alone[2] = {common(100 * border, 1), common(border, 1)};
    CHECK_INT(number(2, alone, 2), 1);
    /* a coarse one cannot pay for the meetings of all fine steps:
     * 3 + 3 + 20 / 10 > 0.8 (6 + 20 / 40) */
    const pma_duty coarse[2] = {common(3 * PMA_MEETING, 1), common(PMA_MEETING / 40, 20)};
    CHECK_INT(number(2, coarse, 2), 1);
    /* three alike for any number of workers from three on */
    const pma_duty large = common(10 * border, 1), three[3] = {large, large, large};
    CHECK_INT(number(3, three, 3), 3);
    CHECK_INT(number(3, three, 8), 3);
}

static void double_step_subdomains_work_beside_the_fine_steps_where_that_pays(void)
{
    const size_t large = 100 * PMA_MEETING;
    /* (W2) max(20, 1) instead of 20 + 1, in hundreds of meetings */
    const pma_duty two[2] = {parallel(20 * large, 1), common(large / 20, 20)};
    pma_roster r = made(2, two, 2, false);
    CHECK_INT(r.fine, 1);
    CHECK_INT(worker_of(&r, 0), 1);
    CHECK_INT(worker_of(&r, 1), 0);
    pma_roster_destroy(&r);
    r = made(2, two, 1, false);
    CHECK_INT(r.fine, 1);
    CHECK_INT(r.workers, 1);
    pma_roster_destroy(&r);
    /* two fine ones, each as much as the coarse one: one worker for all of them is slower */
    const pma_duty three[3] = {parallel(large, 1), common(large, 20), common(large, 20)};
    r = made(3, three, 2, false);
    CHECK_INT(r.fine, 2);
    CHECK(worker_of(&r, 1) != worker_of(&r, 2));
    pma_roster_destroy(&r);
    /* with a third worker there is one for each */
    r = made(3, three, 3, false);
    CHECK_INT(r.fine, 2);
    CHECK_INT(worker_of(&r, 0), 2);
    pma_roster_destroy(&r);
}

static pma_duty divisible(size_t entries, size_t substeps)
{
    return (pma_duty){.entries = entries, .substeps = substeps, .divides = true};
}

static size_t split_of(size_t count, const pma_duty *duties, size_t workers)
{
    pma_roster r = made(count, duties, workers, false);
    const size_t split = r.split;
    pma_roster_destroy(&r);
    return split;
}

static void a_subdomain_that_divides_is_split_from_two_ranges_on(void)
{
    const pma_duty below = divisible(2 * PMA_RANGE - 1, 1), two = divisible(2 * PMA_RANGE, 1),
                   whole = common(20 * PMA_RANGE, 1);
    CHECK(split_of(1, &below, 8) == PMA_NO_SPLIT);
    CHECK(split_of(1, &whole, 8) == PMA_NO_SPLIT);
    CHECK(split_of(1, &two, 1) == PMA_NO_SPLIT);
    CHECK_INT(split_of(1, &two, 8), 0);
    CHECK_INT(number(1, &below, 8), 1);
    CHECK_INT(number(1, &two, 8), 2); /* a worker for each range: 5 + 2 against 0.8 10 meetings */
    const pma_duty five = divisible(5 * PMA_RANGE, 1);
    CHECK_INT(number(1, &five, 8), 5);
    CHECK_INT(number(1, &five, 3), 3);
}

static void a_subdomain_is_split_where_the_others_leave_workers_idle(void)
{
    const size_t e = 10 * PMA_RANGE;
    /* (W3) a half and a small one instead of the whole one beside the small one */
    const pma_duty uneven[2] = {common(e / 10, 1), divisible(e, 1)};
    CHECK_INT(split_of(2, uneven, 2), 1);
    /* each has a worker: to split one only costs a meeting */
    const pma_duty even[2] = {common(e, 1), divisible(e, 1)};
    CHECK(split_of(2, even, 2) == PMA_NO_SPLIT);
    /* of several the one with most to read in a macro step, one at most */
    const pma_duty three[3] = {divisible(e, 1), divisible(e / 2, 20), divisible(e, 2)};
    CHECK_INT(split_of(3, three, 4), 1);
    /* the rest goes on beside it */
    const pma_duty coarse[2] = {parallel(20 * e, 1), divisible(e, 20)};
    pma_roster r = made(2, coarse, 3, false);
    CHECK_INT(r.fine, 2);
    CHECK_INT(r.split, 1);
    CHECK_INT(worker_of(&r, 1), 0);
    CHECK_INT(worker_of(&r, 0), 2);
    pma_roster_destroy(&r);
}

static void there_are_no_workers_without_work(void)
{
    /* 2 ranges of one that divides, but what is not split is all that counts */
    const pma_duty two[2] = {common(100 * PMA_RANGE, 1), divisible(2 * PMA_RANGE, 1)};
    pma_roster r = made(2, two, 3, false);
    CHECK(r.split == PMA_NO_SPLIT);
    CHECK_INT(r.workers, 2);
    pma_roster_destroy(&r);
}

/* ---- all of them ---------------------------------------------------------------------------- */

const test ROSTER_TESTS[] = {
    TEST(every_subdomain_has_one_worker_and_every_worker_a_subdomain),
    TEST(the_largest_subdomains_go_to_the_least_loaded_workers),
    TEST(subdomains_of_the_caller_are_worker_0s_and_the_rest_is_balanced_around_them),
    TEST(subdomains_with_the_finest_steps_are_balanced_among_themselves),
    TEST(double_step_subdomains_work_beside_the_fine_steps_where_that_pays),
    TEST(several_workers_are_taken_where_they_save_a_fifth),
    TEST(a_subdomain_that_divides_is_split_from_two_ranges_on),
    TEST(a_subdomain_is_split_where_the_others_leave_workers_idle),
    TEST(there_are_no_workers_without_work),
    END_OF_TESTS,
};
