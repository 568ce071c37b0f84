/* contact.h - unilateral contact and dry friction between subdomains.                 (U1) to (U12)
 *
 * Rows are conditions on velocities in which impulses act when the gap is closed at the end of a
 * fine step; all subdomains that they reach have a time level there. */
#ifndef PMA_CONTACT_H
#define PMA_CONTACT_H

#include <stddef.h>
#include <stdint.h>

#include "algebra/link.h"
#include "factor/elimination.h"
#include "forces/load.h"
#include "status.h"

/* What one member has of the rows. */
typedef struct {
    size_t member;
    pma_link N; /* rows x nb, by columns: nb of the member, which has impulses on its interface */
} pma_contact_side;

/* Arrays of the caller, which have to outlive the coupler. */
typedef struct {
    size_t contacts;
    const int64_t *first; /* contacts+1: their rows; a normal one, then none, one or two tangents */
    const double *gap, *restitution, *friction; /* contacts */
    const double *friction_static; /* contacts, at least the friction: of a row that has stuck */
    size_t sides;
    const pma_contact_side *side; /* copied */
    pma_load obstacle; /* 2 contacts: d and d' of what moves against them, by fine steps; or none */
    pma_blas blas;
} pma_contact_parts;

typedef struct pma_contact pma_contact;

/* PMA_BAD_SIZE and PMA_BAD_INDEX unless rows and sides fit `count` members. */
pma_status pma_contact_check(const pma_contact_parts *parts, size_t count);

#endif
