/* test_record.c - which time levels of a run are recorded, and where. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "check.h"
#include "couple/coupler.h"
#include "models.h"
#include "naive.h"
#include "observe/record.h"
#include "observe/selection.h"
#include "subdomain/subdomain.h"
#include "tests.h"

static void the_row_of_a_time_level_follows_from_its_number(void)
{
    const pma_record all = {.begin = 4, .every = 0}, third = {.begin = 4, .every = 3};
    CHECK_INT(pma_record_row(&all, 4, 1, 5), 1);
    CHECK_INT(pma_record_row(&all, 4, 5, 5), 5);
    CHECK_INT(pma_record_row(&all, 6, 2, 5), 12);
    CHECK_INT(pma_record_row(&third, 5, 5, 5), 1); /* macro level 6, row 0 is macro level 4 */
    CHECK_INT(pma_record_row(&third, 8, 5, 5), 2); /* macro level 9 */
    CHECK_INT(pma_record_row(&third, 5, 4, 5), PMA_NO_ROW);
    CHECK_INT(pma_record_row(&third, 4, 5, 5), PMA_NO_ROW);
    CHECK_INT(pma_record_row(&third, 6, 5, 5), PMA_NO_ROW);
    const pma_record begun_at_one = {.begin = 6, .every = 3};
    CHECK_INT(pma_record_row(&begun_at_one, 8, 1, 1), 1);
}

static void rows_of_a_ring_are_used_again_once_they_are_read_and_else_lost(void)
{
    int64_t steps[2] = {-1, -1};
    pma_ring ring = {.size = 2, .steps = steps};
    const pma_record all = {.begin = 4, .every = 0, .ring = &ring};
    for (int64_t macro = 4; macro < 7; macro++) /* there are rows for two of them */
        pma_record_begin(&all, macro);
    CHECK_INT(pma_record_row(&all, 4, 5, 5), 5);
    CHECK_INT(pma_record_row(&all, 5, 1, 5), 6);
    CHECK_INT(pma_record_row(&all, 6, 1, 5), PMA_NO_ROW);
    CHECK_INT(ring.lost, 1);
    atomic_store(&ring.read, 1);
    pma_record_begin(&all, 7); /* in the slot of 5, which is not read */
    atomic_store(&ring.read, 3);
    pma_record_begin(&all, 8);
    CHECK_INT(pma_record_row(&all, 7, 1, 5), PMA_NO_ROW);
    CHECK_INT(pma_record_row(&all, 8, 2, 5), 2);
    CHECK_INT(ring.lost, 2);
    pma_record_end(&all, 9);
    CHECK_INT(ring.written, 9);

    steps[0] = steps[1] = -1;
    atomic_store(&ring.read, 0);
    const pma_record third = {.begin = 4, .every = 3, .ring = &ring};
    for (int64_t macro = 4; macro < 12; macro++)
        pma_record_begin(&third, macro);
    CHECK_INT(pma_record_row(&third, 5, 5, 5), 1);
    CHECK_INT(pma_record_row(&third, 8, 5, 5), 2);
    CHECK_INT(pma_record_row(&third, 11, 5, 5), PMA_NO_ROW);
    CHECK_INT(ring.lost, 3);
}

static void the_selected_dofs_of_a_state_are_written_in_the_order_of_the_selection(void)
{
    double u[3] = {1, 2, 3}, v[3] = {4, 5, 6}, w[3] = {7, 8, 9};
    double to_u[6] = {0}, to_v[6] = {0}, to_w[6] = {0};
    const pma_selection selection = {
        .count = 2, .position = (int64_t[]){2, 0}, .u = to_u, .v = to_v, .w = to_w};
    pma_selection_write(&selection, &(pma_state){.u = u, .v = v, .w = w}, 1);
    CHECK_BITS(6, to_u, ((double[]){0, 0, 3, 1, 0, 0}));
    CHECK_BITS(6, to_v, ((double[]){0, 0, 6, 4, 0, 0}));
    CHECK_BITS(6, to_w, ((double[]){0, 0, 9, 7, 0, 0}));
    pma_selection_add(&selection, &(pma_state){.u = w, .v = u, .w = v}, 1);
    CHECK_BITS(6, to_u, ((double[]){0, 0, 12, 8, 0, 0}));
    CHECK_BITS(6, to_v, ((double[]){0, 0, 9, 5, 0, 0}));
    CHECK_BITS(6, to_w, ((double[]){0, 0, 15, 11, 0, 0}));
}

