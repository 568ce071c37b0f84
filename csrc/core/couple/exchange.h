/* exchange.h - one coupler in several processes: what they exchange, and when.
 *
 * Every process has all subdomains in the same order, its own and the `remote` ones (remote.h), the
 * interface matrix and the multipliers. They meet in rounds, in a sequence that follows from the
 * problem alone. Each round carries a status: a process in which something failed takes part in the
 * next round, whichever it is, and all end the macro step there. The core knows no MPI; whoever
 * makes the coupler brings the function that gathers. */
#ifndef PMA_EXCHANGE_H
#define PMA_EXCHANGE_H

#include <stdbool.h>
#include <stddef.h>

#include "status.h"
#include "subdomain/member.h"

/* Arrays of the caller, which have to outlive the coupler. */
typedef struct {
    size_t ranks, rank;
    const int64_t *first; /* ranks + 1: rank r has the members first[r]..first[r + 1] - 1 */
    double *all;          /* `pma_exchange_size` numbers of all ranks */
    int *counts, *starts; /* ranks: the numbers of rank r in `all`: how many, and the first */

    /* Those of this rank are set; sets the others. False when that is impossible. */
    bool (*gather)(void *ctx, double *all, const int *counts, const int *starts);
    void *ctx;
} pma_exchange_parts;

/* The numbers of the largest round. */
size_t pma_exchange_size(size_t ranks, size_t count, const pma_member *members);

/* Values of a member that are sent in a round: at most three. */
typedef struct {
    pma_interface_kind kind;
    size_t j;
} pma_piece;

/* At most; and the numbers of a measure (newton.h). */
enum { PMA_MOST_PIECES = 3, PMA_MEASURES = 8 };

#endif
