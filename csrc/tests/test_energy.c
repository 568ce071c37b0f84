/* test_energy.c - works of hand-made steps, and of the steps of a model. */
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "check.h"
#include "models.h"
#include "observe/energy.h"
#include "subdomain/subdomain.h"
#include "tests.h"

static const double LINK_VALUE = -2.0;
static const int64_t LINK_PTR[2] = {0, 1};
static const int32_t LINK_INDEX = 0;

static const pma_restoring NO_RESTORING = {.function = NULL};
static const pma_springs NO_SPRINGS = {.count = 0};
static const pma_load NO_LOAD = {.kind = PMA_LOAD_NONE, .n = 2};

/* Two dofs, the second on the interface under constraint -2. */
static pma_energy_parts two_dofs(const double *M, const double *K, const double *C)
{
    return (pma_energy_parts){.n = 2,
                              .nb = 1,
                              .substeps = 1,
                              .M = {.form = PMA_DIAGONAL, .n = 2, .values = M},
                              .K = {.form = PMA_DENSE, .n = 2, .values = K},
                              .C = {.form = PMA_DIAGONAL, .n = 2, .values = C},
                              .link = {1, 1, LINK_PTR, &LINK_INDEX, &LINK_VALUE, NULL},
                              .load = &NO_LOAD,
                              .restoring = &NO_RESTORING,
                              .springs = &NO_SPRINGS};
}

/* All numbers below are small integers and halves: no rounding, any order of summation. The steps
 * to levels 1, 2, 3 in one macro step of three substeps, or in three of one. */
static void check_by_hand(size_t substeps, bool implicit)
{
    const double M[2] = {2.0, 4.0}, K[4] = {3.0, -1.0, -1.0, 2.0}, C[2] = {1.0, 0.5};
    double u[4][2] = {{0, 0}, {1, 2}, {3, 2}, {2, 6}};
    double v[4][2] = {{2, 0}, {1, 4}, {0, 2}, {-1, 0}}, no_springs[1] = {0.0};
    const double loads[4][2] = {{1, 1}, {3, 5}, {0, 2}, {4, -2}}, lam[4] = {1, 3, -1, 2};
    double expected[4][PMA_ENERGIES] = {
        {4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 4.0},
        /* from 0 to 1, though the step was a double one: there is no level before
         * T = (2 + 64)/2; U = (3 - 4 + 8)/2; C v: (2, 0), (1, 2); pull: -2, -6; F u: 13 */
        {33.0, 3.5, 3.5, 8.0, -8.0, 0.0, 23.5},
        /* a double step from 0 to 2
         * T = 16/2; U = (27 - 12 + 8)/2; du = (3, 2); C v: (0, 1); pull: 2; F u: 4 */
        {8.0, 11.5, 4.0, 4.5, 0.0, 0.0, 15.5},
        /* and from 1 to 3, on the sums of level 1: du = (1, 4); C v: (-1, 0); pull: -4; F u: -4 */
        {1.0, 30.0, 3.5 + 4.0, 8.0 + 9.5, -8.0 - 20.0, 0.0, 35.0}};
    const pma_load load = {
        .kind = PMA_LOAD_TABLE, .n = 2, .values = loads[1], .first = 40, .rows = 3};
    pma_energy_parts parts = two_dofs(M, K, C);
    parts.substeps = substeps;
    parts.doubled = true;
    parts.implicit = implicit;
    parts.load = &load;
    if (implicit) { /* (B14)  36.5 - 4 + 3.5 - 8 at level 1, and from there on */
        expected[1][PMA_INTERFACE_WORK] = 28.0;
        expected[3][PMA_INTERFACE_WORK] = 28.0 - 20.0;
    }
    double out[PMA_ENERGIES];
    pma_energy *e;
    CHECK_STATUS(pma_energy_create(&parts, &e), PMA_OK);
    for (size_t k = 0; k < 4; k++) {
        const pma_state x = {.u = u[k], .v = v[k], .springs = no_springs};
        const pma_substep step = {
            .j = (k + substeps - 1) % substeps, .number = 39 + (int64_t)k, .twice = true};
        if (k == 0)
            pma_energy_begin(e, &x, loads[0], &lam[0], NULL);
        else
            pma_energy_close(e, &step, &x, &lam[k]);
        pma_energy_at(e, k == 0 ? 0 : step.j + 1, &x, out);
        CHECK_BITS(PMA_ENERGIES, out, expected[k]);
        if (k > 0 && step.j + 1 == substeps) {
            pma_energy_commit(e);
            pma_energy_at(e, 0, &x, out);
            CHECK_BITS(PMA_ENERGIES, out, expected[k]);
        }
    }
    pma_energy_destroy(e);
}

