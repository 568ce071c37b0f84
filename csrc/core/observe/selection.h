/* selection.h - which dofs, springs and outputs of a subdomain are recorded, and where. */
#ifndef PMA_SELECTION_H
#define PMA_SELECTION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "forces/restoring.h"
#include "state.h"

/* A sparse matrix by rows: columns and weights of row k are at start[k] .. start[k + 1] - 1. */
typedef struct {
    const int64_t *start;    /* one more than rows, or NULL without entries */
    const int64_t *position; /* start[rows]: columns, in elimination order */
    const double *weight;    /* start[rows] */
} pma_combination;

/* Rows of `count` values, a row for each recorded time level. Arrays of the caller. */
typedef struct pma_selection {
    size_t count;
    const int64_t *position;     /* count: which dofs, in elimination order */
    double *u, *v, *w;           /* rows x count by rows */
    size_t springs, of_springs;  /* number of springs recorded, and of all springs */
    const int64_t *spring;       /* springs: which */
    double *deformation, *force; /* rows x springs by rows */
    size_t history, of_history;  /* numbers recorded of internal forces, all or none, and of all */
    double *q;                   /* rows x history by rows */
    double *corrections;         /* rows, or NULL: of iterated substeps */
    size_t commands;             /* numbers recorded of each array of rigs, all or none */
    const pma_restoring *of_rig; /* which has their traces, from number `rig_begin` on */
    size_t rig_begin;            /* of what springs and the restoring force remember */
    double *command, *sent, *measured, *rig_force; /* rows x commands by rows */
    size_t outputs; /* number of outputs y = of_u u + of_v v + of_w w */
    pma_combination of_u, of_v, of_w;
    double *output;                   /* rows x outputs by rows */
    const struct pma_selection *next; /* of another case beside this one, or NULL */
} pma_selection;

/* True if nothing is recorded. */
static inline bool pma_selection_is_empty(const pma_selection *selection)
{
    return (selection->count | selection->springs | selection->history | selection->outputs |
            selection->commands) == 0 &&
           !selection->corrections;
}

/* Copies the selected dofs and springs of a state into a row, and computes its outputs; and all
 * that for the selections that follow it, in this function and in those below. */
void pma_selection_write(const pma_selection *selection, const pma_state *state, size_t row);

/* Adds an acceleration y (n) to the selected w, and to the outputs that depend on it. */
void pma_selection_accelerate(const pma_selection *selection, const double *y, size_t row);

/* Adds the selected dofs of a state, and its outputs, to what the row holds. */
void pma_selection_add(const pma_selection *selection, const pma_state *state, size_t row);

#endif
