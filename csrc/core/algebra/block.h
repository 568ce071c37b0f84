/* block.h - the compliance of an interface from a factor, all constraints at once.        (F6)
 *
 * G = L_b S^-1 L_b^T = Y^T D_b^-1 X with X = R_bb^-1 L_b^T and Y = Q_bb^-1 L_b^T. One sweep for
 * each constraint reads the factor of the interface as often as there are constraints; here BLAS
 * takes many together. */
#ifndef PMA_BLOCK_H
#define PMA_BLOCK_H

#include <stddef.h>

#include "algebra/link.h"
#include "algebra/numeric.h"

/* From this number of constraints on BLAS is faster than sweeps. */
enum { PMA_BLOCK_MANY = 16 };

/* Doubles of scratch that pma_block_compliance needs for this number of constraints; 0 where sweeps
 * are faster, or the factor has no panels. */
size_t pma_block_scratch(const pma_numeric *f, size_t count);

/* G (count x count) := scale L_b S^-1 L_b^T between constraints, of a factor with panels. column
 * has for each entry of the link which of the constraints it belongs to. */
void pma_block_compliance(const pma_numeric *f, const pma_link *L, const size_t *column,
                          size_t count, double scale, double *G, double *scratch);

#endif
