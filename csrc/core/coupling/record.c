#include "coupling/record.h"

size_t pma_record_row(const pma_record *record, int64_t macro, size_t j, size_t nodes)
{
    if (record->every == 0)
        return (size_t)(macro - record->begin) * nodes + j;
    if (j != nodes || (macro + 1) % record->every != 0)
        return PMA_NO_ROW;
    return (size_t)((macro + 1) / record->every - record->begin / record->every);
}

static void record_springs(const pma_record_nodes *nodes, const pma_state *state, size_t row)
{
    if (nodes->springs == 0)
        return;
    double *deformation = nodes->deformation + row * nodes->springs;
    double *force = nodes->force + row * nodes->springs;
    for (size_t i = 0; i < nodes->springs; i++) {
        deformation[i] = state->springs[nodes->spring[i]];
        force[i] = state->springs[nodes->of_springs + (size_t)nodes->spring[i]];
    }
}

void pma_record_state(const pma_record_nodes *nodes, const pma_state *state, size_t row)
{
    double *u = nodes->u + row * nodes->count;
    double *v = nodes->v + row * nodes->count;
    double *w = nodes->w + row * nodes->count;
    for (size_t i = 0; i < nodes->count; i++) {
        const int64_t k = nodes->position[i];
        u[i] = state->u[k];
        v[i] = state->v[k];
        w[i] = state->w[k];
    }
    record_springs(nodes, state, row);
}

void pma_record_add(const pma_record_nodes *nodes, const pma_state *state, size_t row)
{
    double *u = nodes->u + row * nodes->count;
    double *v = nodes->v + row * nodes->count;
    double *w = nodes->w + row * nodes->count;
    for (size_t i = 0; i < nodes->count; i++) {
        const int64_t k = nodes->position[i];
        u[i] += state->u[k];
        v[i] += state->v[k];
        w[i] += state->w[k];
    }
}
