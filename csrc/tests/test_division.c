/* test_division.c - a substep by several workers in branches of the tree: bitwise as by one. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "allocations.h"
#include "check.h"
#include "couple/inside.h"
#include "matrices.h"
#include "naive.h"
#include "subdomain/cases.h"
#include "subdomain/inside.h"
#include "subdomain/subdomain.h"
#include "subdomains.h"
#include "tests.h"

enum { SUBSTEPS = 3, MACROS = 4 };

static const int64_t ONE_LINK[UNKNOWNS + 1] = {0};
static double load[UNKNOWNS], begin[3 * UNKNOWNS];

/* K is A and Mbar is A too, which need not belong together. */
static pma_parts describe_tree(structure *m, const pma_tree *T, bool doubled)
{
    size_t column;
    CHECK_STATUS(make_numbers(m, 1e-12, &NEVER, &column), PMA_OK);
    const pma_matrix A = {
        .form = PMA_SPARSE, .n = m->n, .values = m->entries, .ptr = m->ptr, .index = m->index};
    const pma_factor f = {.form = PMA_PANELS,
                          .n = m->n,
                          .nb = m->nb,
                          .inverse = m->inverse,
                          .panels = m->panels,
                          .tree = T};
    return (pma_parts){.n = m->n,
                       .nb = m->nb,
                       .substeps = SUBSTEPS,
                       .doubled = doubled,
                       .K = A,
                       .C = {.form = PMA_ZERO, .n = m->n},
                       .single = {pma_step_make(generalized_alpha(0.5), 0.1), f},
                       .twice = {pma_step_make(generalized_alpha(0.5), 0.2), f},
                       .link = {.nb = m->nb, .ptr = ONE_LINK}};
}

static pma_substep substep(size_t macro, size_t j, bool doubled)
{
    const size_t number = SUBSTEPS * macro + j;
    return (pma_substep){.j = j,
                         .number = (int64_t)number,
                         .t1 = 0.1 * (double)(number + 1),
                         .twice = doubled && number >= SUBSTEPS};
}

static void check_same(const pma_subdomain *a, const pma_subdomain *b, size_t j)
{
    const size_t n = a->parts.n;
    const pma_state *x = pma_levels_at(&a->levels, j), *y = pma_levels_at(&b->levels, j);
    CHECK_BITS(n, x->u, y->u);
    CHECK_BITS(n, x->v, y->v);
    CHECK_BITS(n, x->w, y->w);
    CHECK_BITS(n, x->a, y->a);
}

/* The branches of as many workers, one after the other. */
static bool share_in_turn(void *ctx, bool (*work)(void *self, size_t worker), void *self)
{
    bool finite = true;
    for (size_t w = *(const size_t *)ctx; w-- > 0;)
        finite = work(self, w) && finite;
    return finite;
}

static void step_in_branches(const pma_member *m, size_t workers, const pma_substep *step)
{
    const pma_workers all = {workers, &workers, share_in_turn};
    CHECK_STATUS(m->table->advance(m->self, NULL, step, NULL, &all), PMA_OK);
    CHECK_STATUS(m->table->advance(m->self, step, NULL, NULL, &all), PMA_OK);
}

/* Every node is in one branch or in the trunk. */
static void check_division(const pma_subdomain *s, size_t workers)
{
    const pma_branches *b = &s->division->branches;
    const pma_tree *T = s->parts.single.factor.tree;
    size_t nodes = b->trunk_count;
    CHECK_INT(b->workers, workers);
    for (size_t i = 0; i < b->begin[workers]; i++) {
        size_t low = b->root[i];
        while (T->child[low] != PMA_NO_NODE)
            low = T->child[low];
        nodes += b->root[i] - low + 1;
    }
    CHECK_INT(nodes, T->count);
}

