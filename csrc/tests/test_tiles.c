/* test_tiles.c - several substeps in one pass over K: bitwise what they are one by one. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "algebra/tiles.h"
#include "allocations.h"
#include "check.h"
#include "coupling/coupler.h"
#include "coupling/interface.h"
#include "member/inside.h"
#include "naive.h"
#include "tests.h"

enum { ROWS = 900, REACH = 12, FACE = 7, SUBSTEPS = 10, MACRO_STEPS = 3 };

/* ---- matrices ------------------------------------------------------------------------------- */

/* A sparse matrix by rows; the last FACE rows are coupled anywhere, each in one neighbourhood. */
typedef struct {
    bool there[ROWS * ROWS];
    int64_t ptr[ROWS + 1], first[ROWS + 1], strip_ptr[ROWS + 1], start[ROWS + 1];
    int32_t *index, *strip_index;
    double *values, *strip_values;
    pma_matrix K;
} sparse;

static void draw_pattern(sparse *m, uint64_t *seed)
{
    const size_t inner = ROWS - FACE;
    memset(m->there, 0, sizeof m->there);
    for (size_t i = 0; i < ROWS; i++) {
        const size_t near = i < inner ? i : draw(seed, (uint32_t)inner);
        m->there[i * ROWS + i] = true;
        for (size_t k = 0; k < 5; k++) {
            const size_t j = near + draw(seed, REACH);
            if (j < inner)
                m->there[i * ROWS + j] = m->there[j * ROWS + i] = true;
        }
    }
}

static void fill_rows(sparse *m, uint64_t *seed)
{
    m->index = malloc(ROWS * 64 * sizeof *m->index);
    m->values = malloc(ROWS * 64 * sizeof *m->values);
    m->ptr[0] = 0;
    for (size_t i = 0; i < ROWS; i++) {
        int64_t k = m->ptr[i];
        for (size_t j = 0; j < ROWS; j++) {
            if (m->there[i * ROWS + j]) {
                m->index[k] = (int32_t)j;
                m->values[k++] = draw_eighth(seed) / 3.0;
            }
        }
        m->ptr[i + 1] = k;
    }
    m->K = (pma_matrix){
        .form = PMA_SPARSE, .n = ROWS, .values = m->values, .ptr = m->ptr, .index = m->index};
}

static void fill_strips(sparse *m)
{
    static int64_t columns[ROWS], mark[ROWS];
    const size_t count = pma_strips_group(ROWS, m->ptr, m->index, m->first, columns, mark);
    m->strip_ptr[0] = m->start[0] = 0;
    for (size_t s = 0; s < count; s++) {
        m->strip_ptr[s + 1] = m->strip_ptr[s] + columns[s];
        m->start[s + 1] = m->start[s] + columns[s] * (m->first[s + 1] - m->first[s]);
    }
    m->strip_index = calloc((size_t)m->strip_ptr[count], sizeof *m->strip_index);
    m->strip_values = calloc((size_t)m->start[count], sizeof *m->strip_values);
    const pma_strips S = {count, m->first, m->strip_ptr, m->strip_index, m->start, m->strip_values};
    pma_strips_fill(&S, ROWS, m->ptr, m->index, m->values, mark, m->strip_index, m->strip_values);
    m->K = (pma_matrix){.form = PMA_STRIPS, .n = ROWS, .strips = S};
}

static void make_sparse(sparse *m, bool strips, uint64_t *seed)
{
    draw_pattern(m, seed);
    fill_rows(m, seed);
    m->strip_index = NULL;
    m->strip_values = NULL;
    if (strips)
        fill_strips(m);
    CHECK_STATUS(pma_matrix_check(&m->K), PMA_OK);
}

static void free_sparse(sparse *m)
{
    free(m->index);
    free(m->values);
    free(m->strip_index);
    free(m->strip_values);
}

/* ---- tiles ---------------------------------------------------------------------------------- */

/* How many stages every row has done. */
typedef struct {
    const sparse *m;
    size_t done[ROWS], fails_at;
    bool in_turn;
} progress;

