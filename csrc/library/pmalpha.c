#include "library/pmalpha.h"

#include <math.h>
#include <string.h>

#include "library/model.h"
#include "library/version.h"
#include "memory.h"
#include "text.h"
#include "workers/denormals.h"

int pmalpha_abi(void)
{
    return PMALPHA_ABI;
}

const char *pmalpha_version(void)
{
    return PMALPHA_VERSION;
}

/* ---- messages ------------------------------------------------------------------------------- */

pmalpha_status pmalpha_say(pmalpha_model *m, pmalpha_status status, const char *text)
{
    pma_text message = pma_text_begin(m->message, sizeof m->message);
    pma_text_word(&message, text);
    return status;
}

pmalpha_status pmalpha_well(pmalpha_model *m)
{
    m->message[0] = 0;
    return PMALPHA_OK;
}

const char *pmalpha_message(const pmalpha_model *m)
{
    return m->message;
}

/* Bytes of the name of a subdomain in a message. */
enum { MOST_OF_A_NAME = 60 };

/* The name of a subdomain in the file. */
static const char *name_of(const pmalpha_model *m, size_t member)
{
    const pma_field root = pma_field_root((pma_fields *)(uintptr_t)&m->fields, NULL);
    const pma_field list = pma_field_at(&root, "subdomains"), f = pma_field_item(&list, member);
    const pma_field name = pma_field_at(&f, "name");
    return name.node->kind == PMA_WORD
               ? (const char *)(m->fields.base + (uintptr_t)name.node->is.at)
               : "";
}

pmalpha_status pmalpha_end(pmalpha_model *m, pmalpha_status status)
{
    m->state = status;
    memcpy(m->ended, m->message, sizeof m->ended);
    return status;
}

static pmalpha_status say_limit(pmalpha_model *m, pmalpha_status status, size_t member)
{
    static const char *const WORDS[] = {"displacement", "velocity", "acceleration", "force",
                                        "energy"};
    const pma_breach x = pma_subdomain_breach(m->member[member].core);
    pma_text text = pma_text_begin(m->message, sizeof m->message);
    pma_text_word(&text, WORDS[x.what]);
    pma_text_word(&text, " ");
    pma_text_real(&text, x.value);
    pma_text_word(&text, " of subdomain ");
    pma_text_some(&text, name_of(m, member), MOST_OF_A_NAME);
    pma_text_word(&text, " at t = ");
    pma_text_real(&text, x.t);
    pma_text_word(&text, " exceeds its limit ");
    pma_text_real(&text, x.limit);
    return pmalpha_end(m, status);
}

static pmalpha_status say_failure(pmalpha_model *m, pma_status status)
{
    const size_t member = pma_coupler_failed(m->core);
    if (member >= m->members) {
        pmalpha_say(m, PMALPHA_FAILED, pma_status_text(status));
        return pmalpha_end(m, PMALPHA_FAILED);
    }
    if (status == PMA_LIMITED)
        return say_limit(m, PMALPHA_FAILED, member);
    pma_text text = pma_text_begin(m->message, sizeof m->message);
    pma_text_word(&text, pma_status_text(status));
    pma_text_word(&text, ", in subdomain ");
    pma_text_some(&text, name_of(m, member), MOST_OF_A_NAME);
    pma_text_word(&text, " after t = ");
    pma_text_real(&text, pmalpha_time(m));
    return pmalpha_end(m, PMALPHA_FAILED);
}

/* ---- opening -------------------------------------------------------------------------------- */

/* Memory that numbers of a file may ask for beyond its arrays: 256 MB, and 64 times its size. */
enum { ROOM = 1 << 28, ROOM_FOR_EACH = 64 };

