/* models.h - parts and models of coupled parts, for the core and for a naive second program. */
#ifndef PMA_TEST_MODELS_H
#define PMA_TEST_MODELS_H

#include <float.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coupling/coupler.h"
#include "coupling/record.h"
#include "member/load.h"
#include "member/scheme.h"
#include "member/subdomain.h"

/* ---- schemes --------------------------------------------------------------------------------- */

static const pma_scheme TRAPEZOIDAL = {.beta = 0.25, .gamma = 0.5};
static const pma_scheme CENTRAL_DIFFERENCE = {.beta = 0.0, .gamma = 0.5};

/* (P1): all four from one number */
pma_scheme generalized_alpha(double rho);

/* ---- parts: subdomains that know their equations --------------------------------------------- */

enum {
    MOST = 3,            /* dofs of a part */
    CONDITIONS = 2,
    PARTS = 3,
    FINE = 6,            /* fine steps in a macro step */
    STEPS = 8,           /* macro steps */
    NODES = STEPS * FINE + 1
};

/* What a restoring force wrote down: when it was asked, and what it shall return when asked for the
 * fail_at-th time, counted from 1; never for 0. */
typedef struct {
    size_t asked, fail_at;
    double times[2 * NODES];
} diary;

/* r_k = u_k^3 + u_k v_{k+1} / 2 + v_k / 4 + t / 8, indices round and round; keeps a diary, and
 * spoils its copies of u and v. Returns 7 if it fails. */
int pull(double t, intptr_t n, double *u, double *v, double *r, void *user);

/* One part of (1), filled in by a test, and what make_part makes of it. A part is not to be moved
 * afterwards: the core keeps pointers into it. */
typedef struct {
    size_t n, nb, p, substeps;
    bool implicit, doubled, ramped;
    pma_scheme scheme;
    double h;
    double M[MOST * MOST], C[MOST * MOST], K[MOST * MOST]; /* n*n by rows */
    double L[CONDITIONS * MOST]; /* p x n by rows, zero outside the last nb columns */
    double u0[MOST], v0[MOST];
    pma_load load;
    bool restored, lagged;              /* by pull; the last dof of the user is the first here */
    double K_r[MOST * MOST], D_r[MOST * MOST];

    diary pulled;
    int64_t order[MOST];
    double work[3 * MOST];
    double Mbar[2][MOST * MOST], R[2][MOST * MOST], inverse[2][MOST]; /* of h and of 2 h */
    int64_t ptr[MOST + 1];
    int32_t condition[CONDITIONS * MOST];
    double sign[CONDITIONS * MOST];
    double loads[NODES * MOST], shape[MOST * MOST]; /* memory for the load */
    pma_subdomain *core;
} part;

/* al2 = h gamma (1-af)/(1-am)                                                             (P2) */
double al2_of(const part *x, bool twice);

pma_parts describe(part *x);

void make_part(part *x);

/* m w + k u = 0 with as many conditions as L has entries, one or none */
part one_mass(double m, double k, double L, pma_scheme scheme, bool implicit);

/* The present of a subdomain, all four arrays. */
size_t copy_present(const part *x, double *out);

enum { SWINGS = 400 };

/* Each step adds a few roundings of numbers of order one, and nothing amplifies them. */
static const double SWING_TOLERANCE = 10.0 * SWINGS * DBL_EPSILON;

/* ---- the same step, naively: docs/method.md 3 and 4 as written ------------------------------- */

/* All there is at an own node. */
typedef struct {
    double u[MOST], v[MOST], w[MOST], a[MOST], vf[MOST];
} node;

/* Free problem from one node to another at t: (5), (6), (R1), (R2) or (R4), (8) */
void naive_free(const part *x, bool twice, double t, const double *F, const node *from, node *to);

/* wl (n) := Mbar^-1 L^T lam */
void naive_link(const part *x, bool twice, const double *lam, double *wl);

/* Link problem added to the free one, and (9) with the total acceleration */
void naive_close(const part *x, bool twice, const double *lam, const node *from, node *to);

