/* test_scratch.c - steps of one thread and the compliance of another share no scratch. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/factor.h"
#include "check.h"
#include "subdomain/inside.h"
#include "subdomain/response.h"
#include "subdomain/subdomain.h"
#include "subdomains.h"
#include "tests.h"
#include "workers/team.h"

enum { DOFS = 3, FACE = 2, ROUNDS = 500 };

/* A subdomain whose factors are in panels, 0 | 1 2: sweeps of the first want scratch. */
typedef struct {
    subdomain of;
    double values[2][7];
    pma_subdomain *core;
    pma_member member;
} panelled;

static const int64_t PANEL_FIRST[3] = {0, 1, 3}, ROW_PTR[3] = {0, 2, 2}, START[3] = {0, 3, 7};
static const int32_t ROWS[2] = {1, 2};

static void put_into_panels(const subdomain *x, bool twice, double *values, pma_factor *f)
{
    static const size_t places[7] = {0, 1, 2, 4, 5, 7, 8}; /* in R by columns */
    for (size_t k = 0; k < 7; k++)
        values[k] = x->R[twice][places[k]];
    f->form = PMA_PANELS;
    f->panels = (pma_panels){2, PANEL_FIRST, ROW_PTR, ROWS, START, values, 0};
}

static void fill_subdomain(panelled *q)
{
    q->of = (subdomain){.n = DOFS,
                        .nb = FACE,
                        .p = 2,
                        .substeps = 2,
                        .implicit = true,
                        .doubled = true,
                        .scheme = generalized_alpha(0.6),
                        .h = 0.2,
                        .M = {2, 0, 0, 0, 1, 0, 0, 0, 1.5},
                        .K = {5, -2, 0, -2, 4, -2, 0, -2, 2},
                        .L = {0, 1, 0, 0, -1, 1},
                        .u0 = {1.0, 0.5, -0.5}};
}

static void create_panelled(panelled *q, const pma_parts *parts)
{
    const double zeros[DOFS] = {0.0}, lam[CONSTRAINTS] = {0.5, -0.25};
    CHECK_STATUS(pma_subdomain_create(parts, &q->core), PMA_OK);
    pma_subdomain_start(q->core, q->of.u0, zeros, zeros, lam);
    q->member = pma_subdomain_member(q->core);
}

static void make_panelled(panelled *q)
{
    fill_subdomain(q);
    pma_parts parts = describe(&q->of);
    put_into_panels(&q->of, false, q->values[0], &parts.single.factor);
    put_into_panels(&q->of, true, q->values[1], &parts.twice.factor);
    create_panelled(q, &parts);
}

/* A macro step of single or double steps. */
static void walk(const pma_member *m, bool twice)
{
    for (size_t j = 0; j < 2; j++) {
        const pma_substep step = {.j = j, .twice = twice};
        const double lam[CONSTRAINTS] = {1.0 + (double)j, -2.0};
        CHECK_STATUS(m->table->advance(m->self, NULL, &step, NULL, NULL), PMA_OK);
        CHECK_STATUS(m->table->advance(m->self, &step, NULL, lam, NULL), PMA_OK);
    }
    m->table->commit(m->self);
}

/* ---- by one thread, number by number -------------------------------------------------------- */

static const double UNTOUCHED = 7.0;

static void mark(size_t count, double *x)
{
    for (size_t i = 0; i < count; i++)
        x[i] = UNTOUCHED;
}

static void check_marked(size_t count, const double *x)
{
    for (size_t i = 0; i < count; i++)
        CHECK(x[i] == UNTOUCHED);
}

static void steps_leave_the_scratch_of_the_compliance_alone(void)
{
    panelled q;
    make_panelled(&q);
    const size_t scratch = pma_factor_scratch(&q.core->parts.single.factor);
    CHECK_INT(scratch, 3); /* the height of the first panel */
    mark(FACE, q.core->link);
    mark(scratch, q.core->link_work);
    walk(&q.member, false);
    check_marked(FACE, q.core->link);
    check_marked(scratch, q.core->link_work);
    pma_subdomain_destroy(q.core);
}

