/* inner.h - internal forces of a subdomain: shares of its matrices, a cubic term, plasticity.
 *
 * Two functions, in the user's order of dofs. Where the terms that are not linear are left out, the
 * subdomain is the linear one of the naive program. */
#ifndef PMA_TEST_INNER_H
#define PMA_TEST_INNER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "factor/numeric.h"
#include "forces/internal.h"
#include "subdomain/iterate.h"

enum {
    MOST = 3,   /* dofs of a subdomain */
    HISTORY = 2 /* plastic deformation, and steps since the start */
};

/* ---- a full pattern, for the factors of subdomains and of the interface ---------------------- */

typedef struct {
    int64_t ptr[MOST + 1], first[3], row_ptr[3], start[3], owner[MOST];
    int32_t index[MOST * MOST], rows[MOST];
} full_pattern;

/* Up to two supernodes: the interior, and the nb unknowns of the interface. */
pma_numeric_parts describe_full(full_pattern *pattern, size_t n, size_t nb);

/* ---- the functions --------------------------------------------------------------------------- */

typedef struct {
    bool used;
    bool springs, keeps;   /* springs are iterated too; tangents are kept */
    double cubic, ramp;    /* f_k += cubic u_k^3 + ramp t */
    double plastic, yield; /* f_0 += plastic (u_0 - p), |u_0 - p| <= yield, of the user's dof 0 */

    double springs_K[MOST * MOST]; /* what linear springs of the subdomain are of its K */

    size_t evaluated, fail_at; /* calls of both; the one that returns 7, 0: none */
    size_t spoil_from;         /* the first one that adds NaN to its force, 0: none */

    double K1[MOST * MOST], K2[MOST * MOST], C2[MOST * MOST]; /* in the user's order */
    double K[MOST * MOST], C[MOST * MOST];                    /* what is left to the matrices */
    double M_size[MOST * MOST], base[2][MOST * MOST], initial[HISTORY];
    int64_t where[MOST * MOST];
    full_pattern pattern;
    pma_internal_force forces[2];
    pma_iterate_parts iterate;
} inner;

typedef struct subdomain subdomain;

/* Half of K to the first function; a quarter of it, and half of the C of an implicit subdomain,
 * to the second one. */
void share_matrices(subdomain *x);

pma_internal describe_internal(subdomain *x);

/* Of the implicit subdomain with Mbar without the shares; al1, al2 of its two steps. */
const pma_iterate_parts *describe_iterate(subdomain *x, const double *al1, const double *al2);

/* f (n) := what is not linear of both functions, in elimination order; q1: the history after it. */
void naive_inner(const subdomain *x, double t, const double *u, const double *q, double *f,
                 double *q1);

#endif
