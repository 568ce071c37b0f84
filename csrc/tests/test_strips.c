/* test_strips.c - rows that read the same columns, side by side. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "algebra/matrix.h"
#include "check.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"

enum { DOFS = 330 }; /* more columns than are gathered at a time */

/* A symmetric matrix with nodes of several dofs, and its strips in arrays of just their size. */
typedef struct {
    size_t n;
    double A[DOFS * DOFS]; /* by rows */
    int64_t ptr[DOFS + 1];
    int32_t index[DOFS * DOFS];
    double entries[DOFS * DOFS];
    int64_t first[DOFS + 1], own_ptr[DOFS + 1], start[DOFS + 1];
    int32_t *own_index;
    double *values;
    pma_strips strips;
} stripped;

/* One in `one_in` pairs of nodes is tied, by blocks that are full but for one in eight entries. */
static void draw_nodes(stripped *m, size_t nodes, size_t dofs, uint32_t one_in, uint64_t *seed)
{
    const size_t n = m->n = nodes * dofs;
    memset(m->A, 0, sizeof m->A);
    for (size_t a = 0; a < nodes; a++) {
        for (size_t b = 0; b <= a; b++) {
            if (a != b && draw(seed, one_in) != 0)
                continue;
            for (size_t i = a * dofs; i < (a + 1) * dofs; i++) {
                for (size_t j = b * dofs; j < (b + 1) * dofs; j++) {
                    if (draw(seed, 8) != 0)
                        m->A[i * n + j] = m->A[j * n + i] = draw_eighth(seed);
                }
            }
        }
    }
    m->ptr[0] = 0;
    for (size_t i = 0; i < n; i++) {
        int64_t k = m->ptr[i];
        for (size_t j = n; j-- > 0;) { /* in no particular order */
            if (m->A[i * n + j] == 0.0)
                continue;
            m->index[k] = (int32_t)j;
            m->entries[k++] = m->A[i * n + j];
        }
        m->ptr[i + 1] = k;
    }
}

static void make_strips(stripped *m)
{
    static int64_t columns[DOFS], mark[DOFS];
    const size_t count = pma_strips_group(m->n, m->ptr, m->index, m->first, columns, mark);
    m->own_ptr[0] = m->start[0] = 0;
    for (size_t s = 0; s < count; s++) {
        m->own_ptr[s + 1] = m->own_ptr[s] + columns[s];
        m->start[s + 1] = m->start[s] + columns[s] * (m->first[s + 1] - m->first[s]);
    }
    m->own_index = malloc((size_t)m->own_ptr[count] * sizeof *m->own_index + 1);
    m->values = calloc((size_t)m->start[count] + 1, sizeof *m->values);
    m->strips = (pma_strips){count, m->first, m->own_ptr, m->own_index, m->start, m->values};
    pma_strips_fill(&m->strips, m->n, m->ptr, m->index, m->entries, mark, m->own_index, m->values);
    CHECK_STATUS(pma_strips_check(&m->strips, m->n), PMA_OK);
}

static void free_strips(stripped *m)
{
    free(m->own_index);
    free(m->values);
}

/* Products of eighths with small integers: no rounding, so they have to be equal. */
static void check_product(const stripped *m, uint64_t *seed)
{
    static double x[DOFS], y[DOFS], parts[DOFS], expected[DOFS];
    const size_t n = m->n;
    const pma_matrix A = {.form = PMA_STRIPS, .n = n, .strips = m->strips};
    for (size_t i = 0; i < n; i++) {
        x[i] = draw(seed, 100);
        y[i] = parts[i] = expected[i] = draw(seed, 100);
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++)
            expected[i] -= m->A[i * n + j] * x[j];
    }
    CHECK_STATUS(pma_matrix_check(&A), PMA_OK);
    pma_matrix_subtract(&A, x, y);
    CHECK_BITS(n, y, expected);
    for (size_t begin = 0; begin < n; begin += 5) /* in the middle of strips */
        pma_matrix_subtract_rows(&A, begin, begin + 5 < n ? begin + 5 : n, x, parts);
    CHECK_BITS(n, parts, expected);
    pma_matrix_subtract_rows(&A, n, n, x, parts);
    CHECK_BITS(n, parts, expected);
    check_lane_product(&A, seed);
}

static void strips_multiply_like_two_loops(void)
{
    static stripped m;
    uint64_t seed = 18;
    for (size_t drawn = 0; drawn < 400; drawn++) {
        const size_t dofs = 1 + drawn % 8, nodes = 1 + drawn / 8 % 5;
        draw_nodes(&m, nodes, dofs, (uint32_t)nodes, &seed);
        make_strips(&m);
        check_product(&m, &seed);
        free_strips(&m);
    }
    draw_nodes(&m, DOFS / 3, 3, 1, &seed); /* all tied */
    make_strips(&m);
    check_product(&m, &seed);
    free_strips(&m);
}

