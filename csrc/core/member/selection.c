#include "member/selection.h"

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

void pma_selection_write(const pma_selection *selection, const pma_state *state, size_t row)
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
}

void pma_selection_add(const pma_selection *selection, const pma_state *state, size_t row)
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
}
