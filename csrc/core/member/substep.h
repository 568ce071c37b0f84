/* substep.h - one step of one subdomain: the value that every operation of a step is given.
 *
 * Made in one place, coupling/clock.h, from the number of the fine step. */
#ifndef PMA_SUBSTEP_H
#define PMA_SUBSTEP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Time levels of a subdomain are counted from the present, which is time level 0: `substeps` of
 * them in a macro step. They go on beyond it while the last macro step is not committed yet. */
typedef struct {
    size_t j;       /* from time level j to j + 1 */
    int64_t number; /* counted from the start of the run */
    double t1;      /* time at its end (T1) */
    bool twice;     /* double step: from time level j - 1, over 2 h */
    bool held;      /* free macro run (M2): under the last multipliers, held; the rest follows */
} pma_substep;

#endif
