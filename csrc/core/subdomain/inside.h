/* inside.h - the subdomain from inside: what its files share.
 *
 * subdomain.c is the object and what a coupler calls, substep.c makes a substep, observers.c what
 * watches it, impulse.c one with impulses, response.c what macro coupling adds, rig.c what is
 * around the restoring forces of a specimen. */
#ifndef PMA_SUBDOMAIN_INSIDE_H
#define PMA_SUBDOMAIN_INSIDE_H

#include "subdomain/levels.h"
#include "subdomain/rig.h"
#include "subdomain/scheme.h"
#include "subdomain/subdomain.h"

/* Of a subdomain whose substeps several workers may take together, in ranges of its rows: what they
 * do, and the ends of the substep. */
typedef struct {
    const pma_operator *op;
    const pma_substep *step;
    pma_span at;
    const pma_workers *workers;
} pma_division;

/* Of one under mean coupling. */
typedef struct {
    bool is_pushed;
    double *push;             /* n: acceleration by which substeps are pushed (K2), if is_pushed */
    double *acceleration;     /* n: scratch */
    const pma_operator *open; /* of the open step, if its closing waits (K7), else NULL */
} pma_mean;

/* Of one that contacts reach. */
typedef struct {
    double *J, *force; /* nb each: of the open substep */
    double *sweep;     /* n: scratch, where its forces are swept */
} pma_impulse;

/* Of one with internal forces. */
typedef struct {
    double *force;    /* n, and scratch: where they are explicit */
    double *history;  /* at the next start */
    double potential; /* as evaluated last */
} pma_internal_forces;

/* What restoring functions gave in two macro steps in turn, forces without loads that depend on the
 * motion and such loads (2 n each): in their last substeps, of these numbers. */
typedef struct {
    double *values, *first; /* 2 x 2 n; 2 n: at the next start */
    int64_t number[2];
} pma_evaluated;

/* After its parts is what every substep reads. */
struct pma_subdomain {
    pma_parts parts;

    /* what a subdomain or a run has, or NULL */
    bool is_observed;     /* by one of both or both: */
    pma_energy *energy;   /* that is summed up */
    pma_balance *balance; /* of forces that are watched */
    pma_mean *mean;
    pma_iterate *iterate; /* of steps that are iterated */
    const pma_update *update;
    pma_operator second;    /* of a scheme of two stages: with the factor of the first */
    bool extrapolates;      /* a substep uses the velocity extrapolated from its start (R1) */
    bool evaluates;         /* it has springs, or a force that depends on that velocity (R3) */
    double *closing, *work; /* nb: L^T Lam; scratch of the factor: both of a substep */
    pma_levels levels;
    pma_load load;
    pma_member_table table;

    pma_rig *rig; /* of a specimen with limits, or in a paced run */
    pma_response *response;
    pma_division *division;
    pma_impulse *impulse;
    pma_internal_forces *internal;
    void *spread;                 /* springs in lanes */
    pma_state_counts *counts;     /* of what they and functions remember, and of histories */
    pma_evaluated_forces watched; /* of the substep at hand, where they are */

    double *vs;         /* n: extrapolated velocity, if there is one */
    double *remembered; /* by the restoring function, at the next start */
    pma_evaluated evaluated;
    double *product;          /* n: scratch, if it has internal forces */
    double *link, *link_work; /* as closing and work, of `compliance`, which may be called
                                 meanwhile */
    int code;                 /* what a function that failed returned */
    void *block;
};

/* Its link response. */
struct pma_response {
    const pma_subdomain *of;
    pma_state state;
    pma_unit_responses units;
    double *vs;   /* n: extrapolated velocity, if C is lagged */
    double *pull; /* nb: L_b^T lam */
    double *y;    /* n: mean coupling: M^-1 L_b^T lam */
    bool twice;   /* of a double step */
    double *work; /* scratch of the factor */
};

/* At set-up, where no substep is at hand: of single or of double steps. */
static inline const pma_operator *pma_operator_of(const pma_subdomain *s, bool twice)
{
    return twice ? &s->parts.twice : &s->parts.single;
}

/* What takes this substep. */
static inline const pma_operator *pma_operator_at(const pma_subdomain *s, const pma_substep *step)
{
    if (s->parts.staged && step->j % 2 == 1)
        return &s->second;
    return pma_operator_of(s, step->twice);
}

/* Where the values of the substep with this number are kept; -1: the start. */
static inline size_t pma_evaluated_slot(const pma_subdomain *s, int64_t number)
{
    const int64_t substeps = (int64_t)s->parts.substeps;
    return (size_t)((number + substeps) / substeps) & 1;
}

/* The interface dofs are the last of a vector over all dofs. */
static inline double *pma_interface_of(const pma_subdomain *s, double *x)
{
    return x + (s->parts.n - s->parts.nb);
}

