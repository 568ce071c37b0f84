/* update.h - predictors and correctors, the loops over all dofs, for each kind of processor. */
#ifndef PMA_UPDATE_H
#define PMA_UPDATE_H

#include <stdbool.h>
#include <stddef.h>

#include "state.h"
#include "subdomain/scheme.h"

typedef struct {
    /* (5), (6) and the known part of (9) for the rows begin..end-1, from one state into another or
     * in place; w := 0 */
    void (*predict)(const pma_step *c, size_t begin, size_t end, const pma_state *from,
                    const pma_state *to);
    /* (8), (9) for the rows begin..end-1; true when every new value is finite */
    bool (*correct)(const pma_step *c, size_t begin, size_t end, const pma_state *x);
} pma_update;

/* The widest instructions of this processor; bitwise identical to the plain loops, since the order
 * of the sums is the same. */
const pma_update *pma_update_best(void);

/* What every processor has. */
const pma_update *pma_update_plain(void);

#endif
