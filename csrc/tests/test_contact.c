/* test_contact.c - impulses of contacts: which rows push, and how much. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "check.h"
#include "couple/contact.h"
#include "couple/coupler.h"
#include "matrices.h"
#include "models.h"
#include "naive.h"
#include "solve/complementarity.h"
#include "subdomain/subdomain.h"
#include "subdomains.h"
#include "tests.h"

enum { ROWS = 60 };

/* Conditions below 1e4 and numbers of size 1. */
static const double SOLVED = 1e-9;

typedef struct {
    size_t rows, contacts;
    int64_t first[ROWS + 1];
    double friction[ROWS], W[ROWS * ROWS], b[ROWS];
    size_t closed[ROWS];
} problem;

/* W = B B^T / n + I, with `rank` columns in B and no unit matrix if it is singular; `skew` is added
 * above the diagonal and subtracted below */
static void make(problem *x, size_t contacts, size_t tangents, size_t rank, double skew,
                 uint64_t *seed)
{
    double B[ROWS][ROWS];
    const size_t n = contacts * (1 + tangents), columns = rank > 0 ? rank : n;
    x->rows = n;
    x->contacts = contacts;
    for (size_t k = 0; k <= contacts; k++)
        x->first[k] = (int64_t)(k * (1 + tangents));
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < columns; k++)
            B[i][k] = draw_eighth(seed);
    }
    for (size_t i = 0; i < n; i++) {
        x->b[i] = draw_eighth(seed);
        for (size_t j = 0; j < n; j++) {
            double sum = rank == 0 && i == j ? 1.0 : 0.0;
            for (size_t k = 0; k < columns; k++)
                sum += B[i][k] * B[j][k] / (double)columns;
            x->W[j * n + i] = sum + (i < j ? skew : i > j ? -skew : 0.0);
        }
    }
    /* of a singular W: b in its range, so that there is a solution */
    for (size_t i = 0; i < n && rank > 0; i++) {
        x->b[i] = 0.0;
        for (size_t k = 0; k < columns; k++)
            x->b[i] += B[i][k] * (double)((int)(k % 3) - 1);
    }
    for (size_t k = 0; k < contacts; k++) {
        x->friction[k] = 0.0;
        x->closed[k] = k;
    }
}

static void multiply(const problem *x, const double *P, double *y)
{
    for (size_t i = 0; i < x->rows; i++) {
        y[i] = x->b[i];
        for (size_t j = 0; j < x->rows; j++)
            y[i] += x->W[j * x->rows + i] * P[j];
    }
}

static pma_complementarity *create(const problem *x)
{
    const pma_complementarity_parts parts = {
        .contacts = x->contacts, .first = x->first, .friction = x->friction, .blas = NAIVE_BLAS};
    pma_complementarity *made;
    CHECK_STATUS(pma_complementarity_create(&parts, &made), PMA_OK);
    pma_complementarity_set(made, x->W);
    return made;
}

/* P: the impulses for all contacts of `closed`, from what pushed last; *row where there are none */
static pma_status solve(const problem *x, size_t count, const size_t *closed, double *P,
                        size_t *row)
{
    pma_complementarity *solver = create(x);
    const pma_status status = pma_complementarity_solve(solver, count, closed, x->b, P, row);
    pma_complementarity_destroy(solver);
    return status;
}

/* (U5) in every row, from the data alone */
static void check_frictionless(const problem *x, const double *P, double tolerance)
{
    double y[ROWS];
    multiply(x, P, y);
    for (size_t k = 0; k < x->rows; k++) {
        CHECK(P[k] >= 0.0);
        CHECK(y[k] >= -tolerance);
        CHECK_NEAR(P[k] * y[k], 0.0, tolerance);
    }
}

static void block_pivoting_solves_from_any_start(void)
{
    uint64_t seed = 1;
    problem x;
    for (size_t n = 1; n <= ROWS; n += n < 8 ? 1 : 13) {
        make(&x, n, 0, 0, n % 2 ? 0.0 : 0.05, &seed);
        pma_complementarity *solver = create(&x);
        double cold[ROWS] = {0.0}, warm[ROWS];
        size_t row;
        CHECK_STATUS(pma_complementarity_solve(solver, n, x.closed, x.b, cold, &row), PMA_OK);
        check_frictionless(&x, cold, SOLVED);
        CHECK(pma_complementarity_turns(solver) <= 6);
        memcpy(warm, cold, sizeof warm);
        CHECK_STATUS(pma_complementarity_solve(solver, n, x.closed, x.b, warm, &row), PMA_OK);
        CHECK_INT(pma_complementarity_turns(solver), 1);
        CHECK_BITS(n, warm, cold);
        for (size_t k = 0; k < n; k++)
            warm[k] = 1.0;
        CHECK_STATUS(pma_complementarity_solve(solver, n, x.closed, x.b, warm, &row), PMA_OK);
        CHECK_BITS(n, warm, cold); /* the same rows push, whatever the start */
        pma_complementarity_destroy(solver);
    }
}