/* 27 neighbours, of which a node and the next have 18 in common: what a solid has. */
static void a_strip_holds_the_dofs_of_one_node(void)
{
    static stripped m;
    for (size_t dofs = 2; dofs <= 6; dofs++) {
        const size_t nodes = 54, n = m.n = nodes * dofs;
        int64_t k = m.ptr[0] = 0;
        for (size_t i = 0; i < n; i++) {
            for (size_t column = 0; column < 27 * dofs; column++)
                m.index[k++] = (int32_t)((9 * (i / dofs) * dofs + column) % n);
            m.ptr[i + 1] = k;
        }
        memset(m.entries, 0, (size_t)k * sizeof *m.entries);
        make_strips(&m);
        CHECK_INT(m.strips.count, nodes);
        for (size_t s = 0; s <= nodes; s++)
            CHECK_INT(m.first[s], s * dofs);
        free_strips(&m);
    }
}

/* Strips {0, 1} on the columns 0..3 and {2} on 2, 2, 2, 2 of three dofs. */
static pma_strips two_strips(void)
{
    static const int64_t first[3] = {0, 2, 3}, ptr[3] = {0, 4, 8}, start[3] = {0, 8, 12};
    static const int32_t index[8] = {0, 1, 2, 2, 2, 2, 2, 2};
    static const double values[12] = {0.0};
    return (pma_strips){2, first, ptr, index, start, values};
}

static pma_status strips_status(const int64_t *first, const int64_t *ptr, const int32_t *index,
                                const int64_t *start)
{
    pma_strips S = two_strips();
    S.first = first ? first : S.first;
    S.ptr = ptr ? ptr : S.ptr;
    S.index = index ? index : S.index;
    S.start = start ? start : S.start;
    return pma_strips_check(&S, 3);
}

static void strips_with_a_bad_index_are_refused(void)
{
    CHECK_STATUS(strips_status(NULL, NULL, NULL, NULL), PMA_OK);
    CHECK_STATUS(strips_status((int64_t[]){1, 2, 3}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(strips_status((int64_t[]){0, 3, 3}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(strips_status((int64_t[]){0, 4, 3}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(strips_status((int64_t[]){0, 2, 4}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(strips_status(NULL, (int64_t[]){4, 4, 8}, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(strips_status(NULL, (int64_t[]){0, 3, 8}, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(strips_status(NULL, (int64_t[]){0, 8, 4}, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(strips_status(NULL, NULL, (int32_t[]){0, 1, 2, 3, 2, 2, 2, 2}, NULL),
                 PMA_BAD_INDEX);
    CHECK_STATUS(strips_status(NULL, NULL, (int32_t[]){0, 1, 2, 2, 2, 2, 2, -1}, NULL),
                 PMA_BAD_INDEX);
    CHECK_STATUS(strips_status(NULL, NULL, NULL, (int64_t[]){0, 4, 12}), PMA_BAD_INDEX);
    CHECK_STATUS(strips_status(NULL, NULL, NULL, (int64_t[]){1, 9, 13}), PMA_BAD_INDEX);
    /* three above the first is the last of four that follow one another */
    const int64_t all[2] = {0, 4}, sixteen[2] = {0, 16};
    const double zeros[16] = {0.0};
    const int32_t good[4] = {0, 1, 2, 3}, bad[4] = {0, 2, 1, 3};
    const pma_strips right = {1, all, all, good, sixteen, zeros};
    const pma_strips wrong = {1, all, all, bad, sixteen, zeros};
    CHECK_STATUS(pma_strips_check(&right, 4), PMA_OK);
    CHECK_STATUS(pma_strips_check(&wrong, 4), PMA_BAD_INDEX);
    /* seven rows in a strip, with all else as it has to be */
    const int64_t first[2] = {0, 7}, ptr[2] = {0, 4}, start[2] = {0, 28};
    pma_strips S = two_strips();
    S = (pma_strips){1, first, ptr, S.index, start, S.values};
    CHECK_STATUS(pma_strips_check(&S, 7), PMA_BAD_INDEX);
}

const test STRIPS_TESTS[] = {
    TEST(strips_multiply_like_two_loops),
    TEST(a_strip_holds_the_dofs_of_one_node),
    TEST(strips_with_a_bad_index_are_refused),
    END_OF_TESTS,
};
