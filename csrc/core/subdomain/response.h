/* response.h - the link response of a subdomain over a macro step: macro and mean coupling.
 *
 * The substeps of a macro step from rest, without loads, under multipliers that grow from zero to
 * dlam (M3), or under a constant acceleration of the interface (K3). The result is linear in the
 * multipliers, so that it can be stored for unit ones. */
#ifndef PMA_RESPONSE_H
#define PMA_RESPONSE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "state.h"
#include "status.h"

typedef struct pma_response pma_response;

/* States at the end of a macro step for unit multipliers. Arrays of the caller. */
typedef struct {
    size_t count;         /* constraints; 0: nothing is stored, the substeps are repeated */
    const int64_t *rows;  /* count, each in 0..p-1 */
    const double *values; /* count x 4 x n by rows: u, v, w, a of each; n is that of one lane */
} pma_unit_responses;

void pma_response_store(pma_response *r, pma_unit_responses units);

bool pma_response_is_stored(const pma_response *r);

/* Before the first substep: the response is that of single steps or of a double step. Under mean
 * coupling y (n) := M^-1 L_b^T lam, half of it in a double step.                            (K1) */
void pma_response_begin(pma_response *r, bool twice, const double *lam);

/* Substep j = 1..substeps of the response, from rest, to lam (p) times j / substeps         (M3);
 * under mean coupling to y                                                                  (K3) */
void pma_response_step(pma_response *r, size_t j, const double *lam);

/* The state after the last substep; u, v, w, a are one array of 4 n. */
const pma_state *pma_response_state(const pma_response *r);

/* x += the response to lam (p): the stored one, or that of the last steps, which were 1..substeps
 * to the same lam (M5). PMA_NOT_FINITE when a value of x is not finite then. */
pma_status pma_response_add(const pma_response *r, const double *lam, const pma_state *x);

#endif
