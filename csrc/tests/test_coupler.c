/* test_coupler.c - the coupler as an object, and against the naive program. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "algebra/factor.h"
#include "check.h"
#include "coupling/coupler.h"
#include "member/load.h"
#include "member/subdomain.h"
#include "models.h"
#include "naive.h"
#include "tests.h"

/* ---- the coupler as an object ---------------------------------------------------------------- */

static pma_status status_of(const pma_coupler_parts *parts)
{
    pma_coupler *made = (pma_coupler *)&made;
    const pma_status status = pma_coupler_create(parts, &made);
    CHECK_INT(made != NULL, status == PMA_OK);
    pma_coupler_destroy(made);
    return status;
}

static void a_coupler_with_sizes_that_do_not_agree_is_refused(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    const pma_coupler_parts good = describe_coupler(&m);
    pma_coupler_parts bad[6] = {good, good, good, good, good, good};
    const int64_t ptr[3] = {0, 1, 1};
    const int32_t index = 2;
    CHECK_STATUS(status_of(&good), PMA_OK);
    bad[0].p = 1;
    bad[1].H_start.n = 1;
    bad[2].H_start.nb = 1;
    bad[3].H.n = bad[3].H.nb = 3;
    bad[4].H.nb = 0;
    for (size_t i = 0; i < 5; i++)
        CHECK_STATUS(status_of(&bad[i]), PMA_BAD_SIZE);
    for (int later = 0; later <= 1; later++) {
        bad[5] = good;
        *(later ? &bad[5].H : &bad[5].H_start) =
            (pma_factor){.form = PMA_SPARSE, .n = 2, .nb = 2, .inverse = m.inverse[0],
                         .values = m.R[0], .ptr = ptr, .index = &index};
        CHECK_STATUS(status_of(&bad[5]), PMA_BAD_INDEX);
    }
    destroy_model(&m);
    pma_coupler_destroy(NULL);
}

static void a_motion_of_rows_that_do_not_exist_is_refused(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    const pma_coupler_parts parts = describe_coupler(&m);
    const int64_t many[3] = {0, 1, 0};
    CHECK_STATUS(status_of(&parts), PMA_OK);
    m.moved_row = 2;
    CHECK_STATUS(status_of(&parts), PMA_BAD_INDEX);
    m.moved_row = -1;
    CHECK_STATUS(status_of(&parts), PMA_BAD_INDEX);
    m.motion = (pma_motion){many, {.kind = PMA_LOAD_NONE, .n = 2}};
    CHECK_STATUS(status_of(&parts), PMA_OK);
    m.motion.load.n = 3;
    CHECK_STATUS(status_of(&parts), PMA_BAD_SIZE);
    destroy_model(&m);
}

static void a_coupler_of_a_subdomain_with_other_conditions_is_refused(void)
{
    static model m, n;
    make_chain(&m, MIXED, 1.0);
    make_oscillator(&n, (split){0.1, 1, false, false, TRAPEZOIDAL, CENTRAL_DIFFERENCE});
    pma_coupler_parts parts = describe_coupler(&m);
    m.subdomains[2] = n.parts[0].core;
    CHECK_STATUS(status_of(&parts), PMA_BAD_SIZE);
    m.subdomains[2] = m.parts[2].core;
    CHECK_STATUS(status_of(&parts), PMA_OK);
    destroy_model(&m);
    destroy_model(&n);
}

/* Two single masses without an interface, with these substeps. */
static pma_status status_of_substeps(size_t first, size_t second)
{
    const double H = 1.0;
    part x = one_mass(1.0, 1.0, 0.0, TRAPEZOIDAL, true), y = x;
    x.substeps = first;
    y.substeps = second;
    make_part(&x);
    make_part(&y);
    pma_subdomain *both[2] = {x.core, y.core};
    const pma_factor none = {.form = PMA_DIAGONAL, .inverse = &H};
    const pma_coupler_parts parts = {.count = 2, .subdomains = both, .H_start = none, .H = none,
                                     .dt = 0.1};
    const pma_status status = status_of(&parts);
    pma_subdomain_destroy(x.core);
    pma_subdomain_destroy(y.core);
    return status;
}