/* What springs remember: deformations, forces, inner variables, `of_springs` each. */
static void the_selected_springs_of_a_state_are_written_too(void)
{
    double remembered[9] = {1, 2, 3, 4, 5, 6, 7, 8, 9}, d[4] = {0}, f[4] = {0};
    const pma_selection selection = {
        .springs = 2, .of_springs = 3, .spring = (int64_t[]){2, 1}, .deformation = d, .force = f};
    pma_selection_write(&selection, &(pma_state){.springs = remembered}, 1);
    CHECK_BITS(4, d, ((double[]){0, 0, 3, 2}));
    CHECK_BITS(4, f, ((double[]){0, 0, 6, 5}));
}

static void outputs_are_weighted_sums_of_a_state(void)
{
    double u[3] = {1, 2, 3}, v[3] = {4, 5, 6}, w[3] = {7, 8, 9}, y[4] = {0};
    const pma_selection selection = {
        .outputs = 2,
        .of_u = {(int64_t[]){0, 2, 2}, (int64_t[]){2, 0}, (double[]){10, -1}}, /* row 1: empty */
        .of_w = {(int64_t[]){0, 1, 2}, (int64_t[]){1, 2}, (double[]){0.5, 2}},
        .output = y};
    pma_selection_write(&selection, &(pma_state){.u = u, .v = v, .w = w}, 1);
    CHECK_BITS(4, y, ((double[]){0, 0, 30 - 1 + 4, 18}));
    pma_selection_add(&selection, &(pma_state){.u = w, .v = u, .w = v}, 1);
    CHECK_BITS(4, y, ((double[]){0, 0, 33 + 90 - 7 + 2.5, 18 + 12}));
    CHECK(!pma_selection_is_empty(&selection));
    CHECK(pma_selection_is_empty(&(pma_selection){.of_springs = 3}));
}

static void check_rows_alike(const tape *few, const tape *all, const model *m, size_t row,
                             size_t macro)
{
    for (size_t i = 0; i < m->count; i++) {
        const size_t n = m->subdomains[i].n, from = macro * m->subdomains[i].substeps * n;
        CHECK_BITS(n, few->u[i] + row * n, all->u[i] + from);
        CHECK_BITS(n, few->v[i] + row * n, all->v[i] + from);
        CHECK_BITS(n, few->w[i] + row * n, all->w[i] + from);
    }
    const size_t p = m->p, from = macro * m->fine * p;
    CHECK_BITS(p, few->lam + row * p, all->lam + from);
    CHECK_BITS(p, few->velocity + row * p, all->velocity + from);
    CHECK_BITS(p, few->displacement + row * p, all->displacement + macro * p);
}

/* From macro step `begin` on: row 0 is `begin`, row i + 1 the i-th later multiple of three. */
static void check_every_third(int64_t begin, const tape *all, const double *untouched)
{
    static model m;
    static tape few;
    make_chain(&m, MIXED, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, begin, NULL, NULL), PMA_OK);
    make_tape(&few, &m, begin, 3);
    run_taped(&m, &few, STEPS - begin);
    size_t row = 0;
    check_rows_alike(&few, all, &m, row++, (size_t)begin);
    for (size_t macro = (size_t)begin + 1; macro <= STEPS; macro++) {
        if (macro % 3 == 0)
            check_rows_alike(&few, all, &m, row++, macro);
    }
    for (size_t i = 0; i < m.count; i++)
        CHECK_BITS(m.subdomains[i].n, few.u[i] + row * m.subdomains[i].n, untouched);
    CHECK_BITS(m.p, few.lam + row * m.p, untouched);
    CHECK_BITS(m.p, few.velocity + row * m.p, untouched);
    CHECK_BITS(m.p, few.displacement + row * m.p, untouched);
    destroy_model(&m);
}

