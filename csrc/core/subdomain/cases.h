/* cases.h - a subdomain for several load cases, side by side in lanes (algebra/lanes.h).
 *
 * It is a subdomain like any other, PMA_LANES times as large, whose matrices, factors and links are
 * the same in every lane: number i of case l is at i * PMA_LANES + l of every vector, also of what
 * springs remember and of Lam. Every case is bitwise the run of the subdomain alone, for the
 * operations in each lane are the same in the same order. */
#ifndef PMA_CASES_H
#define PMA_CASES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "subdomain/subdomain.h"

/* Restoring and internal forces that are functions are evaluated for one case alone. */
bool pma_cases_are_possible(const pma_subdomain *s);

/* `of` has to outlive it. Stored responses are those of `of`. */
pma_status pma_cases_create(pma_subdomain *of, pma_subdomain **out);

/* ---- unit responses ---------------------------------------------------------------------------
 *
 * Responses to unit multipliers of several constraints, side by side (algebra/lanes.h): each
 * substep reads matrices and factors once for all of them. Set-up makes such runs. */

typedef struct pma_unit_response pma_unit_response;

/* Memory for the runs of a subdomain that has responses, about 5 n PMA_LANES doubles. */
pma_status pma_unit_response_create(const pma_subdomain *s, pma_unit_response **out);
void pma_unit_response_destroy(pma_unit_response *r); /* NULL is allowed */

/* From rest, to unit multipliers of `count` constraints, at most PMA_LANES. */
void pma_unit_response_begin(pma_unit_response *r, bool twice, size_t count, const int64_t *rows);

/* Substep j = 1..substeps, in turn. */
void pma_unit_response_step(pma_unit_response *r, size_t j);

/* After the last one, of constraint `row` in the response in this lane: L_b v at the end (L_b u
 * under mean coupling), and the mean of all L_b v, which is far larger than the former where the
 * subdomain resonates with the macro step. */
double pma_unit_response_end(const pma_unit_response *r, size_t lane, int64_t row);
double pma_unit_response_mean(const pma_unit_response *r, size_t lane, int64_t row);

/* ... and its state: out (4 n) := u, v, w, a. */
void pma_unit_response_copy(const pma_unit_response *r, size_t lane, double *out);

/* Are all values of the states finite? */
bool pma_unit_response_is_finite(const pma_unit_response *r);

#endif
