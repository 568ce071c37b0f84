/* passage.h - the works of (B8) from one time level to the next, in one loop over the dofs. */
#ifndef PMA_PASSAGE_H
#define PMA_PASSAGE_H

#include <stdbool.h>
#include <stddef.h>

/* Sums over the dofs: work of what acts, of r_*, and of the resultant; |r| |u|; and v . M v at the
 * end, where matrices are diagonal. */
enum {
    PMA_PASSAGE_WORK,
    PMA_PASSAGE_START,
    PMA_PASSAGE_RESULTANT,
    PMA_PASSAGE_SIZE,
    PMA_PASSAGE_KINETIC,
    PMA_PASSAGE_TERMS
};

/* From a time level, and to the next one, with the state u, v, w (n each) and the forces r (n) that
 * were evaluated. Of both levels displacement, what acts, and resultant (n each) follow each other;
 * at the end they are r + K_r al1 w and M w where these matrices are diagonal, otherwise there. */
typedef struct {
    const double *from; /* 3 n */
    double *to;         /* 3 n, to be written */
    const double *u, *v, *w, *r;
    const double *fixed; /* 3 n: r_*, and the diagonals of K_r and M */
    bool is_diagonal;    /* in one lane alone */
    double al1;
} pma_passage;

/* terms (PMA_PASSAGE_TERMS x lanes); number i is that of lane i % lanes, 1 or PMA_LANES of them. */
void pma_passage_sum(size_t n, size_t lanes, const pma_passage *p, double *terms);

#endif
