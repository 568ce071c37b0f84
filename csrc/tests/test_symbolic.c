/* test_symbolic.c - the structure of a factor, against elimination by brute force. */
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "algebra/panels.h"
#include "check.h"
#include "factor/symbolic.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"

/* filled (n*n): eliminating unknown j ties all that are left and tied to it to one another. */
static void eliminate_by_brute_force(const structure *m, bool *filled)
{
    const size_t n = m->n;
    for (size_t i = 0; i < n * n; i++)
        filled[i] = m->A[i] != 0.0;
    for (size_t j = 0; j < n; j++) {
        for (size_t i = j + 1; i < n; i++) {
            for (size_t k = j + 1; filled[i * n + j] && k < n; k++)
                filled[i * n + k] = filled[i * n + k] || filled[k * n + j];
        }
    }
}

/* Entries below the diagonal of column j, and the first of them, -1 if there is none. */
static int64_t count_below(const structure *m, const bool *filled, size_t j, int64_t *first)
{
    int64_t count = 0;
    *first = -1;
    for (size_t i = m->n; i-- > j + 1;) {
        count += filled[i * m->n + j];
        *first = filled[i * m->n + j] ? (int64_t)i : *first;
    }
    return count;
}

static void check_count(const structure *m, const bool *filled)
{
    for (size_t j = 0; j < m->n; j++) {
        int64_t first = -1;
        CHECK_INT(m->count[j], count_below(m, filled, j, &first));
        CHECK_INT(m->parent[j], first);
    }
}

static void the_symbolic_count_agrees_with_brute_force(void)
{
    static structure m;
    static bool filled[UNKNOWNS * UNKNOWNS];
    uint64_t seed = 6;
    for (size_t n = 0; n <= 12; n++) {
        for (uint32_t one_in = 1; one_in <= 6; one_in++) {
            for (int i = 0; i < 10; i++) {
                draw_definite(&m, n, 0, one_in, &seed);
                eliminate_by_brute_force(&m, filled);
                list_entries(&m);
                count_entries(&m);
                check_count(&m, filled);
            }
        }
    }
}

/* Each dof is there once, and the interface where it was. */
static void check_permutation(const structure *m)
{
    bool seen[UNKNOWNS] = {false};
    for (size_t k = 0; k < m->n; k++) {
        const bool inside = m->order[k] >= 0 && (size_t)m->order[k] < m->n;
        CHECK(inside && !seen[m->order[k]]);
        if (inside)
            seen[m->order[k]] = true;
        if (k >= m->n - m->nb)
            CHECK_INT(m->order[k], k);
    }
}

/* In the new order: every interior subtree is contiguous, its root last, and the child that is
 * next to its parent has the longest column among the children. */
static void check_subtrees(const structure *m, const bool *filled)
{
    size_t size[UNKNOWNS] = {0}, lowest[UNKNOWNS];
    const size_t interior = m->n - m->nb;
    int64_t parent = -1, ignored;
    for (size_t k = 0; k < interior; k++)
        lowest[k] = k;
    for (size_t k = 0; k < interior; k++) {
        size[k]++;
        CHECK_INT(lowest[k], k + 1 - size[k]);
        const int64_t length = count_below(m, filled, k, &parent);
        if (parent < 0 || (size_t)parent >= interior)
            continue;
        const size_t p = (size_t)parent;
        size[p] += size[k];
        lowest[p] = lowest[k] < lowest[p] ? lowest[k] : lowest[p];
        CHECK(length <= count_below(m, filled, p - 1, &ignored));
        CHECK_INT(ignored, p); /* the column next to p is a child of p */
    }
}

static void check_postorder(structure *m)
{
    static bool filled[UNKNOWNS * UNKNOWNS];
    int64_t before[UNKNOWNS], ignored;
    list_entries(m);
    count_entries(m);
    memcpy(before, m->count, sizeof before);
    pma_symbolic_postorder(m->n, m->nb, m->parent, m->count, m->integers, m->order);
    check_permutation(m);
    reorder(m);
    eliminate_by_brute_force(m, filled);
    for (size_t k = 0; k < m->n; k++)
        CHECK_INT(count_below(m, filled, k, &ignored), before[m->order[k]]);
    check_subtrees(m, filled);
}

