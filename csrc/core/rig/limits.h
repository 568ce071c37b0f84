/* limits.h - what a specimen is commanded and what it returns: limits, and when that was.
 *
 * A command is the displacement at which restoring forces are evaluated, once in a substep. Its
 * rate and acceleration are differences of commands; energy is the work of the forces along them.
 * Commands are known by the number of their substep, so that a macro step can be taken again. Those
 * of a paced run are judged by the clock too, in the order in which they are given. */
#ifndef PMA_LIMITS_H
#define PMA_LIMITS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "status.h"

/* ---- when: of the last command and the force that came back, in ns of a clock ---------------- */

#define PMA_NEVER INT64_MIN

/* ... and what they were at some positions of the elimination order, arrays of the caller. */
typedef struct {
    int64_t (*now)(void *ctx);
    void *ctx;
    int64_t commanded, returned;
    size_t count;
    const int64_t *position;
    double *command, *force; /* count each */
} pma_stamp;

/* ---- how much -------------------------------------------------------------------------------- */

typedef enum {
    PMA_OF_DISPLACEMENT,
    PMA_OF_VELOCITY,
    PMA_OF_ACCELERATION,
    PMA_OF_FORCE,
    PMA_OF_ENERGY
} pma_limited;

/* Arrays of the caller in elimination order; NULL: not limited. */
typedef struct {
    size_t n;
    double h;                                                     /* between two commands */
    const double *displacement, *velocity, *acceleration, *force; /* n each, absolute values */
    double energy; /* that the specimen may have returned beyond what it got; INFINITY: any */
} pma_limits_parts;

/* What was exceeded last: at which position, by which value, at which time; by rates of the clock
 * or of the problem? */
typedef struct {
    pma_limited what;
    bool by_clock;
    size_t position;
    double value, limit, t;
} pma_breach;

/* A clock by which a command is given every `period` ns. */
typedef struct {
    int64_t (*now)(void *ctx);
    void *ctx;
    double period;
} pma_limits_clock;

typedef struct pma_limits pma_limits;

pma_status pma_limits_create(const pma_limits_parts *parts, pma_limits **out);
void pma_limits_destroy(pma_limits *l); /* NULL is allowed */

/* Commands and works so far are forgotten. */
void pma_limits_begin(pma_limits *l);

/* Later commands are given by this clock; NULL: by none. */
void pma_limits_pace(pma_limits *l, const pma_limits_clock *clock);

/* Is u (n) of the substep `number`, that ends at t, within the limits, and v (n; or NULL)? `first`:
 * of a macro step. u0, v0 (n): the state at the beginning of the substep, in place of commands that
 * are not known. NaN is within no limit. */
bool pma_limits_command(pma_limits *l, int64_t number, bool first, double t, const double *u0,
                        const double *v0, const double *u, const double *v);

/* Where the force (n) is to be written that the last command was answered with; is it? */
double *pma_limits_force(pma_limits *l);
bool pma_limits_measure(pma_limits *l);

/* The initial values u (n), which are evaluated at t before there is a substep: where their force
 * (n) is to be written; is it within the limits? With them as the command before substep 0, and
 * with the velocity v (n), commands begin anew. */
double *pma_limits_first(pma_limits *l, const double *u);
bool pma_limits_measure_first(pma_limits *l, double t);
void pma_limits_begin_first(pma_limits *l, const double *v);

const pma_breach *pma_limits_breach(const pma_limits *l);

#endif
