#include "observe/selection.h"

#include <string.h>

/* y (rows) += A x */
static void add_product(const pma_combination *A, size_t rows, const double *x, double *y)
{
    if (!A->start)
        return;
    for (size_t row = 0; row < rows; row++) {
        double sum = 0.0;
        for (int64_t k = A->start[row]; k < A->start[row + 1]; k++)
            sum += A->weight[k] * x[A->position[k]];
        y[row] += sum;
    }
}

/* y := A_u u + A_v v + A_a w, or += */
static void take_outputs(const pma_selection *selection, const pma_state *state, bool adds,
                         size_t row)
{
    const size_t outputs = selection->outputs;
    double *y = selection->output + row * outputs;
    if (outputs == 0)
        return;
    if (!adds)
        memset(y, 0, outputs * sizeof(double));
    add_product(&selection->of_u, outputs, state->u, y);
    add_product(&selection->of_v, outputs, state->v, y);
    add_product(&selection->of_w, outputs, state->w, y);
}

/* A row := what the state has at the positions selected. */
static void write_motion(const pma_selection *selection, const pma_state *state, size_t row)
{
    const size_t count = selection->count, at = row * count;
    double *u = selection->u + at, *v = selection->v + at, *w = selection->w + at;
    const pma_state x = *state; /* or it would be read again after each number that is stored */
    const int64_t *position = selection->position;
    for (size_t i = 0; i < count; i++) {
        const int64_t k = position[i];
        u[i] = x.u[k];
        v[i] = x.v[k];
        w[i] = x.w[k];
    }
}

static void add_motion(const pma_selection *selection, const pma_state *state, size_t row)
{
    const size_t at = row * selection->count;
    double *u = selection->u + at, *v = selection->v + at, *w = selection->w + at;
    for (size_t i = 0; i < selection->count; i++) {
        const int64_t k = selection->position[i];
        u[i] += state->u[k];
        v[i] += state->v[k];
        w[i] += state->w[k];
    }
}

static void write_springs(const pma_selection *selection, const pma_state *state, size_t row)
{
    if (selection->springs == 0)
        return;
    double *deformation = selection->deformation + row * selection->springs;
    double *force = selection->force + row * selection->springs;
    for (size_t i = 0; i < selection->springs; i++) {
        deformation[i] = state->springs[selection->spring[i]];
        force[i] = state->springs[selection->of_springs + (size_t)selection->spring[i]];
    }
}

static void write_history(const pma_selection *selection, const pma_state *state, size_t row)
{
    if (selection->history > 0)
        memcpy(selection->q + row * selection->history, state->history,
               selection->history * sizeof(double));
    if (selection->corrections)
        selection->corrections[row] = state->history[selection->of_history];
}

static void write_rig(const pma_selection *selection, const pma_state *state, size_t row)
{
    if (selection->commands == 0)
        return;
    const double *memory = state->springs + selection->rig_begin;
    size_t at = row * selection->commands;
    for (size_t k = 0; k < selection->of_rig->traces; k++) {
        const pma_trace *trace = &selection->of_rig->trace[k];
        const size_t bytes = trace->width * sizeof(double);
        memcpy(selection->command + at, memory + trace->command, bytes);
        memcpy(selection->sent + at, memory + trace->sent, bytes);
        memcpy(selection->measured + at, memory + trace->measured, bytes);
        memcpy(selection->rig_force + at, memory + trace->force, bytes);
        at += trace->width;
    }
}

void pma_selection_write(const pma_selection *selection, const pma_state *state, size_t row)
{
    for (; selection; selection = selection->next) {
        write_motion(selection, state, row);
        take_outputs(selection, state, false, row);
        write_springs(selection, state, row);
        write_history(selection, state, row);
        write_rig(selection, state, row);
    }
}

void pma_selection_add(const pma_selection *selection, const pma_state *state, size_t row)
{
    for (; selection; selection = selection->next) {
        add_motion(selection, state, row);
        take_outputs(selection, state, true, row);
    }
}

void pma_selection_accelerate(const pma_selection *selection, const double *y, size_t row)
{
    for (; selection; selection = selection->next) {
        double *w = selection->w + row * selection->count;
        for (size_t i = 0; i < selection->count; i++)
            w[i] += y[selection->position[i]];
        if (selection->outputs > 0)
            add_product(&selection->of_w, selection->outputs, y,
                        selection->output + row * selection->outputs);
    }
}
