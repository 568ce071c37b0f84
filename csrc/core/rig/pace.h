/* pace.h - fine steps that begin when a clock says so, for a specimen in a laboratory.
 *
 * Fine step k is due k periods after the first one: the times are absolute. A step that ends after
 * the next one is due either ends the run or shifts all later times, by as much as lets the next
 * command come a period after the last one. Nothing allocates, and no lock is waited for. */
#ifndef PMA_PACE_H
#define PMA_PACE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "rig/limits.h"

/* ns of a clock; `sleep` returns at that time or earlier. */
typedef struct {
    int64_t (*now)(void *ctx);
    void (*sleep)(void *ctx, int64_t until);
    void *ctx;
} pma_pace_clock;

extern const pma_pace_clock pma_pace_system_clock;

/* The caller's, with its arrays, in s from when the first fine step was due. */
typedef struct {
    pma_pace_clock clock;
    double period; /* ns between two fine steps */
    bool stops;    /* PMA_LATE when one ends after the next one is due */
    size_t rows;   /* fine steps that there is room for */
    double *begun, *commanded, *returned, *ended; /* rows each; nan where nothing is evaluated */
    double *shifts;                               /* rows: `shift` of each, in s */
    size_t stamp_count;
    pma_stamp *stamps; /* of members with a specimen */
    size_t columns;    /* commands and forces of all stamps */
    double *values;    /* rows x columns: command and force of each stamp in turn */
    int64_t origin;    /* when the first one was due; set when it begins */
    size_t done;       /* fine steps */
    int64_t shift;     /* ns by which later ones are due later, after those that were missed */
    int64_t command;   /* when the last command was given; the last step begun, without one */
} pma_pace;

/* ns after the origin at which fine step k is due                                       (Y10) */
static inline int64_t pma_pace_due(const pma_pace *p, size_t k)
{
    return (int64_t)(p->period * (double)k) + p->shift;
}

/* Has the time of the next fine step come? If not, sleeps until then, but for at most 50 ms. */
bool pma_pace_wait(pma_pace *p);

/* The next fine step begins; it ends: PMA_LATE if that ends the run. */
void pma_pace_begin(pma_pace *p);
pma_status pma_pace_end(pma_pace *p);

#endif