static void check_branches(pma_subdomain *a, pma_subdomain *b, bool doubled, size_t workers)
{
    const pma_member x = pma_subdomain_member(a), y = pma_subdomain_member(b);
    if (!b->division || b->division->branches.workers == 0)
        return;
    CHECK_STATUS(y.table->prepare(y.self, false, workers), PMA_OK);
    check_division(b, workers);
    for (size_t macro = 0; macro < MACROS; macro++) {
        for (size_t j = 0; j < SUBSTEPS; j++) {
            const pma_substep now = substep(macro, j, doubled);
            CHECK_STATUS(x.table->advance(x.self, NULL, &now, NULL, NULL), PMA_OK);
            CHECK_STATUS(x.table->advance(x.self, &now, NULL, NULL, NULL), PMA_OK);
            step_in_branches(&y, workers, &now);
            check_same(a, b, j + 1);
            CHECK_BITS(a->parts.nb, pma_levels_free_velocity(&b->levels, j + 1),
                       pma_levels_free_velocity(&a->levels, j + 1));
        }
        x.table->commit(x.self);
        y.table->commit(y.self);
    }
}

static pma_subdomain *start(const pma_parts *parts)
{
    pma_subdomain *s;
    const double *u = begin;
    CHECK_STATUS(pma_subdomain_create(parts, &s), PMA_OK);
    pma_subdomain_set_load(s, (pma_load){.kind = PMA_LOAD_CONSTANT, .n = parts->n, .values = load});
    pma_subdomain_start(s, u, u + parts->n, u + 2 * parts->n, NULL);
    return s;
}

static interrupter stop;
static const pma_member_table *usual;
static pma_member_table interrupted;

/* Where several share it, each of them is interrupted in its work. */
typedef struct {
    const pma_workers *workers;
    bool (*work)(void *self, size_t worker);
    void *self;
} interrupted_work;

static bool work_and_interrupt(void *ctx, size_t worker)
{
    const interrupted_work *w = ctx;
    interrupt(&stop, worker > 0);
    return w->work(w->self, worker);
}

static bool share_and_interrupt(void *ctx, bool (*work)(void *self, size_t worker), void *self)
{
    const pma_workers *workers = ctx;
    interrupted_work w = {workers, work, self};
    return workers->share(workers->ctx, work_and_interrupt, &w);
}

static pma_status advance_and_interrupt(void *self, const pma_substep *closed,
                                        const pma_substep *opened, const double *lam,
                                        const pma_workers *workers)
{
    if (!workers) {
        if (closed)
            interrupt(&stop, false);
        return usual->advance(self, closed, opened, lam, workers);
    }
    const pma_workers shared = {workers->count, (void *)(uintptr_t)workers, share_and_interrupt};
    return usual->advance(self, closed, opened, lam, &shared);
}

/* As a coupler does it, which takes the member for one that is worth several workers. */
static pma_coupler *couple(pma_subdomain *s, size_t threads, pma_interface *none)
{
    const pma_factor empty = {.form = PMA_DIAGONAL};
    pma_member member = pma_subdomain_member(s);
    member.entries = 10 * PMA_RANGE;
    usual = member.table;
    interrupted = *usual;
    interrupted.advance = advance_and_interrupt;
    member.table = &interrupted;
    CHECK_STATUS(pma_interface_create(&empty, none), PMA_OK);
    const pma_interface H = *none;
    const pma_coupler_parts parts = {.count = 1,
                                     .members = &member,
                                     .H_start = H,
                                     .H = H,
                                     .dt = SUBSTEPS * s->parts.single.step.h,
                                     .schedule = &pma_fine_schedule,
                                     .threads = threads};
    pma_coupler *c;
    CHECK_STATUS(pma_coupler_create(&parts, &c), PMA_OK);
    pma_coupler_start(c, 0, load, load); /* no constraint */
    CHECK_INT(pma_coupler_threads(c), threads);
    return c;
}

/* Without an interface, in nodes of one supernode each. */
static pma_tree *draw_alone(structure *m, uint64_t seed)
{
    pma_tree *T;
    draw_definite(m, UNKNOWNS, 0, 24, &seed);
    analyse(m);
    draw_vector(m->n, &seed, load);
    for (size_t k = 0; k < 3 * m->n; k++)
        begin[k] = draw_eighth(&seed);
    CHECK_STATUS(pma_tree_create(&m->panels, m->n, m->nb, 0, &T), PMA_OK);
    return T;
}

