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
    f->slope = calloc(pmalpha_inputs(f->model) + 1, sizeof *f->slope);
    if (!f->slope)
        return refuse(f, "there is no memory for the inputs");
    snprintf(own, sizeof own, "{%016" PRIx64 "-%zu}", pma_file_sum_of(bytes), size);
    return !token || strcmp(token, own) == 0 ||
           refuse(f, "the description is that of another model");
}

void fmu_close(fmu *f)
{
    pmalpha_close(f->model);
    free(f->owned);
    free(f->slope);
    free(f);
}

/* What a function of the library has returned, with its message. */
static bool taken(fmu *f, pmalpha_status status)
{
    return status == PMALPHA_OK || refuse(f, pmalpha_message(f->model));
}

/* ---- stages --------------------------------------------------------------------------------- */

static bool is_present(const fmu *f, double t)
{
    return fabs(t - pmalpha_time(f->model)) <= 0.5 * pmalpha_step_size(f->model);
}

bool fmu_check_start(fmu *f, double start)
{
    if (f->stage != FMU_MADE)
        return refuse(f, "the start time can only be set before the initialization");
    if (is_present(f, start))
        return true;
    snprintf(f->message, sizeof f->message,
             "the start time must be %.17g, at which the model was frozen, got %.17g",
             pmalpha_time(f->model), start);
    return false;
}

bool fmu_enter(fmu *f)
{
    if (f->stage != FMU_MADE)
        return refuse(f, "the initialization can only be entered after instantiation or reset");
    f->stage = FMU_BEGINS;
    return true;
}

/* Inputs that were set are in the initial accelerations, unless a run has made the present. */
static bool start_anew(fmu *f)
{
    const bool begins = f->starts_anew && pmalpha_count(f->model) == 0;
    f->starts_anew = begins && !taken(f, pmalpha_begin(f->model));
    return !f->starts_anew;
}

bool fmu_exit(fmu *f)
{
    if (f->stage != FMU_BEGINS)
        return refuse(f, "the initialization has not been entered");
    if (!start_anew(f))
        return false;
    f->stage = FMU_STEPS;
    return true;
}

bool fmu_terminate(fmu *f)
{
    if (f->stage != FMU_STEPS)
        return refuse(f, "only what has been initialized can be terminated");
    f->stage = FMU_ENDED;
    return true;
}

void fmu_reset(fmu *f)
{
    pmalpha_reset(f->model);
    memset(f->slope, 0, pmalpha_inputs(f->model) * sizeof *f->slope);
    f->stage = FMU_MADE;
    f->starts_anew = false;
}

/* ---- variables ------------------------------------------------------------------------------ */

/* The number of an input, or -1. */
static int input_of(const fmu *f, uint32_t reference)
{
    const bool is_input =
        reference / FMU_EACH_INPUT < pmalpha_inputs(f->model) && reference % FMU_EACH_INPUT == 0;
    return is_input ? (int)(reference / FMU_EACH_INPUT) : -1;
}

bool fmu_get(fmu *f, uint32_t reference, double *value)
{
    const size_t inputs = pmalpha_inputs(f->model), i = reference / FMU_EACH_INPUT;
    const size_t part = reference % FMU_EACH_INPUT;
    if (f->stage == FMU_BEGINS && !start_anew(f))
        return false;
    if (i >= inputs) {
        const size_t output = reference - FMU_EACH_INPUT * inputs;
        if (output > pmalpha_outputs(f->model))
            return refuse(f, "there is no such variable");
        *value = output < pmalpha_outputs(f->model) ? pmalpha_get(f->model, (int)output)
                                                    : pmalpha_time(f->model);
        return true;
    }
    double c[3];
    (void)pmalpha_command(f->model, (int)i, c);
    *value = part == 0 ? pmalpha_given(f->model, (int)i) : c[part - 1];
    return true;
}

bool fmu_set(fmu *f, uint32_t reference, double value)
{
    const int i = input_of(f, reference);
    if (i < 0)
        return refuse(f, "only inputs can be set");
    if (f->stage == FMU_ENDED)
        return refuse(f, "what has been terminated cannot be set");
    const double before = pmalpha_given(f->model, i);
    if (!taken(f, pmalpha_set(f->model, i, value)))
        return false;
    f->slope[i] = 0.0;
    f->starts_anew |= f->stage != FMU_STEPS && value != before;
    return true;
}

bool fmu_set_slope(fmu *f, uint32_t reference, int order, double slope)
{
    const int i = input_of(f, reference);
    if (i < 0)
        return refuse(f, "only inputs have derivatives that can be set");
    if (order != 1 || !isfinite(slope))
        return refuse(f, "a derivative of an input must be finite and of order 1");
    if (f->stage != FMU_STEPS)
        return refuse(f, "derivatives of inputs can only be set between steps");
    f->slope[i] = slope;
    return true;
}