/* vf := v - al2 Mbar^-1 L^T lam, (S2) and (S3) */
void naive_store(const part *x, bool twice, const double *lam, node *at);

/* L x for one condition */
double conditioned(const part *x, size_t row, const double *values);

/* Some 50 steps of some 50 roundings each, of numbers of order one; a division by h in (18) and
 * matrices of condition 10 make 1e2 of it at most. A term left out shows at 1e-3. */
static const double AGREE = 1e-11;

void check_state(const part *x, const pma_state *actual, const node *expected);

/* ---- models: coupled parts, for the core and for the naive program --------------------------- */

typedef struct {
    part parts[PARTS];
    size_t count, p, fine;
    double dt;
    bool rebased;
    size_t threads;

    double H[2][CONDITIONS * CONDITIONS]; /* of the first macro step, of the later ones */
    double R[2][CONDITIONS * CONDITIONS], inverse[2][CONDITIONS];
    double lam0[CONDITIONS];
    pma_subdomain *subdomains[PARTS];
    int64_t moved_row;
    double moved[NODES]; /* prescribed velocity of that row, fine step by fine step */
    pma_motion motion;
    size_t motion_count; /* 0 or 1 */
    pma_coupler *coupler;

    node nodes[PARTS][NODES]; /* naive: every own node of every part, and Lam at every instant */
    double lam[NODES][CONDITIONS];
} model;

pma_coupler_parts describe_coupler(model *m);

/* g (p) at fine node k of the run; 0 at the start */
void prescribe(const model *m, size_t k, double *g);

/* Both programs stand at t = 0. */
void start_model(model *m);

/* The parts are filled in; made, coupled and started. */
void make_model(model *m);

void destroy_model(model *m);

/* What there is to see of the present, in a row; all of it must be alike for "bit for bit". */
typedef struct {
    size_t count;
    double values[PARTS * 4 * MOST + CONDITIONS];
} snapshot;

snapshot present(const model *m);

void check_same_present(const model *m, const snapshot *expected);

/* One oscillator cut in two: A implicit, double on request; B explicit or as A. Masses
 * and stiffnesses are shared unequally, so that the multiplier has work to do. */
typedef struct {
    double dt;
    size_t substeps; /* of B */
    bool doubled, same;
    pma_scheme A, B;
} split;

static const double M_A = 3.0, M_B = 1.0, K_A = 10.0, K_B = 30.0, OMEGA = 3.16227766016837933;

void make_oscillator(model *m, split s);

/* Three parts in a chain under loads of three kinds: A implicit, damped, sampled load with shape; B
 * explicit with both dofs on the interface, a table; C trapezoidal with a full mass matrix, a
 * constant load. The velocity is 1 everywhere, so the ties are satisfied. With restoring forces if
 * asked for. */
typedef struct {
    size_t substeps[PARTS];
    bool A_doubled, C_doubled, rebased, moved, restored;
} plan;

/* Initial values and loads times `scale`. */
void make_chain(model *m, plan chosen, double scale);
void make_threaded_chain(model *m, plan chosen, size_t threads);

/* everybody with another step, double steps, and a prescribed velocity between B and C */
static const plan MIXED = {{2, 6, 3}, true, true, true, true, false};

/* ---- the naive coupler: docs/method.md 5 and 6 as written ------------------------------------ */

void naive_run(model *m, size_t steps);

/* ---- tapes: records of everything ------------------------------------------------------------ */

/* Memory for a record of everything, NaN where nothing was written. */
typedef struct {
    pma_record record;
    pma_record_nodes nodes[PARTS];
    int64_t position[MOST];
    double u[PARTS][NODES * MOST], v[PARTS][NODES * MOST], w[PARTS][NODES * MOST];
    double lam[NODES * CONDITIONS], velocity[NODES * CONDITIONS], displacement[NODES * CONDITIONS];
} tape;

void make_tape(tape *t, const model *m, int64_t begin, int64_t every);

/* The present into row 0, then `steps` macro steps. */
void run_taped(model *m, tape *t, int64_t steps);

#endif
