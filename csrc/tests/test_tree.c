/* test_tree.c - sweeps by the nodes of an elimination tree, in any order that a tree allows. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "algebra/factor.h"
#include "algebra/tree.h"
#include "check.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"

static void factor_structure(structure *m)
{
    size_t column;
    CHECK_STATUS(make_numbers(m, 1e-12, &NEVER, &column), PMA_OK);
}

static pma_factor factor_of(const structure *m, const pma_tree *T)
{
    return (pma_factor){.form = PMA_PANELS,
                        .n = m->n,
                        .nb = m->nb,
                        .inverse = m->inverse,
                        .panels = m->panels,
                        .tree = T};
}

static void check_structure(const void *of, const double *x, const double *b)
{
    check_definite_residual(of, x, b);
}

/* Every column is in one node, the nodes below another one have smaller numbers, and a node that is
 * no single supernode has at most `entries`. */
static void check_nodes(const structure *m, const pma_tree *T, size_t entries)
{
    CHECK_INT(T->column[0], 0);
    CHECK_INT(T->column[T->count], m->n - m->nb);
    for (size_t t = 0; t < T->count; t++) {
        const size_t begin = (size_t)m->owner[T->column[t]],
                     last = (size_t)m->owner[T->column[t + 1] - 1];
        CHECK(T->column[t] < T->column[t + 1] && T->parent[t] > t && T->parent[t] <= T->count);
        CHECK(begin == last || (size_t)(m->start[last + 1] - m->start[begin]) <= entries);
    }
}

/* Of the whole sweeps, and of the same node by node: the subtree below a node both ways before the
 * node itself is swept forward again. */
static void check_orders(const pma_factor *f, const double *b)
{
    const pma_tree *T = f->tree;
    double x[UNKNOWNS], opened[UNKNOWNS], again[UNKNOWNS] = {0.0}, x_b[UNKNOWNS];
    const double zero[UNKNOWNS] = {0.0};
    double *work = take_scratch(f);
    memcpy(opened, b, sizeof opened);
    pma_factor_open(f, opened, x_b, work);
    memcpy(x, b, sizeof x);
    pma_factor_open_interior(f, x, work);
    CHECK_BITS(f->n, x, opened);
    pma_factor_close(f, zero, x, work);

    double visited[UNKNOWNS];
    memcpy(visited, opened, sizeof visited);
    memcpy(again + (f->n - f->nb), b + (f->n - f->nb), f->nb * sizeof *b);
    pma_factor_close_border(f, zero, visited, work);
    size_t node = T->child[T->count];
    while (node != T->count) {
        pma_factor_close_node(f, node, visited, NULL, work);
        memcpy(again + T->column[node], b + T->column[node],
               (T->column[node + 1] - T->column[node]) * sizeof *b);
        if (T->child[node] != PMA_NO_NODE) {
            node = T->child[node];
            continue;
        }
        pma_factor_open_node(f, node, again, NULL, work);
        while (T->sibling[node] == PMA_NO_NODE && T->parent[node] != T->count) {
            node = T->parent[node];
            pma_factor_open_node(f, node, again, NULL, work);
        }
        node = T->sibling[node] != PMA_NO_NODE ? T->sibling[node] : T->count;
    }
    pma_factor_open_border(f, again, x_b, work);
    CHECK_BITS(f->n, visited, x);
    CHECK_BITS(f->n, again, opened);
    return_scratch(f, work);
}

/* Trees from one supernode a node to few nodes; returns how many had at least two. */
static size_t check_trees(structure *m, uint64_t *seed)
{
    double b[UNKNOWNS] = {0.0}, x[UNKNOWNS], x_b[UNKNOWNS];
    const double zero[UNKNOWNS] = {0.0};
    size_t trees = 0;
    analyse(m);
    factor_structure(m);
    draw_vector(m->n, seed, b);
    for (size_t entries = 0; entries <= 256; entries = 2 * entries + 1) {
        pma_tree *T;
        CHECK_STATUS(pma_tree_create(&m->panels, m->n, m->nb, entries, &T), PMA_OK);
        if (!T)
            continue;
        const pma_factor f = factor_of(m, T);
        check_nodes(m, T, entries);
        memcpy(x, b, sizeof x);
        double *work = take_scratch(&f);
        pma_factor_open(&f, x, x_b, work);
        pma_factor_close(&f, zero, x, work);
        return_scratch(&f, work);
        check_definite_residual(m, x, b);
        check_orders(&f, b);
        check_lanes(&f, check_structure, m, seed);
        pma_tree_destroy(T);
        trees++;
    }
    return trees;
}

static void sweeps_by_nodes_solve_and_do_not_depend_on_their_order(void)
{
    static structure m;
    uint64_t seed = 71;
    size_t trees = 0;
    draw_grid(&m);
    trees += check_trees(&m, &seed);
    for (uint32_t one_in = 1; one_in <= 64; one_in *= 2) {
        draw_definite(&m, UNKNOWNS, draw(&seed, 8), one_in, &seed);
        trees += check_trees(&m, &seed);
    }
    CHECK(trees > 20);
}

/* None, one unknown, no more than an interface, forests. */
static void small_trees_and_forests_are_swept_too(void)
{
    static structure m;
    uint64_t seed = 72;
    size_t trees = 0;
    for (size_t n = 0; n <= 16; n++) {
        for (size_t nb = 0; nb <= n; nb++) {
            draw_definite(&m, n, nb, 3 + draw(&seed, 9), &seed);
            const size_t found = check_trees(&m, &seed);
            CHECK(n - nb > 1 || found == 0);
            trees += found;
        }
    }
    CHECK(trees > 100);
}

/* The first column updates row 2, the second one, which comes next on its way, does not. */
static void rows_that_a_parent_has_not_are_passed_on(void)
{
    const int64_t first[] = {0, 1, 2, 3, 4}, row_ptr[] = {0, 2, 3, 4, 4}, start[] = {0, 3, 5, 7, 8};
    const int32_t rows[] = {1, 2, 3, 3};
    double values[] = {1.0, 0.5, 0.25, 1.0, 0.5, 1.0, 2.0, 1.0}, x[] = {8.0, 4.0, 2.0, 1.0};
    const double inverse[] = {1.0, 1.0, 1.0, 1.0}, expected[] = {8.0, 0.0, 0.0, 1.0};
    const pma_panels p = {4, first, row_ptr, rows, start, values, 0};
    pma_tree *T;
    CHECK_STATUS(pma_panels_check(&p, 4, 0), PMA_OK);
    CHECK_STATUS(pma_tree_create(&p, 4, 0, 2, &T), PMA_OK);
    const pma_factor f = {.form = PMA_PANELS, .n = 4, .inverse = inverse, .panels = p, .tree = T};
    CHECK_INT(T->count, 4);
    double *work = take_scratch(&f);
    pma_factor_open(&f, x, x, work);
    CHECK_BITS(4, x, expected);
    return_scratch(&f, work);
    pma_tree_destroy(T);
}

const test TREE_TESTS[] = {
    TEST(sweeps_by_nodes_solve_and_do_not_depend_on_their_order),
    TEST(small_trees_and_forests_are_swept_too),
    TEST(rows_that_a_parent_has_not_are_passed_on),
    END_OF_TESTS,
};
