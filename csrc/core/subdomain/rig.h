/* rig.h - the rig of a subdomain among whose restoring forces is a specimen: what it commands, what
 * comes back, within which limits, and when. A subdomain without limits and stamp has none. */
#ifndef PMA_RIG_H
#define PMA_RIG_H

#include "subdomain/subdomain.h"

typedef struct pma_rig pma_rig;

void pma_rig_destroy(pma_rig *rig); /* NULL is allowed */

/* Before and after springs and functions are evaluated at the displacement of `to`, the end of the
 * substep: PMA_LIMITED where the command, or the reply, is beyond the limits. */
pma_status pma_rig_command(pma_rig *rig, const pma_substep *step, const pma_state *to);
pma_status pma_rig_reply(pma_rig *rig, const pma_state *to);

/* Is the command u, v (n each) of that substep within the limits, before it is given? Compensators
 * work on it until pma_rig_command_first. */
bool pma_rig_admits(pma_rig *rig, const pma_substep *step, const double *u, const double *v);

/* The same of the initial values, u (n) at t, which no limit of a command concerns. */
void pma_rig_command_first(pma_rig *rig);
pma_status pma_rig_reply_first(pma_rig *rig, double t, const double *u, const double *v);

/* Commands and replies so far are forgotten; the next ones follow the initial values, whose
 * velocity is v (n; NULL: there are none). */
void pma_rig_begin(pma_rig *rig, const double *v);

#endif
