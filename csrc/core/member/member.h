/* member.h - a subdomain as the coupler sees it: in interface space, through a table of operations.
 *
 * A coupler knows nothing else of a subdomain, so that whatever fills such a table can take part:
 * the subdomain of subdomain.h, or the naive one of the tests. In what follows `j` is a time level
 * counted from the present (substep.h), `lam` has p numbers, and to `sum` (p) something is added.
 *
 * One thread at a time works with a member. The operations marked (c) may be called by the thread
 * that called pma_coupler_advance while another one is inside `open`, `close` or `record`; `opened`
 * and `is_known` while it is inside `close` or `record`. No operation allocates but `look_ahead`
 * and `prepare_visits`.
 *
 * A member that is `doubled` has rebase; that `responds`: respond, record_response, add_response
 * and repeats; that `divides`: the stages of ranges of rows. is_known comes with look_ahead, energy
 * with is_observed; hold is needed in macro coupling without substeps. */
#ifndef PMA_MEMBER_H
#define PMA_MEMBER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "member/iterated.h"
#include "member/selection.h"
#include "member/substep.h"
#include "status.h"

/* What a member has on the interface. */
typedef enum {
    PMA_FREE_VELOCITY,         /* vf */
    PMA_VELOCITY,              /* v */
    PMA_DISPLACEMENT,          /* u */
    PMA_LINK_VELOCITY,         /* Mbar^-1 L^T lam: al2 times it is what lam adds to v */
    PMA_EXPECTED_DISPLACEMENT, /* u that lam would give an open substep */
    PMA_REBASED_VELOCITY       /* vf at the beginning of the substep, after it has changed (N13) */
} pma_interface_kind;