static void compare_closed(const panelled *actual, const panelled *expected)
{
    const pma_state *x = pma_levels_at(&actual->core->levels, 1);
    const pma_state *y = pma_levels_at(&expected->core->levels, 1);
    CHECK_BITS(DOFS, x->u, y->u);
    CHECK_BITS(DOFS, x->w, y->w);
}

/* Between the opening of a substep and its closing. */
static void the_compliance_leaves_the_scratch_of_the_steps_alone(void)
{
    panelled q, alone;
    make_panelled(&q);
    make_panelled(&alone);
    const size_t scratch = pma_factor_scratch(&q.core->parts.single.factor);
    const double lam[CONSTRAINTS] = {3.0, -4.0};
    double sum[CONSTRAINTS] = {0.0}, vf[2][CONSTRAINTS] = {{0.0}};
    const pma_substep step = {.j = 0};
    CHECK_STATUS(q.member.table->advance(q.member.self, NULL, &step, NULL, NULL), PMA_OK);
    CHECK_STATUS(alone.member.table->advance(alone.member.self, NULL, &step, NULL, NULL), PMA_OK);
    mark(FACE, q.core->closing);
    mark(scratch, q.core->work);
    for (int twice = 0; twice <= 1; twice++)
        pma_member_compliance(&q.member, twice, lam, sum);
    check_marked(FACE, q.core->closing);
    check_marked(scratch, q.core->work);
    CHECK(sum[0] != 0.0 && sum[1] != 0.0);
    pma_member_free_velocity(&q.member, 0, 0.5, 1.0, vf[0]);
    pma_member_free_velocity(&alone.member, 0, 0.5, 1.0, vf[1]);
    CHECK_BITS(CONSTRAINTS, vf[0], vf[1]);
    CHECK_STATUS(q.member.table->advance(q.member.self, &step, NULL, lam, NULL), PMA_OK);
    CHECK_STATUS(alone.member.table->advance(alone.member.self, &step, NULL, lam, NULL), PMA_OK);
    compare_closed(&q, &alone);
    pma_subdomain_destroy(q.core);
    pma_subdomain_destroy(alone.core);
}

/* One factor may want scratch and the other none. */
static void check_one_in_panels(bool twice)
{
    panelled q, dense;
    fill_subdomain(&q);
    fill_subdomain(&dense);
    pma_parts parts = describe(&q.of);
    put_into_panels(&q.of, twice, q.values[twice],
                    twice ? &parts.twice.factor : &parts.single.factor);
    create_panelled(&q, &parts);
    parts = describe(&dense.of);
    create_panelled(&dense, &parts);
    const double lam[CONSTRAINTS] = {3.0, -4.0};
    double x[CONSTRAINTS] = {0.0}, y[CONSTRAINTS] = {0.0};
    for (size_t macro = 0; macro < 3; macro++) {
        walk(&q.member, macro > 0);
        walk(&dense.member, macro > 0);
        pma_member_compliance(&q.member, macro > 0, lam, x);
        pma_member_compliance(&dense.member, macro > 0, lam, y);
    }
    for (size_t i = 0; i < DOFS; i++) {
        CHECK_NEAR(pma_subdomain_present(q.core)->u[i], pma_subdomain_present(dense.core)->u[i],
                   AGREE);
        CHECK_NEAR(pma_subdomain_present(q.core)->w[i], pma_subdomain_present(dense.core)->w[i],
                   AGREE);
    }
    for (size_t row = 0; row < CONSTRAINTS; row++)
        CHECK_NEAR(x[row], y[row], AGREE);
    pma_subdomain_destroy(q.core);
    pma_subdomain_destroy(dense.core);
}

