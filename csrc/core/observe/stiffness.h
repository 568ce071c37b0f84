/* stiffness.h - how stiff evaluated forces have been between two evaluations, beside what a step
 * allows.                                                                                (B15) */
#ifndef PMA_STIFFNESS_H
#define PMA_STIFFNESS_H

#include <stdbool.h>
#include <stddef.h>

#include "algebra/matrix.h"

/* Of a step of length h: u1 = ut + al1 w1, and in a motion that changes its sign with each step
 * w1 = - ut1 / stiff, u1 = inert w1, w1 = - vs1 / damp and v1 = (damp - h) w1.            (B15) */
typedef struct {
    double h, al1, stiff, inert, damp;
} pma_step_limits;

/* Where the forces were evaluated, and what they were, with loads that depend on the motion: n
 * each; vs: NULL where they depend on no velocity. */
typedef struct {
    const double *ut, *total, *vs;
} pma_evaluation_at;

/* The step over that which the forces allow, if they depend on displacements, squared, and if they
 * depend on velocities; 0 where that is not known. Above 1 they let the motion grow. */
typedef struct {
    double displacement, velocity;
} pma_excess;

/* Matrices of the subdomain; K_r and D_r: zero where they do not act. */
typedef struct {
    size_t n, lanes;
    bool is_explicit; /* K is evaluated where the forces are */
    pma_matrix M, K, K_r, D_r;
} pma_stiffness;

/* From one evaluation to the next, a step apart, of a lane. scratch: 3 n */
pma_excess pma_stiffness_excess(const pma_stiffness *s, const pma_step_limits *step,
                                const pma_evaluation_at *from, const pma_evaluation_at *to,
                                size_t lane, double *scratch);

#endif
