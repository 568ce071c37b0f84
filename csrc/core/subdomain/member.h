/* member.h - a subdomain as the coupler sees it: in interface space, through a table of operations.
 *
 * A coupler knows nothing else of a subdomain, so that whatever fills such a table can take part:
 * the subdomain of subdomain.h, or the naive one of the tests. In what follows `j` is a time level
 * counted from the present (state.h), and `lam` has p numbers.
 *
 * One thread at a time works with a member. `values` of kinds marked (c) may be called by the
 * thread that called pma_coupler_advance while another one is inside `advance` or `record`;
 * `opened` and `is_known` while it closes or records. No operation allocates but `prepare`. */
#ifndef PMA_MEMBER_H
#define PMA_MEMBER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/link.h"
#include "observe/selection.h"
#include "solve/newton.h"
#include "state.h"
#include "status.h"

/* ---- a member with internal forces (N11) ---------------------------------------------------- */

typedef struct {
    /* The first guess of a substep, from the multipliers at its beginning (N4). Evaluates loads
     * and what is evaluated once. */
    pma_status (*begin)(void *self, const pma_substep *step, const double *lam);

    /* Iterates alone, under lam, up to the energy scale of the member itself. PMA_STOPPED when
     * stop, called before each evaluation, returns true. */
    pma_status (*converge)(void *self, const pma_newton *newton, const double *lam,
                           bool (*stop)(void *ctx), void *ctx);

    /* See pma_equations. `linearize` factors the tangent if it is fresh, and makes the law: o is
     * then the free velocity at the end of the substep, G its compliance, and `changed` says
     * whether G is another one than before; lam: the multipliers that `correct` was given last. */
    pma_status (*evaluate)(void *self, bool tangent, pma_measure *measure);
    pma_status (*linearize)(void *self, bool fresh, const double *lam, bool *changed);
    void (*correct)(void *self, const double *lam, pma_measure *measure);
    void (*move)(void *self, double by);
    void (*restart)(void *self, const double *lam);
    void (*remember_rounding)(void *self);

    /* The law in the middle of a substep that ends later (N13): the stored free velocity of its
     * beginning, time level j, follows the new tangent. */
    void (*rebase)(void *self, size_t j, const double *lam);

    /* block (count x count) := G between the constraints of the member */
    void (*block)(void *self, double *block);

    /* The iterate is the state at the end of the substep. */
    pma_status (*finish)(void *self, const double *lam);

    /* The corrections made for the substep that ended at time level j, to be read or written; the
     * energy scale s^2 (N6). */
    double *(*corrections)(void *self, size_t j);
    double (*scale)(const void *self);

    /* Is there a factor, which can be kept? */
    bool (*has_factor)(const void *self);
} pma_iterated_table;

/* The constraints of such a member: their rows, ascending. */
typedef struct {
    const pma_iterated_table *table;
    size_t count;
    const int64_t *rows;
} pma_iterated;

/* ---- every member --------------------------------------------------------------------------- */

/* Values on the interface (nb); L of them is what a coupler sums up. */
typedef enum {
    PMA_FREE_VELOCITY,      /* (c) vf at time level j, once the substep to it is open */
    PMA_BEGINNING_VELOCITY, /* (c) vf at time level j, where the substep at hand begins */
    PMA_VELOCITY,           /* v at time level j, which is closed */
    PMA_DISPLACEMENT,       /* u there; of a step that waits to be closed, its free solution */
    PMA_LINK_VELOCITY,      /* (c) al2 Mbar^-1 L^T lam: what lam adds to v (14), and for unit
                                  multipliers the block of H (F6) */
} pma_interface_kind;

/* What recording may show of a member, see `record`. */
typedef enum {
    PMA_MOTION,      /* time level j, which is closed, written */
    PMA_RESPONSE,    /* the link response after its last substep, added */
    PMA_ACCELERATION /* the acceleration of lam, which no state has, added                 (K5) */
} pma_recordable;

/* Several workers who can share the work of one member: `share(ctx, work, self)` returns when all
 * have done work(self, worker), worker = 0..count-1; true if all of them returned true. */
typedef struct {
    size_t count;
    void *ctx;
    bool (*share)(void *ctx, bool (*work)(void *self, size_t worker), void *self);
} pma_workers;