static void scratch_is_enough_for_the_factor_of_either_step(void)
{
    for (int twice = 0; twice <= 1; twice++)
        check_one_in_panels(twice);
}

/* Substeps of a link response while a substep of the free macro run is open. */
static void link_responses_have_scratch_of_their_own(void)
{
    panelled q, dense;
    const double lam[CONSTRAINTS] = {3.0, -4.0};
    const pma_substep step = {.j = 0};
    fill_subdomain(&q);
    fill_subdomain(&dense);
    q.of.doubled = dense.of.doubled = false;
    q.of.has_responses = dense.of.has_responses = true;
    pma_parts parts = describe(&q.of);
    put_into_panels(&q.of, false, q.values[0], &parts.single.factor);
    create_panelled(&q, &parts);
    parts = describe(&dense.of);
    create_panelled(&dense, &parts);
    const size_t scratch = pma_factor_scratch(&q.core->parts.single.factor);
    CHECK_STATUS(q.member.table->advance(q.member.self, NULL, &step, NULL, NULL), PMA_OK);
    mark(scratch, q.core->work);
    mark(scratch, q.core->link_work);
    for (size_t j = 1; j <= 2; j++) {
        q.member.table->advance_response(q.member.self, j, lam, lam);
        dense.member.table->advance_response(dense.member.self, j, lam, lam);
    }
    check_marked(scratch, q.core->work);
    check_marked(scratch, q.core->link_work);
    const pma_state *x = pma_response_state(pma_subdomain_response(q.core));
    const pma_state *y = pma_response_state(pma_subdomain_response(dense.core));
    for (size_t i = 0; i < DOFS; i++) {
        CHECK_NEAR(x->u[i], y->u[i], AGREE);
        CHECK_NEAR(x->w[i], y->w[i], AGREE);
    }
    pma_subdomain_destroy(q.core);
    pma_subdomain_destroy(dense.core);
}

/* ---- by two threads ------------------------------------------------------------------------- */

static void walk_on(void *ctx, size_t worker)
{
    (void)worker;
    for (size_t round = 0; round < ROUNDS; round++)
        walk(ctx, false);
}

/* Marked (c) in member.h. ThreadSanitizer watches, and no number changes. */
static void the_compliance_can_be_evaluated_while_steps_are_made(void)
{
    panelled q, alone;
    pma_team *team;
    const double lam[CONSTRAINTS] = {3.0, -4.0};
    double expected[CONSTRAINTS] = {0.0}, x[4 * MOST], y[4 * MOST];
    make_panelled(&q);
    make_panelled(&alone);
    pma_member_compliance(&alone.member, false, lam, expected);
    walk_on(&alone.member, 0);
    CHECK_STATUS(pma_team_create(2, &team), PMA_OK);
    CHECK_STATUS(pma_team_gather(team), PMA_OK);
    pma_team_post(team, 1, walk_on, &q.member);
    for (size_t k = 0; k < ROUNDS; k++) {
        double sum[CONSTRAINTS] = {0.0};
        pma_member_compliance(&q.member, false, lam, sum);
        CHECK_BITS(CONSTRAINTS, sum, expected);
    }
    pma_team_await(team, 1, NULL, NULL);
    q.of.core = q.core;
    alone.of.core = alone.core;
    const size_t count = copy_present(&q.of, x);
    copy_present(&alone.of, y);
    CHECK_BITS(count, x, y);
    pma_team_destroy(team);
    pma_subdomain_destroy(q.core);
    pma_subdomain_destroy(alone.core);
}

const test SCRATCH_TESTS[] = {
    TEST(steps_leave_the_scratch_of_the_compliance_alone),
    TEST(the_compliance_leaves_the_scratch_of_the_steps_alone),
    TEST(scratch_is_enough_for_the_factor_of_either_step),
    TEST(link_responses_have_scratch_of_their_own),
    TEST(the_compliance_can_be_evaluated_while_steps_are_made),
    END_OF_TESTS,
};