static void works_of_single_and_double_steps_are_those_of_hand_calculation(void)
{
    check_by_hand(3, false);
    check_by_hand(1, false);
    check_by_hand(3, true);
    check_by_hand(1, true);
    pma_energy_destroy(NULL);
}

/* A bilinear spring of test_springs.c at three levels: d, f, p; stored (H5) d^2/2 + 3 (d - p)^2/2,
 * so 1/8, 7/8 and 7/8. The state of rest before the beginning, which the memory of a fresh energy
 * holds too, is no level of the run. */
static void check_springs_by_hand(size_t substeps)
{
    const int32_t first = 1, ground = -1;
    const double one = 1.0, three = 3.0, half = 0.5, zero[4] = {0.0};
    const pma_spring_set set = {.law = PMA_BILINEAR,
                                .count = 1,
                                .first = &first,
                                .second = &ground,
                                .parameters = {&one, &three, &half}};
    const pma_springs springs = {.count = 1, .sets = &set, .total = 1};
    double springs_at[3][3] = {{0.25, 1.0, 0.0}, {1.0, 2.5, 0.5}, {-1.0, -2.5, -0.5}};
    double u[3][2] = {{0.0, 0.25}, {0.0, 1.0}, {0.0, -1.0}}, v[2] = {0.0, 0.0};
    /* 3/4 7/2 / 2 + 1/8 - 7/8;  a double step, from the first level: 5/4 3/2 / 2 + 1/8 - 7/8 */
    const double stored[3] = {0.125, 0.875, 0.875}, dissipated[3] = {0.0, 0.5625, 0.1875};
    pma_energy_parts parts = two_dofs(zero, zero, zero);
    parts.substeps = substeps;
    parts.doubled = true;
    parts.springs = &springs;
    pma_energy *e;
    CHECK_STATUS(pma_energy_create(&parts, &e), PMA_OK);
    for (size_t k = 0; k < 3; k++) {
        const pma_state x = {.u = u[k], .v = v, .springs = springs_at[k]};
        const pma_substep step = {.j = (k + substeps - 1) % substeps, .twice = true};
        double out[PMA_ENERGIES];
        if (k == 0)
            pma_energy_begin(e, &x, zero, zero, NULL);
        else
            pma_energy_close(e, &step, &x, zero);
        pma_energy_at(e, k == 0 ? 0 : step.j + 1, &x, out);
        CHECK(out[PMA_STRAIN] == stored[k]);
        CHECK(out[PMA_DISSIPATED] == dissipated[k]);
        if (k > 0 && step.j + 1 == substeps)
            pma_energy_commit(e);
    }
    pma_energy_destroy(e);
}

static void the_first_double_step_of_springs_is_counted_from_the_present(void)
{
    check_springs_by_hand(2);
    check_springs_by_hand(1);
}