static bool do_stage(void *context, size_t k, size_t begin, size_t end)
{
    progress *at = context;
    for (size_t i = begin; i < end; i++) {
        at->in_turn = at->in_turn && at->done[i] == k;
        for (int64_t e = at->m->ptr[i]; e < at->m->ptr[i + 1]; e++) {
            const size_t other = at->done[at->m->index[e]];
            at->in_turn = at->in_turn && k <= other && other <= k + 1;
        }
    }
    for (size_t i = begin; i < end; i++)
        at->done[i]++;
    return k != at->fails_at || begin > 0;
}

static void a_stage_waits_for_the_rows_that_are_coupled_with_its_own(void)
{
    static sparse m;
    static progress at;
    uint64_t seed = 41;
    for (size_t drawn = 0; drawn < 8; drawn++) {
        pma_tiles tiles;
        make_sparse(&m, drawn % 2, &seed);
        CHECK_STATUS(pma_tiles_create(&m.K, FACE, &tiles), PMA_OK);
        CHECK(tiles.count > 3 && tiles.depth >= 2);
        for (size_t steps = 1; steps <= 20; steps++) {
            at = (progress){.m = &m, .in_turn = true, .fails_at = drawn < 4 ? SIZE_MAX : steps};
            CHECK(pma_tiles_advance(&tiles, steps, do_stage, &at) == (drawn < 4));
            CHECK(at.in_turn);
            for (size_t i = 0; i < ROWS; i++)
                CHECK_INT(at.done[i], steps + 1);
        }
        pma_tiles_destroy(&tiles);
        free_sparse(&m);
    }
}

static void a_matrix_that_is_coupled_all_over_has_no_tiles(void)
{
    static sparse m;
    uint64_t seed = 42;
    pma_tiles tiles;
    make_sparse(&m, false, &seed);
    CHECK_STATUS(pma_tiles_create(&m.K, ROWS, &tiles), PMA_OK); /* every row may go anywhere */
    CHECK_INT(tiles.count, 0);
    for (size_t i = 0; i < ROWS; i++) /* one row after the other: the first with the last */
        m.index[m.ptr[i]] = (int32_t)(ROWS - FACE - 1 - i % (ROWS - FACE));
    CHECK_STATUS(pma_tiles_create(&m.K, FACE, &tiles), PMA_OK);
    CHECK_INT(tiles.count, 0);
    const pma_matrix dense = {.form = PMA_DENSE, .n = ROWS};
    CHECK_STATUS(pma_tiles_create(&dense, FACE, &tiles), PMA_OK);
    CHECK_INT(tiles.count, 0);
    free_sparse(&m);
}

/* ---- substeps ------------------------------------------------------------------------------- */

/* Two explicit subdomains of the same sparse K, tied at one dof, under macro or mean coupling. */
typedef struct {
    double inverse[ROWS], C[ROWS], load[2 * SUBSTEPS * MACRO_STEPS * ROWS], state[3 * ROWS];
    int64_t ptr[FACE + 1];
    int32_t row[1];
    double sign[2], inverse_H[1];
    pma_load loads[2];
    pma_subdomain *subdomains[2];
    pma_member members[2];
    pma_ldl H;
    pma_coupler *coupler;
} twins;

static const pma_scheme SCHEME = {.am = 0.2, .af = 0.1, .beta = 0.1, .gamma = 0.6};

