/* response.h - the link response of a subdomain with substeps under macro coupling.
 *
 * The substeps of a macro step from rest, without loads, under multipliers that grow from zero to
 * dlam: (M3). The result is linear in dlam, so that it can be stored for unit multipliers. */
#ifndef PMA_RESPONSE_H
#define PMA_RESPONSE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "member/state.h"
#include "status.h"

typedef struct pma_response pma_response;

/* States at the end of a macro step for unit multipliers. Arrays of the caller. */
typedef struct {
    size_t count;         /* constraints; 0: nothing is stored, the substeps are repeated */
    const int64_t *rows;  /* count, each in 0..p-1 */
    const double *values; /* count x 4 x n by rows: u, v, w, a of each */
} pma_unit_responses;

void pma_response_store(pma_response *r, pma_unit_responses units);
bool pma_response_is_stored(const pma_response *r);

/* Substep j = 1..substeps of the response, from rest, to lam (p) times j / substeps         (M3) */
void pma_response_step(pma_response *r, size_t j, const double *lam);

/* The state after the last substep; u, v, w, a are one array of 4 n. */
const pma_state *pma_response_state(const pma_response *r);

/* x += the response to lam (p): the stored one, or that of the last steps, which were 1..substeps
 * to the same lam (M5). PMA_NOT_FINITE when a value of x is not finite then. */
pma_status pma_response_add(const pma_response *r, const double *lam, const pma_state *x);

/* All substeps of the response to lam (p): end (p) += L_b v of the last, mean (p) += the mean of
 * all of them, which is far larger where the subdomain resonates with the macro step. */
pma_status pma_response_run(pma_response *r, const double *lam, double *end, double *mean);

#endif
