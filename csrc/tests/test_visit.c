/* test_visit.c - a substep closed and the next one opened in one visit, bitwise as one by one. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "matrices.h"
#include "member/cases.h"
#include "member/inside.h"
#include "member/subdomain.h"
#include "naive.h"
#include "parts.h"
#include "tests.h"

enum { SUBSTEPS = 3, MACROS = 4 };

static const int64_t ONE_LINK[UNKNOWNS + 1] = {0};
static double load[UNKNOWNS], begin[3 * UNKNOWNS];

static bool never(void *ctx)
{
    (void)ctx;
    return false;
}

/* K is A and Mbar is A too, which need not belong together. */
static pma_parts describe_tree(structure *m, const pma_tree *T, bool doubled)
{
    double *update = malloc((pma_panels_update_size(&m->panels) + 1) * sizeof *update);
    size_t column;
    const pma_panels_input input = {
        .n = m->n, .ptr = m->ptr, .index = m->index, .values = m->entries, .lost = 1e-12};
    CHECK_STATUS(pma_panels_factor(&m->panels, &input, m->owner, &NAIVE_BLAS, m->inverse, update,
                                   m->integers, &column, never, NULL),
                 PMA_OK);
    free(update);
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

/* One by one in `a`; in `b` each closed together with the next one opened, past the macro level. */
static void check_steps(pma_subdomain *a, pma_subdomain *b, bool doubled)
{
    const pma_member x = pma_subdomain_member(a), y = pma_subdomain_member(b);
    const pma_substep first = substep(0, 0, doubled);
    CHECK_STATUS(y.table->prepare_visits(y.self), PMA_OK);
    CHECK_STATUS(y.table->open(y.self, &first), PMA_OK);
    for (size_t macro = 0; macro < MACROS; macro++) {
        for (size_t j = 0; j < SUBSTEPS; j++) {
            const pma_substep now = substep(macro, j, doubled),
                              next = substep(macro, j + 1, doubled);
            CHECK_STATUS(x.table->open(x.self, &now), PMA_OK);
            CHECK_STATUS(x.table->close(x.self, &now, NULL), PMA_OK);
            CHECK_STATUS(y.table->visit(y.self, &now, &next, NULL), PMA_OK);
            CHECK_INT(y.table->opened(y.self), j + 2);
            check_same(a, b, j + 1);
            CHECK_BITS(a->parts.nb, pma_levels_free_velocity(&b->levels, j + 1),
                       pma_levels_free_velocity(&a->levels, j + 1));
        }
        x.table->commit(x.self);
        y.table->commit(y.self);
        check_same(a, b, 0);
        CHECK_INT(y.table->opened(y.self), 1);
    }
}

/* ... and when it is discarded, what was opened last leaves no trace. */
static void check_discarded(pma_subdomain *a, pma_subdomain *b, bool doubled)
{
    const pma_member x = pma_subdomain_member(a), y = pma_subdomain_member(b);
    const pma_substep now = substep(MACROS, 0, doubled), next = substep(MACROS, 1, doubled);
    CHECK_STATUS(y.table->visit(y.self, &now, &next, NULL), PMA_OK);
    y.table->discard(y.self);
    CHECK_INT(y.table->opened(y.self), 0);
    check_same(a, b, 0);
    for (size_t i = 0; i < 2; i++) {
        const pma_member *z = i == 0 ? &x : &y;
        CHECK_STATUS(z->table->open(z->self, &now), PMA_OK);
        CHECK_STATUS(z->table->close(z->self, &now, NULL), PMA_OK);
    }
    check_same(a, b, 1);
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

static void check_visits(structure *m, size_t entries, bool doubled)
{
    pma_tree *T;
    CHECK_STATUS(pma_tree_create(&m->panels, m->n, m->nb, entries, &T), PMA_OK);
    const pma_parts parts = describe_tree(m, T, doubled);
    pma_subdomain *a = start(&parts), *b = start(&parts);
    CHECK_INT(b->fuses, T != NULL);
    check_steps(a, b, doubled);
    check_discarded(a, b, doubled);
    pma_subdomain_destroy(a);
    pma_subdomain_destroy(b);
    pma_tree_destroy(T);
}

static void two_substeps_in_a_visit_are_those_one_by_one(void)
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
            check_visits(&m, entries, false);
            check_visits(&m, entries, true);
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

/* Two nodes without nodes below them have nothing to do with each other. */
static void rows_that_couple_beside_the_tree_are_not_visited_together(void)
{
    static structure m, other;
    pma_tree *T;
    pma_subdomain *s;
    uint64_t seed = 82;
    draw_definite(&m, UNKNOWNS, 4, 24, &seed);
    analyse(&m);
    CHECK_STATUS(pma_tree_create(&m.panels, m.n, m.nb, 0, &T), PMA_OK);
    pma_parts parts = describe_tree(&m, T, false);
    size_t beside = 1;
    while (beside < T->count && T->child[beside] != PMA_NO_NODE)
        beside++;
    CHECK(beside < T->count);
    for (size_t i = 0; i < 2; i++) {
        other = m;
        couple_first(&other, (int32_t)T->column[i == 0 ? T->parent[0] : beside]);
        parts.K.ptr = other.ptr;
        parts.K.index = other.index;
        CHECK_STATUS(pma_subdomain_create(&parts, &s), PMA_OK);
        CHECK_INT(s->fuses, i == 0);
        pma_subdomain_destroy(s);
    }
    pma_tree_destroy(T);
}

const test VISIT_TESTS[] = {
    TEST(two_substeps_in_a_visit_are_those_one_by_one),
    TEST(rows_that_couple_beside_the_tree_are_not_visited_together),
    END_OF_TESTS,
};