static void an_energy_with_sizes_or_indices_that_do_not_agree_is_refused(void)
{
    const double two[4] = {1.0, 1.0, 1.0, 1.0};
    const int64_t ptr[3] = {0, 1, 2};
    const int32_t outside[2] = {0, 2};
    const pma_energy_parts good = two_dofs(two, two, two);
    pma_energy_parts bad[5] = {good, good, good, good, good};
    bad[0].M.n = 3;
    bad[1].K.n = 1;
    bad[2].C.n = 3;
    bad[3].nb = 3;
    bad[4].link.nb = 2;
    pma_energy *e;
    for (size_t i = 0; i < 5; i++) {
        CHECK_STATUS(pma_energy_create(&bad[i], &e), PMA_BAD_SIZE);
        CHECK(e == NULL);
    }
    bad[0] = good;
    bad[0].M =
        (pma_matrix){.form = PMA_SPARSE, .n = 2, .values = two, .ptr = ptr, .index = outside};
    CHECK_STATUS(pma_energy_create(&bad[0], &e), PMA_BAD_INDEX);
    bad[1] = good;
    bad[1].n = bad[1].M.n = bad[1].K.n = bad[1].C.n = SIZE_MAX / 16;
    CHECK_STATUS(pma_energy_create(&bad[1], &e), PMA_NO_MEMORY);
    CHECK(e == NULL);
}

/* Works of all subdomains of a chain are summed up from the present on. */
static void begin_energy(model *m)
{
    const double none[MOST] = {0.0};
    for (size_t i = 0; i < m->count; i++) {
        const pma_matrix M = {
            .form = PMA_DENSE, .n = m->subdomains[i].n, .values = m->subdomains[i].M};
        CHECK_STATUS(pma_subdomain_begin_energy(m->subdomains[i].core, M,
                                                (pma_matrix){.form = PMA_ZERO}, none,
                                                pma_coupler_multipliers(m->coupler), NULL),
                     PMA_OK);
        CHECK(pma_subdomain_energy(m->subdomains[i].core));
    }
}

static void a_run_with_energy_is_the_same_run(void)
{
    static model m, other;
    static tape t;
    static double energies[(STEPS + 1) * SUBDOMAINS * PMA_ENERGIES];
    make_chain(&m, MIXED, 1.0);
    make_chain(&other, MIXED, 1.0);
    make_tape(&t, &m, 0, 0);
    begin_energy(&m);
    t.record.energy = energies;
    run_taped(&m, &t, STEPS);
    CHECK_STATUS(pma_coupler_advance(other.coupler, STEPS, NULL, NULL), PMA_OK);
    check_same(&m, &other);
    for (size_t i = 0; i < m.count; i++) {
        const subdomain *x = &m.subdomains[i];
        const double *last = energies + (STEPS * m.count + i) * PMA_ENERGIES;
        const pma_state *s = pma_subdomain_present(x->core);
        double twice_T = 0.0;
        for (size_t r = 0; r < x->n; r++) {
            for (size_t c = 0; c < x->n; c++)
                twice_T += s->v[r] * x->M[r * x->n + c] * s->v[c];
        }
        CHECK_NEAR(last[PMA_KINETIC], 0.5 * twice_T, 100.0 * DBL_EPSILON * twice_T);
        CHECK(energies[i * PMA_ENERGIES + PMA_EXTERNAL] == 0.0);
    }
    pma_subdomain_end_energy(m.subdomains[0].core);
    CHECK(!pma_subdomain_energy(m.subdomains[0].core));
    pma_subdomain_end_energy(m.subdomains[0].core); /* once more is allowed */
    destroy_model(&m);
    destroy_model(&other);
}

/* ---- against the naive run ------------------------------------------------------------------ */

/* What acts at a time level. */
typedef struct {
    double load[MOST], damping[MOST], pull[MOST];
} forces;

/* Multipliers at time level k of subdomain i: those of its interface problem, or on the line
 * (M1) */
static double multiplier_at(const model *m, size_t i, size_t k, size_t row)
{
    const size_t substeps = m->subdomains[i].substeps, macro = k / substeps;
    if (!m->macro)
        return m->lam[k * (m->fine / substeps)][row];
    const double share = (double)(k % substeps) / (double)substeps;
    return share == 0.0 ? m->lam[macro][row]
                        : (1.0 - share) * m->lam[macro][row] + share * m->lam[macro + 1][row];
}