static void a_postorder_keeps_the_fill_and_gathers_every_subtree(void)
{
    static structure m;
    uint64_t seed = 8;
    draw_grid(&m);
    check_postorder(&m);
    for (size_t n = 0; n <= 24; n++) {
        for (uint32_t one_in = 1; one_in <= 9; one_in += 2) {
            draw_definite(&m, n, draw(&seed, (uint32_t)n + 1), one_in, &seed);
            check_postorder(&m);
        }
    }
}

/* The rows of a supernode are the pattern of its last column, by brute force, and the patterns of
 * its other columns are among them. */
static void check_supernode(const structure *m, const bool *filled, size_t s)
{
    const size_t n = m->n, last = (size_t)m->first[s + 1] - 1;
    int64_t k = m->row_ptr[s];
    CHECK(m->first[s + 1] - m->first[s] <= PMA_WIDEST);
    for (size_t i = last + 1; i < n; i++) {
        const bool listed = k < m->row_ptr[s + 1] && (size_t)m->rows[k] == i;
        CHECK_INT(listed, filled[i * n + last]);
        for (size_t j = (size_t)m->first[s]; j < last; j++)
            CHECK(listed || !filled[i * n + j]);
        k += listed;
    }
    CHECK_INT(k, m->row_ptr[s + 1]);
    for (int64_t j = m->first[s]; j < m->first[s + 1]; j++)
        CHECK_INT(m->owner[j], s);
}

static void check_supernodes(structure *m)
{
    static bool filled[UNKNOWNS * UNKNOWNS];
    analyse(m);
    eliminate_by_brute_force(m, filled);
    CHECK_STATUS(pma_panels_check(&m->panels, m->n, m->nb), PMA_OK);
    for (size_t s = 0; s < m->panels.count; s++)
        check_supernode(m, filled, s);
}

static void supernodes_hold_the_whole_fill_and_break_at_the_interface(void)
{
    static structure m;
    uint64_t seed = 9;
    draw_grid(&m);
    check_supernodes(&m);
    for (size_t n = 0; n <= 24; n++) {
        for (uint32_t one_in = 1; one_in <= 9; one_in += 2) {
            draw_definite(&m, n, draw(&seed, (uint32_t)n + 1), one_in, &seed);
            check_supernodes(&m);
        }
    }
}

/* Columns of a dense matrix all belong together, those of a diagonal one never; no supernode is
 * wider than it may be, and the interface begins a new one. */
static void supernodes_of_dense_and_diagonal_matrices_are_as_few_and_as_many_as_can_be(void)
{
    enum { N = PMA_WIDEST + 44 };
    static int64_t parent[N], length[N], scratch[N], first[N + 1];
    for (size_t n = 1; n <= PMA_WIDEST; n += 85) {
        for (size_t j = 0; j < n; j++) {
            parent[j] = j + 1 < n ? (int64_t)j + 1 : -1;
            length[j] = (int64_t)(n - 1 - j);
        }
        CHECK_INT(pma_symbolic_supernodes(n, 0, parent, length, scratch, first), 1);
        CHECK_INT(pma_symbolic_supernodes(n, n, parent, length, scratch, first), 1);
        if (n > 1)
            CHECK_INT(pma_symbolic_supernodes(n, 1, parent, length, scratch, first), 2);
        CHECK_INT(first[0], 0);
    }
    for (size_t j = 0; j < N; j++) {
        parent[j] = j + 1 < N ? (int64_t)j + 1 : -1;
        length[j] = (int64_t)(N - 1 - j);
    }
    CHECK(pma_symbolic_supernodes(N, 0, parent, length, scratch, first) >= 2);
    CHECK(first[1] <= PMA_WIDEST);
    for (size_t j = 0; j < N; j++) {
        parent[j] = -1;
        length[j] = 0;
    }
    CHECK_INT(pma_symbolic_supernodes(N, 0, parent, length, scratch, first), N);
}