static void every_third_macro_level_is_recorded_wherever_the_interval_begins(void)
{
    static model m;
    static tape all;
    double untouched[MOST];
    memset(untouched, 0xff, sizeof untouched);
    make_chain(&m, MIXED, 1.0);
    make_tape(&all, &m, 0, 0);
    run_taped(&m, &all, STEPS);
    for (int64_t begin = 0; begin <= 5; begin++)
        check_every_third(begin, &all, untouched);
    destroy_model(&m);
}

/* An interval that begins later continues the rows of one that began at 0. */
static void a_record_of_all_time_levels_may_begin_in_the_middle(void)
{
    static model m, later;
    static tape all, late;
    make_chain(&m, MIXED, 1.0);
    make_chain(&later, MIXED, 1.0);
    make_tape(&all, &m, 0, 0);
    make_tape(&late, &later, 3, 0);
    run_taped(&m, &all, STEPS);
    CHECK_STATUS(pma_coupler_advance(later.coupler, 3, NULL, NULL), PMA_OK);
    run_taped(&later, &late, STEPS - 3);
    for (size_t i = 0; i < m.count; i++) {
        const size_t n = m.subdomains[i].n, skipped = 3 * m.subdomains[i].substeps * n;
        CHECK_BITS((STEPS - 3) * m.subdomains[i].substeps * n + n, late.u[i], all.u[i] + skipped);
    }
    CHECK_BITS(((STEPS - 3) * FINE + 1) * m.p, late.lam, all.lam + 3 * FINE * m.p);
    CHECK_BITS((STEPS - 3 + 1) * m.p, late.displacement, all.displacement + 3 * m.p);
    destroy_model(&m);
    destroy_model(&later);
}

/* Without constraints, and of a subdomain without selection, no array is touched: NULL will do. */
static void a_run_without_constraints_leaves_the_interface_arrays_alone(void)
{
    static model m;
    double u[3] = {0}, v[3] = {0}, w[3] = {0};
    pma_selection selections[2] = {{.count = 1, .position = (int64_t[]){0}, .u = u, .v = v, .w = w},
                                   {.count = 0}};
    const pma_record record = {.begin = 0, .every = 1, .selections = selections};
    m = (model){.count = 2, .dt = 0.5};
    m.subdomains[0] = one_mass(1.0, 4.0, 0.0, TRAPEZOIDAL, true); /* omega h = 1 */
    m.subdomains[1] = one_mass(1.0, 1.0, 0.0, CENTRAL_DIFFERENCE, false);
    m.subdomains[0].u0[0] = 1.0;
    make_model(&m);
    pma_coupler_record_present(m.coupler, &record);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 2, &record, NULL), PMA_OK);
    const double q = 2.0 * atan(0.5);
    for (size_t n = 0; n <= 2; n++)
        CHECK_NEAR(u[n], cos((double)n * q), 10.0 * EPS); /* two steps of a few roundings */
    destroy_model(&m);
}

const test RECORD_TESTS[] = {
    TEST(the_row_of_a_time_level_follows_from_its_number),
    TEST(rows_of_a_ring_are_used_again_once_they_are_read_and_else_lost),
    TEST(the_selected_dofs_of_a_state_are_written_in_the_order_of_the_selection),
    TEST(the_selected_springs_of_a_state_are_written_too),
    TEST(outputs_are_weighted_sums_of_a_state),
    TEST(every_third_macro_level_is_recorded_wherever_the_interval_begins),
    TEST(a_record_of_all_time_levels_may_begin_in_the_middle),
    TEST(a_run_without_constraints_leaves_the_interface_arrays_alone),
    END_OF_TESTS,
};
