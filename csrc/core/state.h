/* state.h - the numbers of a subdomain at a time level, and one step from one to another. */
#ifndef PMA_STATE_H
#define PMA_STATE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A time level, or a substep that is open. All arrays in elimination order.                (E1)
 *
 *        closed                      opened
 *   u    displacement                predictor ut
 *   v    velocity                    predictor vt
 *   w    acceleration                swept right-hand side y
 *   a    acceleration-like variable  its part that is known, (af w - am a)/(1 - am) */
typedef struct {
    double *u, *v, *w, *a; /* n each */
    double *springs;       /* what they remember, and then the restoring function; of an open
                              substep already that of its end */
    double *history;       /* the same of internal forces; of an iterated substep the number of
                              corrections follows */
} pma_state;

/* Counts among the numbers of an array: `count` of them from number `first` on, whole ones in
 * 0..most. What computes with a count trusts it, since a state is checked where it is taken. */
typedef struct {
    size_t first, count;
    double most;
} pma_state_counts;

/* A count of evaluations, which grows by 1. */
#define PMA_MOST_COUNTED 0x1p53

/* One of the arrays that are a state, by its name in files, and what of it are counts. */
typedef struct {
    const char *name;
    size_t count;
    double *values;
    size_t tables;
    const pma_state_counts *counts; /* tables */
} pma_state_array;

/* NULL, or the first of these values (count) for the array that should be a count and is not one,
 * with the largest that it can be. */
const double *pma_state_wrong_count(const pma_state_array *array, const double *values,
                                    double *most);

/* The number of no substep. */
#define PMA_NO_SUBSTEP INT64_MIN

/* One step of one subdomain: the value that every operation of a step is given, made in one place,
 * couple/clock.h, from the number of the fine step. Time levels of a subdomain are counted from
 * the present, which is time level 0: `substeps` of them in a macro step. They go on beyond it
 * while the last macro step is not committed yet. */
typedef struct {
    size_t j;         /* from time level j to j + 1 */
    int64_t number;   /* counted from the start of the run */
    double t1;        /* time at its end (T1) */
    bool twice;       /* double step: from time level j - 1, over 2 h */
    bool is_free_run; /* (M2): under the last multipliers, kept constant; the rest follows */
} pma_substep;

#endif
