/* iterate.h - the substep of a subdomain with internal forces: residual, tangent, iterate. (N2)
 *
 * While a substep is iterated, the state of its end holds the predictors ut, vt and the iterate w;
 * `pma_iterate_finish` makes it a state. */
#ifndef PMA_ITERATE_H
#define PMA_ITERATE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/matrix.h"
#include "factor/numeric.h"
#include "solve/newton.h"
#include "state.h"
#include "status.h"
#include "subdomain/member.h"

/* Bare arrays of the caller, which have to outlive the subdomain. */
typedef struct {
    bool springs;              /* those of the subdomain are iterated too */
    bool keeps;                /* tangents are kept from one macro step to the next */
    pma_numeric_parts tangent; /* pattern of Mbar with all tangents */
    const double *base;        /* its entries: M + al2 (C + D_r) + al1 K of the single step */
    const double *base_twice;  /* the same of the double step, if the subdomain takes them */
    pma_matrix M_size;         /* the size of the entries of M */
} pma_iterate_parts;

typedef struct pma_subdomain pma_subdomain;
typedef struct pma_iterate pma_iterate;

/* Checks the parts and allocates all that an iteration needs. */
pma_status pma_iterate_create(pma_subdomain *s, const pma_iterate_parts *parts, pma_iterate **out);
void pma_iterate_destroy(pma_iterate *it); /* NULL is allowed */

const pma_iterate_parts *pma_iterate_get_parts(const pma_iterate *it);

/* The factor that follows the tangent: at the same place as long as the iterate exists. */
const pma_factor *pma_iterate_factor(const pma_iterate *it);

/* Where the last iteration failed: time of its substep, corrections made, and the dofs (in
 * elimination order) at which the tangent was singular and the force of functions is not finite,
 * or SIZE_MAX. */
typedef struct {
    double t;
    size_t iterations, dof, spoiled;
} pma_iterate_failure;

pma_iterate_failure pma_iterate_failed(const pma_iterate *it);

/* What an iteration starts from beside the time levels. */
typedef struct {
    double scale;          /* of energy */
    const double *entries; /* of Mbar, that are factored; NULL where no tangent is kept, or none is
                              factored yet */
    bool twice;            /* they are those of the double step */
} pma_kept_iteration;

/* To be read or written between macro steps. */
size_t pma_iterate_entries(const pma_iterate *it); /* of Mbar */
pma_kept_iteration pma_iterate_kept(const pma_iterate *it);
pma_status pma_iterate_restore(pma_iterate *it, pma_kept_iteration kept);

/* The macro step at hand is committed, or begins again: scale and kept tangent go along. */
void pma_iterate_commit(pma_iterate *it);
void pma_iterate_discard(pma_iterate *it);

/* f (n) of the last evaluation, without springs, K u and C v. */
double *pma_iterate_force(const pma_iterate *it);

#endif