static pmalpha_status take_bytes(pmalpha_model *m, const void *bytes, size_t size)
{
    pma_status status = pma_file_read(bytes, size, &m->fields);
    m->bytes = bytes;
    m->fields.room =
        size > (SIZE_MAX - ROOM) / ROOM_FOR_EACH ? SIZE_MAX : ROOM + ROOM_FOR_EACH * size;
    if (status == PMA_OK)
        status = pmalpha_take(m);
    if (status == PMA_OK)
        status = pmalpha_take_state(m);
    if (status == PMA_NO_MEMORY)
        return pmalpha_say(m, PMALPHA_NO_MEMORY, pma_status_text(status));
    if (status != PMA_OK)
        return pmalpha_say(m, PMALPHA_BAD_FILE,
                           m->fields.refusal[0] ? m->fields.refusal : pma_status_text(status));
    pmalpha_reset(m);
    return m->state == PMALPHA_FAILED ? PMALPHA_BAD_FILE : PMALPHA_OK;
}

pmalpha_status pmalpha_refuse(pmalpha_status status, const char *reason, char *message)
{
    if (message) {
        pma_text text = pma_text_begin(message, PMALPHA_MESSAGE);
        pma_text_word(&text, reason);
    }
    return status;
}

pmalpha_status pmalpha_open_bytes(const void *bytes, size_t size, char *message,
                                  pmalpha_model **out)
{
    pmalpha_model *m = pma_memory_allocate(1, sizeof *m);
    if (!m)
        return pmalpha_refuse(PMALPHA_NO_MEMORY, pma_status_text(PMA_NO_MEMORY), message);
    const pmalpha_status status = take_bytes(m, bytes, size);
    pmalpha_refuse(status, status == PMALPHA_OK ? "" : m->message, message);
    if (status == PMALPHA_OK)
        *out = m;
    else
        pmalpha_release(m);
    return status;
}

/* What is wrong with the arguments of an opening, or NULL. */
static const char *fault_of(const void *bytes, const pmalpha_model *const *out)
{
    if (!bytes || (uintptr_t)bytes % sizeof(uint64_t) != 0)
        return "the bytes must be at a multiple of 8";
    return out ? NULL : "there is no place for the model";
}

pmalpha_status pmalpha_open_memory(const void *bytes, size_t size, char *message,
                                   pmalpha_model **out)
{
    const char *const fault = fault_of(bytes, (const pmalpha_model *const *)out);
    if (out)
        *out = NULL;
    return fault ? pmalpha_refuse(PMALPHA_BAD_ARGUMENT, fault, message)
                 : pmalpha_open_bytes(bytes, size, message, out);
}

size_t pmalpha_room(const void *bytes, size_t size)
{
    pma_room count = {.at = NULL};
    pmalpha_model *m;
    pma_memory_enter(&count);
    const pmalpha_status status = pmalpha_open_memory(bytes, size, NULL, &m);
    pma_memory_enter(NULL);
    if (status != PMALPHA_OK)
        return 0;
    pmalpha_close(m);
    return count.used;
}

pmalpha_status pmalpha_open_in(const void *bytes, size_t size, void *room, size_t room_size,
                               char *message, pmalpha_model **out)
{
    pma_room within = {.at = room, .left = room_size};
    const char *fault = fault_of(bytes, (const pmalpha_model *const *)out);
    if (out)
        *out = NULL;
    if (!fault && (!room || (uintptr_t)room % _Alignof(max_align_t) != 0))
        fault = "the room must be aligned as memory of malloc is";
    if (fault)
        return pmalpha_refuse(PMALPHA_BAD_ARGUMENT, fault, message);
    pma_memory_enter(&within);
    const pmalpha_status status = pmalpha_open_bytes(bytes, size, message, out);
    pma_memory_enter(NULL);
    if (status == PMALPHA_NO_MEMORY)
        return pmalpha_refuse(status, "the room is too small: pmalpha_room", message);
    if (status == PMALPHA_OK)
        (*out)->is_in_room = true;
    return status;
}

void pmalpha_close(pmalpha_model *m)
{
    if (m && !m->is_in_room)
        pmalpha_release(m);
}