static void a_coupler_with_any_number_of_threads_is_bitwise_identical(void)
{
    static structure m;
    pma_interface none;
    pma_tree *T = draw_alone(&m, 83);
    for (size_t doubled = 0; doubled < 2; doubled++) {
        const pma_parts parts = describe_tree(&m, T, doubled);
        pma_subdomain *alone = start(&parts);
        pma_coupler *c = couple(alone, 1, &none);
        CHECK_STATUS(pma_coupler_advance(c, MACROS, NULL, NULL), PMA_OK);
        pma_coupler_destroy(c);
        pma_interface_destroy(&none);
        for (size_t threads = 2; threads <= 4; threads++) {
            pma_subdomain *shared = start(&parts);
            c = couple(shared, threads, &none);
            CHECK_STATUS(pma_coupler_advance(c, MACROS - 1, NULL, NULL), PMA_OK);
            CHECK_STATUS(pma_coupler_advance(c, 1, NULL, NULL), PMA_OK);
            check_same(shared, alone, 0);
            pma_coupler_destroy(c);
            pma_interface_destroy(&none);
            pma_subdomain_destroy(shared);
        }
        pma_subdomain_destroy(alone);
    }
    pma_tree_destroy(T);
}

/* ---- stopped in a step ---------------------------------------------------------------------- */

/* At the stop_at-th substep, or share of one: true if the run ended with it. All is as after whole
 * macro steps of `alone`, and goes on from there. */
