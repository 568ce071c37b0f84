/* test_energy.c - works of hand-made steps, and of the steps of a model. */
#include <float.h>
#include <stdint.h>

#include "check.h"
#include "member/energy.h"
#include "member/subdomain.h"
#include "models.h"
#include "tests.h"

static const double LINK_VALUE = -2.0;
static const int64_t LINK_PTR[2] = {0, 1};
static const int32_t LINK_INDEX = 0;

/* Two dofs, the second on the interface under condition -2. */
static pma_energy_parts two_dofs(const double *M, const double *K, const double *C)
{
    return (pma_energy_parts){.n = 2,
                              .nb = 1,
                              .M = {.form = PMA_DIAGONAL, .n = 2, .values = M},
                              .K = {.form = PMA_DENSE, .n = 2, .values = K},
                              .C = {.form = PMA_DIAGONAL, .n = 2, .values = C},
                              .link = {1, 1, LINK_PTR, &LINK_INDEX, &LINK_VALUE}};
}

/* all numbers below are small integers and halves: no rounding, any order of summation */
static void works_of_single_and_double_steps_are_those_of_hand_calculation(void)
{
    const double M[2] = {2.0, 4.0}, K[4] = {3.0, -1.0, -1.0, 2.0}, C[2] = {1.0, 0.5};
    const double u[4][2] = {{0, 0}, {1, 2}, {3, 2}, {2, 6}};
    const double v[4][2] = {{2, 0}, {1, 4}, {0, 2}, {-1, 0}};
    const double load[4][2] = {{1, 1}, {3, 5}, {0, 2}, {4, -2}}, lam[4] = {1, 3, -1, 2};
    const pma_energy_parts parts = two_dofs(M, K, C);
    double out[PMA_ENERGIES];
    pma_energy *e;
    CHECK_STATUS(pma_energy_create(&parts, &e), PMA_OK);
    pma_energy_begin(e, u[0], v[0], load[0], &lam[0]);
    pma_energy_tell(e, u[0], v[0], out);
    CHECK_BITS(PMA_ENERGIES, out, ((double[]){4.0, 0.0, 0.0, 0.0, 0.0}));

    /* from 0 to 1, though the step was a double one: there is no node before */
    memcpy(pma_energy_open(e), load[1], sizeof load[1]);
    pma_energy_close(e, u[1], v[1], &lam[1], true);
    pma_energy_tell(e, u[1], v[1], out);
    /* T = (2 + 64)/2; U = (3 - 4 + 8)/2; C v: (2, 0), (1, 2); pull: -2, -6 */
    CHECK_BITS(PMA_ENERGIES, out, ((double[]){33.0, 3.5, 3.5, 8.0, -8.0}));

    /* a double step from 0 to 2, opened together with the one to 3 */
    memcpy(pma_energy_open(e), load[2], sizeof load[2]);
    memcpy(pma_energy_open(e), load[3], sizeof load[3]);
    pma_energy_close(e, u[2], v[2], &lam[2], true);
    pma_energy_tell(e, u[2], v[2], out);
    /* T = 16/2; U = (27 - 12 + 8)/2; du = (3, 2); C v: (0, 1); pull: 2 */
    CHECK_BITS(PMA_ENERGIES, out, ((double[]){8.0, 11.5, 4.0, 4.5, 0.0}));

    /* and from 1 to 3, on the sums of node 1 */
    pma_energy_close(e, u[3], v[3], &lam[3], true);
    pma_energy_tell(e, u[3], v[3], out);
    /* du = (1, 4); C v: (-1, 0); pull: -4 */
    CHECK_BITS(PMA_ENERGIES, out, ((double[]){1.0, 30.0, 3.5 + 4.0, 8.0 + 9.5, -8.0 - 20.0}));
    pma_energy_destroy(e);
    pma_energy_destroy(NULL);
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
    bad[0].M = (pma_matrix){
        .form = PMA_SPARSE, .n = 2, .values = two, .ptr = ptr, .index = outside};
    CHECK_STATUS(pma_energy_create(&bad[0], &e), PMA_BAD_INDEX);
    bad[1] = good;
    bad[1].n = bad[1].M.n = bad[1].K.n = bad[1].C.n = SIZE_MAX / 16;
    CHECK_STATUS(pma_energy_create(&bad[1], &e), PMA_NO_MEMORY);
    CHECK(e == NULL);
}

/* Works of all parts of a chain asked for; energies of macro node k in rows of `told`. */
static void run_with_energy(model *m, tape *t, double *told)
{
    const double none[MOST] = {0.0};
    for (size_t i = 0; i < m->count; i++) {
        const pma_matrix M = {.form = PMA_DENSE, .n = m->parts[i].n, .values = m->parts[i].M};
        CHECK_STATUS(pma_subdomain_begin_energy(m->subdomains[i], M, none, m->lam0), PMA_OK);
        CHECK(pma_subdomain_has_energy(m->subdomains[i]));
    }
    t->record.energy = told;
    run_taped(m, t, STEPS);
}

static void a_run_with_energy_is_the_same_run(void)
{
    static model m, other;
    static tape t;
    static double told[(STEPS + 1) * PARTS * PMA_ENERGIES];
    make_chain(&m, MIXED, 1.0);
    make_chain(&other, MIXED, 1.0);
    make_tape(&t, &m, 0, 0);
    run_with_energy(&m, &t, told);
    CHECK_STATUS(pma_coupler_advance(other.coupler, STEPS, NULL, NULL), PMA_OK);
    const snapshot expected = present(&other);
    check_same_present(&m, &expected);
    for (size_t i = 0; i < m.count; i++) {
        const part *x = &m.parts[i];
        const double *last = told + (STEPS * m.count + i) * PMA_ENERGIES;
        const pma_state *s = pma_subdomain_at(x->core, 0);
        double twice_T = 0.0;
        for (size_t r = 0; r < x->n; r++) {
            for (size_t c = 0; c < x->n; c++)
                twice_T += s->v[r] * x->M[r * x->n + c] * s->v[c];
        }
        CHECK_NEAR(last[PMA_KINETIC], 0.5 * twice_T, 100.0 * DBL_EPSILON * twice_T);
        CHECK(told[i * PMA_ENERGIES + PMA_EXTERNAL] == 0.0);
    }
    pma_subdomain_end_energy(m.subdomains[0]);
    CHECK(!pma_subdomain_has_energy(m.subdomains[0]));
    pma_subdomain_end_energy(m.subdomains[0]); /* once more is allowed */
    destroy_model(&m);
    destroy_model(&other);
}

const test ENERGY_TESTS[] = {
    TEST(works_of_single_and_double_steps_are_those_of_hand_calculation),
    TEST(an_energy_with_sizes_or_indices_that_do_not_agree_is_refused),
    TEST(a_run_with_energy_is_the_same_run),
    END_OF_TESTS,
};
