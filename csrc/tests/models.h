/* models.h - coupled subdomains, for the core and for a naive second program. */
#ifndef PMA_TEST_MODELS_H
#define PMA_TEST_MODELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "couple/coupler.h"
#include "interfaces.h"
#include "iterated_models.h"
#include "naive_member.h"
#include "observe/record.h"
#include "solve/interface.h"
#include "subdomain/member.h"
#include "subdomain/subdomain.h"
#include "subdomains.h"

enum { SUBDOMAINS = 3 };

/* A tolerance that leaves nothing but rounding in equilibrium. */
static const double TIGHT = 1e-13;

/* ---- models: coupled subdomains, for the core and for the naive program ---------------------- */

struct model {
    subdomain subdomains[SUBDOMAINS];
    size_t count, p, fine; /* fine: interface problems in a macro step */
    double dt;
    bool rebased, macro; /* macro: one interface problem in a macro step, as in section 13; */
    bool mean;           /* ... as in section 15, else fine steps as in section 5 */
    size_t threads;
    bool naive[SUBDOMAINS], looks_ahead; /* naive members, and whether they can look ahead */
    bool stored;                         /* link responses, for unit multipliers */
    pma_newton newton;                   /* of a model with internal forces */
    iteration_memory iteration;

    double H[2][CONSTRAINTS * CONSTRAINTS]; /* of the first macro step, of the later ones */
    double R[2][CONSTRAINTS * CONSTRAINTS], inverse[2][CONSTRAINTS];
    pma_interface interfaces[2];
    unsymmetric_interface unsymmetric[2];      /* of H under mean coupling */
    double doubled[CONSTRAINTS * CONSTRAINTS]; /* the part of H of double steps */
    double lam0[CONSTRAINTS];
    naive_member wrapped[SUBDOMAINS];
    pma_member members[SUBDOMAINS];
    int64_t unit_rows[SUBDOMAINS][CONSTRAINTS];
    double units[SUBDOMAINS][CONSTRAINTS * 4 * MOST];
    int64_t moved_row;
    double moved[LEVELS]; /* prescribed velocity of that row, interface problem by problem */
    pma_motion motion;
    size_t motion_count; /* 0 or 1 */
    pma_coupler *coupler;

    /* naive: of all subdomains, and Lam at every interface problem */
    level levels[SUBDOMAINS][LEVELS];
    double lam[LEVELS][CONSTRAINTS];
};

/* H (p*p) += al2 L Mbar^-1 L^T or L U^v of a subdomain, with the double step if `later`    (18)
 * (M4) */
void add_interface(const model *m, const subdomain *x, bool later, double *H);

/* The interface factors are made anew, in their place: couplers made before can go on. */
pma_coupler_parts describe_coupler(model *m);

/* g (p) at fine step k of the run; 0 at the start */
void prescribe(const model *m, size_t k, double *g);

/* Both programs are at t = 0. */
void start_model(model *m);

/* The subdomains are filled in; made, coupled and started. */
void make_model(model *m);

void destroy_model(model *m);

/* Of a coupler that is made of these parts, and destroyed; none is made where it is not PMA_OK. */
pma_status coupler_status(const pma_coupler_parts *parts);

/* An infinite load at one dof of subdomain i after some steps: it is named, nothing has changed,
 * and without it a run to the end is that of a model like this one, which takes all its steps.
 * Both models are destroyed. */
void check_infinite_load(model *m, size_t i, size_t dof, int64_t after, model *like);

/* All that can be seen of the present, in a row. */
typedef struct {
    size_t count;
    double values[SUBDOMAINS * 4 * MOST + CONSTRAINTS + MORE];
} snapshot;

snapshot present(const model *m);

/* Bitwise identical? */
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

/* Three subdomains in a chain under loads of three kinds: A implicit, damped, sampled load with
 * shape; B explicit with both dofs on the interface, a table; C trapezoidal with a full mass
 * matrix, a constant load. The velocity is 1 everywhere, so the ties are satisfied. With restoring
 * forces on request. */
typedef struct {
    size_t substeps[SUBDOMAINS];
    bool A_doubled, C_doubled, rebased, moved, restored;
} plan;

/* What else a chain can be. */
struct chain {
    plan plan;
    double scale;   /* of initial values and loads; 0 stands for 1 */
    size_t threads; /* 0 stands for 1 */
    bool macro, mean;
    bool stored, sprung; /* sprung: springs of all laws; linear ones with internal forces that are
                            linear */
    bool undamped;
    bool naive[SUBDOMAINS], looks_ahead;
    bool inner[SUBDOMAINS]; /* internal forces, with shares of the matrices */
    bool nonlinear;         /* ... and with all other terms of inner.h */
    pma_newton newton;      /* of 0 iterations: TIGHT, 40 of them */
};

void build_chain(model *m, const chain *chosen);
void make_chain(model *m, plan chosen, double scale);
void make_threaded_chain(model *m, plan chosen, size_t threads);

/* all with different steps, double steps, and a prescribed velocity between B and C */
static const plan MIXED = {{2, 6, 3}, true, true, true, true, false};

/* ---- the naive coupler: sections 5, 6, 13 and 15 as written, naive_schedules.c --------------- */

void naive_run(model *m, size_t steps);

/* The response to lam over a macro step, from rest; the last substep                (M3) (K3) */
level naive_response(const subdomain *x, bool twice, const double *lam);

/* ---- tapes: records of everything ----------------------------------------------------------- */

/* Memory for a record of everything, NaN where nothing was written. */
typedef struct {
    pma_record record;
    pma_selection selections[SUBDOMAINS];
    int64_t position[MOST];
    double u[SUBDOMAINS][LEVELS * MOST], v[SUBDOMAINS][LEVELS * MOST], w[SUBDOMAINS][LEVELS * MOST];
    double lam[LEVELS * CONSTRAINTS], velocity[LEVELS * CONSTRAINTS];
    double displacement[LEVELS * CONSTRAINTS];
} tape;

void make_tape(tape *t, const model *m, int64_t begin, int64_t every);

/* The present into row 0, then `steps` macro steps. */
void run_taped(model *m, tape *t, int64_t steps);

/* A tape of all time levels from the start on, bitwise identical. */
void check_tape(const tape *actual, const tape *expected);

/* The same against a naive run: all time levels of all subdomains, multipliers, displacement
 * jumps. */
void check_against_naive(const model *m, const tape *t, size_t steps);

/* A chain: all its time levels against a naive run. */
void check_chain(const chain *chosen);

/* The present of one is bitwise that of the other. */
void check_same(const model *m, const model *expected);

/* What belongs to the state of a coupler, by its name; no values where there is none. */
pma_state_array present_array(pma_coupler *c, const char *name);

/* All arrays of one subdomain into another; their number. */
size_t copy_levels(pma_subdomain *from, pma_subdomain *to);

#endif