static void substeps_that_do_not_divide_the_largest_are_refused(void)
{
    CHECK_STATUS(status_of_substeps(1, 1), PMA_OK);
    CHECK_STATUS(status_of_substeps(3, 6), PMA_OK);
    CHECK_STATUS(status_of_substeps(6, 2), PMA_OK);
    CHECK_STATUS(status_of_substeps(2, 3), PMA_BAD_SIZE);
    CHECK_STATUS(status_of_substeps(6, 4), PMA_BAD_SIZE);
}

static void a_coupler_without_an_initial_state_does_not_run(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    const pma_coupler_parts parts = describe_coupler(&m);
    pma_coupler *fresh = NULL;
    CHECK_STATUS(pma_coupler_create(&parts, &fresh), PMA_OK);
    const snapshot before = present(&m);
    CHECK_STATUS(pma_coupler_advance(fresh, 1, NULL, NULL), PMA_NOT_READY);
    CHECK_STATUS(pma_coupler_advance(fresh, 0, NULL, NULL), PMA_NOT_READY);
    CHECK_INT(pma_coupler_step_count(fresh), 0);
    check_same_present(&m, &before);
    pma_coupler_start(fresh, 0, m.lam0, (double[]){0.0, 0.0});
    CHECK_STATUS(pma_coupler_advance(fresh, 0, NULL, NULL), PMA_OK);
    CHECK_INT(pma_coupler_step_count(fresh), 0);
    CHECK_STATUS(pma_coupler_advance(fresh, 1, NULL, NULL), PMA_OK);
    CHECK_INT(pma_coupler_step_count(fresh), 1);
    pma_coupler_destroy(fresh);
    destroy_model(&m);
}

static void a_started_coupler_shows_its_parts_and_its_multipliers(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    CHECK_INT(pma_coupler_get_parts(m.coupler)->count, 3);
    CHECK_INT(pma_coupler_get_parts(m.coupler)->p, 2);
    CHECK_NEAR(pma_coupler_get_parts(m.coupler)->dt, 0.3, 0.0);
    CHECK_BITS(2, pma_coupler_multipliers(m.coupler), m.lam0);
    destroy_model(&m);
}

/* ---- the schedule, against the naive program ------------------------------------------------- */

/* Both programs, all nodes of all parts and all instants. */
static void check_against_naive_coupler(plan chosen)
{
    static model m;
    static tape t;
    make_chain(&m, chosen, 1.0);
    make_tape(&t, &m, 0, 0);
    run_taped(&m, &t, STEPS);
    naive_run(&m, STEPS);
    for (size_t i = 0; i < m.count; i++) {
        const part *x = &m.parts[i];
        for (size_t row = 0; row <= STEPS * x->substeps; row++) {
            for (size_t k = 0; k < x->n; k++) {
                CHECK_NEAR(t.u[i][row * x->n + k], m.nodes[i][row].u[k], AGREE);
                CHECK_NEAR(t.v[i][row * x->n + k], m.nodes[i][row].v[k], AGREE);
                CHECK_NEAR(t.w[i][row * x->n + k], m.nodes[i][row].w[k], AGREE);
            }
        }
        check_state(x, pma_subdomain_at(x->core, 0), &m.nodes[i][STEPS * x->substeps]);
    }
    for (size_t k = 0; k <= STEPS * m.fine; k++) {
        for (size_t row = 0; row < m.p; row++)
            CHECK_NEAR(t.lam[k * m.p + row], m.lam[k][row], AGREE);
    }
    for (size_t k = 0; k <= STEPS; k++) {
        for (size_t row = 0; row < m.p; row++) {
            double jump = 0.0;
            for (size_t i = 0; i < m.count; i++)
                jump += conditioned(&m.parts[i], row, m.nodes[i][k * m.parts[i].substeps].u);
            CHECK_NEAR(t.displacement[k * m.p + row], jump, AGREE);
        }
    }
    destroy_model(&m);
}

static void gc_is_the_schedule_as_it_is_written(void)
{
    check_against_naive_coupler((plan){{1, 1, 1}, false, false, true, false, false});
    check_against_naive_coupler((plan){{1, 6, 2}, false, false, true, false, false});
    check_against_naive_coupler((plan){{6, 3, 1}, false, false, true, false, false});
    check_against_naive_coupler((plan){{1, 6, 2}, false, false, true, true, false});
}