/* More rows than a block of columns, and little in each: what is not there is not read. */
static void a_banded_matrix_is_solved(void)
{
    uint64_t seed = 7;
    problem x;
    for (size_t band = 0; band <= 5; band++) {
        make(&x, ROWS, 0, 0, 0.02, &seed);
        for (size_t i = 0; i < ROWS; i++) {
            for (size_t j = 0; j < ROWS; j++) {
                if (i > j + band || j > i + 2 * band)
                    x.W[j * ROWS + i] = 0.0;
            }
            x.W[i * ROWS + i] += 4.0;
        }
        double P[ROWS] = {0.0};
        size_t row;
        CHECK_STATUS(solve(&x, ROWS, x.closed, P, &row), PMA_OK);
        check_frictionless(&x, P, SOLVED);
    }
}

static void rows_that_are_open_have_no_impulse(void)
{
    uint64_t seed = 2;
    problem x;
    const size_t closed[2] = {1, 4};
    make(&x, 6, 0, 0, 0.0, &seed);
    x.b[1] = x.b[4] = -1.0;
    double P[ROWS] = {1.0, 1.0, 1.0, 1.0, 1.0, 1.0};
    size_t row;
    CHECK_STATUS(solve(&x, 2, closed, P, &row), PMA_OK);
    for (size_t k = 0; k < 6; k++)
        CHECK((P[k] > 0.0) == (k == 1 || k == 4));
}

static void redundant_rows_have_right_sums(void)
{
    uint64_t seed = 3;
    problem x;
    for (size_t rank = 2; rank <= 20; rank += 6) {
        make(&x, 40, 0, rank, 0.0, &seed);
        double P[ROWS] = {0.0};
        size_t row;
        CHECK_STATUS(solve(&x, 40, x.closed, P, &row), PMA_OK);
        check_frictionless(&x, P, SOLVED);
    }
}

/* (U7) in every contact, from the data alone */
static void check_rough(const problem *x, size_t tangents, const double *P)
{
    double y[ROWS];
    multiply(x, P, y);
    for (size_t k = 0; k < x->contacts; k++) {
        const size_t n = (size_t)x->first[k];
        double slid = 0.0, pull = 0.0, along = 0.0;
        CHECK(P[n] >= 0.0 && y[n] >= -SOLVED);
        CHECK_NEAR(P[n] * y[n], 0.0, SOLVED);
        for (size_t t = 1; t <= tangents; t++) {
            slid = hypot(slid, y[n + t]);
            pull = hypot(pull, P[n + t]);
            along += P[n + t] * y[n + t];
        }
        CHECK(pull <= x->friction[k] * P[n] + SOLVED);
        CHECK_NEAR(along, -pull * slid, SOLVED);
        if (pull < x->friction[k] * P[n] - 1e-6)
            CHECK_NEAR(slid, 0.0, SOLVED);
    }
}

static void sweeps_find_friction_on_a_cone(void)
{
    uint64_t seed = 4;
    problem x;
    for (size_t tangents = 1; tangents <= 2; tangents++) {
        for (size_t n = 1; n <= 15; n += 7) {
            make(&x, n, tangents, 0, 0.0, &seed);
            for (size_t k = 0; k < n; k++)
                x.friction[k] = 0.1 + 0.05 * (double)k;
            double P[ROWS] = {0.0};
            size_t row;
            CHECK_STATUS(solve(&x, n, x.closed, P, &row), PMA_OK);
            check_rough(&x, tangents, P);
        }
    }
}

/* Six dofs on up to 20 contacts with 60 rows, again and again from the last impulses. */
static void friction_on_redundant_rows_is_solved(void)
{
    uint64_t seed = 6;
    problem x;
    for (size_t tangents = 1; tangents <= 2; tangents++) {
        for (size_t n = 4; n <= 20; n += 8) {
            for (size_t trial = 0; trial < 20; trial++) {
                make(&x, n, tangents, 6, 0.0, &seed);
                for (size_t k = 0; k < n; k++)
                    x.friction[k] = 0.1 + 0.02 * (double)k;
                pma_complementarity *solver = create(&x);
                double P[ROWS] = {0.0};
                size_t row;
                for (size_t step = 0; step < 3; step++) {
                    CHECK_STATUS(pma_complementarity_solve(solver, n, x.closed, x.b, P, &row),
                                 PMA_OK);
                    check_rough(&x, tangents, P);
                    for (size_t k = 0; k < x.rows; k++)
                        x.b[k] += 0.1 * x.W[(step % 2) * x.rows + k];
                }
                pma_complementarity_destroy(solver);
            }
        }
    }
}

