/* record.h - where the time levels of an interval of a run are written.
 *
 * Row 0 of every array is the time level at which the interval began. The row of a later one
 * follows from its number alone, so nothing is counted, and the rows of an abandoned macro step
 * are simply written again. */
#ifndef PMA_RECORD_H
#define PMA_RECORD_H

#include <stddef.h>
#include <stdint.h>

#include "member/selection.h"

#define PMA_NO_ROW SIZE_MAX

/* Arrays of the caller. Those of the interface are not touched without constraints, p = 0. */
typedef struct {
    int64_t begin;             /* macro step at which the interval began */
    int64_t every;             /* 0: every time level; else macro ones whose number it divides */
    pma_selection *selections; /* one for each subdomain */
    double *multipliers;       /* rows x p */
    double *velocity_jump;     /* rows x p */
    double *displacement_jump; /* rows x p, of macro time levels */
    double *energy;            /* rows x subdomains x PMA_ENERGIES, of macro time levels; or NULL.
                                  With a column for each subdomain whose energy is summed up */
} pma_record;

/* The row of time level j = 1..levels inside macro step `macro` (counted from 0), or PMA_NO_ROW. */
size_t pma_record_row(const pma_record *record, int64_t macro, size_t j, size_t levels);

#endif
