/* load.h - the external force F(t) of a subdomain, evaluated at the end of a step only. */
#ifndef PMA_LOAD_H
#define PMA_LOAD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/lanes.h"
#include "forces/path.h"
#include "status.h"

typedef enum {
    PMA_LOAD_NONE,
    PMA_LOAD_CONSTANT,
    PMA_LOAD_SAMPLED,
    PMA_LOAD_TABLE,
    PMA_LOAD_MOVING,
    PMA_LOAD_CALLED,
    PMA_LOAD_SUM,
    PMA_LOAD_IN_LANES
} pma_load_kind;

/* f (n) := F(t), in the user's order of dofs; f arrives zeroed. Other than 0: stop the run. */
typedef int (*pma_force_function)(double t, intptr_t n, double *f, void *user);

/* Arrays of the caller, which have to outlive it. */
typedef struct pma_load {
    pma_load_kind kind;
    size_t n;
    const double *values; /* constant: n; sampled: samples x k by rows; table: rows x n by rows */
    const double *shape;  /* sampled: k vectors of length n, or NULL: k = n and the unit matrix */
    size_t samples, k;
    double begin;         /* sampled: the time of the first sample */
    double dt;            /* sampled: time between two samples */
    bool hold;            /* sampled: keep the last sample after the end, else zero */
    const pma_path *path; /* moving: where the force acts, whose samples are those of k = 1 */
    int64_t first;        /* table: the substep whose load is row 0, counted from the start */
    size_t rows;
    pma_force_function function; /* called */
    void *user;
    const int64_t *order;        /* called: n, the user's dof of each of ours, each in 0..n-1 */
    double *work;                /* called: n, the last value */
    const struct pma_load *each; /* sum: count loads of n dofs, none of them a sum or in lanes */
    const struct pma_lane_term *terms; /* in lanes: count */
    size_t count;
} pma_load;

/* Terms side by side, of the sums that the loads of PMA_LANES lanes are. */
typedef struct pma_lane_term {
    pma_load of[PMA_LANES]; /* sampled, also what is constant or no load */
    size_t series;          /* vectors of the lane that has most */
    const double *shape;    /* series x n x PMA_LANES: a line for each dof; else zero */
    bool has_units;         /* some have no shape */
    bool has_equal_times;   /* the samples of all lanes have the same times */
} pma_lane_term;

/* The loads `each` of PMA_LANES lanes as one: constant, sampled, sums of these, or none. They have
 * to outlive it, and the arrays: so many terms, and so many numbers for the shapes of all. */
size_t pma_load_lane_terms(const pma_load *each);
size_t pma_load_lane_shapes(const pma_load *each);
pma_load pma_load_in_lanes(const pma_load *each, pma_lane_term *terms, double *shapes);

/* Whether it is of this kind, or one of a sum. */
bool pma_load_has(const pma_load *load, pma_load_kind kind);

/* False for a table without a row for each of the substeps begin..end-1, or one of a sum. */
bool pma_load_covers(const pma_load *load, int64_t begin, int64_t end);

/* Evaluates called loads at t; does nothing for any other. PMA_FORCE_FAILED when a function
 * returns other than 0, which goes to *code. */
pma_status pma_load_evaluate(const pma_load *load, double t, int *code);

/* g (n) += F(t), where t ends the substep `number` of the run; of a called load the value it was
 * evaluated to last. Does not allocate. */
void pma_load_add(const pma_load *load, double t, int64_t number, double *g);

/* g (n) += the last values of called loads alone */
void pma_load_add_called(const pma_load *load, double *g);

/* the same as pma_load_add for the rows begin..end-1 of g alone */
void pma_load_add_rows(const pma_load *load, double t, int64_t number, size_t begin, size_t end,
                       double *g);

#endif
