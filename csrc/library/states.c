/* states.c - what the next steps of a model depend on, in a block of numbers.
 *
 * That is the present of the last macro step, and the inputs of the fine steps since: restoring
 * takes these once more, so that nothing of what is open has to be described. */
#include <math.h>
#include <string.h>

#include "library/model.h"
#include "text.h"

/* In front: check sum of the file, fine steps since the present, macro steps; at the end the check
 * sum of all. */
enum { SUM, FINE, STEP, HEAD, TAIL = 1 };

/* ---- what is of the present ----------------------------------------------------------------- */

static double *append(double *to, const double *x, size_t count)
{
    if (count > 0)
        memcpy(to, x, count * sizeof *x);
    return to + count;
}

static size_t numbers_of(const pma_state_array *arrays, size_t count)
{
    size_t total = 0;
    for (size_t i = 0; i < count; i++)
        total += arrays[i].count;
    return total;
}

static double *save_arrays(const pma_state_array *arrays, size_t count, double *to)
{
    for (size_t i = 0; i < count; i++)
        to = append(to, arrays[i].values, arrays[i].count);
    return to;
}

static const double *restore_arrays(const pma_state_array *arrays, size_t count, const double *from)
{
    for (size_t i = 0; i < count; from += arrays[i++].count)
        append(arrays[i].values, from, arrays[i].count);
    return from;
}

/* Of an iteration: scale, whether there are entries and whether of the double step, the entries. */
enum { KEPT = 3 };

static size_t size_of_member(const pmalpha_member *x)
{
    pma_state_array arrays[PMA_LEVEL_ARRAYS];
    const pma_iterate *it = pma_subdomain_iterate(x->core);
    return numbers_of(arrays, pma_subdomain_kept(x->core, arrays)) +
           (it ? KEPT + pma_iterate_entries(it) : 0);
}

static double *save_member(const pmalpha_member *x, double *to)
{
    pma_state_array arrays[PMA_LEVEL_ARRAYS];
    to = save_arrays(arrays, pma_subdomain_kept(x->core, arrays), to);
    const pma_iterate *it = pma_subdomain_iterate(x->core);
    if (!it)
        return to;
    const pma_kept_iteration kept = pma_iterate_kept(it);
    const size_t entries = pma_iterate_entries(it);
    to[0] = kept.scale;
    to[1] = kept.entries != NULL;
    to[2] = kept.twice;
    append(to + KEPT, kept.entries, kept.entries ? entries : 0);
    return to + KEPT + entries;
}

static const double *restore_member(const pmalpha_member *x, const double *from, pma_status *status)
{
    pma_state_array arrays[PMA_LEVEL_ARRAYS];
    from = restore_arrays(arrays, pma_subdomain_arrays(x->core, arrays), from);
    pma_subdomain_watch_again(x->core);
    pma_iterate *it = pma_subdomain_iterate(x->core);
    if (!it)
        return from;
    const pma_kept_iteration kept = {
        .scale = from[0], .entries = from[1] != 0.0 ? from + KEPT : NULL, .twice = from[2] != 0.0};
    const pma_status restored = pma_iterate_restore(it, kept);
    *status = *status == PMA_OK ? restored : *status;
    return from + KEPT + pma_iterate_entries(it);
}

/* ---- a block -------------------------------------------------------------------------------- */

static size_t log_size(const pmalpha_model *m)
{
    return (pma_coupler_instants(m->core) + 1) * m->inputs;
}

static size_t size_of(const pmalpha_model *m)
{
    pma_state_array arrays[PMA_COUPLER_ARRAYS];
    size_t total = HEAD + TAIL + log_size(m);
    total += numbers_of(arrays, pma_coupler_arrays(m->core, arrays));
    for (size_t i = 0; i < m->members; i++)
        total += size_of_member(&m->member[i]);
    return total;
}

static void put(double *at, uint64_t number)
{
    memcpy(at, &number, sizeof number);
}

static uint64_t number_at(const double *at)
{
    uint64_t number;
    memcpy(&number, at, sizeof number);
    return number;
}

