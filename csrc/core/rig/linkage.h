/* linkage.h - the filter of a linkage between the dofs of a structure and actuators. */
#ifndef PMA_LINKAGE_H
#define PMA_LINKAGE_H

#include <stdbool.h>

#include "rig/filter.h"

/* Commands J d, forces J^T f: a matrix, or two arms (Y17). Arrays of the caller, by rows. */
typedef struct {
    bool has_arms;
    double length[2], angle[2];
    const double *matrix, *inverse; /* width x width, without arms */
    double *work;                   /* width: scratch */
} pma_linkage;

extern const pma_filter_kind pma_linkage_kind;

#endif