/* (B2): F, C v + r and L^T Lam; at the beginning no load, and r of the first substep */
static forces forces_at(const model *m, size_t i, size_t k)
{
    const subdomain *x = &m->subdomains[i];
    const level *at = &m->levels[i][k];
    forces q = {{0.0}, {0.0}, {0.0}};
    if (k > 0)
        naive_force(x, (double)k / (double)x->substeps * m->dt, k - 1, q.load);
    for (size_t r = 0; r < x->n; r++) {
        q.damping[r] = m->levels[i][k > 0 ? k : 1].r[r];
        for (size_t c = 0; c < x->n; c++)
            q.damping[r] += x->C[r * x->n + c] * at->v[c];
        for (size_t row = 0; row < m->p; row++)
            q.pull[r] += x->L[row * x->n + r] * multiplier_at(m, i, k, row);
    }
    return q;
}

static double quadratic(size_t n, const double *A, const double *x)
{
    double sum = 0.0;
    for (size_t r = 0; r < n; r++) {
        for (size_t c = 0; c < n; c++)
            sum += 0.5 * x[r] * A[r * n + c] * x[c];
    }
    return sum;
}

/* (B1), (B2), (B3) at all time levels of subdomain i */
static void naive_energies(const model *m, size_t i, double (*out)[PMA_ENERGIES])
{
    const subdomain *x = &m->subdomains[i];
    for (size_t k = 0; k <= STEPS * x->substeps; k++) {
        const size_t before = k - (x->doubled && k > x->substeps ? 2 : k > 0);
        const level *from = &m->levels[i][before], *to = &m->levels[i][k];
        const forces p = forces_at(m, i, before), q = forces_at(m, i, k);
        memcpy(out[k], k > 0 ? out[before] : (double[PMA_ENERGIES]){0.0}, sizeof out[k]);
        out[k][PMA_KINETIC] = quadratic(x->n, x->M, to->v);
        out[k][PMA_STRAIN] = quadratic(x->n, x->K, to->u);
        for (size_t r = 0; r < x->n; r++) {
            const double half_way = 0.5 * (to->u[r] - from->u[r]);
            out[k][PMA_DISSIPATED] += half_way * (p.damping[r] + q.damping[r]);
            out[k][PMA_EXTERNAL] += half_way * (p.load[r] + q.load[r]);
            out[k][PMA_INTERFACE_WORK] += half_way * (p.pull[r] + q.pull[r]);
        }
        out[k][PMA_CONSERVED] = out[k][PMA_KINETIC] + out[k][PMA_STRAIN]; /* - F u */
        for (size_t r = 0; r < x->n; r++)
            out[k][PMA_CONSERVED] -= q.load[r] * to->u[r];
    }
}

/* Some 50 products of numbers up to 10 whose errors are below AGREE */
static const double SUMS_AGREE = 1e3 * AGREE;

static void check_energies(const chain *chosen)
{
    static model m;
    static tape t;
    static double energies[STEPS + 1][SUBDOMAINS][PMA_ENERGIES], expected[LEVELS][PMA_ENERGIES];
    build_chain(&m, chosen);
    make_tape(&t, &m, 0, 0);
    begin_energy(&m);
    t.record.energy = energies[0][0];
    run_taped(&m, &t, STEPS);
    naive_run(&m, STEPS);
    for (size_t i = 0; i < m.count; i++) {
        naive_energies(&m, i, expected);
        for (size_t macro = 0; macro <= STEPS; macro++) {
            for (size_t k = 0; k < PMA_ENERGIES; k++)
                CHECK_NEAR(energies[macro][i][k], expected[macro * m.subdomains[i].substeps][k],
                           SUMS_AGREE);
        }
    }
    destroy_model(&m);
}

static void energies_are_those_of_all_time_levels_of_the_naive_run(void)
{
    const plan macro = {{3, 5, 2}, false, false, true, true, false};
    for (int restored = 0; restored <= 1; restored++) {
        check_energies(&(chain){.plan = {{1, 6, 2}, false, false, true, true, restored}});
        check_energies(&(chain){.plan = {{2, 6, 3}, true, true, true, true, restored}});
        check_energies(&(chain){.plan = {{1, 1, 1}, true, false, true, true, restored}});
        check_energies(
            &(chain){.plan = {{1, 3, 4}, true, false, true, false, restored}, .macro = true});
        for (int stored = 0; stored <= 1; stored++) {
            chain chosen = {.plan = macro, .macro = true, .stored = stored};
            chosen.plan.restored = restored;
            check_energies(&chosen);
        }
    }
}

