/* iterated_substep.h - the iterate from inside: what iterate.c and iterated_substep.c share. */
#ifndef PMA_ITERATED_SUBSTEP_H
#define PMA_ITERATED_SUBSTEP_H

#include "factor/numeric.h"
#include "subdomain/inside.h"

/* What a substep is iterated with that is iterated alone. */
typedef struct {
    const double *lam;
    bool (*stop)(void *ctx);
    void *ctx;
} pma_iterated_alone;

struct pma_iterate {
    pma_subdomain *of;
    pma_iterate_parts parts;
    pma_numeric numeric;
    size_t count; /* constraints: rows */
    int64_t *rows, *spring_entries;
    size_t *column; /* of each entry of the link, the place of its constraint in rows */

    /* the substep at hand */
    pma_iterated_alone alone;
    pma_substep step;
    size_t corrections;
    bool factored, factored_twice; /* there is a factor, and of which step */
    size_t singular;               /* dof of a pivot that is lost */

    double scale, motion; /* energy of the largest motion so far, or less that of rounding (N9);
                              with the iterate */
    double left;          /* the residual that the last correction began with, with L^T dLam */
    double slope;         /* s(0) of the last correction, and how far from its end the iterate is */
    double moved;         /* ... in parts of it                                          (N10) */
    bool doubtful;        /* at its end the residual is rounding that is not small       (N21) */
    pma_measure measure;  /* of the residual at the iterate, and of the last correction */
    double scale_present; /* the same at the present */
    bool factored_present; /* ... of a factor that is kept */
    bool factored_twice_present;
    bool refactored;             /* the tangent was written since the present */
    bool overwritten;            /* the tangent is not the one that is factored */
    bool tied;                   /* the iterate is one after a correction */
    bool leapt;                  /* the force has jumped within rounding in this substep */
    bool linearized;             /* with a fresh tangent at the iterate where it is */
    bool evaluated, has_tangent; /* R, and the tangent, are those of the iterate where it is */

    double *u_n, *v_n;                  /* state in which the substep begins */
    double *springs_n, *history_n;      /* what springs and functions remember of it */
    double *fixed;                      /* F(t1) and what else is evaluated once */
    double *guess;                      /* first guess of w */
    double *u, *v, *f, *force;          /* iterate, C v + K u + f, f of the functions */
    double *R, *dw;                     /* residual, last correction */
    double *pull, *pull_size;           /* nb: L_b^T Lam that R contains, |L_b^T| |Lam| */
    double *forces, *limit, *rounding;  /* of each row: at the beginning, of the terms of R */
    int64_t *diagonal;                  /* entries of Mbar */
    double *slopes, *scratch, *entries; /* of springs; of functions; kept at the present */
    double *stiffness;                  /* of functions, in the pattern of the tangent */
    double *lam;                        /* 2 p: scratch, the first half zero */
    double *many;                       /* scratch of pma_numeric_compliance */
    double *size, *product;             /* n: scratch */
    void *block;
};

/* What a coupler is given. */
pma_iterated pma_iterated_substep_member(const pma_iterate *it);

/* Numbers that the springs remember of a time level. */
static inline size_t pma_iterate_spring_numbers(const pma_iterate *it)
{
    return pma_springs_numbers(&it->of->parts.springs);
}

#endif
