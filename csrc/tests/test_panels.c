/* test_panels.c - factors made in panels, and sweeps over them. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "algebra/factor.h"
#include "algebra/panels.h"
#include "check.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"

static pma_status make_numbers_polled(structure *m, double lost, stopper *a, size_t *column)
{
    return make_numbers(m, lost, &(pma_patience){.stop = poll_stopper, .ctx = a}, column);
}

static void check_structure(const void *of, const double *x, const double *b)
{
    check_definite_residual(of, x, b);
}

static void check_factored(structure *m, uint64_t *seed)
{
    double b[UNKNOWNS], x[UNKNOWNS], x_b[UNKNOWNS], nothing[UNKNOWNS] = {0.0};
    stopper a = {0, 0};
    size_t column = 0;
    analyse(m);
    CHECK_STATUS(make_numbers_polled(m, 1e-12, &a, &column), PMA_OK);
    CHECK_INT(a.polled, m->panels.count);
    const pma_factor f = {
        .form = PMA_PANELS, .n = m->n, .nb = m->nb, .inverse = m->inverse, .panels = m->panels};
    CHECK_STATUS(pma_factor_check(&f), PMA_OK);
    draw_vector(m->n, seed, b);
    memcpy(x, b, m->n * sizeof(double));
    double *work = take_scratch(&f);
    pma_factor_open(&f, x, x_b, work);
    pma_factor_close(&f, nothing, x, work);
    return_scratch(&f, work);
    check_definite_residual(m, x, b);
    check_lanes(&f, check_structure, m, seed);
}

static void a_factor_made_in_panels_solves(void)
{
    static structure m;
    uint64_t seed = 10;
    draw_grid(&m);
    check_factored(&m, &seed);
    for (uint32_t one_in = 1; one_in <= 64; one_in *= 2) {
        draw_definite(&m, UNKNOWNS, draw(&seed, 8), one_in, &seed);
        check_factored(&m, &seed);
    }
    for (size_t n = 0; n <= 24; n++) {
        for (uint32_t one_in = 1; one_in <= 9; one_in += 2) {
            draw_definite(&m, n, draw(&seed, (uint32_t)n + 1), one_in, &seed);
            check_factored(&m, &seed);
        }
    }
}

/* A pivot does not depend on what comes after it, so the spoilt one is the first to fail. */
static void check_spoilt(structure *m, size_t spoilt, double diagonal)
{
    stopper a = {0, 0};
    size_t column = SIZE_MAX;
    const double kept = m->A[spoilt * (m->n + 1)];
    m->A[spoilt * (m->n + 1)] = diagonal;
    list_entries(m);
    CHECK_STATUS(make_numbers_polled(m, 1e-12, &a, &column), PMA_NOT_DEFINITE);
    CHECK_INT(column, spoilt);
    m->A[spoilt * (m->n + 1)] = kept;
}

/* In many panels, and in one that is wider than a block. */
static void the_column_of_a_pivot_that_is_not_positive_is_named(void)
{
    static structure m;
    draw_grid(&m);
    analyse(&m);
    for (size_t i = 0; i < UNKNOWNS; i++) {
        check_spoilt(&m, i, -1.0);
        check_spoilt(&m, i, NAN);
    }
    m = (structure){.n = UNKNOWNS};
    for (size_t i = 0; i < UNKNOWNS * UNKNOWNS; i++)
        m.A[i] = i % (UNKNOWNS + 1) == 0 ? 4.0 : 1.0;
    analyse(&m);
    CHECK_INT(m.panels.count, 1);
    for (size_t i = 1; i < UNKNOWNS; i++) {
        check_spoilt(&m, i, -1.0);
        check_spoilt(&m, i, 0.1); /* elimination takes at least 1/4 away */
    }
}

/* [1 1; 1 1 + d] has the pivot d, which is lost when d is the rounding of the diagonal. */
static void a_pivot_that_is_only_rounding_counts_as_not_positive(void)
{
    static structure m;
    stopper a = {0, 0};
    size_t column = SIZE_MAX;
    m = (structure){.n = 2, .A = {1.0, 1.0, 1.0, 1.0 + 1e-13}};
    analyse(&m);
    CHECK_STATUS(make_numbers_polled(&m, 1e-12, &a, &column), PMA_NOT_DEFINITE);
    CHECK_INT(column, 1);
    CHECK_STATUS(make_numbers_polled(&m, 1e-14, &a, &column), PMA_OK);
}

