/* laws.h - the laws of springs, (H1) to (H14), a table with a row for each.
 *
 * A law is its parameters, its inner variables, and its functions: where it goes, its tangents and
 * its energy. What else depends on a law is made of this table: checks, sizes, lanes, and the list
 * of laws that Python has. */
#ifndef PMA_LAWS_H
#define PMA_LAWS_H

#include <stddef.h>

#include "forces/springs.h"

/* `count` springs that go from the deformations d0 to d, with their forces and inner variables
 * before and after. Parameter k of spring i is P[k][i], its inner variable k is [k * stride + i].
 * What is after may be where what is before was. */
typedef struct {
    size_t count, elements, stride;
    const double *const *P;
    const double *d0, *d, *rate, *f0,
        *inner0; /* rate: d' at the end, of a law that has a dashpot */
    double *f, *inner1;
} pma_law_path;

/* One spring at the end of its path: parameter k is P[k][i]. */
typedef struct {
    size_t i, elements, stride;
    const double *const *P;
    double d0, d, f;
    const double *inner0, *inner1; /* at this spring */
} pma_law_end;

typedef void pma_law_go(const pma_law_path *path);

typedef struct {
    const char *name;
    size_t parameters, inner;           /* of each spring */
    size_t each_parameters, each_inner; /* more for each of its elements */
    pma_law_go *go, *go_plain;          /* where the processor has AVX2; bitwise the same on all */
    double (*tangent)(const pma_law_end *end); /* df/dd */
    double (*energy)(const pma_law_end *end);  /* that it can give back                    (H5) */
    double (*dashpot)(const pma_law_end *end); /* df/dd'; NULL: without one */
    size_t most; /* of inner variable 0, where that is a count; 0: no inner variable is one */
} pma_law;

extern const pma_law pma_laws[PMA_SPRING_LAWS];

#endif