typedef struct {
    /* ---- what every member must do ------------------------------------------------------ */

    /* A substep closed, or one opened; the other one is NULL.
     * Closed: the link problem (14) under lam, added: the state at its end. Fails with
     * PMA_NOT_FINITE when a value of that state is not finite.
     * Opened: the free problem (13), as far as the free velocity on the interface; the only substep
     * of a free macro run has that under lam (M6). Evaluates loads and forces, once.
     * Fails with PMA_FORCE_FAILED, PMA_RESTORING_FAILED or PMA_INTERNAL_FAILED, PMA_UNSYMMETRIC.
     * Workers (or NULL) of a member that divides. Bitwise the same for any number of them. */
    pma_status (*advance)(void *self, const pma_substep *closed, const pma_substep *opened,
                          const double *lam, const pma_workers *workers);

    /* The time level up to which substeps are open or closed; 0 at the present. */
    size_t (*opened)(const void *self);

    /* Values of a kind, with the operator of the single or the double step, until the next call. */
    const double *(*values)(void *self, pma_interface_kind kind, size_t j, bool twice,
                            const double *lam);

    /* Into a row. */
    void (*record)(void *self, pma_recordable what, size_t j, const double *lam,
                   const pma_selection *selection, size_t row);

    /* The last time level of the macro step becomes the present. Cannot fail. */
    void (*commit)(void *self);

    /* What is open is given up: the macro step at hand begins again. */
    void (*discard)(void *self);

    /* ---- what a member may do; NULL where it does not ----------------------------------- */

    /* Look-ahead: room for a macro step that begins before the last one is committed. Allocates. */
    pma_status (*prepare)(void *self);

    /* Look-ahead: can the load of a substep be evaluated already, before its turn? */
    bool (*is_known)(const void *self, const pma_substep *step);

    /* Double steps. The stored free velocity of time level j is changed over to the operator of the
     * double step, once, at the end of the first macro step (S3). */
    void (*rebase)(void *self, size_t j, const double *lam);

    /* Energy. Is it summed up? Then out (PMA_ENERGIES), unless NULL, is that of time level j = 0 or
     * substeps. */
    bool (*energy)(const void *self, size_t j, double *out);

    /* Macro coupling with substeps. Substep j = 1..substeps of the link response, from rest, to
     * dlam times j / substeps (M3), after a free macro run under lam; and the response after the
     * last of them, stored or just repeated (M5), added to the last time level, which fails as
     * closing does. `repeats` is the number of substeps that have to be repeated, where the inner
     * time levels are recorded or not. */
    void (*begin_response)(void *self, bool twice, const double *dlam);
    void (*advance_response)(void *self, size_t j, const double *lam, const double *dlam);
    pma_status (*add_response)(void *self, const double *dlam);
    size_t (*repeats)(const void *self, bool recorded);

    /* Mean coupling, whose link responses are those above, with or without substeps, under constant
     * multipliers lam from the beginning on (hold_energy: for their work). All substeps from here
     * on are pushed by the constant acceleration of lam (K2). */
    void (*hold_energy)(void *self, bool twice, const double *lam);
    void (*push)(void *self, const double *lam);

    /* Internal forces, iterated or not: v . M v at time level j */
    double (*kinetic)(const void *self, size_t j);
} pma_member_table;

/* What a member does besides that impulses on the interface can strike: one with contacts. */
typedef struct {
    /* Impulses f (nb) at the end of an open substep: predictors, right-hand side and vf with them
     * (U3) (U4); and its closing, as `advance`. */
    void (*strike)(void *self, const pma_substep *step, const double *f);
    pma_status (*close)(void *self, const pma_substep *step, const double *lam);

    /* u and v (nb) := displacement and velocity that lam would give an open substep, or nothing,
     * NULL. */
    void (*approach)(void *self, const pma_substep *step, const double *lam, double *u, double *v);

    /* v (nb) := V f, what such impulses do to the velocity. */
    void (*recoil)(void *self, const double *f, double *v);

    /* Work of impulses, summed up with the energy of time level j, if there is one. */
    void (*add_work)(void *self, size_t j, double work);
} pma_impulse_table;

/* Double steps: none, from the second macro step on, or from the first one on, from a time level
 * before the present. */
typedef enum { PMA_SINGLE, PMA_DOUBLED, PMA_CONTINUED } pma_doubling;

static inline pma_doubling pma_doubling_of(bool doubled, bool continues)
{
    return !doubled ? PMA_SINGLE : continues ? PMA_CONTINUED : PMA_DOUBLED;
}

/* Has it a restoring force, evaluated once for every substep in turn; by which thread? */
typedef enum { PMA_NO_FORCES, PMA_BY_ANY, PMA_BY_CALLER } pma_evaluation;

/* A table, what its operations work on, and what a coupler has to know beforehand. */
typedef struct {
    const pma_member_table *table;
    void *self;
    const pma_link *link;
    size_t substeps; /* in a macro step */
    double h;        /* length of a single substep; of two stages the mean one */
    size_t entries;  /* matrix entries read by one substep, a measure of its duration */
    pma_doubling doubling;
    pma_evaluation forces;
    bool staged;       /* substeps are the two stages of a step in turn (P3) */
    bool divides;      /* several workers can share a substep */
    bool deferred;     /* under mean coupling: the closing of its single steps (K7) */
    bool has_internal; /* forces: macro coupling repeats its macro step (shooting.c) */
    bool elsewhere;    /* is in another process (remote.h): has nothing but `values` */
    const pma_impulse_table *impulse; /* with contacts, else NULL */
    pma_iterated iterated; /* with a table where its steps are iterated: it does not advance */
} pma_member;

/* Is its energy summed up? */
static inline bool pma_member_is_observed(const pma_member *m)
{
    return m->table->energy && m->table->energy(m->self, 0, NULL);
}

/* sum (p) += scale L x, x of this kind */
static inline void pma_member_gather(const pma_member *m, pma_interface_kind kind, size_t j,
                                     double scale, double *sum)
{
    pma_link_gather(m->link, scale, m->table->values(m->self, kind, j, false, NULL), sum);
}

/* sum (p) += scale L vf at time level j + theta, linear between j and j + 1; the substep to j + 1
 * is open                                                                                 (15) */
static inline void pma_member_free_velocity(const pma_member *m, size_t j, double theta,
                                            double scale, double *sum)
{
    pma_member_gather(m, PMA_BEGINNING_VELOCITY, j, scale * (1.0 - theta), sum);
    pma_member_gather(m, PMA_FREE_VELOCITY, j + 1, scale * theta, sum);
}

/* sum (p) += al2 L Mbar^-1 L^T lam, with the operator of the single or the double step (18) */
static inline void pma_member_compliance(const pma_member *m, bool twice, const double *lam,
                                         double *sum)
{
    pma_link_gather(m->link, 1.0, m->table->values(m->self, PMA_LINK_VELOCITY, 0, twice, lam), sum);
}

#endif
