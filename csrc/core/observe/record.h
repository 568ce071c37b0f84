/* record.h - where the time levels of an interval of a run are written.
 *
 * Row 0 of every array is the time level at which the interval began. The row of a later one
 * follows from its number alone, so nothing is counted, and the rows of an abandoned macro step
 * are simply written again. */
#ifndef PMA_RECORD_H
#define PMA_RECORD_H

#include <stddef.h>
#include <stdint.h>

#include "count.h"
#include "observe/selection.h"

#define PMA_NO_ROW SIZE_MAX

/* The rows of some macro steps at a time (of those whose number `every` divides), which are used
 * again once another thread has read them. One that finds none is lost: the run never waits. */
typedef struct {
    int64_t size;
    int64_t *steps;    /* size: the one in each slot, counted from 0; else -1 */
    pma_count read;    /* how many the other thread is done with */
    pma_count written; /* the macro step up to which all is written or lost */
    pma_count lost;
} pma_ring;

/* Arrays of the caller. Those of the interface are not touched without constraints, p = 0. */
typedef struct {
    int64_t begin;             /* macro step at which the interval began */
    int64_t every;             /* 0: every time level; else macro ones whose number it divides */
    pma_selection *selections; /* one for each subdomain */
    double *multipliers;       /* rows x p */
    double *velocity_jump;     /* rows x p; of one row, NULL: neither of both */
    double *displacement_jump; /* rows x p, of macro time levels */
    double *contact_impulse;   /* rows x rows of contacts: summed since the row before; or NULL */
    double *contact_gap;       /* rows x contacts; or NULL */
    double *energy;            /* rows x subdomains x PMA_ENERGIES, of macro time levels; or NULL.
                                  With a column for each subdomain whose energy is summed up */
    pma_ring *ring;            /* or NULL: there are rows for all */
} pma_record;

/* Macro step `macro` begins; all macro steps before `macro` are written. With a ring alone. */
void pma_record_begin(const pma_record *record, int64_t macro);
void pma_record_end(const pma_record *record, int64_t macro);

/* The row of time level j = 1..levels inside macro step `macro` (counted from 0), or PMA_NO_ROW. */
size_t pma_record_row(const pma_record *record, int64_t macro, size_t j, size_t levels);

#endif