/* All but the check sum of all. */
static void copy_state(const pmalpha_model *m, double *block, size_t total)
{
    pma_state_array arrays[PMA_COUPLER_ARRAYS];
    const size_t done = pma_coupler_fine_done(m->core);
    double *to = block + HEAD;
    memset(block, 0, total * sizeof *block);
    put(block + SUM, pma_file_sum_of(m->bytes));
    put(block + FINE, done);
    put(block + STEP, (uint64_t)pma_coupler_step_count(m->core));
    for (size_t i = 0; i < m->members; i++)
        to = save_member(&m->member[i], to);
    to = save_arrays(arrays, pma_coupler_arrays(m->core, arrays), to);
    for (size_t i = 0; i < m->inputs; i++)
        *to++ = m->input[i].value;
    append(to, m->log, done * m->inputs);
}

static void save(const pmalpha_model *m, double *block, size_t total)
{
    copy_state(m, block, total);
    put(block + total - TAIL, pma_file_sum(block, (total - TAIL) * sizeof *block));
}

/* ---- what a block is checked for, before anything changes ------------------------------------ */

static bool are_counts(const pma_state_array *arrays, size_t count, const double **from)
{
    double most;
    for (size_t i = 0; i < count; *from += arrays[i++].count) {
        if (pma_state_wrong_count(&arrays[i], *from, &most))
            return false;
    }
    return true;
}

static bool is_flag(double x)
{
    return x == 0.0 || x == 1.0;
}

static bool is_of_member(const pmalpha_member *x, const double **from)
{
    pma_state_array arrays[PMA_LEVEL_ARRAYS];
    const pma_iterate *it = pma_subdomain_iterate(x->core);
    if (!are_counts(arrays, pma_subdomain_kept(x->core, arrays), from))
        return false;
    const double *kept = *from;
    if (it)
        *from += KEPT + pma_iterate_entries(it);
    return !it || (is_flag(kept[1]) && is_flag(kept[2]));
}

/* A macro step that the coupler can count from. */
static bool is_step(const pmalpha_model *m, int64_t step)
{
    return step >= m->origin && step < pma_coupler_most_steps(m->core);
}

/* Is everything that is counted with a count, and within its range? */
static bool is_whole(pmalpha_model *m, const double *block)
{
    const double *from = block + HEAD;
    pma_state_array arrays[PMA_COUPLER_ARRAYS];
    if (number_at(block + FINE) >= pma_coupler_instants(m->core) ||
        !is_step(m, (int64_t)number_at(block + STEP)))
        return false;
    for (size_t i = 0; i < m->members; i++) {
        if (!is_of_member(&m->member[i], &from))
            return false;
    }
    return are_counts(arrays, pma_coupler_arrays(m->core, arrays), &from);
}

/* ---- restoring ------------------------------------------------------------------------------ */

static void set_all(pmalpha_model *m, const double *values)
{
    for (size_t i = 0; i < m->inputs; i++)
        pmalpha_put(&m->input[i], values[i]);
}

/* The fine steps of the log once more; attached functions have returned what is in it. */
static pmalpha_status repeat(pmalpha_model *m, const double *log, size_t steps)
{
    pmalpha_status status = pmalpha_show(m);
    m->replays = true;
    for (size_t k = 0; k < steps && status == PMALPHA_OK; k++) {
        set_all(m, log + k * m->inputs);
        status = pmalpha_step(m);
    }
    m->replays = false;
    return status;
}

pmalpha_status pmalpha_return(pmalpha_model *m, const double *block)
{
    const size_t p = pma_coupler_get_parts(m->core)->p;
    const double *from = block + HEAD;
    pma_state_array arrays[PMA_COUPLER_ARRAYS];
    pma_status status = PMA_OK;
    m->state = PMALPHA_OK;
    for (size_t i = 0; i < m->members; i++)
        from = restore_member(&m->member[i], from, &status);
    pma_coupler_set_origin(m->core, m->origin, m->t0);
    pma_coupler_discard(m->core);
    pma_coupler_start(m->core, (int64_t)number_at(block + STEP), from, from + p);
    from = restore_arrays(arrays, pma_coupler_arrays(m->core, arrays), from);
    if (status != PMA_OK) {
        pmalpha_say(m, PMALPHA_FAILED, "a kept tangent is singular");
        return pmalpha_end(m, PMALPHA_FAILED);
    }
    set_all(m, from);
    const pmalpha_status repeated = repeat(m, from + m->inputs, number_at(block + FINE));
    set_all(m, from);
    return repeated;
}

size_t pmalpha_state_size(const pmalpha_model *m)
{
    return size_of(m) * sizeof(double);
}

