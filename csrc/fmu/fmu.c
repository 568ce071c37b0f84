#include "fmu/fmu.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fields/file.h"

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

size_t fmu_state_size(const fmu *f)
{
    return pmalpha_state_size(f->model);
}

fmu_state *fmu_save(fmu *f, fmu_state *into)
{
    const size_t size = fmu_state_size(f);
    fmu_state *state = into && into->size == size ? into : malloc(sizeof *state + size);
    if (!state)
        return NULL;
    state->size = size;
    if (pmalpha_save(f->model, state->bytes, size) == PMALPHA_OK)
        return state;
    refuse(f, "a model that has failed has no state");
    if (state != into)
        free(state);
    return NULL;
}

bool fmu_restore(fmu *f, const void *bytes, size_t size)
{
    return pmalpha_restore(f->model, bytes, size) == PMALPHA_OK ||
           refuse(f, pmalpha_message(f->model));
}
