/* passage.h - the works of (B8) from one time level to the next, in one loop over the dofs. */
#ifndef PMA_PASSAGE_H
#define PMA_PASSAGE_H

#include <stddef.h>

/* Sums over the dofs: work of what acts, of r_*, and of the resultant; |r| |u|; and v . M v at the
 * end, where M is diagonal and there is one lane. */
enum {
    PMA_PASSAGE_WORK,
    PMA_PASSAGE_START,
    PMA_PASSAGE_RESULTANT,
    PMA_PASSAGE_SIZE,
    PMA_PASSAGE_KINETIC,
    PMA_PASSAGE_TERMS
};

/* Arrays of n. The state at the end is u, v, w, the forces that were evaluated are r. What acts is
 * f + k al1 w with diagonal k, the resultant q + m w with diagonal m; in lanes f and q alone. */
typedef struct {
    const double *u0, *f0, *q0; /* displacement, what acted, and resultant at the beginning */
    double *u1, *f1, *q1;       /* the same at the end, to be written; may be u, f and q */
    const double *u, *v, *w, *r, *f, *q, *k, *m;
    const double *start; /* r_* */
    double al1;
} pma_passage;

/* terms (PMA_PASSAGE_TERMS x lanes); number i is that of lane i % lanes, 1 or PMA_LANES of them. */
void pma_passage_sum(size_t n, size_t lanes, const pma_passage *p, double *terms);

#endif