/* ---- time ----------------------------------------------------------------------------------- */

double pmalpha_step_size(const pmalpha_model *m)
{
    return pma_coupler_get_parts(m->core)->dt / (double)pmalpha_substeps(m);
}

size_t pmalpha_substeps(const pmalpha_model *m)
{
    return pma_coupler_instants(m->core);
}

int64_t pmalpha_count(const pmalpha_model *m)
{
    return pma_coupler_step_count(m->core) * (int64_t)pmalpha_substeps(m) +
           (int64_t)pma_coupler_fine_done(m->core);
}

double pmalpha_time(const pmalpha_model *m)
{
    return pma_coupler_time(m->core);
}

/* ---- inputs and outputs --------------------------------------------------------------------- */

size_t pmalpha_inputs(const pmalpha_model *m)
{
    return m->inputs;
}

size_t pmalpha_outputs(const pmalpha_model *m)
{
    return m->outputs;
}

pmalpha_input *pmalpha_input_at(const pmalpha_model *m, int i)
{
    return i >= 0 && (size_t)i < m->inputs ? &m->input[i] : NULL;
}

static const pmalpha_output *output_at(const pmalpha_model *m, int i)
{
    return i >= 0 && (size_t)i < m->outputs ? &m->output[i] : NULL;
}

const char *pmalpha_input_name(const pmalpha_model *m, int i)
{
    const pmalpha_input *in = pmalpha_input_at(m, i);
    return in ? in->name : NULL;
}

const char *pmalpha_output_name(const pmalpha_model *m, int i)
{
    const pmalpha_output *out = output_at(m, i);
    return out ? out->name : NULL;
}

int pmalpha_find_input(const pmalpha_model *m, const char *name)
{
    for (size_t i = 0; name && i < m->inputs; i++) {
        if (strcmp(m->input[i].name, name) == 0)
            return (int)i;
    }
    return -1;
}

int pmalpha_find_output(const pmalpha_model *m, const char *name)
{
    for (size_t i = 0; name && i < m->outputs; i++) {
        if (strcmp(m->output[i].name, name) == 0)
            return (int)i;
    }
    return -1;
}

pmalpha_kind pmalpha_input_kind(const pmalpha_model *m, int i)
{
    const pmalpha_input *in = pmalpha_input_at(m, i);
    return in ? in->kind : PMALPHA_FORCE;
}

int pmalpha_command(const pmalpha_model *m, int i, double c[3])
{
    const pmalpha_input *in = pmalpha_input_at(m, i);
    memset(c, 0, 3 * sizeof *c);
    if (!in)
        return 0;
    memcpy(c, in->command, 3 * sizeof *c);
    return in->is_new;
}

void pmalpha_put(pmalpha_input *in, double value)
{
    in->value = value;
    if (in->scaled)
        *in->scaled = value / in->scale;
}

pmalpha_status pmalpha_set(pmalpha_model *m, int i, double value)
{
    pmalpha_input *in = pmalpha_input_at(m, i);
    if (!in)
        return pmalpha_say(m, PMALPHA_BAD_ARGUMENT, "there is no input of this number");
    if (!isfinite(value))
        return pmalpha_say(m, PMALPHA_BAD_ARGUMENT, "the value of an input must be finite");
    pmalpha_put(in, value);
    return pmalpha_well(m);
}

double pmalpha_given(const pmalpha_model *m, int i)
{
    const pmalpha_input *in = pmalpha_input_at(m, i);
    return in ? in->value : (double)NAN;
}

int pmalpha_lead(const pmalpha_model *m, int i)
{
    const pmalpha_input *in = pmalpha_input_at(m, i);
    const size_t fine = pmalpha_substeps(m);
    if (!in)
        return 0;
    if (in->kind == PMALPHA_VELOCITY || fine == 1)
        return 1;
    const size_t ratio = fine / pma_subdomain_parts(m->member[in->member].core)->substeps;
    const size_t begun = pma_coupler_fine_done(m->core) % ratio;
    return (int)(begun > 0 ? 2 * ratio - begun : ratio);
}