static void make_twin(twins *q, size_t i, const sparse *m, bool mean, bool damped, double h)
{
    const pma_factor factor = {.form = PMA_DIAGONAL, .n = ROWS, .nb = FACE, .inverse = q->inverse};
    const pma_parts parts = {
        .n = ROWS,
        .nb = FACE,
        .substeps = SUBSTEPS - i, /* one pass is not as long as the other */
        .responds = true,
        .mean = mean,
        .mass = factor,
        .K = m->K,
        .C = {.form = damped ? PMA_DIAGONAL : PMA_ZERO, .n = ROWS, .values = q->C},
        .single = {pma_step_make(SCHEME, h / (double)(SUBSTEPS - i)), factor},
        .link = {1, FACE, q->ptr, q->row, &q->sign[i], NULL}};
    CHECK_STATUS(pma_subdomain_create(&parts, &q->subdomains[i]), PMA_OK);
    CHECK(q->subdomains[i]->tiles.count > 0);
    pma_subdomain_set_load(q->subdomains[i], q->loads[i]);
    const double lam = 0.5;
    pma_subdomain_start(q->subdomains[i], q->state, q->state + ROWS, q->state + 2 * ROWS, &lam);
    q->members[i] = pma_subdomain_member(q->subdomains[i]);
}

static void fill_twins(twins *q, uint64_t *seed)
{
    for (size_t i = 0; i < ROWS; i++) {
        q->inverse[i] = 1.0 / (1.0 + (double)(i % 7));
        q->C[i] = 0.1 * (double)(i % 3);
    }
    for (size_t i = 0; i < 3 * ROWS; i++)
        q->state[i] = draw_eighth(seed);
    for (size_t i = 0; i < sizeof q->load / sizeof *q->load; i++)
        q->load[i] = draw_eighth(seed);
    for (size_t i = 0; i <= FACE; i++)
        q->ptr[i] = i > 2; /* the third dof of the interface is tied */
    q->row[0] = 0;
    q->sign[0] = 1.0;
    q->sign[1] = -1.0;
    q->inverse_H[0] = 0.25;
    q->loads[0] = (pma_load){
        .kind = PMA_LOAD_TABLE, .n = ROWS, .values = q->load, .rows = SUBSTEPS * MACRO_STEPS};
    q->loads[1] = (pma_load){.kind = PMA_LOAD_SAMPLED,
                             .n = ROWS,
                             .values = q->load,
                             .shape = NULL,
                             .samples = 20,
                             .k = ROWS,
                             .dt = 0.01};
}

/* ---- with a stop in a pass ------------------------------------------------------------------ */

static interrupter stop;
static const pma_member_table *usual;
static pma_member_table interrupted;

/* The second subdomain is that of the second worker, if there is one. */
static const pma_subdomain *second;
static bool is_second_apart;

static pma_status run_and_interrupt(void *self, const pma_substep *steps, size_t count,
                                    const double *lam)
{
    interrupt(&stop, is_second_apart && self == second);
    return usual->run(self, steps, count, lam);
}

static void respond_and_interrupt(void *self, size_t j, size_t count, const double *dlam)
{
    interrupt(&stop, is_second_apart && self == second);
    usual->respond_run(self, j, count, dlam);
}

static void make_twins(twins *q, const sparse *m, bool mean, bool damped, double h, size_t threads)
{
    uint64_t seed = 43;
    fill_twins(q, &seed);
    for (size_t i = 0; i < 2; i++)
        make_twin(q, i, m, mean, damped, h);
    usual = q->members[0].table;
    interrupted = *usual;
    interrupted.run = run_and_interrupt;
    interrupted.respond_run = respond_and_interrupt;
    for (size_t i = 0; i < 2; i++)
        q->members[i].table = &interrupted;
    const pma_factor factor = {.form = PMA_DIAGONAL, .n = 1, .nb = 1, .inverse = q->inverse_H};
    CHECK_STATUS(pma_ldl_create(&factor, &q->H), PMA_OK);
    const pma_interface H = pma_ldl_interface(&q->H);
    const pma_coupler_parts parts = {.count = 2,
                                     .members = q->members,
                                     .p = 1,
                                     .H_start = H,
                                     .H = H,
                                     .doubled = {.form = PMA_ZERO, .n = 1},
                                     .dt = h,
                                     .schedule = mean ? &pma_mean_schedule : &pma_macro_schedule,
                                     .threads = threads};
    CHECK_STATUS(pma_coupler_create(&parts, &q->coupler), PMA_OK);
    const double lam = 0.5, g = 0.0;
    pma_coupler_start(q->coupler, 0, &lam, &g);
}