static void what_has_no_solution_names_a_row(void)
{
    /* a row that nothing moves, and that would have to: y = -1 whatever P */
    uint64_t seed = 5;
    problem x;
    make(&x, 2, 1, 0, 0.0, &seed);
    memset(x.W, 0, sizeof x.W);
    for (size_t k = 0; k < 4; k++)
        x.W[k * 4 + k] = k == 2 ? 1e-6 : 1.0;
    x.W[2 * 4 + 0] = x.W[0 * 4 + 2] = -2.0; /* indefinite: each makes the other worse */
    for (size_t k = 0; k < 4; k++)
        x.b[k] = -1.0;
    x.friction[0] = x.friction[1] = 0.5;
    double P[ROWS] = {0.0};
    size_t row = 99;
    CHECK_STATUS(solve(&x, 2, x.closed, P, &row), PMA_NO_IMPULSES);
    CHECK(row == 0 || row == 2);
}

static void contacts_that_do_not_fit_are_refused(void)
{
    const int64_t first[3] = {0, 1, 3}, later[3] = {1, 2, 3}, wide[3] = {0, 1, 5}, ptr[2] = {0, 1};
    const int32_t index = 2, outside = 3;
    const double one = 1.0;
    pma_contact_side side = {.member = 0,
                             .N = {.p = 3, .nb = 1, .ptr = ptr, .index = &index, .values = &one}};
    pma_contact_parts parts = {.contacts = 2, .first = first, .sides = 1, .side = &side};
    CHECK_STATUS(pma_contact_check(&parts, 1), PMA_OK);
    CHECK_STATUS(pma_contact_check(&parts, 0), PMA_BAD_INDEX);
    parts.first = later;
    CHECK_STATUS(pma_contact_check(&parts, 1), PMA_BAD_SIZE);
    parts.first = wide;
    CHECK_STATUS(pma_contact_check(&parts, 1), PMA_BAD_INDEX);
    parts.first = first;
    side.N.index = &outside;
    CHECK_STATUS(pma_contact_check(&parts, 1), PMA_BAD_INDEX);
    side.N.index = &index;
    side.N.p = 2;
    CHECK_STATUS(pma_contact_check(&parts, 1), PMA_BAD_SIZE);
}

/* ---- coupled to masses ----------------------------------------------------------------------- */

/* Two free masses of 1 and 3 above the ground, or what moves there: contact 0 of the first one with
 * the ground, contact 1 of both. Its arrays are those of the core, so it is not to be moved. */
typedef struct {
    double zeros[2], inverse[2], gap[2], restitution[2], friction[2], signs[3], force[2];
    double moving[4]; /* d and d' of the ground */
    int64_t none[3], first[3], columns[3];
    int32_t rows[3];
    pma_contact_side side;
    pma_contact_parts contact;
    pma_member member;
    pma_subdomain *core;
    pma_coupler *coupler;
} masses;

static const double MASS = 3.0, H = 0.0625, NONE[2] = {0.0, 0.0};

static void make_masses(masses *x, double speed, const double *force)
{
    *x = (masses){.inverse = {1.0, 1.0 / MASS},
                  .restitution = {0.5, 0.75},
                  .signs = {1.0, -1.0, 1.0},
                  .force = {force[0], force[1]},
                  .moving = {0.0, 0.0, speed, 0.0},
                  .first = {0, 1, 2},
                  .columns = {0, 2, 3},
                  .rows = {0, 1, 1}};
    pma_parts parts = {.n = 2, .nb = 2, .substeps = 1};
    parts.K = parts.C = (pma_matrix){.form = PMA_ZERO, .n = 2};
    parts.link = (pma_link){.p = 0, .nb = 2, .ptr = x->none, .index = x->rows, .values = x->signs};
    parts.single.step = pma_step_make(CENTRAL_DIFFERENCE, H);
    parts.single.factor =
        (pma_factor){.form = PMA_DIAGONAL, .n = 2, .nb = 2, .inverse = x->inverse};
    parts.impulse.inverse = x->inverse;
    CHECK_STATUS(pma_subdomain_create(&parts, &x->core), PMA_OK);
    pma_subdomain_set_load(x->core,
                           (pma_load){.kind = PMA_LOAD_CONSTANT, .n = 2, .values = x->force});
    x->member = pma_subdomain_member(x->core);
    x->side.N =
        (pma_link){.p = 2, .nb = 2, .ptr = x->columns, .index = x->rows, .values = x->signs};
    x->contact = (pma_contact_parts){.contacts = 2,
                                     .first = x->first,
                                     .gap = x->gap,
                                     .restitution = x->restitution,
                                     .friction = x->friction,
                                     .friction_static = x->friction,
                                     .sides = 1,
                                     .side = &x->side,
                                     .blas = NAIVE_BLAS};
    x->contact.obstacle = (pma_load){
        .kind = speed != 0.0 ? PMA_LOAD_CONSTANT : PMA_LOAD_NONE, .n = 4, .values = x->moving};
    pma_coupler_parts coupled = {.count = 1, .members = &x->member, .dt = H};
    coupled.schedule = &pma_contact_schedule;
    coupled.contact = &x->contact;
    CHECK_STATUS(pma_coupler_create(&coupled, &x->coupler), PMA_OK);
}

