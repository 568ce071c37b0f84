/* record.h - where a stretch of a run leaves its nodes.
 *
 * Row 0 of every array is the node where the stretch began. The row of a later node follows from
 * its number alone, so nothing is counted and an aborted macro step is simply written again. */
#ifndef PMA_RECORD_H
#define PMA_RECORD_H

#include <stddef.h>
#include <stdint.h>

#include "member/subdomain.h"

#define PMA_NO_ROW SIZE_MAX

/* What is kept of one subdomain: rows of `count` values. */
typedef struct {
    size_t count;
    const int64_t *position; /* count: which dofs, in elimination order */
    double *u, *v, *w;       /* rows x count by rows */
    size_t springs, of_springs;   /* so many of so many springs */
    const int64_t *spring;        /* springs: which */
    double *deformation, *force;  /* rows x springs by rows */
} pma_record_nodes;

/* Arrays of the caller. Those of the interface are not touched without conditions, p = 0. */
typedef struct {
    int64_t begin;           /* macro step at which the stretch began */
    int64_t every;           /* 0: every node; else macro nodes whose number it divides */
    pma_record_nodes *nodes; /* one for each subdomain */
    double *multipliers;     /* rows x p */
    double *velocity_jump;   /* rows x p */
    double *displacement_jump; /* rows x p, of macro nodes */
    double *energy;          /* rows x subdomains x PMA_ENERGIES, of macro nodes; or NULL */
} pma_record;

/* The row of node j = 1..nodes inside macro step `macro` (counted from 0), or PMA_NO_ROW. */
size_t pma_record_row(const pma_record *record, int64_t macro, size_t j, size_t nodes);

/* Copies the chosen dofs and springs of a state into a row. */
void pma_record_state(const pma_record_nodes *nodes, const pma_state *state, size_t row);

/* The same, added to what the row holds. */
void pma_record_add(const pma_record_nodes *nodes, const pma_state *state, size_t row);

#endif