static void pm_is_the_schedule_as_it_is_written(void)
{
    check_against_naive_coupler((plan){{1, 1, 1}, true, false, true, false, false});
    check_against_naive_coupler((plan){{1, 4, 2}, true, false, true, false, false});
    check_against_naive_coupler((plan){{3, 6, 1}, true, true, true, false, false});
    check_against_naive_coupler(MIXED);
    check_against_naive_coupler((plan){{2, 6, 3}, true, true, false, false, false});
}

static void restoring_forces_and_lagged_damping_stand_where_they_are_written(void)
{
    check_against_naive_coupler((plan){{1, 1, 1}, false, false, true, false, true});
    check_against_naive_coupler((plan){{1, 6, 2}, false, false, true, true, true});
    check_against_naive_coupler((plan){{1, 1, 1}, true, false, true, false, true});
    check_against_naive_coupler((plan){{3, 6, 1}, true, true, true, false, true});
    check_against_naive_coupler((plan){{2, 6, 3}, true, true, true, true, true});
}

/* ---- bit for bit ----------------------------------------------------------------------------- */

static void a_run_of_many_steps_equals_many_runs_of_one(void)
{
    static model m, n;
    static tape t;
    make_chain(&m, MIXED, 1.0);
    make_chain(&n, MIXED, 1.0);
    make_tape(&t, &n, 0, 2);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    for (size_t i = 0; i < STEPS; i++)
        CHECK_STATUS(pma_coupler_advance(n.coupler, 1, &t.record, NULL), PMA_OK);
    const snapshot expected = present(&m);
    check_same_present(&n, &expected);
    CHECK_INT(pma_coupler_step_count(n.coupler), STEPS);
    destroy_model(&m);
    destroy_model(&n);
}

/* Every step is linear in state and load, and a power of two passes every rounding. */
static void scaling_by_a_power_of_two_scales_every_bit(void)
{
    static model m, n;
    make_chain(&m, MIXED, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    for (int k = -60; k <= 60; k += 30) {
        snapshot expected = present(&m);
        for (size_t i = 0; i < expected.count; i++)
            expected.values[i] = ldexp(expected.values[i], k);
        make_chain(&n, MIXED, ldexp(1.0, k));
        CHECK_STATUS(pma_coupler_advance(n.coupler, STEPS, NULL, NULL), PMA_OK);
        check_same_present(&n, &expected);
        destroy_model(&n);
    }
    destroy_model(&m);
}

static void a_second_start_forgets_the_first_run(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    const snapshot expected = present(&m);
    start_model(&m);
    CHECK_INT(pma_coupler_step_count(m.coupler), 0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    check_same_present(&m, &expected);
    destroy_model(&m);
}

static void copy_state(size_t n, const pma_state *from, const pma_state *to)
{
    memcpy(to->u, from->u, n * sizeof(double));
    memcpy(to->v, from->v, n * sizeof(double));
    memcpy(to->w, from->w, n * sizeof(double));
    memcpy(to->a, from->a, n * sizeof(double));
}

/* All nodes of one model into another, which goes on as if it had been there all the time. */
static void check_taken_over(plan chosen, int64_t after)
{
    static model m, n;
    make_chain(&m, chosen, 1.0);
    make_chain(&n, chosen, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, after, NULL, NULL), PMA_OK);
    for (size_t i = 0; i < m.count; i++) {
        const part *x = &m.parts[i];
        const pma_nodes from = pma_subdomain_nodes(x->core);
        const pma_nodes to = pma_subdomain_nodes(n.parts[i].core);
        copy_state(x->n, &from.present, &to.present);
        memcpy(to.vf, from.vf, x->nb * sizeof(double));
        CHECK_INT(from.previous.u != NULL, x->doubled);
        if (x->doubled)
            copy_state(x->n, &from.previous, &to.previous);
    }
    double g[CONDITIONS];
    prescribe(&m, (size_t)after * m.fine, g);
    pma_coupler_start(n.coupler, after, pma_coupler_multipliers(m.coupler), g);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - after, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_coupler_advance(n.coupler, STEPS - after, NULL, NULL), PMA_OK);
    const snapshot expected = present(&m);
    check_same_present(&n, &expected);
    CHECK_INT(pma_coupler_step_count(n.coupler), STEPS);
    destroy_model(&m);
    destroy_model(&n);
}

static void a_run_goes_on_from_nodes_that_were_written(void)
{
    for (int64_t after = 0; after <= 3; after++) {
        check_taken_over(MIXED, after);
        check_taken_over((plan){{1, 4, 2}, true, false, true, false, false}, after);
    }
}

