/* agenda.h - what has to be done to make a factor in panels, and in what order.
 *
 * A supernode is updated by all its descendants that have one of its columns among their rows. A
 * task is a range of supernodes: a subtree of the elimination tree, or one supernode above. Tasks
 * are listed by what is still to be done after them on the way to the root, the most first. So a
 * task comes after all tasks that it needs, and several workers that take one after the other never
 * all wait. */
#ifndef PMA_AGENDA_H
#define PMA_AGENDA_H

#include <stddef.h>
#include <stdint.h>

#include "algebra/panels.h"
#include "status.h"

typedef struct {
    size_t *update; /* count+1 of the panels: where the updates of each supernode begin */
    size_t *source; /* update[count]: the supernodes they come from, ascending */
    size_t *row;    /* update[count]: the first of the source's rows that is a column */
    size_t tasks;
    size_t *first, *last; /* tasks: supernodes of each */
} pma_agenda;

/* Panels that were checked, with the supernode of each column; for one worker each tree is one
 * task. Allocates: PMA_NO_MEMORY; *out is empty then. */
pma_status pma_agenda_create(const pma_panels *p, const int64_t *owner, size_t workers,
                             pma_agenda *out);
void pma_agenda_destroy(pma_agenda *a); /* an empty one is allowed */

#endif
