/* test_member.c - any member will do: the naive one of naive_member.h in the real coupler, alone,
 * beside the core's subdomains, and these alone. */
#include <stdbool.h>
#include <stddef.h>

#include "check.h"
#include "couple/coupler.h"
#include "models.h"
#include "tests.h"

enum { MIXTURES = 1 << SUBDOMAINS };

/* All mixtures of naive members and the core's. */
static void check_mixtures(chain chosen)
{
    for (unsigned mixture = 0; mixture < MIXTURES; mixture++) {
        for (size_t i = 0; i < SUBDOMAINS; i++)
            chosen.naive[i] = mixture >> i & 1;
        check_chain(&chosen);
    }
}

static void members_of_both_kinds_make_the_same_single_steps(void)
{
    check_mixtures((chain){.plan = {{1, 1, 1}, false, false, true, false, false}});
    check_mixtures((chain){.plan = {{1, 6, 2}, false, false, true, true, false}});
    check_mixtures((chain){.plan = {{6, 3, 1}, false, false, true, false, true}});
}

static void members_of_both_kinds_make_the_same_double_steps(void)
{
    check_mixtures((chain){.plan = {{1, 1, 1}, true, false, true, false, false}});
    check_mixtures((chain){.plan = MIXED});
    check_mixtures((chain){.plan = {{2, 6, 3}, true, true, false, false, false}});
    check_mixtures((chain){.plan = {{2, 6, 3}, true, true, true, true, true}});
}

static void members_of_both_kinds_make_the_same_macro_steps(void)
{
    check_mixtures((chain){.plan = {{1, 1, 1}, true, false, true, false, false}, .macro = true});
    check_mixtures((chain){.plan = {{1, 4, 3}, true, false, true, true, false}, .macro = true});
    check_mixtures((chain){.plan = {{3, 5, 2}, false, false, true, false, true}, .macro = true});
}

/* With a worker beside the fine steps, and with members that cannot look ahead: these are done in
 * turn. */
static void members_of_both_kinds_work_in_a_team(void)
{
    for (size_t threads = 2; threads <= 3; threads++) {
        for (int looks_ahead = 0; looks_ahead <= 1; looks_ahead++) {
            check_mixtures((chain){.plan = MIXED, .threads = threads, .looks_ahead = looks_ahead});
            check_mixtures((chain){.plan = {{1, 4, 3}, true, false, true, true, true},
                                   .threads = threads,
                                   .looks_ahead = looks_ahead,
                                   .macro = true});
        }
    }
}

const test MEMBER_TESTS[] = {
    TEST(members_of_both_kinds_make_the_same_single_steps),
    TEST(members_of_both_kinds_make_the_same_double_steps),
    TEST(members_of_both_kinds_make_the_same_macro_steps),
    TEST(members_of_both_kinds_work_in_a_team),
    END_OF_TESTS,
};