/* ---- after a stop --------------------------------------------------------------------------- */

typedef struct {
    double at[STEPS + 1][SUBDOMAINS][PMA_ENERGIES]; /* macro time level by macro time level */
} account;

/* Energy from macro step `begun` on; the poll stops the run at its stop_at-th call, and it goes on.
 * Was it stopped? */
static bool keep_account(const chain *chosen, int64_t begun, size_t stop_at, account *a)
{
    static model m;
    static tape t;
    stopper stop = {0, stop_at};
    const pma_poll poll = {poll_stopper, &stop, 0};
    memset(a, 0xff, sizeof *a);
    build_chain(&m, chosen);
    CHECK_STATUS(pma_coupler_advance(m.coupler, begun, NULL, NULL), PMA_OK);
    make_tape(&t, &m, begun, 0);
    begin_energy(&m);
    t.record.energy = a->at[0][0];
    pma_coupler_record_present(m.coupler, &t.record);
    const pma_status status = pma_coupler_advance(m.coupler, STEPS - begun, &t.record, &poll);
    CHECK(status == PMA_OK || status == PMA_STOPPED);
    CHECK_STATUS(
        pma_coupler_advance(m.coupler, STEPS - pma_coupler_step_count(m.coupler), &t.record, NULL),
        PMA_OK);
    CHECK_INT(pma_coupler_step_count(m.coupler), STEPS);
    destroy_model(&m);
    return status == PMA_STOPPED;
}

/* At every call of the poll, so at every place in a macro step. */
static void check_stopped(const chain *chosen, int64_t begun)
{
    static account expected, actual;
    size_t stop_at = 1;
    CHECK(!keep_account(chosen, begun, 0, &expected));
    while (keep_account(chosen, begun, stop_at, &actual)) {
        CHECK_BITS(sizeof actual / sizeof(double), actual.at[0][0], expected.at[0][0]);
        stop_at += STRIDE;
    }
    CHECK(stop_at > (size_t)(STEPS - begun));
    for (size_t i = 0; i < SUBDOMAINS; i++) {
        const double *last = expected.at[STEPS - begun][i];
        CHECK(fabs(last[PMA_EXTERNAL]) > 1e-3 && fabs(last[PMA_INTERFACE_WORK]) > 1e-3);
        for (size_t k = 0; k < PMA_ENERGIES; k++)
            CHECK(isfinite(last[k]));
    }
}

/* Works of a macro step that was given up are lost with it. */
static void energies_of_a_stopped_run_are_bitwise_those_of_one_never_stopped(void)
{
    const plan gc = {{1, 6, 2}, false, false, true, true, false};
    const plan macro = {{1, 5, 3}, true, false, true, true, false};
    for (unsigned with = 0; with < 4; with++) {
        const int64_t begun = with == 0 || with == 3 ? 4 : 0; /* with both values of either bit */
        chain chosen = {.plan = MIXED, .sprung = with & 1, .threads = 1 + with % 3};
        chosen.plan.restored = with & 2;
        check_stopped(&chosen, begun);
        chosen.plan = gc;
        chosen.plan.restored = with & 2;
        check_stopped(&chosen, begun);
        chosen.plan = macro;
        chosen.plan.restored = with & 2;
        chosen.macro = true;
        chosen.stored = with & 1;
        chosen.threads = 1; /* or the number of polls would depend on the roster */
        check_stopped(&chosen, begun);
    }
}

const test ENERGY_TESTS[] = {
    TEST(works_of_single_and_double_steps_are_those_of_hand_calculation),
    TEST(the_first_double_step_of_springs_is_counted_from_the_present),
    TEST(an_energy_with_sizes_or_indices_that_do_not_agree_is_refused),
    TEST(a_run_with_energy_is_the_same_run),
    TEST(energies_are_those_of_all_time_levels_of_the_naive_run),
    TEST(energies_of_a_stopped_run_are_bitwise_those_of_one_never_stopped),
    END_OF_TESTS,
};