static bool check_stop(const pma_parts *parts, size_t threads, size_t stop_at)
{
    pma_interface none[2];
    pma_subdomain *s = start(parts), *alone = start(parts);
    pma_coupler *c = couple(s, threads, &none[0]), *other = couple(alone, 1, &none[1]);
    const pma_poll poll = {poll_interrupter, &stop, 0};
    stop.stop_at = stop_at;
    atomic_store(&stop.called, 0);
    atomic_store(&stop.polled, false);
    const pma_status status = pma_coupler_advance(c, MACROS, NULL, &poll);
    const bool stopped = status == PMA_STOPPED;
    const int64_t whole = pma_coupler_step_count(c);
    CHECK(stopped || (status == PMA_OK && whole == MACROS));
    stop.stop_at = 0;
    CHECK_STATUS(pma_coupler_advance(other, whole, NULL, NULL), PMA_OK);
    check_same(s, alone, 0);
    CHECK_INT(s->levels.opened, alone->levels.opened);
    CHECK_STATUS(pma_coupler_advance(c, MACROS + 1 - whole, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_coupler_advance(other, MACROS + 1 - whole, NULL, NULL), PMA_OK);
    check_same(s, alone, 0);
    pma_coupler_destroy(c);
    pma_coupler_destroy(other);
    for (size_t i = 0; i < 2; i++)
        pma_interface_destroy(&none[i]);
    pma_subdomain_destroy(s);
    pma_subdomain_destroy(alone);
    return stopped;
}

static void a_stop_in_the_middle_of_a_substep_leaves_the_last_macro_level(void)
{
    static structure m;
    pma_tree *T = draw_alone(&m, 84);
    for (size_t doubled = 0; doubled < 2; doubled++) {
        const pma_parts parts = describe_tree(&m, T, doubled);
        for (size_t threads = 1; threads <= 3; threads++) {
            size_t stop_at = 1;
            while (check_stop(&parts, threads, stop_at))
                stop_at += STRIDE * threads; /* of several threads at one: a stop waits 20 ms */
            CHECK(stop_at > threads * (MACROS * SUBSTEPS - 2)); /* in every one of them */
        }
    }
    pma_tree_destroy(T);
}

static void a_step_in_branches_does_not_allocate(void)
{
    static structure m;
    pma_interface none;
    if (!count_allocations())
        return;
    pma_tree *T = draw_alone(&m, 85);
    const pma_parts parts = describe_tree(&m, T, true);
    for (size_t threads = 1; threads <= 3; threads++) {
        const size_t nothing = allocations_counted();
        pma_subdomain *s = start(&parts);
        pma_coupler *c = couple(s, threads, &none);
        CHECK_STATUS(pma_coupler_advance(c, 1, NULL, NULL), PMA_OK); /* workers are there now */
        const size_t before = allocations_counted();
        CHECK(before > nothing);
        CHECK_STATUS(pma_coupler_advance(c, MACROS, NULL, NULL), PMA_OK);
        CHECK_INT(allocations_counted(), before);
        pma_coupler_destroy(c);
        pma_interface_destroy(&none);
        pma_subdomain_destroy(s);
    }
    pma_tree_destroy(T);
}

/* ---- one worker and several ----------------------------------------------------------------- */

static void check_parts(const pma_parts *parts, bool branched, bool doubled)
{
    for (size_t workers = 1; workers <= 5; workers += 2) {
        pma_subdomain *a = start(parts), *b = start(parts);
        CHECK_INT(b->division && b->division->branches.workers > 0, branched);
        check_branches(a, b, doubled, workers);
        pma_subdomain_destroy(a);
        pma_subdomain_destroy(b);
    }
}

static void check_workers(structure *m, size_t entries, bool doubled)
{
    pma_tree *T;
    CHECK_STATUS(pma_tree_create(&m->panels, m->n, m->nb, entries, &T), PMA_OK);
    const pma_parts parts = describe_tree(m, T, doubled);
    check_parts(&parts, T != NULL, doubled);
    pma_tree_destroy(T);
}

static void a_substep_by_any_workers_is_that_of_one(void)
{
    static structure m;
    uint64_t seed = 81;
    for (size_t i = 0; i < 12; i++) {
        const size_t n = i < 8 ? UNKNOWNS : 1 + draw(&seed, 9);
        if (i == 0)
            draw_grid(&m);
        else
            draw_definite(&m, n, draw(&seed, (uint32_t)(n < 8 ? n : 8) + 1), 4 * (uint32_t)i,
                          &seed);
        analyse(&m);
        draw_vector(m.n, &seed, load);
        for (size_t k = 0; k < 3 * m.n; k++)
            begin[k] = draw_eighth(&seed);
        for (size_t entries = 0; entries <= 256; entries = 8 * entries + 4) {
            check_workers(&m, entries, false);
            check_workers(&m, entries, true);
        }
    }
}

/* The diagonal, and one entry in the row of the first unknown. */
static void couple_first(structure *m, int32_t with)
{
    for (size_t i = 0; i < m->n; i++) {
        m->index[i + (i > 0)] = (int32_t)i;
        m->ptr[i] = (int64_t)(i + (i > 0));
    }
    m->index[1] = with;
    m->ptr[m->n] = (int64_t)m->n + 1;
}

/* Two nodes without nodes below them, which no entry of the factor couples, in two branches. */
static void rows_of_K_may_couple_any_nodes(void)
{
    static structure m, other;
    pma_tree *T;
    uint64_t seed = 82;
    draw_definite(&m, UNKNOWNS, 4, 24, &seed);
    analyse(&m);
    CHECK_STATUS(pma_tree_create(&m.panels, m.n, m.nb, 0, &T), PMA_OK);
    pma_parts parts = describe_tree(&m, T, false);
    size_t beside = 1;
    while (beside < T->count && T->child[beside] != PMA_NO_NODE)
        beside++;
    CHECK(beside < T->count);
    other = m;
    couple_first(&other, (int32_t)T->column[beside]);
    parts.K.ptr = other.ptr;
    parts.K.index = other.index;
    check_parts(&parts, true, false);
    pma_tree_destroy(T);
}

const test DIVISION_TESTS[] = {
    TEST(a_substep_by_any_workers_is_that_of_one),
    TEST(a_coupler_with_any_number_of_threads_is_bitwise_identical),
    TEST(a_stop_in_the_middle_of_a_substep_leaves_the_last_macro_level),
    TEST(a_step_in_branches_does_not_allocate),
    TEST(rows_of_K_may_couple_any_nodes),
    END_OF_TESTS,
};
