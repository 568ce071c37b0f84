/* springs.h - many springs at once, between two dofs or a dof and the ground.
 *
 * A spring feels its deformation d = u_first - u_second and pulls back with f. What it remembers is
 * part of a state: three numbers for each spring. */
#ifndef PMA_SPRINGS_H
#define PMA_SPRINGS_H

#include <stddef.h>
#include <stdint.h>

#include "status.h"

/* The laws (H1) to (H4), with their parameters in this order:
 *
 *   cubic      k, k3                                        f = k d + k3 d^3
 *   gap        k, gap                                       f = k (d - gap), if that is positive
 *   bilinear   k_hard, k_soft, d_y                          f = k_hard d + k_soft (d - p)
 *   Bouc-Wen   k_hard, f_soft, 1/d_y, n, beta, gamma, rate  f = k_hard d + f_soft z */
typedef enum { PMA_CUBIC, PMA_GAP, PMA_BILINEAR, PMA_BOUC_WEN } pma_spring_law;

enum { PMA_SPRING_LAWS = PMA_BOUC_WEN + 1, PMA_SPRING_PARAMETERS = 7 };

/* The number of parameters of each law. */
extern const size_t pma_spring_parameters[PMA_SPRING_LAWS];

/* Springs of one law. Arrays of the caller, which have to outlive it. */
typedef struct {
    pma_spring_law law;
    size_t count;
    const int32_t *first, *second;                   /* count: dofs, -1 for the ground */
    const double *parameters[PMA_SPRING_PARAMETERS]; /* count each */
} pma_spring_set;

typedef struct {
    size_t count; /* sets */
    const pma_spring_set *sets;
    size_t total; /* springs in all of them */
} pma_springs;

/* What springs remember of a time level: `total` deformations, forces, and inner variables (p or
 * z), in the order of the sets. All zero: a spring that was never loaded. */
enum { PMA_SPRING_FIELDS = 3 };

/* PMA_BAD_INDEX unless all dofs lie in 0..n-1 or are the ground, PMA_BAD_SIZE unless the total
 * is one. */
pma_status pma_springs_check(const pma_springs *springs, size_t n);

/* y -= r(u): `to` is what the springs remember after they went from `from` to u. `from` and `to`
 * may be the same. Does not allocate. */
void pma_springs_subtract(const pma_springs *springs, const double *u, const double *from,
                          double *to, double *y);

/* df/dd (total) at the end of the path from one level to another, which r(u) was evaluated for. */
void pma_springs_tangent(const pma_springs *springs, const double *from, const double *to,
                         double *slopes);

/* The energy that they can give back at a time level.                                      (H5) */
double pma_springs_energy(const pma_springs *springs, const double *level);

/* The work done on them between two time levels, (d1 - d0) (f0 + f1) / 2 each. */
double pma_springs_work(const pma_springs *springs, const double *from, const double *to);

#endif