double pmalpha_get(const pmalpha_model *m, int i)
{
    const pmalpha_output *out = output_at(m, i);
    return out ? *out->at / out->scale : (double)NAN;
}

pmalpha_status pmalpha_attach(pmalpha_model *m, int i, pmalpha_specimen f, void *user)
{
    pmalpha_input *in = pmalpha_input_at(m, i);
    if (!in || in->kind != PMALPHA_SPECIMEN)
        return pmalpha_say(m, PMALPHA_BAD_ARGUMENT, "there is no specimen of this number");
    in->f = f;
    in->user = user;
    return pmalpha_well(m);
}

/* ---- steps ---------------------------------------------------------------------------------- */

/* What the specimens of a subdomain are commanded in the coming step. */
static pma_status find_command(pmalpha_model *m, pmalpha_member *x)
{
    pma_substep step;
    const bool is_new = pma_coupler_coming(m->core, x->number, &step);
    x->asks = true;
    const pma_status status =
        is_new && x->is_tried ? pma_subdomain_admit(x->core, &step, x->u, x->v) : PMA_OK;
    x->asks = false;
    for (size_t i = 0; i < m->inputs; i++) {
        pmalpha_input *in = &m->input[i];
        if (in->kind != PMALPHA_SPECIMEN || in->member != x->number)
            continue;
        in->is_new = is_new && status == PMA_OK;
        if (in->is_new)
            pma_subdomain_command(x->core, &step, in->position, in->command);
        if (in->is_new && x->is_compensated)
            memcpy(in->command, in->sent, sizeof in->sent);
    }
    return status;
}

pmalpha_status pmalpha_show(pmalpha_model *m)
{
    size_t limited = m->members;
    pma_coupler_record_taken(m->core, &m->record);
    const pma_denormals before = pma_denormals_flush();
    for (size_t i = 0; i < m->members; i++) {
        pmalpha_member *x = &m->member[i];
        if (x->specimens > 0 && find_command(m, x) != PMA_OK && limited == m->members)
            limited = i;
    }
    pma_denormals_restore(before);
    return limited < m->members ? say_limit(m, PMALPHA_LIMITED, limited) : pmalpha_well(m);
}

pmalpha_status pmalpha_step(pmalpha_model *m)
{
    double *log = m->log + pma_coupler_fine_done(m->core) * m->inputs;
    const pma_status status = pma_coupler_take(m->core);
    if (status != PMA_OK)
        return say_failure(m, status);
    for (size_t i = 0; i < m->inputs; i++)
        log[i] = m->input[i].value;
    return pmalpha_show(m);
}

static pmalpha_status timed_step(pmalpha_model *m)
{
    const int64_t begin = m->now(m->clock);
    const pmalpha_status status = pmalpha_step(m);
    const int64_t taken = m->now(m->clock) - begin;
    m->longest = taken > m->longest ? taken : m->longest;
    return status;
}

pmalpha_status pmalpha_advance(pmalpha_model *m, size_t steps)
{
    pmalpha_status status = PMALPHA_OK;
    for (size_t k = 0; k < steps && status == PMALPHA_OK; k++) {
        if (m->state != PMALPHA_OK) {
            m->state = PMALPHA_FAILED;
            return pmalpha_say(m, PMALPHA_FAILED, m->ended);
        }
        status = m->now ? timed_step(m) : pmalpha_step(m);
    }
    return status;
}

void pmalpha_clock(pmalpha_model *m, int64_t (*now)(void *user), void *user)
{
    m->now = now;
    m->clock = user;
    m->longest = 0;
}

int64_t pmalpha_longest(const pmalpha_model *m)
{
    return m->longest;
}
