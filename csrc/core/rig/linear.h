/* linear.h - a specimen with its transfer system: a linear system of commands, displacements that
 * are measured, and forces (Y13). */
#ifndef PMA_LINEAR_H
#define PMA_LINEAR_H

#include <stdint.h>

#include "rig/signals.h"

/* Arrays of the caller, matrices by rows. */
typedef struct {
    size_t inputs, states;
    const double *phi;                  /* states x states: exp(h A) */
    const double *before, *after;       /* states x inputs: of the last command and of this one */
    const double *rest;                 /* states x inputs: at rest under a constant command */
    const double *displacement, *force; /* inputs x states */
    pma_delay delay;
    double largest;                     /* of commands that are followed, infinite for none */
    double noise, force_noise, quantum; /* 0 for none; the quantum of commands and displacements */
    uint64_t seed;
    double *work; /* states: scratch */
} pma_linear;

/* Numbers that it remembers, all zero before the first evaluation. */
size_t pma_linear_numbers(const pma_linear *p);

/* Commands u (inputs) become what is measured, and f (inputs) the forces. Once a step. */
void pma_linear_evaluate(const pma_linear *p, double *u, double *f, double *memory);

#endif