/* Panels of a chain, then an entry between its ends. */
static void an_entry_outside_the_pattern_is_refused(void)
{
    static structure m;
    stopper a = {0, 0};
    size_t column;
    m = (structure){.n = SIZE};
    for (size_t i = 0; i < SIZE; i++) {
        m.A[i * SIZE + i] = 4.0;
        if (i > 0)
            m.A[i * SIZE + i - 1] = m.A[(i - 1) * SIZE + i] = 1.0;
    }
    analyse(&m);
    CHECK_STATUS(make_numbers_polled(&m, 1e-12, &a, &column), PMA_OK);
    m.A[SIZE - 1] = m.A[(SIZE - 1) * SIZE] = 1.0;
    list_entries(&m);
    CHECK_STATUS(make_numbers_polled(&m, 1e-12, &a, &column), PMA_BAD_INDEX);
}

static void a_factor_in_the_making_can_be_stopped(void)
{
    static structure m;
    size_t column;
    draw_grid(&m);
    analyse(&m);
    CHECK(m.panels.count >= 3);
    for (size_t stop_at = 1; stop_at <= 3; stop_at++) {
        stopper a = {0, stop_at};
        CHECK_STATUS(make_numbers_polled(&m, 1e-12, &a, &column), PMA_STOPPED);
        CHECK_INT(a.polled, stop_at);
    }
}

/* Supernodes {0, 1} with the rows 3, 4 below, {2} with 3, 4 and {3, 4}. */
static pma_panels three_panels(void)
{
    static const int64_t first[4] = {0, 2, 3, 5}, row_ptr[4] = {0, 2, 4, 4};
    static const int64_t start[4] = {0, 8, 11, 15};
    static const int32_t rows[4] = {3, 4, 3, 4};
    static double values[15];
    return (pma_panels){3, first, row_ptr, rows, start, values, 0};
}

static void panels_report_how_much_scratch_they_need(void)
{
    const pma_panels p = three_panels();
    const pma_factor f = {.form = PMA_PANELS, .n = 5, .panels = p};
    CHECK_INT(pma_panels_most_height(&p), 4); /* the first: two columns, two rows below */
    CHECK_INT(pma_factor_entries(&f), 15);
}

static pma_status panels_status(const int64_t *first, const int64_t *row_ptr, const int32_t *rows,
                                const int64_t *start)
{
    pma_panels p = three_panels();
    p.first = first ? first : p.first;
    p.row_ptr = row_ptr ? row_ptr : p.row_ptr;
    p.rows = rows ? rows : p.rows;
    p.start = start ? start : p.start;
    return pma_panels_check(&p, 5, 0);
}

