/* subdomains.h - subdomains that know their equations, and their steps as docs/method.md has
 * them. */
#ifndef PMA_TEST_SUBDOMAINS_H
#define PMA_TEST_SUBDOMAINS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "forces/load.h"
#include "forces/springs.h"
#include "inner.h"
#include "naive.h"
#include "subdomain/scheme.h"
#include "subdomain/subdomain.h"

/* ---- schemes -------------------------------------------------------------------------------- */

static const pma_scheme TRAPEZOIDAL = {.beta = 0.25, .gamma = 0.5};
static const pma_scheme CENTRAL_DIFFERENCE = {.beta = 0.0, .gamma = 0.5};

/* (P1): all four from one number */
pma_scheme generalized_alpha(double rho);

/* ---- subdomains ------------------------------------------------------------------------------ */

enum {
    SPRING_FIELDS = 3, /* deformation, force and an inner variable */
    CONSTRAINTS = 2,
    FINE = 6,  /* fine steps in a macro step */
    STEPS = 8, /* macro steps */
    LEVELS = STEPS * FINE + 1
};

/* What a restoring force wrote down: when it was evaluated, and when it shall fail: at the
 * fail_at-th evaluation, counted from 1; never for 0. */
typedef struct {
    size_t evaluated, fail_at;
    double times[2 * LEVELS];
} diary;

/* r_k = u_k^3 + u_k v_{k+1} / 2 + v_k / 4 + t / 8, indices round and round; keeps a diary, and
 * spoils its copies of u and v. Returns 7 if it fails. */
int pull(double t, intptr_t n, double *u, double *v, double *r, void *user);

/* One subdomain of (1), filled in by a test, and what make_subdomain makes of it. A subdomain is
 * not to be moved afterwards: the core keeps pointers into it. */
struct subdomain {
    size_t n, nb, p, substeps;
    bool implicit, doubled, has_responses;
    bool mean, deferred; /* as those of pma_parts */
    pma_scheme scheme;
    double h;
    double M[MOST * MOST], C[MOST * MOST], K[MOST * MOST]; /* n*n by rows */
    double L[CONSTRAINTS * MOST]; /* p x n by rows, zero outside the last nb columns */
    double u0[MOST], v0[MOST];
    pma_load load;
    bool restored, lagged; /* by pull; the last dof of the user is the first here */
    double K_r[MOST * MOST], D_r[MOST * MOST];
    pma_springs springs; /* unknown to the naive program */
    inner inner;         /* ... what is not linear of it */

    diary pulled;
    int64_t order[MOST];
    double work[3 * MOST];
    double Mbar[2][MOST * MOST], R[2][MOST * MOST], inverse[2][MOST]; /* of h and of 2 h */
    double R_mass[MOST * MOST], inverse_mass[MOST];
    int64_t ptr[MOST + 1];
    int32_t constraint[CONSTRAINTS * MOST];
    double sign[CONSTRAINTS * MOST];
    double loads[LEVELS * MOST], shape[MOST * MOST]; /* memory for the load */
    pma_subdomain *core;
};

/* al1 = h^2 beta (1-af)/(1-am), al2 = h gamma (1-af)/(1-am)                               (P2) */
double al1_of(const subdomain *x, bool twice);
double al2_of(const subdomain *x, bool twice);

pma_parts describe(subdomain *x);

void make_subdomain(subdomain *x);

/* Of a subdomain that is made of these parts and destroyed; none is made where it is not PMA_OK. */
pma_status subdomain_status(const pma_parts *parts);

/* m w + k u = 0 with as many constraints as L has entries, one or none */
subdomain one_mass(double m, double k, double L, pma_scheme scheme, bool implicit);

/* The present of a subdomain, all four arrays. */
size_t copy_present(const subdomain *x, double *out);

enum { SWINGS = 400 };

/* Each step adds a few roundings of numbers of order one, and nothing amplifies them. */
static const double SWING_TOLERANCE = 10.0 * SWINGS * DBL_EPSILON;

/* ---- the same step, naively: sections 3 and 4 as written ------------------------------------ */

/* All there is at a time level; r is the restoring force of the substep that ended there. */
typedef struct {
    double u[MOST], v[MOST], w[MOST], a[MOST], vf[MOST], r[MOST];
    double more[MOST]; /* what is recorded beside w (K5) */
} level;

/* F (n) := F(t) at the end of this substep of the run */
void naive_force(const subdomain *x, double t, size_t substep, double *F);

/* r (n) := the restoring force, in elimination order; 0 where there is none */
void naive_pull(const subdomain *x, double t, const double *u, const double *v, double *r);

/* (5), (6) and (R1) */
void naive_predict(const subdomain *x, bool twice, const level *from, double *ut, double *vt,
                   double *vs);

/* (9) */
double naive_recur(pma_scheme s, double w1, double w0, double a0);

/* Free problem from one time level to another at t: (5), (6), (R1), (R2) or (R4), (8) */
void naive_free(const subdomain *x, bool twice, double t, const double *F, const level *from,
                level *to);

/* wl (n) := Mbar^-1 L^T lam */
void naive_link(const subdomain *x, bool twice, const double *lam, double *wl);

/* Link problem added to the free one, and (9) with the total acceleration */
void naive_close(const subdomain *x, bool twice, const double *lam, const level *from, level *to);

/* vf := v - al2 Mbar^-1 L^T lam, (S2) and (S3) */
void naive_store(const subdomain *x, bool twice, const double *lam, level *at);

/* y (n) := M^-1 L^T lam, and a substep that it pushes                               (K1) (K2) */
void naive_push(const subdomain *x, const double *lam, double *y);
void naive_pushed(const subdomain *x, bool twice, double t, const double *F, const double *y,
                  const level *from, level *to);

/* A substep of the link response under lam: (M3) with K + K_r, C + D_r, lagged C vs */
void naive_link_response(const subdomain *x, bool twice, const double *lam, const level *from,
                         level *to);

/* to += more, but for vf                                                                 (M5) */
void naive_add(const subdomain *x, const level *more, level *to);

/* L x for one constraint */
double constrained(const subdomain *x, size_t row, const double *values);

/* Some 50 steps of some 50 roundings each, of numbers of order one; a division by h in (18) and
 * matrices of condition 10 make 1e2 of it at most. A term left out shows at 1e-3. */
static const double AGREE = 1e-11;

void check_state(const subdomain *x, const pma_state *actual, const level *expected);

#endif
