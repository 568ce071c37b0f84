/* selection.h - which dofs and springs of a subdomain are recorded, and where. */
#ifndef PMA_SELECTION_H
#define PMA_SELECTION_H

#include <stddef.h>
#include <stdint.h>

#include "member/state.h"

/* Rows of `count` values, a row for each recorded time level. Arrays of the caller. */
typedef struct {
    size_t count;
    const int64_t *position;     /* count: which dofs, in elimination order */
    double *u, *v, *w;           /* rows x count by rows */
    size_t springs, of_springs;  /* number of springs recorded, and of all springs */
    const int64_t *spring;       /* springs: which */
    double *deformation, *force; /* rows x springs by rows */
} pma_selection;

/* Copies the selected dofs and springs of a state into a row. */
void pma_selection_write(const pma_selection *selection, const pma_state *state, size_t row);

/* Adds the selected dofs of a state to what the row holds. */
void pma_selection_add(const pma_selection *selection, const pma_state *state, size_t row);

#endif