/* Against the naive program: the present, the own node before, and both free velocities. */
static void check_nodes(size_t substeps)
{
    static model m;
    make_chain(&m, (plan){{substeps, 6, 3}, true, true, true, true, false}, 1.0);
    naive_run(&m, 4);
    for (size_t macro = 1; macro <= 4; macro++) {
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
        for (size_t i = 0; i < m.count; i++) {
            const part *x = &m.parts[i];
            const pma_nodes nodes = pma_subdomain_nodes(x->core);
            const node *now = &m.nodes[i][macro * x->substeps];
            check_state(x, &nodes.present, now);
            for (size_t b = 0; b < x->nb; b++)
                CHECK_NEAR(nodes.vf[b], now->vf[x->n - x->nb + b], AGREE);
            if (!x->doubled)
                continue;
            check_state(x, &nodes.previous, now - 1);
            for (size_t b = 0; b < x->nb; b++)
                CHECK_NEAR(nodes.vf_previous[b], (now - 1)->vf[x->n - x->nb + b], AGREE);
        }
    }
    destroy_model(&m);
}

static void the_nodes_of_a_subdomain_are_its_present_and_the_own_node_before(void)
{
    check_nodes(1);
    check_nodes(2);
    check_nodes(3);
    check_nodes(6);
}

/* ---- no allocation in a step ----------------------------------------------------------------- */

/* Without AddressSanitizer nobody counts, and the test says nothing. */
static size_t allocations;

#if defined(__SANITIZE_ADDRESS__)
#define COUNTS_ALLOCATIONS 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define COUNTS_ALLOCATIONS 1
#endif
#endif

#ifdef COUNTS_ALLOCATIONS
/* as <sanitizer/allocator_interface.h> has it, which not every compiler brings along */
int __sanitizer_install_malloc_and_free_hooks(void (*malloced)(const volatile void *, size_t),
                                              void (*freed)(const volatile void *));

static void count_allocation(const volatile void *memory, size_t size)
{
    (void)memory;
    (void)size;
    allocations++;
}

static void ignore_free(const volatile void *memory)
{
    (void)memory;
}

static bool count_allocations(void)
{
    return __sanitizer_install_malloc_and_free_hooks(count_allocation, ignore_free) > 0;
}
#else
static bool count_allocations(void)
{
    return false;
}
#endif

static void a_step_does_not_allocate(void)
{
    static model m;
    static tape t;
    asker a = {0, 0};
    const pma_poll poll = {ask, &a, 0};
    if (!count_allocations()) {
        printf("allocations are counted under AddressSanitizer only\n");
        return;
    }
    make_chain(&m, MIXED, 1.0);
    make_tape(&t, &m, 0, 0);
    CHECK(allocations >= 2 * PARTS + 2); /* the counter counts: a struct and a block for each */
    const size_t before = allocations;
    run_taped(&m, &t, 3);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - 3, NULL, &poll), PMA_OK);
    start_model(&m);
    CHECK_INT(allocations, before);
    destroy_model(&m);
}

/* ---- all of them ----------------------------------------------------------------------------- */

const test COUPLER_TESTS[] = {
    TEST(a_coupler_with_sizes_that_do_not_agree_is_refused),
    TEST(a_motion_of_rows_that_do_not_exist_is_refused),
    TEST(a_coupler_of_a_subdomain_with_other_conditions_is_refused),
    TEST(substeps_that_do_not_divide_the_largest_are_refused),
    TEST(a_coupler_without_an_initial_state_does_not_run),
    TEST(a_started_coupler_shows_its_parts_and_its_multipliers),
    TEST(gc_is_the_schedule_as_it_is_written),
    TEST(pm_is_the_schedule_as_it_is_written),
    TEST(restoring_forces_and_lagged_damping_stand_where_they_are_written),
    TEST(a_run_of_many_steps_equals_many_runs_of_one),
    TEST(scaling_by_a_power_of_two_scales_every_bit),
    TEST(a_second_start_forgets_the_first_run),
    TEST(a_run_goes_on_from_nodes_that_were_written),
    TEST(the_nodes_of_a_subdomain_are_its_present_and_the_own_node_before),
    TEST(a_step_does_not_allocate),
    END_OF_TESTS,
};
