/* springs.h - many springs at once, between two dofs or a dof and the ground.
 *
 * A spring feels its deformation d = u_first - u_second, one with a damper its rate d' too, and
 * pulls back with f. What it remembers is part of a state: three numbers for each spring. */
#ifndef PMA_SPRINGS_H
#define PMA_SPRINGS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "state.h"
#include "status.h"

/* The laws, with their parameters in this order:
 *
 *   cubic           k, k3                                        f = k d + k3 d^3            (H1)
 *   gap             k, gap                                       f = k (d - gap), if positive (H2)
 *   bilinear        k_hard, k_soft, d_y                          f = k_hard d + k_soft (d - p) (H3)
 *   Bouc-Wen        k_hard, f_soft, 1/d_y, n, beta, gamma, rate  f = k_hard d + f_soft z     (H4)
 *   multilinear     k, then k_e, d_e of each element             f = k d + sum k_e (d - p_e) (H9)
 *   ... elastic     the same                                     and without memory          (H10)
 *   Ramberg-Osgood  d_y, f_y, n, alpha                           Masing's branches         (H11)
 *   damped gap      k, gap, c                                    + c d' of a gap          (H13)
 *   damped cubic    k, k3, c                                     + c d' of a cubic spring (H14) */
typedef enum {
    PMA_CUBIC,
    PMA_GAP,
    PMA_BILINEAR,
    PMA_BOUC_WEN,
    PMA_MULTILINEAR,
    PMA_ELASTIC,
    PMA_RAMBERG_OSGOOD,
    PMA_DAMPED_GAP,
    PMA_DAMPED_CUBIC
} pma_spring_law;

enum { PMA_SPRING_LAWS = PMA_DAMPED_CUBIC + 1, PMA_SPRING_PARAMETERS = 63 };

/* Springs of one law. Arrays of the caller, which have to outlive it. */
typedef struct {
    pma_spring_law law;
    size_t count, elements;                          /* elements in parallel of each, or 0 */
    const int32_t *first, *second;                   /* count: dofs, -1 for the ground */
    const double *parameters[PMA_SPRING_PARAMETERS]; /* count each */
} pma_spring_set;

typedef struct {
    size_t count; /* sets */
    const pma_spring_set *sets;
    size_t total;  /* springs in all of them */
    bool in_lanes; /* each PMA_LANES times, one after the other, as the numbers of their dofs */
} pma_springs;

/* What springs remember of a time level: `total` deformations, forces, and for each inner variable
 * of the law that has most of them, at least one, `total` numbers; springs in the order of the
 * sets. All zero: a spring that was never loaded. */
size_t pma_springs_fields(const pma_springs *springs);
size_t pma_springs_numbers(const pma_springs *springs); /* fields x total */

/* How many tables of counts there are in what springs remember of a time level, and these. */
size_t pma_springs_tables(const pma_springs *springs);
void pma_springs_counts(const pma_springs *springs, pma_state_counts *out);

/* The number of parameters of a spring of a set. */
size_t pma_spring_parameters(const pma_spring_set *set);

/* PMA_BAD_INDEX unless all dofs lie in 0..n-1 or are the ground, PMA_BAD_SIZE unless the total
 * is one and the parameters are at most PMA_SPRING_PARAMETERS. */
pma_status pma_springs_check(const pma_springs *springs, size_t n);

/* Does a force depend on the velocity? */
bool pma_springs_have_rates(const pma_springs *springs);

/* y -= r(u, v): `to` is what the springs remember after they went from `from` to u. `from` and `to`
 * may be the same; v is NULL at rest, and where no force depends on it. Does not allocate. */
void pma_springs_subtract(const pma_springs *springs, const double *u, const double *v,
                          const double *from, double *to, double *y);

/* The same by loops for any processor, to be compared. */
void pma_springs_subtract_plain(const pma_springs *springs, const double *u, const double *v,
                                const double *from, double *to, double *y);

/* y -= r(u, v) of springs that were never loaded, which stay so. Allocates: PMA_NO_MEMORY. */
pma_status pma_springs_subtract_first(const pma_springs *springs, const double *u, const double *v,
                                      double *y);

/* by_d df/dd + by_rate df/dd' (total) at the end of the path from one level to another, which
 * r(u, v) was evaluated for. */
void pma_springs_tangent(const pma_springs *springs, const double *from, const double *to,
                         double by_d, double by_rate, double *slopes);

/* The energy that they can give back at a time level.                                      (H5) */
double pma_springs_energy(const pma_springs *springs, const double *level);

/* The work done on them between two time levels, (d1 - d0) (f0 + f1) / 2 each. */
double pma_springs_work(const pma_springs *springs, const double *from, const double *to);

/* r += what the springs pull with at a time level. */
void pma_springs_add(const pma_springs *springs, const double *level, double *r);

/* out (lanes) += that energy, -= that work, of each lane: spring i is one of lane i % lanes. */
void pma_springs_add_energy(const pma_springs *springs, size_t lanes, const double *level,
                            double *out);
void pma_springs_subtract_work(const pma_springs *springs, size_t lanes, const double *from,
                               const double *to, double *out);

#endif
