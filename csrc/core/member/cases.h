/* cases.h - a subdomain for several load cases, side by side in lanes (algebra/lanes.h).
 *
 * It is a subdomain like any other, PMA_LANES times as large, whose matrices, factors and links are
 * the same in every lane: number i of case l is at i * PMA_LANES + l of every vector, also of what
 * springs remember and of Lam. Every case is bitwise the run of the subdomain alone, for the
 * operations in each lane are the same in the same order. */
#ifndef PMA_CASES_H
#define PMA_CASES_H

#include <stdbool.h>

#include "member/subdomain.h"

/* Restoring and internal forces that are functions are evaluated for one case alone. */
bool pma_cases_are_possible(const pma_subdomain *s);

/* What it is made of, but for springs and internal forces, which are still those of each. */
pma_parts pma_parts_in_lanes(const pma_parts *each);

/* `of` has to outlive it. Stored responses are those of `of`. */
pma_status pma_cases_create(pma_subdomain *of, pma_subdomain **out);

#endif
