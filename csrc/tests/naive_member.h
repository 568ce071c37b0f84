/* naive_member.h - a subdomain as a member of a coupler: a second implementation of member.h.
 *
 * It keeps all time levels of the run and solves dense systems, all by the naive steps; of the core
 * it has nothing but the table. No energy, no workers, and look-ahead only where it is
 * wanted, so that operations that may be left out are left out. */
#ifndef PMA_TEST_NAIVE_MEMBER_H
#define PMA_TEST_NAIVE_MEMBER_H

#include <stdbool.h>
#include <stddef.h>

#include "subdomain/member.h"
#include "subdomains.h"

enum { AHEAD = 2 }; /* time levels that may be open beyond the last macro step */

typedef struct {
    const subdomain *of;
    bool looks_ahead;
    size_t present; /* which of the levels */
    size_t opened;
    level levels[LEVELS + AHEAD]; /* since the start */
    level response;               /* after the last substep of the link response */
    double added[MOST];           /* of multipliers, to the velocity */
    pma_link link;
    pma_member_table table;
} naive_member;

/* At t = 0, with all that is known there. */
void naive_member_start(naive_member *s, const level *first);

/* s->of and s->looks_ahead are set. */
pma_member naive_member_of(naive_member *s);

#endif