/* From now on substep by substep. */
static void forget_tiles(twins *q)
{
    for (size_t i = 0; i < 2; i++)
        pma_tiles_destroy(&q->subdomains[i]->tiles);
}

static void destroy_twins(twins *q)
{
    pma_coupler_destroy(q->coupler);
    pma_subdomain_destroy(q->subdomains[0]);
    pma_subdomain_destroy(q->subdomains[1]);
    pma_ldl_destroy(&q->H);
}

static void check_levels(twins *actual, twins *expected)
{
    CHECK_BITS(1, pma_coupler_multipliers(actual->coupler),
               pma_coupler_multipliers(expected->coupler));
    for (size_t i = 0; i < 2; i++) {
        const pma_kept_levels x = pma_subdomain_levels(actual->subdomains[i]),
                              y = pma_subdomain_levels(expected->subdomains[i]);
        CHECK_BITS(ROWS, x.present.u, y.present.u);
        CHECK_BITS(ROWS, x.present.v, y.present.v);
        CHECK_BITS(ROWS, x.present.w, y.present.w);
        CHECK_BITS(ROWS, x.present.a, y.present.a);
        CHECK_BITS(FACE, x.vf, y.vf);
    }
}

static void check_same(twins *actual, twins *expected)
{
    check_levels(actual, expected);
    for (size_t i = 0; i < 2; i++) {
        const double u = pma_subdomain_present(expected->subdomains[i])->u[0];
        CHECK(isfinite(u) && u != actual->state[0]);
    }
}