/* A block of this size cannot have a state of `bytes`. */
static pmalpha_status check_block(pmalpha_model *m, const void *block, size_t size, size_t bytes)
{
    if (!block || (uintptr_t)block % sizeof(double) != 0)
        return pmalpha_say(m, PMALPHA_BAD_ARGUMENT, "a state must be at a multiple of 8");
    return size < bytes
               ? pmalpha_say(m, PMALPHA_BAD_ARGUMENT, "a state of this model has more bytes")
               : pmalpha_well(m);
}

pmalpha_status pmalpha_save(pmalpha_model *m, void *block, size_t size)
{
    const size_t total = size_of(m);
    const pmalpha_status status = check_block(m, block, size, total * sizeof(double));
    if (status != PMALPHA_OK)
        return status;
    if (m->state == PMALPHA_FAILED)
        return pmalpha_say(m, PMALPHA_BAD_ARGUMENT, "a model that has failed has no state");
    save(m, block, total);
    return PMALPHA_OK;
}

/* A tangent that is singular, or fine steps that fail, show when the state is taken: then the model
 * goes back to where it was. */
static pmalpha_status go_to(pmalpha_model *m, const double *block)
{
    char message[PMALPHA_MESSAGE], ended[PMALPHA_MESSAGE];
    const pmalpha_status state = m->state;
    memcpy(ended, m->ended, sizeof ended);
    copy_state(m, m->before, size_of(m));
    const pmalpha_status status = pmalpha_return(m, block);
    if (status != PMALPHA_FAILED)
        return status;
    memcpy(message, m->message, sizeof message);
    if (state != PMALPHA_FAILED) /* else there is nothing to go back to */
        pmalpha_return(m, m->before);
    m->state = state;
    memcpy(m->ended, ended, sizeof ended);
    pma_text text = pma_text_begin(m->message, sizeof m->message);
    pma_text_word(&text, "the state is damaged: ");
    pma_text_some(&text, message, sizeof message);
    return PMALPHA_BAD_ARGUMENT;
}

pmalpha_status pmalpha_restore(pmalpha_model *m, const void *block, size_t size)
{
    const size_t total = size_of(m), bytes = total * sizeof(double);
    const double *x = block;
    const pmalpha_status status = check_block(m, block, size, bytes);
    if (status != PMALPHA_OK)
        return status;
    if (number_at(x + SUM) != pma_file_sum_of(m->bytes))
        return pmalpha_say(m, PMALPHA_BAD_ARGUMENT, "the state is of another model");
    if (number_at(x + total - TAIL) != pma_file_sum(x, bytes - TAIL * sizeof(double)) ||
        !is_whole(m, x))
        return pmalpha_say(m, PMALPHA_BAD_ARGUMENT, "the state is damaged");
    return go_to(m, x);
}

void pmalpha_reset(pmalpha_model *m)
{
    pmalpha_return(m, m->start);
}

/* ---- the start with other inputs ------------------------------------------------------------- */

static void add(const pmalpha_entries *x, double scale, double *to)
{
    for (size_t k = 0; k < x->count; k++)
        to[x->at[k]] += scale * x->by[k];
}

static double *array_of(const pma_state_array *arrays, size_t count, const char *name)
{
    size_t i = 0;
    while (i + 1 < count && strcmp(arrays[i].name, name) != 0)
        i++;
    return arrays[i].values;
}

/* w += dw x, a as w, and the multipliers with both of those under mean coupling          (S1) */
static void add_response(pmalpha_model *m, const pmalpha_input *in, double x)
{
    pma_state_array of_coupler[PMA_COUPLER_ARRAYS], of_member[PMA_LEVEL_ARRAYS];
    const size_t p = pma_coupler_get_parts(m->core)->p;
    const size_t count = pma_coupler_arrays(m->core, of_coupler);
    double *end = array_of(of_coupler, count, "end_multipliers");
    for (size_t i = 0; i < m->members; i++) {
        const size_t levels = pma_subdomain_arrays(m->member[i].core, of_member);
        add(&in->accelerations[i], x, array_of(of_member, levels, "w"));
        add(&in->accelerations[i], x, array_of(of_member, levels, "a"));
    }
    add(&in->multipliers, x, array_of(of_coupler, count, "multipliers"));
    add(&in->multipliers, x, end);
    add(&in->multipliers, x, end + p);
}

/* The free velocities of these multipliers; iterated steps make theirs.                   (S2) */
static void rebase(pmalpha_model *m)
{
    pma_state_array arrays[PMA_COUPLER_ARRAYS];
    const size_t count = pma_coupler_arrays(m->core, arrays);
    for (size_t i = 0; i < m->members; i++)
        pma_subdomain_rebase(m->member[i].core, false, array_of(arrays, count, "multipliers"));
}