/* Doubles of scratch for each of its factors. */
static inline size_t pma_parts_scratch(const pma_parts *p)
{
    const size_t single = pma_factor_scratch(&p->single.factor);
    const size_t twice = p->doubled ? pma_factor_scratch(&p->twice.factor) : 0;
    const size_t mass = p->mean ? pma_factor_scratch(&p->mass) : 0;
    const size_t most = single > twice ? single : twice;
    return most > mass ? most : mass;
}

/* ---- a substep: substep.c ------------------------------------------------------------------- */

/* Two operations of a member (member.h), which are called in every fine step. */
pma_status pma_substep_advance(void *self, const pma_substep *closed, const pma_substep *opened,
                               const double *lam, const pma_workers *workers);
const double *pma_substep_values(void *self, pma_interface_kind kind, size_t j, bool twice,
                                 const double *lam);

/* Finds whether several workers can share its substeps, bitwise. Allocates: PMA_NO_MEMORY. */
pma_status pma_substep_divide(pma_subdomain *s);

/* link (nb) := S^-1 L_b^T lam, in s->link */
void pma_substep_solve_link(pma_subdomain *s, const pma_operator *op, const double *lam);

/* vf (nb) := v_b - al2 S^-1 L_b^T lam: the free velocity that, with lam, gives this velocity */
void pma_substep_store_free_velocity(pma_subdomain *s, const pma_operator *op, const double *v_b,
                                     const double *lam, double *vf);

/* Its stages. */
pma_status pma_substep_load(pma_subdomain *s, const pma_substep *step);
/* y -= r(t1, ut, vs); what the function remembers goes on from the level before, double step or
 * not, since it is evaluated at one level after the other */
pma_status pma_substep_subtract_restoring(pma_subdomain *s, const pma_substep *step,
                                          const pma_state *to, double *y);

/* Of restoring functions, as evaluated last: forces (n) without loads that depend on the motion,
 * and such loads (n). */
void pma_substep_take_functions(const pma_subdomain *s, double *out);
void pma_substep_load_interface(pma_subdomain *s, const double *lam);
bool pma_substep_sweep_back(const pma_subdomain *s, const pma_operator *op, const pma_state *x);

/* r (n) += springs and restoring forces, as evaluated last, without loads that depend on motion */
void pma_substep_add_evaluated(const pma_subdomain *s, const pma_state *x, double *r);

/* total (n) := those of them that are evaluated once, with such loads, of an iterated substep */
void pma_substep_take_total(const pma_subdomain *s, const pma_state *x, double *total);

/* y (n) := M^-1 L_b^T lam: mean coupling alone; pull (nb), work: scratch                  (K1) */
void pma_parts_accelerate(const pma_parts *p, const double *lam, double *pull, double *work,
                          double *y);
static inline void pma_substep_accelerate(pma_subdomain *s, const double *lam, double *y)
{
    pma_parts_accelerate(&s->parts, lam, s->closing, s->work, y);
}

/* Under mean coupling  ut += h^2/2 y, vt += h y, and the velocity vs that is extrapolated, unless
 * NULL                                                                                    (K2) */
void pma_substep_push(size_t n, double h, const double *y, const pma_state *to, double *vs);

/* vs (n) := v + h w                                                                        (R1) */
void pma_substep_extrapolate(double h, size_t n, const pma_state *from, double *vs);

/* ---- observers: observers.c -------------------------------------------------------------------
 *
 * What is shown to the energy that is summed up and to the watch of forces, if the subdomain
 * is_observed: a substep before it is opened, PMA_UNBOUNDED where that makes no sense any more;
 * forces before they are subtracted from to->w, and after that; a substep that is closed, which
 * fails only where a function of the user evaluates a potential; a substep of the link response;
 * the last time level of a macro step, which is the present now. */
pma_status pma_observers_open(const pma_subdomain *s);
void pma_observers_evaluate(pma_subdomain *s, const pma_substep *step, const pma_state *to);
void pma_observers_evaluated(const pma_subdomain *s, const pma_state *to);
pma_status pma_observers_close(pma_subdomain *s, const pma_substep *step, const double *lam);
void pma_observers_respond(const pma_subdomain *s, size_t j, const double *lam, const double *dlam);
void pma_observers_commit(pma_subdomain *s);

/* ---- impulses: impulse.c --------------------------------------------------------------------- */

extern const pma_impulse_table pma_impulse_operations;

pma_status pma_impulse_create(const pma_parts *parts, pma_impulse **out);

/* ---- link response: response.c -------------------------------------------------------------- */

pma_status pma_response_create(pma_subdomain *s, pma_response **out);
void pma_response_destroy(pma_response *r); /* NULL is allowed */

#endif
