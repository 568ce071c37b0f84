/* tests.h - the lists of tests, one for each file; test_core.c runs them all. */
#ifndef PMA_TEST_TESTS_H
#define PMA_TEST_TESTS_H

#include <stddef.h>

/* A function whose name is the sentence it checks. */
typedef struct {
    const char *name;
    void (*run)(void);
} test;

#define TEST(name) {#name, name}
#define END_OF_TESTS {NULL, NULL}

extern const test STATUS_TESTS[];
extern const test FIELDS_TESTS[];
extern const test SCHEME_TESTS[];
extern const test MATRIX_TESTS[];
extern const test KERNEL_TESTS[];
extern const test BLAS_TESTS[];
extern const test FACTOR_TESTS[];
extern const test STRIPS_TESTS[];
extern const test SYMBOLIC_TESTS[];
extern const test PANELS_TESTS[];
extern const test ELIMINATION_TESTS[];
extern const test NUMERIC_TESTS[];
extern const test MEMORY_TESTS[];
extern const test UNSYMMETRIC_TESTS[];
extern const test NARROW_TESTS[];
extern const test LINK_TESTS[];
extern const test LOAD_TESTS[];
extern const test RESTORING_TESTS[];
extern const test PATH_TESTS[];
extern const test PACE_TESTS[];
extern const test SPRINGS_TESTS[];
extern const test ESTIMATE_TESTS[];
extern const test SUBDOMAIN_TESTS[];
extern const test SCRATCH_TESTS[];
extern const test CASES_TESTS[];
extern const test RECORD_TESTS[];
extern const test TEAM_TESTS[];
extern const test ROSTER_TESTS[];
extern const test ENERGY_TESTS[];
extern const test CLOCK_TESTS[];
extern const test INTERFACE_TESTS[];
extern const test MEMBER_TESTS[];
extern const test METHOD_TESTS[];
extern const test COUPLER_TESTS[];
extern const test STOP_TESTS[];
extern const test THREADS_TESTS[];
extern const test SPLIT_TESTS[];
extern const test MACRO_TESTS[];
extern const test SCHEDULES_TESTS[];
extern const test PROCESSES_TESTS[];
extern const test BROYDEN_TESTS[];
extern const test INTERNAL_TESTS[];
extern const test NEWTON_TESTS[];
extern const test ITERATED_TESTS[];
extern const test DUFFING_TESTS[];
extern const test ITERATED_RUNS_TESTS[];
extern const test CONTACT_TESTS[];
extern const test BALANCE_TESTS[];
extern const test SPECIMEN_TESTS[];
extern const test TRIAL_TESTS[];
extern const test DENORMALS_TESTS[];

#endif
