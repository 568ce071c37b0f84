/* scheme.h - the four-parameter schemes and the constants of one step.
 *
 * Generalized-alpha with equilibrium at the end of the step; am and af weight the old state.
 * Newmark, central difference, HHT-alpha and WBZ-alpha are other points of the same family. */
#ifndef PMA_SCHEME_H
#define PMA_SCHEME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "state.h"

typedef struct {
    double am, af, beta, gamma;
} pma_scheme;

/* Constants of one step of length h, formed once. */
typedef struct {
    double h;
    double al1, al2;       /* (P2) u1 = ut + al1 w1, v1 = vt + al2 w1 */
    double u_a, u_w;       /* (5)  ut = u + h v + u_a a + u_w w */
    double v_a, v_w;       /* (6)  vt = v + v_a a + v_w w */
    double a_a, a_w, a_w1; /* (9)  a1 = a_a a + a_w w + a_w1 w1 */
} pma_step;

pma_step pma_step_make(pma_scheme scheme, double h);

/* ---- estimates ------------------------------------------------------------------------------ */

/* Recorded motion of a subdomain, a row for each time level. Arrays of the caller. */
typedef struct {
    size_t columns;
    const double *u, *v, *w; /* levels x columns by rows */
} pma_motion_rows;

/* Some of its steps: step s goes from level begin[s] to level end[s], each of them h long. */
typedef struct {
    size_t count;
    const int64_t *begin, *end; /* count */
    double h;
} pma_recorded_steps;

/* e of column k and step s to e[k * count + s] */
void pma_estimate_errors(const pma_motion_rows *x, const pma_recorded_steps *steps, double *e);

/* ---- predictors and correctors, for each kind of processor ---------------------------------- */

typedef struct {
    /* (5), (6) and the known part of (9) for the rows begin..end-1, from one state into another or
     * in place; w := 0 */
    void (*predict)(const pma_step *c, size_t begin, size_t end, const pma_state *from,
                    const pma_state *to);
    /* (8), (9) for the rows begin..end-1; true when every new value is finite */
    bool (*correct)(const pma_step *c, size_t begin, size_t end, const pma_state *x);
} pma_update;

/* The widest instructions of this processor; bitwise identical to the plain loops, since the order
 * of the sums is the same. */
const pma_update *pma_update_best(void);

/* What every processor has. */
const pma_update *pma_update_plain(void);

#endif