/* Supernodes of 200 columns of a dense matrix of 1e8 unknowns, by hand: panel s, with 200 k rows
 * below it, has 200 (200 + 200 k) entries. */
static void entries_and_rows_are_counted_in_64_bits(void)
{
    enum { WIDTH = 200, S = 1000 };
    static int64_t first[S + 1], count[WIDTH * S], row_ptr[S + 1], start[S + 1];
    const int64_t beyond = 100000000 - WIDTH * S;
    for (int64_t s = 0; s <= S; s++)
        first[s] = WIDTH * s;
    for (int64_t j = 0; j < WIDTH * S; j++)
        count[j] = beyond + WIDTH * S - 1 - j;
    pma_symbolic_lay_out(S, first, count, row_ptr, start);
    CHECK_INT(row_ptr[1], beyond + WIDTH * (S - 1));
    CHECK_INT(row_ptr[S], S * beyond + (int64_t)WIDTH * S * (S - 1) / 2);
    CHECK_INT(start[S], WIDTH * (S * (int64_t)WIDTH + row_ptr[S]));
    CHECK(row_ptr[S] > UINT32_MAX && start[S] > 1000 * (int64_t)UINT32_MAX);
}

/* Entries drawn at random, some twice, and the same by columns and from both sides. */
static void the_graph_of_groups_agrees_with_brute_force(void)
{
    enum { N = 20, MOST = 60 };
    uint64_t seed = 12;
    for (size_t n = 1; n <= N; n++) {
        bool tied[N * N] = {false};
        int64_t ptr[N + 1] = {0}, start[N + 1], mark[N], list_ptr[N + 1], other_ptr[N + 1];
        int64_t out_ptr[N + 1];
        int32_t index[MOST], group[N], members[N], list[MOST], other[MOST], out[2 * MOST];
        const size_t groups = 1 + draw(&seed, (uint32_t)n);
        for (size_t i = 0; i < n; i++)
            group[i] = (int32_t)draw(&seed, (uint32_t)groups);
        for (size_t i = 0; i < n; i++) {
            ptr[i + 1] = ptr[i] + draw(&seed, 4);
            for (int64_t k = ptr[i]; k < ptr[i + 1]; k++) {
                index[k] = (int32_t)draw(&seed, (uint32_t)n);
                const size_t a = (size_t)group[i], b = (size_t)group[index[k]];
                tied[a * N + b] = tied[b * N + a] = a != b;
            }
        }
        pma_symbolic_merge(n, ptr, index, groups, group, start, members, mark, list_ptr, list);
        pma_symbolic_transpose(groups, list_ptr, list, other_ptr, other);
        pma_symbolic_transpose(groups, other_ptr, other, list_ptr, list);
        pma_symbolic_unite(groups, list_ptr, list, other_ptr, other, out_ptr, NULL);
        CHECK(out_ptr[groups] <= 2 * ptr[n]);
        pma_symbolic_unite(groups, list_ptr, list, other_ptr, other, out_ptr, out);
        int64_t k = 0;
        for (size_t a = 0; a < groups; a++) {
            for (size_t b = 0; b < groups; b++) {
                const bool listed = k < out_ptr[a + 1] && out[k] == (int32_t)b;
                CHECK_INT(listed, tied[a * N + b]);
                k += listed;
            }
            CHECK_INT(k, out_ptr[a + 1]);
        }
    }
}

const test SYMBOLIC_TESTS[] = {
    TEST(the_graph_of_groups_agrees_with_brute_force),
    TEST(entries_and_rows_are_counted_in_64_bits),
    TEST(the_symbolic_count_agrees_with_brute_force),
    TEST(a_postorder_keeps_the_fill_and_gathers_every_subtree),
    TEST(supernodes_hold_the_whole_fill_and_break_at_the_interface),
    TEST(supernodes_of_dense_and_diagonal_matrices_are_as_few_and_as_many_as_can_be),
    END_OF_TESTS,
};
