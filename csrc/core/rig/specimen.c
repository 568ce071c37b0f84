#include "rig/specimen.h"

#include <stdbool.h>
#include <string.h>

#include "rig/linkage.h"

/* ---- what it remembers ---------------------------------------------------------------------- */

/* The number of evaluations, and what the kind needs. */
static size_t numbers_of_filter(const pma_specimen *s, size_t k)
{
    return 1 + s->filters[k].kind->numbers(s->filters[k].of, s->width);
}

static size_t numbers_of_rest(const pma_specimen *s)
{
    return s->linear ? pma_linear_numbers(s->linear) : pma_springs_numbers(&s->springs);
}

/* Where the trace goes on: command, sent, force */
static size_t start_of_trace(const pma_specimen *s)
{
    size_t numbers = s->width + numbers_of_rest(s);
    for (size_t k = 0; k < s->count; k++)
        numbers += numbers_of_filter(s, k);
    return numbers;
}

size_t pma_specimen_numbers(const pma_specimen *s)
{
    return start_of_trace(s) + s->width * (s->h > 0.0 ? 4 : 3);
}

/* Evaluations, of each filter and of a linear system, which has no springs */
size_t pma_specimen_tables(const pma_specimen *s)
{
    return s->count + (s->linear ? 1 : pma_springs_tables(&s->springs));
}

void pma_specimen_counts(const pma_specimen *s, pma_state_counts *out)
{
    size_t at = s->width;
    for (size_t k = 0; k < s->count; at += numbers_of_filter(s, k++))
        *out++ = (pma_state_counts){at, 1, PMA_MOST_COUNTED};
    if (s->linear) {
        *out = (pma_state_counts){at, 1, PMA_MOST_COUNTED};
        return;
    }
    pma_springs_counts(&s->springs, out);
    for (size_t k = 0; k < pma_springs_tables(&s->springs); k++)
        out[k].first += at;
}

pma_trace pma_specimen_trace(const pma_specimen *s)
{
    const size_t command = start_of_trace(s), width = s->width;
    return (pma_trace){
        .width = width, .command = command, .sent = command + width, .force = command + 2 * width};
}

/* ---- the way there -------------------------------------------------------------------------- */

static size_t dof_of(const pma_specimen *s, size_t i)
{
    return s->dofs ? (size_t)s->dofs[i] : i;
}

/* Velocity and acceleration of a command that is `ahead` steps after a, linear in time     (Y18) */
static void extrapolate(const pma_specimen *s, const pma_wanted *wanted, bool is_first,
                        const pma_command *command, double *last)
{
    const double ahead = wanted->ahead;
    for (size_t i = 0; i < s->width; i++) {
        const double a = wanted->a ? wanted->a[dof_of(s, i)] : 0.0, change = a - last[i];
        command->a[i] = is_first ? a : a + ahead * change;
        command->v[i] += is_first ? 0.0 : 0.5 * ahead * ahead * s->h * change;
        last[i] = a;
    }
}

static void take_command(const pma_specimen *s, const pma_wanted *wanted, double *last, double done,
                         const pma_command *command)
{
    for (size_t i = 0; i < s->width; i++) {
        command->u[i] = wanted->u[dof_of(s, i)];
        command->v[i] = wanted->v ? wanted->v[dof_of(s, i)] : 0.0;
        command->a[i] = 0.0;
    }
    if (s->h > 0.0) /* the first acceleration of all is not known when forces are first wanted */
        extrapolate(s, wanted, done < 2.0, command, last);
}

/* True where a linkage before the last compensator makes commands of actuators. */
static bool is_linked(const pma_specimen *s)
{
    for (size_t k = 0; k < s->compensators; k++) {
        if (s->filters[k].kind == &pma_linkage_kind)
            return true;
    }
    return false;
}