static pmalpha_status check_begin(pmalpha_model *m)
{
    if (!m->begins)
        return pmalpha_say(m, PMALPHA_BAD_ARGUMENT,
                           m->inputs > 0 ? "the model was frozen in a run, which has begun"
                                         : "the model has no inputs");
    if (m->state == PMALPHA_FAILED ||
        pmalpha_count(m) != (int64_t)number_at(m->start + STEP) * (int64_t)pmalpha_substeps(m))
        return pmalpha_say(m, PMALPHA_BAD_ARGUMENT, "the first step has been taken");
    for (size_t i = 0; i < m->inputs; i++) {
        const pmalpha_input *in = &m->input[i];
        if (in->kind == PMALPHA_VELOCITY && !(fabs(in->value - in->frozen) <= in->rounding))
            return pmalpha_say(m, PMALPHA_BAD_ARGUMENT,
                               "a velocity at the start must be that of the structure");
    }
    return PMALPHA_OK;
}

pmalpha_status pmalpha_begin(pmalpha_model *m)
{
    pmalpha_status status = check_begin(m);
    if (status != PMALPHA_OK)
        return status;
    for (size_t i = 0; i < m->inputs; i++)
        m->log[i] = m->input[i].value; /* no step is in it */
    status = pmalpha_return(m, m->start);
    for (size_t i = 0; i < m->inputs; i++) {
        pmalpha_input *in = &m->input[i];
        pmalpha_put(in, m->log[i]);
        if (in->accelerations && in->value != in->frozen)
            add_response(m, in, in->value - in->frozen);
    }
    rebase(m);
    return status == PMALPHA_FAILED ? status : pmalpha_show(m);
}

/* ---- the state of the file ------------------------------------------------------------------ */

static pma_status take_member(const pma_field *f, const pmalpha_member *x)
{
    const pma_field levels = pma_field_at(f, "levels"), iteration = pma_field_at(f, "iteration");
    pma_state_array arrays[PMA_LEVEL_ARRAYS];
    pma_iterate *it = pma_subdomain_iterate(x->core);
    pma_kept_iteration kept;
    PMA_TRY(pma_parts_arrays(&levels, arrays, pma_subdomain_arrays(x->core, arrays)));
    if (!it)
        return PMA_OK;
    PMA_TRY(pma_parts_kept(&iteration, it, &kept));
    return pma_iterate_restore(it, kept);
}

static pma_status take_clock(const pma_field *f, pmalpha_model *m)
{
    const pma_field number = pma_field_at(f, "step"), origin = pma_field_at(f, "origin");
    const pma_field t0 = pma_field_at(f, "t0");
    int64_t step;
    PMA_TRY(pma_field_integer(&origin, 0, &m->origin));
    PMA_TRY(pma_field_integer(&number, m->origin, &step));
    PMA_TRY(pma_field_real(&t0, &m->t0));
    if (!is_step(m, step))
        return pma_field_refuse(&number, "is too large");
    pma_coupler_set_origin(m->core, m->origin, m->t0);
    /* zeros, which the arrays replace */
    pma_coupler_start(m->core, step, m->record.multipliers, m->record.multipliers);
    return PMA_OK;
}

pma_status pmalpha_take_state(pmalpha_model *m)
{
    const pma_field root = pma_field_root(&m->fields, NULL), f = pma_field_at(&root, "state");
    const pma_field list = pma_field_at(&root, "subdomains"), numbers = pma_field_at(&f, "arrays");
    pma_state_array arrays[PMA_COUPLER_ARRAYS];
    PMA_TRY(pma_field_room(&f, log_size(m), 2 * sizeof(double)));
    PMA_TRY(pma_field_allocate(&f, log_size(m), sizeof(double), (void *)&m->log));
    PMA_TRY(pma_field_allocate(&f, size_of(m), sizeof(double), (void *)&m->start));
    PMA_TRY(pma_field_allocate(&f, size_of(m), sizeof(double), (void *)&m->before));
    for (size_t i = 0; i < m->members; i++) {
        const pma_field own = pma_field_item(&list, i);
        PMA_TRY(take_member(&own, &m->member[i]));
    }
    PMA_TRY(take_clock(&f, m));
    PMA_TRY(pma_parts_arrays(&numbers, arrays, pma_coupler_arrays(m->core, arrays)));
    save(m, m->start, size_of(m));
    return PMA_OK;
}