static void panels_with_a_bad_index_are_refused(void)
{
    CHECK_STATUS(panels_status(NULL, NULL, NULL, NULL), PMA_OK);
    CHECK_STATUS(panels_status((int64_t[]){1, 2, 3, 5}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status((int64_t[]){0, 2, 2, 5}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status((int64_t[]){0, 3, 2, 5}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status((int64_t[]){0, 2, 3, 4}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status((int64_t[]){0, 2, 3, 6}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, (int64_t[]){1, 2, 4, 4}, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, (int64_t[]){0, 2, 1, 4}, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, (int32_t[]){4, 3, 3, 4}, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, (int32_t[]){3, 3, 3, 4}, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, (int32_t[]){1, 4, 3, 4}, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, (int32_t[]){3, 5, 3, 4}, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, (int32_t[]){-1, 4, 3, 4}, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, NULL, (int64_t[]){1, 9, 12, 16}), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, NULL, (int64_t[]){0, 7, 11, 15}), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, NULL, (int64_t[]){0, 8, 11, 14}), PMA_BAD_INDEX);
    /* an empty supernode, with all else as it has to be */
    const int64_t first[4] = {0, 2, 2, 5}, row_ptr[4] = {0, 2, 2, 2}, start[4] = {0, 8, 8, 17};
    CHECK_STATUS(panels_status(first, row_ptr, NULL, start), PMA_BAD_INDEX);
}

static void panels_have_to_break_where_the_interface_begins(void)
{
    const pma_panels p = three_panels();
    const pma_status expected[6] = {PMA_OK, PMA_BAD_INDEX, PMA_OK, PMA_OK, PMA_BAD_INDEX, PMA_OK};
    for (size_t nb = 0; nb <= 5; nb++) {
        const pma_factor f = {.form = PMA_PANELS, .n = 5, .nb = nb, .panels = p};
        CHECK_STATUS(pma_panels_check(&p, 5, nb), expected[nb]);
        CHECK_STATUS(pma_factor_check(&f), expected[nb]);
    }
    const pma_factor too_many = {.form = PMA_PANELS, .n = 5, .nb = 6, .panels = p};
    CHECK_STATUS(pma_factor_check(&too_many), PMA_BAD_SIZE);
}

/* The factor of a triple cut into panels at random and at the interface. */
typedef struct {
    size_t count;
    int64_t first[SIZE + 1], row_ptr[SIZE + 1], start[SIZE + 1];
    int32_t rows[SIZE * SIZE];
    double values[SIZE * SIZE];
} panelled;

/* One more supernode, of the columns begin..end-1: its rows are all in which one of them has an
 * entry; NaN where nothing is read, on and above the diagonal. */
static void add_panel(panelled *q, const triple *t, size_t begin, size_t end)
{
    const size_t s = q->count++, n = t->n;
    int64_t rows = q->row_ptr[s];
    for (size_t i = end; i < n; i++) {
        bool filled = false;
        for (size_t j = begin; j < end; j++)
            filled = filled || t->R[i * n + j] != 0.0;
        if (filled)
            q->rows[rows++] = (int32_t)i;
    }
    double *value = q->values + q->start[s];
    for (size_t j = begin; j < end; j++) {
        for (size_t i = begin; i < end; i++)
            *value++ = i > j ? t->R[i * n + j] : (double)NAN;
        for (int64_t k = q->row_ptr[s]; k < rows; k++)
            *value++ = t->R[(size_t)q->rows[k] * n + j];
    }
    q->first[s + 1] = (int64_t)end;
    q->row_ptr[s + 1] = rows;
    q->start[s + 1] = value - q->values;
}

static panelled cut_into_panels(const triple *t, size_t nb, uint64_t *seed)
{
    panelled q = {.count = 0};
    size_t begin = 0;
    for (size_t end = 1; end <= t->n; end++) {
        if (end < t->n && end != t->n - nb && draw(seed, 3) > 0)
            continue;
        add_panel(&q, t, begin, end);
        begin = end;
    }
    return q;
}

static void factors_in_panels_solve_for_every_size_of_interface(void)
{
    uint64_t seed = 11;
    for (size_t n = 1; n <= SIZE; n++) {
        for (size_t nb = 0; nb <= n; nb++) {
            const triple t = make_triple(n, n % 2 ? 0.9 : 0.4, &seed);
            panelled q = cut_into_panels(&t, nb, &seed);
            const pma_panels panels = {q.count, q.first, q.row_ptr, q.rows, q.start, q.values, 0};
            const pma_factor f = {
                .form = PMA_PANELS, .n = n, .nb = nb, .inverse = t.inverse, .panels = panels};
            CHECK_INT(pma_factor_scratch(&f), pma_panels_most_height(&panels));
            check_sweeps(&t, &f, &seed);
        }
    }
}

const test PANELS_TESTS[] = {
    TEST(a_factor_made_in_panels_solves),
    TEST(the_column_of_a_pivot_that_is_not_positive_is_named),
    TEST(a_pivot_that_is_only_rounding_counts_as_not_positive),
    TEST(an_entry_outside_the_pattern_is_refused),
    TEST(a_factor_in_the_making_can_be_stopped),
    TEST(panels_report_how_much_scratch_they_need),
    TEST(panels_with_a_bad_index_are_refused),
    TEST(panels_have_to_break_where_the_interface_begins),
    TEST(factors_in_panels_solve_for_every_size_of_interface),
    END_OF_TESTS,
};
