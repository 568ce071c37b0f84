/* test_core.c - the core alone, against hand calculation, closed forms and a naive second program.
 *
 * Every test is a function whose name is the sentence it checks. Nothing here calls the core to
 * find out what to expect of it: matrices are multiplied and solved by the loops of naive.c. An
 * argument runs those tests alone whose names contain it, "threads" those in which threads work. */
#include <stdio.h>
#include <string.h>

#include "check.h"
#include "tests.h"

size_t checks_failed;

static const test *const LISTS[] = {
    STATUS_TESTS,      FIELDS_TESTS,  SCHEME_TESTS,      MATRIX_TESTS,    KERNEL_TESTS,
    BLAS_TESTS,        FACTOR_TESTS,  STRIPS_TESTS,      SYMBOLIC_TESTS,  PANELS_TESTS,
    LINK_TESTS,        LOAD_TESTS,    RESTORING_TESTS,   SPRINGS_TESTS,   SUBDOMAIN_TESTS,
    PATH_TESTS,        SCRATCH_TESTS, CASES_TESTS,       RECORD_TESTS,    TEAM_TESTS,
    ROSTER_TESTS,      ENERGY_TESTS,  CLOCK_TESTS,       INTERFACE_TESTS, MEMBER_TESTS,
    METHOD_TESTS,      COUPLER_TESTS, STOP_TESTS,        THREADS_TESTS,   SPLIT_TESTS,
    MACRO_TESTS,       NUMERIC_TESTS, UNSYMMETRIC_TESTS, NARROW_TESTS,    BROYDEN_TESTS,
    INTERNAL_TESTS,    NEWTON_TESTS,  ITERATED_TESTS,    DUFFING_TESTS,   ITERATED_RUNS_TESTS,
    ELIMINATION_TESTS, MEMORY_TESTS,  ESTIMATE_TESTS,    SCHEDULES_TESTS, PROCESSES_TESTS,
    PACE_TESTS,        CONTACT_TESTS, SPECIMEN_TESTS,    TRIAL_TESTS,     BALANCE_TESTS,
    DENORMALS_TESTS,
};

static const test *const OF_THREADS[] = {
    NUMERIC_TESTS,       RESTORING_TESTS, SCRATCH_TESTS,     TEAM_TESTS,  ENERGY_TESTS,
    MEMBER_TESTS,        THREADS_TESTS,   SPLIT_TESTS,       MACRO_TESTS, ITERATED_TESTS,
    ITERATED_RUNS_TESTS, PROCESSES_TESTS, ELIMINATION_TESTS, TRIAL_TESTS, DENORMALS_TESTS,
};

static bool passes(const test *t)
{
    checks_failed = 0;
    t->run();
    if (checks_failed > 0)
        printf("FAILED %s: %zu checks\n", t->name, checks_failed);
    return checks_failed == 0;
}

int main(int argc, char **argv)
{
    const char *only = argc > 1 ? argv[1] : "";
    const bool threads = strcmp(only, "threads") == 0;
    const test *const *lists = threads ? OF_THREADS : LISTS;
    const size_t count = threads ? sizeof OF_THREADS / sizeof *lists : sizeof LISTS / sizeof *lists;
    size_t passed = 0, failed = 0;
    setvbuf(stdout, NULL, _IOLBF, 0); /* what failed is seen even if a later test crashes */
    for (size_t i = 0; i < count; i++) {
        for (const test *t = lists[i]; t->run; t++) {
            if (!threads && !strstr(t->name, only))
                continue;
            if (passes(t))
                passed++;
            else
                failed++;
        }
    }
    printf("%zu passed, %zu failed\n", passed, failed);
    return failed > 0;
}
