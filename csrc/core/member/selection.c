#include "member/selection.h"

#include <string.h>

bool pma_selection_is_empty(const pma_selection *selection)
{
    return selection->count + selection->springs + selection->history + selection->outputs == 0 &&
           !selection->corrections;
}

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

static void add_outputs(const pma_selection *selection, const pma_state *state, double *y)
{
    add_product(&selection->of_u, selection->outputs, state->u, y);
    add_product(&selection->of_v, selection->outputs, state->v, y);
    add_product(&selection->of_w, selection->outputs, state->w, y);
}

static void write_outputs(const pma_selection *selection, const pma_state *state, size_t row)
{
    if (selection->outputs == 0)
        return;
    double *y = selection->output + row * selection->outputs;
    memset(y, 0, selection->outputs * sizeof(double));
    add_outputs(selection, state, y);
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

static void write_one(const pma_selection *selection, const pma_state *state, size_t row)
{
    double *u = selection->u + row * selection->count;
    double *v = selection->v + row * selection->count;
    double *w = selection->w + row * selection->count;
    for (size_t i = 0; i < selection->count; i++) {
        const int64_t k = selection->position[i];
        u[i] = state->u[k];
        v[i] = state->v[k];
        w[i] = state->w[k];
    }
    write_springs(selection, state, row);
    write_history(selection, state, row);
    write_outputs(selection, state, row);
}

void pma_selection_write(const pma_selection *selection, const pma_state *state, size_t row)
{
    for (; selection; selection = selection->next)
        write_one(selection, state, row);
}

static void add_one(const pma_selection *selection, const pma_state *state, size_t row)
{
    double *u = selection->u + row * selection->count;
    double *v = selection->v + row * selection->count;
    double *w = selection->w + row * selection->count;
    for (size_t i = 0; i < selection->count; i++) {
        const int64_t k = selection->position[i];
        u[i] += state->u[k];
        v[i] += state->v[k];
        w[i] += state->w[k];
    }
    if (selection->outputs > 0)
        add_outputs(selection, state, selection->output + row * selection->outputs);
}

void pma_selection_add(const pma_selection *selection, const pma_state *state, size_t row)
{
    for (; selection; selection = selection->next)
        add_one(selection, state, row);
}

static void accelerate_one(const pma_selection *selection, const double *y, size_t row)
{
    double *w = selection->w + row * selection->count;
    for (size_t i = 0; i < selection->count; i++)
        w[i] += y[selection->position[i]];
    if (selection->outputs > 0)
        add_product(&selection->of_w, selection->outputs, y,
                    selection->output + row * selection->outputs);
}

void pma_selection_accelerate(const pma_selection *selection, const double *y, size_t row)
{
    for (; selection; selection = selection->next)
        accelerate_one(selection, y, row);
}