typedef struct {
    /* ---- what every member must do ------------------------------------------------------ */

    /* The free problem (13) of a substep, as far as the free velocity on the interface. Evaluates
     * loads and forces, once. Fails with PMA_FORCE_FAILED, PMA_RESTORING_FAILED or
     * PMA_INTERNAL_FAILED, PMA_UNSYMMETRIC. */
    pma_status (*open)(void *self, const pma_substep *step);

    /* The link problem (14) of an open substep, added: the state at its end. Fails with
     * PMA_NOT_FINITE when a value of that state is not finite. */
    pma_status (*close)(void *self, const pma_substep *step, const double *lam);

    /* The time level up to which substeps are open or closed; 0 at the present. */
    size_t (*opened)(const void *self);

    /* (c) sum += al2 L Mbar^-1 L^T lam with the operator of the single or the double step: what lam
     * adds to the velocity (14), and for unit multipliers the block of H (F6) */
    void (*compliance)(void *self, bool twice, const double *lam, double *sum);

    /* (c) sum += scale L vf at time level j + theta, linear between j and j + 1 (15); the substep
     * to j + 1 is open */
    void (*free_velocity)(const void *self, size_t j, double theta, double scale, double *sum);

    /* sum += L v, and L u, at time level j, which is closed; L u of a step that waits to be closed
     * is that of its free solution */
    void (*velocity)(const void *self, size_t j, double *sum);
    void (*displacement)(const void *self, size_t j, double *sum);

    /* (c) Is vf finite at time level j? */
    bool (*is_finite)(const void *self, size_t j);

    /* Writes time level j, which is closed, into a row. */
    void (*record)(const void *self, size_t j, const pma_selection *selection, size_t row);

    /* The last time level of the macro step becomes the present. Cannot fail. */
    void (*commit)(void *self);

    /* What is open is given up: the macro step at hand begins again. */
    void (*discard)(void *self);

    /* ---- what a member may do; NULL where it does not ----------------------------------- */

    /* Double steps. The stored free velocity of time level j is changed over to the operator of the
     * double step, once, at the end of the first macro step (S3). */
    void (*rebase)(void *self, size_t j, const double *lam);

    /* Energy. Is it summed up? Then out (PMA_ENERGIES) is that of time level j = 0 or substeps. */
    bool (*is_observed)(const void *self);
    void (*energy)(const void *self, size_t j, double *out);

    /* Look-ahead. Room for the macro step after the one that is not committed yet; allocates.
     * True if the load of a substep can already be evaluated, before its turn. */
    pma_status (*look_ahead)(void *self);
    bool (*is_known)(const void *self, const pma_substep *step);

    /* Visits. Room for them; allocates. `closed`, and in the same visit `opened`, the substep after
     * it, whose load is_known: bitwise what close and open do, and as they fail. The closed time
     * level is kept. */
    pma_status (*prepare_visits)(void *self);
    pma_status (*visit)(void *self, const pma_substep *closed, const pma_substep *opened,
                        const double *lam);

    /* Macro coupling without substeps: vf at time level 1 += the velocity of lam (M6). */
    void (*hold)(void *self, const pma_substep *step, const double *lam);

    /* Macro coupling with substeps. Substep j = 1..substeps of the link response, from rest, to
     * dlam times j / substeps (M3), after a free macro run under lam; the response after the last
     * of them, added to a row; and added to the last time level, stored or just repeated (M5),
     * which fails as close. `repeats` is the number of substeps that have to be repeated, where the
     * inner time levels are recorded or not. */
    void (*begin_response)(void *self, bool twice, const double *dlam);
    void (*respond)(void *self, size_t j, const double *lam, const double *dlam);

    void (*record_response)(const void *self, const pma_selection *selection, size_t row);
    pma_status (*add_response)(void *self, const double *dlam);
    size_t (*repeats)(const void *self, bool recorded);

    /* Mean coupling, whose link responses are those above, with or without substeps, under constant
     * multipliers lam from the beginning on (hold_energy: for their work). The acceleration of lam
     * on the interface, which no state has, is added to a row (K5). */
    void (*hold_energy)(void *self, bool twice, const double *lam);
    void (*record_acceleration)(void *self, const double *lam, const pma_selection *selection,
                                size_t row);

    /* Displacements tied under gc. (c) sum += L u at the end of an open substep that lam would
     * close; and its predictor shifted by Mbar^-1 L^T mu (V1), with the free solution (V2). */
    void (*expect)(void *self, const pma_substep *step, const double *lam, double *sum);
    void (*shift)(void *self, const pma_substep *step, const double *mu);

    /* All substeps from here on are pushed by the constant acceleration of lam (K2). */
    void (*push)(void *self, const double *lam);

    /* Several processes: nb, the number of dofs on the interface, and nb values at time level j,
     * until the next call. */
    size_t (*interface_size)(const void *self);
    const double *(*interface_values)(void *self, pma_interface_kind kind, size_t j, bool twice,
                                      const double *lam);

    /* Internal forces, iterated or not: v . M v at time level j */
    double (*kinetic)(const void *self, size_t j);

    /* A single substep by several threads in ranges of rows: open is evaluate_load, predict,
     * add_forces and open_interface; close is close_interface, correct and observe. One stage is
     * finished in all rows before the next one begins; bitwise identical for any ranges. `correct`
     * returns true when every new value is finite. */
    pma_status (*evaluate_load)(void *self, const pma_substep *step);
    void (*predict)(void *self, const pma_substep *step, size_t begin, size_t end);
    void (*add_forces)(void *self, const pma_substep *step, size_t begin, size_t end);
    void (*open_interface)(void *self, const pma_substep *step);
    void (*close_interface)(void *self, const pma_substep *step, const double *lam);
    bool (*correct)(void *self, const pma_substep *step, size_t begin, size_t end);
    void (*observe)(void *self, const pma_substep *step, const double *lam);

    /* A substep closed, or the next one opened, or both in one visit, by several threads in
     * branches of an elimination tree; what is not done is NULL, and two are both double steps or
     * neither. `divide` among a number of workers allocates. Then begin_visit; `go` by all workers,
     * true when every new value is finite; when all are done end_visit, which fails as close.
     * Bitwise identical for any number of workers. */
    pma_status (*divide)(void *self, size_t workers);
    pma_status (*begin_visit)(void *self, const pma_substep *closed, const pma_substep *opened,
                              const double *lam);
    bool (*go)(const void *self, size_t worker);
    pma_status (*end_visit)(void *self, bool finite);
} pma_member_table;

/* A table, what its operations work on, and what a coupler has to know beforehand. */
typedef struct {
    const pma_member_table *table;
    void *self;
    size_t p, n;     /* constraints; dofs */
    size_t substeps; /* in a macro step */
    double h;        /* length of a single substep */
    size_t entries;  /* matrix entries read by one substep, a measure of its duration */
    bool doubled;    /* takes double steps from the second macro step on: rebase */
    bool continues;  /* takes them from the first one on, from a time level before the present */
    bool evaluates;  /* has a restoring force, evaluated once for every substep in turn */
    bool by_caller;  /* which only the thread that called pma_coupler_advance may evaluate */
    bool responds;   /* has a link response: macro coupling with substeps */
    bool waits;      /* under mean coupling, its single steps are closed, not responded to (K7) */
    bool shifts;     /* can shift its predictor: displacements tied under gc */
    bool shoots;     /* has internal forces: macro coupling repeats its macro step (shooting.c) */
    bool elsewhere;  /* is in another process (remote.h) */
    bool divides;    /* has the stages of ranges of rows */
    bool branches;   /* has the stages of branches of a tree */
    size_t alone;    /* entries of them that one worker has to read while the others wait */
    bool visits;     /* is large enough to gain from being closed and opened in one visit */
    pma_iterated iterated; /* with a table where its steps are iterated: it has no open and close */
} pma_member;

#endif