static void start_masses(masses *x, const double *u, const double *v)
{
    const double w[2] = {x->force[0], x->force[1] / MASS};
    pma_subdomain_start(x->core, u, v, w, x->zeros);
    pma_coupler_start(x->coupler, 0, x->zeros, x->zeros);
}

static void destroy_masses(masses *x)
{
    pma_coupler_destroy(x->coupler);
    pma_subdomain_destroy(x->core);
}

/* The first mass hits the ground, then the second one, and the ground again: (U5) by hand, of one
 * contact after the other. A record with one row leaves all impulses in the sum. */
static void masses_hit_the_ground_and_each_other(void)
{
    static const double speeds[2] = {0.0, 0.0625}, u[2] = {0.53, 1.0}, v[2] = {-1.0, 0.0};
    for (size_t k = 0; k < 2; k++) {
        masses x;
        const double up = speeds[k] + 0.5 * (speeds[k] + 1.0), down = up * (1.0 - 2.25) / 4.0;
        const double away = up * 1.75 / 4.0, end = speeds[k] + 0.5 * (speeds[k] - down);
        double gap[2], impulse[2];
        pma_selection selection = {0};
        const pma_record record = {.every = 1000,
                                   .selections = &selection,
                                   .contact_gap = gap,
                                   .contact_impulse = impulse};
        make_masses(&x, speeds[k], NONE);
        start_masses(&x, u, v);
        pma_coupler_record_present(x.coupler, &record);
        CHECK_STATUS(pma_coupler_advance(x.coupler, 160, &record, NULL), PMA_OK);
        const double *now = pma_subdomain_present(x.core)->v;
        /* some roundings of numbers of order one */
        CHECK_NEAR(now[0], end, 1e-14);
        CHECK_NEAR(now[1], away, 1e-14);
        const pma_state_array array = present_array(x.coupler, "contact");
        const double *contact = array.values;
        CHECK_INT(array.count, 8); /* impulses, d and d', sums */
        CHECK_NEAR(contact[4], speeds[k], 0.0);
        CHECK_NEAR(contact[6], (up + 1.0) + (end - down), 1e-14);
        CHECK_NEAR(contact[7], MASS * away, 1e-14);
        destroy_masses(&x);
    }
}

/* Inside of the ground, on the way out at 0.3, but for a force that turns it back in the step: the
 * velocity -0.2 at its end is above the one that came in, reversed. */
static void what_opens_already_is_not_pushed(void)
{
    static const double u[2] = {-1.0, 5.0}, v[2] = {0.3, 0.0}, force[2] = {-8.0, 0.0};
    masses x;
    make_masses(&x, 0.0, force);
    start_masses(&x, u, v);
    CHECK_STATUS(pma_coupler_advance(x.coupler, 1, NULL, NULL), PMA_OK);
    CHECK_NEAR(pma_subdomain_present(x.core)->v[0], -0.2, 1e-15);
    CHECK_STATUS(pma_coupler_advance(x.coupler, 1, NULL, NULL), PMA_OK);
    CHECK_NEAR(pma_subdomain_present(x.core)->v[0], 0.1, 1e-15); /* half of 0.2, reversed */
    destroy_masses(&x);
}

const test CONTACT_TESTS[] = {
    TEST(block_pivoting_solves_from_any_start),
    TEST(a_banded_matrix_is_solved),
    TEST(rows_that_are_open_have_no_impulse),
    TEST(redundant_rows_have_right_sums),
    TEST(sweeps_find_friction_on_a_cone),
    TEST(friction_on_redundant_rows_is_solved),
    TEST(what_has_no_solution_names_a_row),
    TEST(contacts_that_do_not_fit_are_refused),
    TEST(masses_hit_the_ground_and_each_other),
    TEST(what_opens_already_is_not_pushed),
    END_OF_TESTS,
};