/* ---- steps ---------------------------------------------------------------------------------- */

/* Whether an input changes in the communication step. */
static bool has_slopes(const fmu *f)
{
    for (size_t i = 0; i < pmalpha_inputs(f->model); i++) {
        if (f->slope[i] != 0.0)
            return true;
    }
    return false;
}

/* Inputs with a slope: their values `steps` fine steps after the beginning, at which they act if
 * `leads`. */
static bool set_inputs(fmu *f, const double *begin, size_t steps, bool leads)
{
    const double h = pmalpha_step_size(f->model);
    bool well = true;
    for (int i = 0; i < (int)pmalpha_inputs(f->model); i++) {
        const double after = (double)steps + (leads ? pmalpha_lead(f->model, i) : 0);
        if (f->slope[i] != 0.0)
            well &= taken(f, pmalpha_set(f->model, i, begin[i] + f->slope[i] * after * h));
    }
    return well;
}

static bool step_with_slopes(fmu *f, size_t steps)
{
    const size_t inputs = pmalpha_inputs(f->model);
    double *begin = calloc(inputs, sizeof *begin);
    bool well = begin != NULL || refuse(f, "there is no memory for the inputs");
    for (size_t i = 0; well && i < inputs; i++)
        begin[i] = pmalpha_given(f->model, (int)i);
    for (size_t k = 0; well && k < steps; k++)
        well = set_inputs(f, begin, k, true) && taken(f, pmalpha_advance(f->model, 1));
    if (well)
        well = set_inputs(f, begin, steps, false);
    memset(f->slope, 0, inputs * sizeof *f->slope);
    free(begin);
    return well;
}

bool fmu_step(fmu *f, double point, double length)
{
    const double steps = length / pmalpha_step_size(f->model), nearest = nearbyint(steps);
    if (f->stage != FMU_STEPS)
        return refuse(f, "a step needs an FMU that has been initialized and not terminated");
    if (!is_present(f, point)) {
        snprintf(f->message, sizeof f->message,
                 "a step must begin at the time of the model, %.17g, got %.17g",
                 pmalpha_time(f->model), point);
        return false;
    }
    if (!(nearest >= 1.0 && nearest <= MOST && fabs(steps - nearest) <= ROUNDING * nearest)) {
        snprintf(f->message, sizeof f->message,
                 "a communication step must be a whole number of steps of %.17g, got %.17g",
                 pmalpha_step_size(f->model), length);
        return false;
    }
    return has_slopes(f) ? step_with_slopes(f, (size_t)nearest)
                         : taken(f, pmalpha_advance(f->model, (size_t)nearest));
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

/* In front of the state of the model: the stage, whether inputs were set for the start, slopes. */
enum { STAGE, ANEW, SLOPES };

static size_t head_of(const fmu *f)
{
    return (SLOPES + pmalpha_inputs(f->model)) * sizeof(uint64_t);
}

static size_t size_of(const fmu *f)
{
    return head_of(f) + pmalpha_state_size(f->model);
}

bool fmu_save(fmu *f, void **state)
{
    const size_t size = size_of(f), head = head_of(f);
    state_block *old = *state, *block = old && old->size == size ? old : block_of(size);
    if (!block)
        return refuse(f, "there is no memory for a state");
    if (pmalpha_save(f->model, block->bytes + head / sizeof(uint64_t), size - head) != PMALPHA_OK) {
        if (block != old)
            free(block);
        return refuse(f, pmalpha_message(f->model));
    }
    block->bytes[STAGE] = f->stage;
    block->bytes[ANEW] = f->starts_anew;
    memcpy(block->bytes + SLOPES, f->slope, head - SLOPES * sizeof(uint64_t));
    *state = block;
    return true;
}

bool fmu_restore(fmu *f, const void *state)
{
    const state_block *block = state;
    const size_t head = head_of(f);
    if (!block)
        return refuse(f, "there is no state");
    if (block->size != size_of(f) || block->bytes[STAGE] >= FMU_STAGES)
        return refuse(f, "the state is of another model");
    if (!taken(f, pmalpha_restore(f->model, block->bytes + head / sizeof(uint64_t),
                                  block->size - head)))
        return false;
    f->stage = (fmu_stage)block->bytes[STAGE];
    f->starts_anew = block->bytes[ANEW] != 0;
    memcpy(f->slope, block->bytes + SLOPES, head - SLOPES * sizeof(uint64_t));
    return true;
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
    state_block *block = size == size_of(f) ? block_of(size) : NULL;
    if (!block)
        return refuse(f, "the bytes are no state of this FMU");
    memcpy(block->bytes, bytes, size);
    free(*state);
    *state = block;
    return true;
}
