/* numeric.h - a factor that is made again and again, from the numbers of one pattern.
 *
 * The symbolic analysis is made once, before; the numeric one neither allocates nor calls Python.
 * Mbar with a tangent and the interface matrix that follows from it are factored like this: in
 * panels, or as a band where it is narrow. */
#ifndef PMA_NUMERIC_H
#define PMA_NUMERIC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/factor.h"
#include "algebra/link.h"
#include "algebra/panels.h"
#include "factor/elimination.h"
#include "status.h"

/* Bare arrays of the caller, which have to outlive what is made of them. */
typedef struct {
    size_t n, nb;
    bool unsymmetric;     /* the values are not symmetric; the pattern always is */
    const int64_t *ptr;   /* n+1: the pattern by rows, in elimination order, symmetric, with the */
    const int32_t *index; /* ptr[n]: diagonal; ascending in each row */
    pma_panels panels;    /* the structure of the factor; of no panels where the pattern is the
                             diagonal. Its values are not read */
    const int64_t *owner; /* n: the supernode of each column */
    pma_blas blas;
    pma_crew crew; /* which makes it in panels; bitwise the same for any number of workers */
} pma_numeric_parts;

typedef struct {
    pma_numeric_parts parts;
    double *values;    /* ptr[n]: to be written before `pma_numeric_factor` */
    pma_factor factor; /* the last one; before the first, of the unit matrix */
    double *factored;  /* ptr[n]: the values it is made of, if there is one */
    bool is_factored;
    size_t made; /* how many factors were made */
    double *inverse, *numbers;
    double *limits;               /* of a band: of its pivots, and of what may be subtracted */
    pma_elimination *elimination; /* in panels, else NULL */
    void *block;
} pma_numeric;

/* Checks the parts and allocates, all values zero. PMA_BAD_INDEX for a pattern without its diagonal
 * or not ascending; *out is then empty. */
pma_status pma_numeric_create(const pma_numeric_parts *parts, pma_numeric *out);
void pma_numeric_destroy(pma_numeric *f); /* an empty one is allowed */

/* The factor of the values, which is kept where they are those of the last one: tangents of elastic
 * steps are equal to the bit. Pivots have any sign; PMA_NOT_DEFINITE with the column of one that is
 * lost to rounding (F11); there is no factor then. */
pma_status pma_numeric_factor(pma_numeric *f, size_t *column);

/* The entry (row, column) in the values, or SIZE_MAX. */
size_t pma_numeric_entry(const pma_numeric_parts *parts, size_t row, size_t column);

/* y (n) += A x with the values. */
void pma_numeric_multiply(const pma_numeric *f, const double *x, double *y);

/* ---- the compliance of an interface, all constraints at once                             (F6)
 *
 * G = L_b S^-1 L_b^T = Y^T D_b^-1 X with X = R_bb^-1 L_b^T and Y = Q_bb^-1 L_b^T. One sweep for
 * each constraint reads the factor of the interface as often as there are constraints; here BLAS
 * takes many together. */

/* From this number of constraints on BLAS is faster than sweeps. */
enum { PMA_NUMERIC_MANY = 16 };

/* Doubles of scratch that the function below needs for this number of constraints; 0 where sweeps
 * are faster, or the factor has no panels. */
size_t pma_numeric_compliance_scratch(const pma_numeric *f, size_t count);

/* G (count x count) := scale L_b S^-1 L_b^T between constraints, of a factor with panels. column
 * has for each entry of the link which of the constraints it belongs to. */
void pma_numeric_compliance(const pma_numeric *f, const pma_link *L, const size_t *column,
                            size_t count, double scale, double *G, double *scratch);

#endif