static void check_passes(const sparse *m, bool mean, bool damped, size_t threads)
{
    static twins passes, one_by_one;
    make_twins(&passes, m, mean, damped, 0.1, threads);
    make_twins(&one_by_one, m, mean, damped, 0.1, 1);
    CHECK_INT(passes.members[0].table->depth(passes.subdomains[0]) > 1, 1);
    forget_tiles(&one_by_one);
    CHECK_INT(one_by_one.members[0].table->depth(one_by_one.subdomains[0]), 1);
    CHECK_STATUS(pma_coupler_advance(passes.coupler, MACRO_STEPS, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_coupler_advance(one_by_one.coupler, MACRO_STEPS, NULL, NULL), PMA_OK);
    check_same(&passes, &one_by_one);
    destroy_twins(&passes);
    destroy_twins(&one_by_one);
}

static void passes_are_bitwise_identical_to_substeps_for_any_number_of_threads(void)
{
    static sparse m;
    uint64_t seed = 44;
    for (size_t drawn = 0; drawn < 8; drawn++) {
        make_sparse(&m, drawn % 2, &seed);
        check_passes(&m, drawn & 2, drawn & 4, 1);
        check_passes(&m, drawn & 2, drawn & 4, 2);
        free_sparse(&m);
    }
}

/* At the stop_at-th pass; true if the run ended with it. */
static bool check_stop(const sparse *m, bool mean, size_t threads, size_t stop_at)
{
    static twins q, alone;
    const pma_poll poll = {poll_interrupter, &stop, 0};
    make_twins(&alone, m, mean, false, 0.1, 1);
    make_twins(&q, m, mean, false, 0.1, threads);
    CHECK_INT(pma_coupler_threads(q.coupler), threads);
    second = q.subdomains[1];
    is_second_apart = threads > 1;
    stop.stop_at = stop_at;
    atomic_store(&stop.called, 0);
    atomic_store(&stop.polled, false);
    const pma_status status = pma_coupler_advance(q.coupler, MACRO_STEPS - 1, NULL, &poll);
    const int64_t whole = pma_coupler_step_count(q.coupler);
    CHECK(status == PMA_STOPPED || (status == PMA_OK && whole == MACRO_STEPS - 1));
    stop.stop_at = 0;
    CHECK_STATUS(pma_coupler_advance(alone.coupler, whole, NULL, NULL), PMA_OK);
    check_levels(&q, &alone);
    CHECK_STATUS(pma_coupler_advance(q.coupler, MACRO_STEPS - whole, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_coupler_advance(alone.coupler, MACRO_STEPS - whole, NULL, NULL), PMA_OK);
    check_same(&q, &alone);
    destroy_twins(&q);
    destroy_twins(&alone);
    return status == PMA_STOPPED;
}

static void a_stop_in_the_middle_of_a_pass_leaves_the_last_macro_level(void)
{
    static sparse m;
    uint64_t seed = 47;
    make_sparse(&m, true, &seed);
    for (size_t mean = 0; mean < 2; mean++) {
        for (size_t threads = 1; threads <= 2; threads++) {
            size_t stop_at = 1;
            while (check_stop(&m, mean, threads, stop_at))
                stop_at++;
            CHECK(stop_at > 4 * (MACRO_STEPS - 1)); /* a pass or more twice for each */
        }
    }
    free_sparse(&m);
}

static void a_step_of_passes_does_not_allocate(void)
{
    static sparse m;
    static twins q;
    uint64_t seed = 48;
    if (!count_allocations())
        return;
    make_sparse(&m, false, &seed);
    for (size_t threads = 1; threads <= 2; threads++) {
        const size_t nothing = allocations_counted();
        make_twins(&q, &m, true, false, 0.1, threads);
        CHECK_STATUS(pma_coupler_advance(q.coupler, 1, NULL, NULL), PMA_OK); /* workers are there */
        const size_t before = allocations_counted();
        CHECK(before > nothing);
        CHECK_STATUS(pma_coupler_advance(q.coupler, MACRO_STEPS - 1, NULL, NULL), PMA_OK);
        CHECK_INT(allocations_counted(), before);
        destroy_twins(&q);
    }
    free_sparse(&m);
}

/* A step far above the critical one: numbers grow by 1e8 or so in each substep. */
static void a_pass_finds_what_is_not_finite(void)
{
    static sparse m;
    static twins q;
    uint64_t seed = 45;
    make_sparse(&m, true, &seed);
    for (size_t mean = 0; mean < 2; mean++) {
        make_twins(&q, &m, mean, false, 1e6, 1);
        CHECK_STATUS(pma_coupler_advance(q.coupler, 20, NULL, NULL), PMA_NOT_FINITE);
        CHECK(isfinite(pma_subdomain_present(q.subdomains[0])->u[0]));
        destroy_twins(&q);
    }
    free_sparse(&m);
}

static int no_load(double t, intptr_t n, double *f, void *user)
{
    (void)t;
    (void)n;
    (void)f;
    (void)user;
    return 0;
}

static void a_function_of_time_is_evaluated_substep_by_substep(void)
{
    static sparse m;
    static twins q;
    static const int64_t order[ROWS] = {0};
    static double work[ROWS];
    uint64_t seed = 46;
    make_sparse(&m, false, &seed);
    make_twins(&q, &m, false, false, 0.1, 1);
    pma_subdomain_set_load(
        q.subdomains[0],
        (pma_load){
            .kind = PMA_LOAD_CALLED, .n = ROWS, .function = no_load, .order = order, .work = work});
    CHECK_INT(q.members[0].table->depth(q.subdomains[0]), 1);
    CHECK(q.members[1].table->depth(q.subdomains[1]) > 1);
    destroy_twins(&q);
    free_sparse(&m);
}

const test TILES_TESTS[] = {
    TEST(a_stage_waits_for_the_rows_that_are_coupled_with_its_own),
    TEST(a_matrix_that_is_coupled_all_over_has_no_tiles),
    TEST(passes_are_bitwise_identical_to_substeps_for_any_number_of_threads),
    TEST(a_stop_in_the_middle_of_a_pass_leaves_the_last_macro_level),
    TEST(a_step_of_passes_does_not_allocate),
    TEST(a_pass_finds_what_is_not_finite),
    TEST(a_function_of_time_is_evaluated_substep_by_substep),
    END_OF_TESTS,
};