/* The displacements of the dofs under a command of actuators: back through the linkages. */
static const double *at_dofs(const pma_specimen *s, const pma_command *command)
{
    double *f = s->work + 3 * s->width, *x = f + s->width;
    memcpy(x, command->u, s->width * sizeof(double));
    memset(f, 0, s->width * sizeof(double));
    for (size_t k = s->compensators; k-- > 0;) {
        const pma_filter *filter = &s->filters[k];
        if (filter->kind == &pma_linkage_kind)
            filter->kind->receive(filter->of, s->width, 0.0, x, f, NULL);
    }
    return x;
}

/* The commands of other dofs are those of the structure. So are velocities with a linkage, where
 * those of the actuators are of other quantities. */
static bool is_allowed(const pma_specimen *s, const pma_command *command)
{
    pma_cell *cell = s->cell;
    if (!cell || !cell->allows)
        return true;
    const bool linked = is_linked(s);
    const double *u = linked ? at_dofs(s, command) : command->u;
    const double *v = linked ? NULL : command->v;
    cell->refused = !cell->allows(cell->self, s->number, s->dofs, s->width, u, v);
    return !cell->refused;
}

/* True unless the cell refuses what compensators make of the command. */
static bool send(const pma_specimen *s, const pma_command *command, double *memory, double *sent)
{
    const size_t bytes = s->width * sizeof(double);
    double *own = memory + s->width;
    memcpy(sent, command->u, bytes);
    for (size_t k = 0; k < s->count; k++) {
        const pma_filter *f = &s->filters[k];
        f->kind->send(f->of, s->width, *own, command, own + 1);
        own += numbers_of_filter(s, k);
        if (k + 1 == s->leading)
            memcpy(sent, command->u, bytes);
        if (k + 1 == s->compensators && !is_allowed(s, command))
            return false;
    }
    return true;
}

/* ---- the specimen, and the way back --------------------------------------------------------- */

/* u becomes what was measured, f the forces. */
static int move(const pma_specimen *s, double t, const pma_command *command, double *f, double *own)
{
    const size_t n = s->width;
    memset(f, 0, n * sizeof(double));
    if (s->linear) {
        pma_linear_evaluate(s->linear, command->u, f, own);
        return 0;
    }
    pma_springs_subtract(&s->springs, command->u, command->v, own, own, f);
    double *r = command->a; /* done with */
    memset(r, 0, n * sizeof(double));
    const int code =
        s->function ? s->function(t, (intptr_t)n, command->u, command->v, r, s->user) : 0;
    for (size_t i = 0; i < n; i++)
        f[i] = r[i] - f[i];
    return code;
}

static void receive(const pma_specimen *s, double *x, double *f, double *end)
{
    double *own = end;
    for (size_t k = s->count; k-- > 0;) {
        const pma_filter *filter = &s->filters[k];
        own -= numbers_of_filter(s, k);
        if (filter->kind->receive)
            filter->kind->receive(filter->of, s->width, *own, x, f, own + 1);
        *own += 1.0;
    }
}

int pma_specimen_evaluate(const pma_specimen *s, double t, const pma_wanted *wanted, double *r,
                          double *memory)
{
    const size_t n = s->width, bytes = n * sizeof(double);
    const pma_command command = {s->work, s->work + n, s->work + 2 * n};
    double *f = s->work + 3 * n, *trace = memory + start_of_trace(s);
    double *own = trace - numbers_of_rest(s); /* springs, or the linear system */
    take_command(s, wanted, trace + 3 * n, s->count > 0 ? memory[n] : 0.0, &command);
    memcpy(trace, command.u, bytes);
    if (!send(s, &command, memory, trace + n))
        return 1;
    const int code = move(s, t, &command, f, own);
    receive(s, command.u, f, own);
    memcpy(memory, command.u, bytes);
    memcpy(trace + 2 * n, f, bytes);
    for (size_t i = 0; i < n; i++)
        r[dof_of(s, i)] += f[i];
    return code;
}
