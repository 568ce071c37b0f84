/* symbolic.h - how many entries a factor will have, known before it is computed. */
#ifndef PMA_SYMBOLIC_H
#define PMA_SYMBOLIC_H

#include <stddef.h>
#include <stdint.h>

/* Entries of R below the diagonal, column by column, for a matrix of size n in this order.
 *
 * ptr (n+1), index: the pattern by rows, symmetric, every index in 0..n-1; entries on and above
 * the diagonal are passed over. parent, mark (n): scratch. count (n): output. Does not allocate.
 * Takes time in proportion to the entries of R. */
void pma_symbolic_count(size_t n, const int64_t *ptr, const int32_t *index, int64_t *parent,
                        int64_t *mark, int64_t *count);

#endif
