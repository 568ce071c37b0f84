/* test_trial.c - which of two ways is faster, by a clock of its own. */
#include <stdbool.h>
#include <stdint.h>

#include "check.h"
#include "tests.h"
#include "workers/trial.h"

/* A piece costs cost[0] by the team and cost[1] alone, in ns. */
typedef struct {
    pma_trial trial;
    int64_t now, cost[2];
    int64_t spent[2]; /* in each of the ways */
} work;

static void do_for(work *w, int64_t duration)
{
    for (const int64_t end = w->now + duration; w->now < end;) {
        const bool alone = w->trial.alone;
        w->now += w->cost[alone];
        w->spent[alone] += w->cost[alone];
        pma_trial_end_piece(&w->trial, w->now);
    }
}

static const int64_t SECOND = 1000000000;

static work set_up(int64_t team, int64_t alone)
{
    work w = {.cost = {team, alone}};
    pma_trial_begin(&w.trial, 0);
    return w;
}

static void the_faster_way_is_taken_and_the_other_tried_for_little_time(void)
{
    for (int64_t piece = 1000; piece <= 100000000; piece *= 10) {
        for (int64_t alone = 0; alone < 2; alone++) {
            work w = set_up(alone ? 2 * piece : piece, alone ? piece : 2 * piece);
            do_for(&w, 100 * SECOND > 2000 * piece ? 10 * SECOND : 2000 * piece);
            CHECK(w.trial.chosen == alone);
            /* the first trial, two thirds of it for the other way, and less than one in 16 later */
            CHECK(16 * w.spent[!alone] < w.now + 16 * 9 * (2 * piece + SECOND / 1000));
        }
    }
}

static void a_choice_follows_what_changes(void)
{
    work w = set_up(1000, 2000);
    do_for(&w, SECOND);
    CHECK(!w.trial.chosen);
    w.cost[0] = 3000; /* another program begins */
    do_for(&w, 4 * SECOND);
    CHECK(w.trial.chosen);
    w.cost[0] = 1000;
    do_for(&w, 4 * SECOND);
    CHECK(!w.trial.chosen);
}

static void a_small_difference_changes_nothing(void)
{
    work w = set_up(1000, 970);
    do_for(&w, SECOND);
    CHECK(!w.trial.chosen);
}

static void a_break_between_pieces_costs_nothing(void)
{
    work w = set_up(1000, 2000);
    for (int i = 0; i < 20000; i++) {
        const bool alone = w.trial.alone;
        pma_trial_begin(&w.trial, w.now);
        do_for(&w, 1);
        w.now += alone ? 0 : SECOND; /* after what the team did */
    }
    CHECK(!w.trial.chosen && w.spent[1] > 0);
}

const test TRIAL_TESTS[] = {
    TEST(the_faster_way_is_taken_and_the_other_tried_for_little_time),
    TEST(a_choice_follows_what_changes),
    TEST(a_small_difference_changes_nothing),
    TEST(a_break_between_pieces_costs_nothing),
    END_OF_TESTS,
};
