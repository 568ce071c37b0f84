/* filter.h - what commands pass on their way to a specimen, and what comes back.
 *
 * A filter is a table of functions and what they are of. It works on all `width` commands of a
 * specimen at once. */
#ifndef PMA_FILTER_H
#define PMA_FILTER_H

#include <stddef.h>

/* Commands (width), their velocities, and their accelerations, which are zero where the specimen
 * has no filter that needs them. */
typedef struct {
    double *u, *v, *a;
} pma_command;

typedef struct {
    /* Numbers that it remembers, all zero before the first evaluation. */
    size_t (*numbers)(const void *of, size_t width);
    /* What becomes of a command; `done` is the number of evaluations before this one. */
    void (*send)(const void *of, size_t width, double done, const pma_command *command,
                 double *memory);
    /* What becomes of the displacements x (width) that were measured and of the forces f (width),
     * in the same evaluation. NULL: they stay as they are. */
    void (*receive)(const void *of, size_t width, double done, double *x, double *f,
                    double *memory);
} pma_filter_kind;

typedef struct {
    const pma_filter_kind *kind;
    const void *of;
} pma_filter;

#endif
