#include "fmu/fmu.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "describe/file.h"

/* Masters add up times with rounding: a communication step may differ by this part of a step. */
#define ROUNDING 1e-6
/* Fine steps of a communication step that can be counted. */
#define MOST 1e9

static bool refuse(fmu *f, const char *reason)
{
    snprintf(f->message, sizeof f->message, "%s", reason);
    return false;
}

bool fmu_open(fmu *f, const char *token, const char *resources)
{
    char own[64];
    size_t size = 0;
    const void *bytes = fmu_bytes(resources, &size, &f->owned);
    if (!bytes)
        return refuse(f, "the model is not among the resources of the FMU");
    if (pmalpha_open_memory(bytes, size, f->message, &f->model) != PMALPHA_OK)
        return false;
    snprintf(own, sizeof own, "{%016" PRIx64 "-%zu}", pma_file_sum_of(bytes), size);
    return !token || strcmp(token, own) == 0 ||
           refuse(f, "the description is that of another model");
}

void fmu_close(fmu *f)
{
    pmalpha_close(f->model);
    free(f->owned);
    free(f);
}

/* ---- variables ------------------------------------------------------------------------------ */

bool fmu_get(const fmu *f, uint32_t reference, double *value)
{
    const size_t inputs = pmalpha_inputs(f->model), i = reference / FMU_EACH_INPUT;
    const size_t part = reference % FMU_EACH_INPUT;
    if (i >= inputs) {
        const size_t output = reference - FMU_EACH_INPUT * inputs;
        if (output > pmalpha_outputs(f->model))
            return false;
        *value = output < pmalpha_outputs(f->model) ? pmalpha_get(f->model, output)
                                                    : pmalpha_time(f->model);
        return true;
    }
    double c[3];
    (void)pmalpha_command(f->model, i, c);
    *value = part == 0 ? pmalpha_given(f->model, i) : c[part - 1];
    return true;
}

bool fmu_set(fmu *f, uint32_t reference, double value)
{
    if (reference / FMU_EACH_INPUT >= pmalpha_inputs(f->model) || reference % FMU_EACH_INPUT != 0)
        return refuse(f, "only inputs can be set");
    pmalpha_set(f->model, reference / FMU_EACH_INPUT, value);
    return true;
}

/* ---- steps ---------------------------------------------------------------------------------- */

bool fmu_step(fmu *f, double length)
{
    const double steps = length / pmalpha_step_size(f->model), nearest = nearbyint(steps);
    if (!(nearest >= 1.0 && nearest <= MOST && fabs(steps - nearest) <= ROUNDING * nearest)) {
        snprintf(f->message, sizeof f->message,
                 "a communication step must be a whole number of steps of %.17g, got %.17g",
                 pmalpha_step_size(f->model), length);
        return false;
    }
    return pmalpha_advance(f->model, (size_t)nearest) == PMALPHA_OK ||
           refuse(f, pmalpha_message(f->model));
}

/* ---- states --------------------------------------------------------------------------------- */

typedef struct {
    size_t size;
    uint64_t bytes[];
} state_block;

static state_block *block_of(size_t size)
{
    state_block *block = malloc(sizeof *block + size);
    if (block)
        block->size = size;
    return block;
}

bool fmu_save(fmu *f, void **state)
{
    const size_t size = pmalpha_state_size(f->model);
    state_block *old = *state, *block = old && old->size == size ? old : block_of(size);
    if (!block)
        return refuse(f, "there is no memory for a state");
    if (pmalpha_save(f->model, block->bytes, size) != PMALPHA_OK) {
        if (block != old)
            free(block);
        return refuse(f, "a model that has failed has no state");
    }
    *state = block;
    return true;
}

bool fmu_restore(fmu *f, const void *state)
{
    const state_block *block = state;
    if (!block)
        return refuse(f, "there is no state");
    return pmalpha_restore(f->model, block->bytes, block->size) == PMALPHA_OK ||
           refuse(f, pmalpha_message(f->model));
}

void fmu_free(void **state)
{
    if (!state)
        return;
    free(*state);
    *state = NULL;
}

size_t fmu_state_size(const void *state)
{
    return ((const state_block *)state)->size;
}

bool fmu_serialize(fmu *f, const void *state, void *bytes, size_t size)
{
    const state_block *block = state;
    if (size < block->size)
        return refuse(f, "the state has more bytes");
    memcpy(bytes, block->bytes, block->size);
    return true;
}

bool fmu_deserialize(fmu *f, const void *bytes, size_t size, void **state)
{
    state_block *block = size == pmalpha_state_size(f->model) ? block_of(size) : NULL;
    if (!block)
        return refuse(f, "the bytes are no state of this FMU");
    memcpy(block->bytes, bytes, size);
    free(*state);
    *state = block;
    return true;
}
