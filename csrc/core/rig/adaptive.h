/* adaptive.h - the filter of a compensator that adapts its coefficients while it runs. */
#ifndef PMA_ADAPTIVE_H
#define PMA_ADAPTIVE_H

#include "rig/filter.h"

enum { PMA_ADAPTIVE_TERMS = 3 };

/* Of each dof on its own                                                              (Y6), (Y7) */
typedef struct {
    double h, start[PMA_ADAPTIVE_TERMS], least[PMA_ADAPTIVE_TERMS], most[PMA_ADAPTIVE_TERMS];
    double change[PMA_ADAPTIVE_TERMS]; /* largest, in an adaptation */
    double threshold;                  /* share of the largest displacement, to adapt at all */
    size_t every, window;              /* steps between samples; samples */
    size_t sections;                   /* of the low-pass filter */
    const double *section;             /* sections x 5: b0, b1, b2, a1, a2 */
} pma_adaptive;

extern const pma_filter_kind pma_adaptive_kind;

#endif
