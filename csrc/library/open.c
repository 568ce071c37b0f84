/* open.c - a model from the tree of its file. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "library/model.h"
#include "memory.h"

/* ---- inputs, as the core calls them ---------------------------------------------------------- */

/* The forces of the specimens of a subdomain: what was set, or a function returns. */
static int call_specimens(double t, intptr_t n, double *u, double *v, double *r, void *user)
{
    const pmalpha_member *x = user;
    pmalpha_model *m = x->model;
    if ((size_t)n != x->n)
        return 1;
    for (size_t i = 0; i < m->inputs; i++) {
        pmalpha_input *in = &m->input[i];
        if (in->kind != PMALPHA_SPECIMEN || in->member != x->number)
            continue;
        if (x->asks) {
            in->sent[0] = u[in->dof];
            in->sent[1] = v[in->dof];
            continue;
        }
        if (in->f && !m->replays) {
            double force = in->value;
            const int code = in->f(t, in->command, &force, in->user);
            if (code != 0 || !isfinite(force))
                return code != 0 ? code : 1;
            in->value = force;
        }
        r[in->dof] = in->value;
    }
    return x->asks;
}

/* The external forces that were set. */
static int call_forces(double t, intptr_t n, double *f, void *user)
{
    const pmalpha_member *x = user;
    const pmalpha_model *m = x->model;
    (void)t, (void)n;
    for (size_t i = 0; i < m->inputs; i++) {
        if (m->input[i].kind == PMALPHA_FORCE && m->input[i].member == x->number)
            f[m->input[i].dof] += m->input[i].value;
    }
    return 0;
}

/* What a word of the file stands for: the inputs of the subdomain that is being taken. */
static pma_status find(pma_fields *fields, const pma_node *node, pma_role role, void *out)
{
    pmalpha_member *x = fields->ctx;
    const char *word = (const char *)(fields->base + (uintptr_t)node->is.at);
    if (role != PMA_RESTORING_ROLE || !x || strcmp(word, "inputs") != 0)
        return PMA_REFUSED;
    *(pma_function *)out = (pma_function){.function = call_specimens, .user = x};
    return PMA_OK;
}

/* ---- words and numbers ---------------------------------------------------------------------- */

static pma_status take_word(const pma_field *of, const char *key, const char **out)
{
    const pma_field f = pma_field_at(of, key);
    if (f.node->kind != PMA_WORD)
        return pma_field_refuse(&f, "must be a word");
    *out = (const char *)(f.fields->base + (uintptr_t)f.node->is.at);
    return PMA_OK;
}

/* A count below `most`. */
static pma_status take_below(const pma_field *of, const char *key, size_t most, size_t *out)
{
    const pma_field f = pma_field_at(of, key);
    PMA_TRY(pma_field_count(&f, 0, out));
    return *out < most ? PMA_OK : pma_field_refuse(&f, "is out of range");
}

static pma_status take_real(const pma_field *of, const char *key, double *out)
{
    const pma_field f = pma_field_at(of, key);
    return pma_field_real(&f, out);
}

/* One of these words, as its number. */
static pma_status take_choice(const pma_field *of, const char *key, const char *const *words,
                              size_t count, size_t *out)
{
    const pma_field f = pma_field_at(of, key);
    for (size_t i = 0; i < count; i++) {
        if (pma_field_is_word(&f, words[i])) {
            *out = i;
            return PMA_OK;
        }
    }
    return pma_field_refuse(&f, "is not known");
}

/* ---- inputs --------------------------------------------------------------------------------- */

/* The subdomain of a field, with the sizes it has said it has. */
static pma_status take_sizes(const pma_field *of, size_t members, size_t *member, size_t *n)
{
    PMA_TRY(take_below(of, "subdomain", members, member));
    const pma_field root = pma_field_root(of->fields, NULL);
    const pma_field list = pma_field_at(&root, "subdomains");
    const pma_field own = pma_field_item(&list, *member), parts = pma_field_at(&own, "parts");
    const pma_field size = pma_field_at(&parts, "n");
    return pma_field_count(&size, 1, n);
}

static pma_status take_input(const pma_field *f, pmalpha_model *m, pmalpha_input *out)
{
    static const char *const KINDS[] = {"specimen", "force", "velocity"};
    size_t kind = 0, n = 0;
    out->scale = 1.0;
    PMA_TRY(take_word(f, "name", &out->name));
    PMA_TRY(take_choice(f, "kind", KINDS, 3, &kind));
    PMA_TRY(take_real(f, "value", &out->frozen));
    out->value = out->frozen;
    out->kind = (pmalpha_kind)kind;
    if (out->kind == PMALPHA_VELOCITY) {
        const pma_field motion = pma_field_at(f, "motion"), row = pma_field_at(f, "row");
        PMA_TRY(take_real(f, "scale", &out->scale));
        PMA_TRY(pma_field_count(&row, 0, &out->row));
        return pma_field_count(&motion, 0, &out->motion); /* in range: when there is a coupler */
    }
    PMA_TRY(take_sizes(f, m->members, &out->member, &n));
    PMA_TRY(take_below(f, "dof", n, &out->dof));
    PMA_TRY(take_below(f, "position", n, &out->position));
    m->member[out->member].specimens += out->kind == PMALPHA_SPECIMEN;
    m->member[out->member].forces += out->kind == PMALPHA_FORCE;
    return PMA_OK;
}

static pma_status take_inputs(const pma_field *root, pmalpha_model *m)
{
    const pma_field list = pma_field_at(root, "inputs");
    PMA_TRY(pma_field_tuple(&list, &m->inputs));
    PMA_TRY(pma_field_allocate(&list, m->inputs, sizeof *m->input, (void *)&m->input));
    for (size_t i = 0; i < m->inputs; i++) {
        const pma_field f = pma_field_item(&list, i);
        PMA_TRY(take_input(&f, m, &m->input[i]));
    }
    return PMA_OK;
}

/* ---- subdomains ----------------------------------------------------------------------------- */

/* The load of the file and after it what is set, as one. */
static pma_status add_forces(const pma_field *f, pmalpha_member *x, const pma_parts *parts,
                             pma_load *load)
{
    const pma_field order = pma_field_at(f, "order");
    const bool sums = load->kind == PMA_LOAD_SUM;
    const size_t before = sums ? load->count : 1;
    pma_load *each;
    PMA_TRY(pma_field_allocate(f, before + 1, sizeof *each, (void *)&each));
    memcpy(each, sums ? load->each : load, before * sizeof *each);
    pma_load *own = &each[before];
    *own = (pma_load){.kind = PMA_LOAD_CALLED, .n = parts->n, .function = call_forces, .user = x};
    PMA_TRY(pma_parts_order(f, parts->n, &own->order));
    PMA_TRY(pma_field_allocate(&order, parts->n, sizeof *own->work, (void *)&own->work));
    *load = (pma_load){.kind = PMA_LOAD_SUM, .n = parts->n, .each = each, .count = before + 1};
    return PMA_OK;
}

static pma_status take_member(const pma_field *f, pmalpha_member *x)
{
    const pma_field fields = pma_field_at(f, "parts");
    pma_subdomain_taken *taken;
    /* its iterate is pointed to */
    PMA_TRY(pma_field_allocate(f, 1, sizeof *taken, (void *)&taken));
    f->fields->ctx = x;
    PMA_TRY(pma_parts_subdomain(&fields, taken));
    f->fields->ctx = NULL;
    const size_t n = taken->parts.n;
    if (x->specimens > 0 && !taken->parts.restoring.function)
        return pma_field_refuse(&fields, "must have a restoring force for its inputs");
    if (x->forces > 0)
        PMA_TRY(add_forces(f, x, &taken->parts, &taken->load));
    PMA_TRY(pma_parts_make_subdomain(taken, &x->core));
    const size_t memory = taken->parts.restoring.memory;
    x->n = n;
    x->is_compensated = memory > 0 && x->specimens > 0;
    x->is_tried = (taken->is_limited || memory > 0) && x->specimens > 0;
    if (x->is_tried) {
        PMA_TRY(pma_field_allocate(f, 4 * n + memory, sizeof(double), (void *)&x->u));
        PMA_TRY(pma_field_allocate(f, n, sizeof(double), (void *)&x->v));
    }
    return PMA_OK;
}

static pma_status take_members(const pma_field *root, pmalpha_model *m)
{
    const pma_field list = pma_field_at(root, "subdomains");
    PMA_TRY(pma_field_tuple(&list, &m->members));
    if (m->members == 0)
        return pma_field_refuse(&list, "must not be empty");
    PMA_TRY(pma_field_allocate(&list, m->members, sizeof *m->member, (void *)&m->member));
    for (size_t i = 0; i < m->members; i++) {
        m->member[i].model = m;
        m->member[i].number = i;
    }
    PMA_TRY(take_inputs(root, m));
    for (size_t i = 0; i < m->members; i++) {
        const pma_field f = pma_field_item(&list, i);
        PMA_TRY(take_member(&f, &m->member[i]));
    }
    return PMA_OK;
}

/* ---- the coupler ---------------------------------------------------------------------------- */

static size_t nb_of(const void *of, size_t member)
{
    const pmalpha_model *m = of;
    return pma_subdomain_parts(m->member[member].core)->nb;
}

static pma_status make_coupler(const pma_field *f, pmalpha_model *m, pma_coupler_taken *taken)
{
    pma_member *members;
    PMA_TRY(pma_interface_create(&taken->H_start, &m->H_start));
    PMA_TRY(pma_interface_create(&taken->H, &m->H));
    PMA_TRY(pma_field_allocate(f, m->members, sizeof *members, (void *)&members));
    for (size_t i = 0; i < m->members; i++)
        members[i] = pma_subdomain_member(m->member[i].core);
    pma_coupler_parts *parts = &taken->parts;
    parts->H_start = m->H_start;
    parts->H = m->H;
    parts->count = m->members;
    parts->members = members;
    parts->threads = 1;
    parts->worthwhile = false;
    return pma_coupler_create(parts, &m->core);
}

/* A load on fine steps: tables are of no use. */
static pma_status take_moving(const pma_field *f, size_t n, pma_load *out)
{
    PMA_TRY(pma_parts_load(f, n, out));
    return pma_load_has(out, PMA_LOAD_TABLE) || pma_load_has(out, PMA_LOAD_CALLED)
               ? pma_field_refuse(f, "must be constant or sampled")
               : PMA_OK;
}

/* What velocities that are set add to a motion, and to its load. */
static pma_status add_velocities(const pma_field *list, pmalpha_model *m, size_t j, pma_load *load)
{
    const size_t n = load->n;
    double *values;
    pma_load *each;
    PMA_TRY(pma_field_allocate(list, n, sizeof *values, (void *)&values));
    PMA_TRY(pma_field_allocate(list, 2, sizeof *each, (void *)&each));
    for (size_t i = 0; i < m->inputs; i++) {
        pmalpha_input *in = &m->input[i];
        if (in->kind != PMALPHA_VELOCITY || in->motion != j)
            continue;
        if (in->row >= n)
            return pma_field_refuse(list, "must have a row for each velocity that is set");
        in->scaled = &values[in->row];
    }
    if (load->kind == PMA_LOAD_SUM)
        return pma_field_refuse(list, "must be constant or sampled where a velocity is set");
    each[0] = *load;
    each[1] = (pma_load){.kind = PMA_LOAD_CONSTANT, .n = n, .values = values};
    *load = load->kind == PMA_LOAD_NONE
                ? each[1]
                : (pma_load){.kind = PMA_LOAD_SUM, .n = n, .each = each, .count = 2};
    return PMA_OK;
}

static bool is_set(const pmalpha_model *m, size_t motion)
{
    for (size_t i = 0; i < m->inputs; i++) {
        if (m->input[i].kind == PMALPHA_VELOCITY && m->input[i].motion == motion)
            return true;
    }
    return false;
}

static pma_status take_motions(const pma_field *root, pmalpha_model *m)
{
    const pma_field list = pma_field_at(root, "motions"), fixed = pma_field_at(root, "obstacle");
    const pma_coupler_parts *parts = pma_coupler_get_parts(m->core);
    const pma_load *obstacle = pma_coupler_obstacle(m->core);
    size_t count;
    pma_load load;
    PMA_TRY(pma_field_tuple(&list, &count));
    if (count != parts->motion_count)
        return pma_field_refuse(&list, "must be as many as the coupler has");
    for (size_t i = 0; i < m->inputs; i++) {
        if (m->input[i].kind == PMALPHA_VELOCITY && m->input[i].motion >= count)
            return pma_field_refuse(&list, "must have one for each velocity that is set");
    }
    for (size_t i = 0; i < count; i++) {
        const pma_field f = pma_field_item(&list, i);
        PMA_TRY(take_moving(&f, parts->motions[i].load.n, &load));
        if (is_set(m, i))
            PMA_TRY(add_velocities(&list, m, i, &load));
        pma_coupler_set_motion(m->core, i, load);
    }
    if (!obstacle)
        return PMA_OK;
    PMA_TRY(take_moving(&fixed, 2 * pma_coupler_contacts(m->core), &load));
    pma_coupler_set_obstacle(m->core, load);
    return PMA_OK;
}

static pma_status take_coupler(const pma_field *root, pmalpha_model *m)
{
    const pma_field f = pma_field_at(root, "coupler");
    const pma_members members = {.count = m->members, .nb = nb_of, .of = m};
    pma_coupler_taken *taken;
    PMA_TRY(pma_field_allocate(&f, 1, sizeof *taken, (void *)&taken));
    PMA_TRY(pma_parts_coupler(&f, &members, taken));
    PMA_TRY(make_coupler(&f, m, taken));
    return take_motions(root, m);
}

/* ---- what inputs change of the start --------------------------------------------------------- */

/* The entries of a vector of n that are not zero; None: there are none. */
static pma_status take_entries(const pma_field *f, size_t n, pmalpha_entries *out)
{
    const pma_field at = pma_field_at(f, "at"), by = pma_field_at(f, "by");
    if (pma_field_is_none(f))
        return PMA_OK;
    PMA_TRY(pma_field_positions(&at, n, &out->count, &out->at));
    return pma_field_doubles(&by, out->count, &out->by);
}

static pma_status take_response(const pma_field *f, pmalpha_model *m, pmalpha_input *in)
{
    const pma_field list = pma_field_at(f, "members"), lam = pma_field_at(f, "multipliers");
    size_t count;
    if (pma_field_is_none(f))
        return PMA_OK;
    PMA_TRY(pma_field_tuple(&list, &count));
    if (count != m->members)
        return pma_field_refuse(&list, "must be as many as there are subdomains");
    PMA_TRY(
        pma_field_allocate(&list, count, sizeof *in->accelerations, (void *)&in->accelerations));
    for (size_t i = 0; i < count; i++) {
        const pma_field item = pma_field_item(&list, i);
        const size_t n = pma_subdomain_parts(m->member[i].core)->n;
        PMA_TRY(take_entries(&item, n, &in->accelerations[i]));
    }
    return take_entries(&lam, pma_coupler_get_parts(m->core)->p, &in->multipliers);
}

static pma_status take_begin(const pma_field *root, pmalpha_model *m)
{
    const pma_field f = pma_field_at(root, "begin"), list = pma_field_at(&f, "inputs");
    const pma_field rounding = pma_field_at(&f, "rounding");
    const double *values;
    size_t count;
    m->begins = !pma_field_is_none(&f);
    if (!m->begins)
        return PMA_OK;
    PMA_TRY(pma_field_tuple(&list, &count));
    if (count != m->inputs)
        return pma_field_refuse(&list, "must be as many as there are inputs");
    PMA_TRY(pma_field_doubles(&rounding, count, &values));
    for (size_t i = 0; i < count; i++) {
        const pma_field item = pma_field_item(&list, i);
        m->input[i].rounding = values[i];
        PMA_TRY(take_response(&item, m, &m->input[i]));
    }
    return PMA_OK;
}

/* ---- outputs -------------------------------------------------------------------------------- */

enum { OF_U, OF_V, OF_A, OF_DEFORMATION, OF_FORCE, OF_MULTIPLIER, QUANTITIES };
static const char *const WORDS[QUANTITIES] = {"u",         "v", "a", "deformation", "spring force",
                                              "multiplier"};

static pma_status take_output(const pma_field *f, pmalpha_model *m, pmalpha_output *out)
{
    size_t what = 0, member = 0, at = 0;
    PMA_TRY(take_word(f, "name", &out->name));
    PMA_TRY(take_choice(f, "what", WORDS, QUANTITIES, &what));
    PMA_TRY(take_real(f, "scale", &out->scale));
    if (what == OF_MULTIPLIER) {
        PMA_TRY(take_below(f, "position", pma_coupler_get_parts(m->core)->p, &at));
        out->at = m->record.multipliers + at;
        return PMA_OK;
    }
    PMA_TRY(take_below(f, "subdomain", m->members, &member));
    pma_selection *s = &m->record.selections[member];
    const pma_parts *parts = pma_subdomain_parts(m->member[member].core);
    const bool of_spring = what == OF_DEFORMATION || what == OF_FORCE;
    PMA_TRY(take_below(f, "position", of_spring ? parts->springs.total : parts->n, &at));
    if (of_spring) {
        ((int64_t *)(uintptr_t)s->spring)[s->springs] = (int64_t)at;
        out->at = (what == OF_FORCE ? s->force : s->deformation) + s->springs++;
    } else {
        ((int64_t *)(uintptr_t)s->position)[s->count] = (int64_t)at;
        out->at = (what == OF_U ? s->u : what == OF_V ? s->v : s->w) + s->count++;
    }
    return PMA_OK;
}

/* One row for each subdomain, long enough for all outputs. */
static pma_status make_record(const pma_field *list, pmalpha_model *m)
{
    const size_t p = pma_coupler_get_parts(m->core)->p, count = m->outputs;
    PMA_TRY(pma_field_allocate(list, p, sizeof(double), (void *)&m->record.multipliers));
    PMA_TRY(pma_field_allocate(list, m->members, sizeof *m->record.selections,
                               (void *)&m->record.selections));
    for (size_t i = 0; i < m->members; i++) {
        pma_selection *s = &m->record.selections[i];
        s->of_springs = pma_subdomain_parts(m->member[i].core)->springs.total;
        double **const numbers[] = {&s->u, &s->v, &s->w, &s->deformation, &s->force};
        for (size_t k = 0; k < sizeof numbers / sizeof *numbers; k++)
            PMA_TRY(pma_field_allocate(list, count, sizeof(double), (void *)numbers[k]));
        PMA_TRY(pma_field_allocate(list, count, sizeof(int64_t), (void *)&s->position));
        PMA_TRY(pma_field_allocate(list, count, sizeof(int64_t), (void *)&s->spring));
    }
    return PMA_OK;
}

static pma_status take_outputs(const pma_field *root, pmalpha_model *m)
{
    const pma_field list = pma_field_at(root, "outputs");
    PMA_TRY(pma_field_tuple(&list, &m->outputs));
    PMA_TRY(pma_field_room(&list, m->outputs, 8 * m->members * sizeof(double)));
    PMA_TRY(pma_field_allocate(&list, m->outputs, sizeof *m->output, (void *)&m->output));
    PMA_TRY(make_record(&list, m));
    for (size_t i = 0; i < m->outputs; i++) {
        const pma_field f = pma_field_item(&list, i);
        PMA_TRY(take_output(&f, m, &m->output[i]));
    }
    return PMA_OK;
}

/* ---- all of it ------------------------------------------------------------------------------ */

pma_status pmalpha_take(pmalpha_model *m)
{
    m->fields.store = &m->store;
    m->fields.find = find;
    const pma_field root = pma_field_root(&m->fields, NULL);
    const pma_field format = pma_field_at(&root, "format");
    if (!pma_field_is_word(&format, "pmalpha"))
        return pma_field_refuse(&format, "must be that of a frozen model");
    PMA_TRY(take_members(&root, m));
    PMA_TRY(take_coupler(&root, m));
    PMA_TRY(take_begin(&root, m));
    return take_outputs(&root, m);
}

void pmalpha_release(pmalpha_model *m)
{
    pma_coupler_destroy(m->core);
    pma_interface_destroy(&m->H_start);
    pma_interface_destroy(&m->H);
    for (size_t i = 0; i < m->members && m->member; i++)
        pma_subdomain_destroy(m->member[i].core);
    pma_store_release(&m->store);
    free(m->file);
    pma_memory_release(m);
}
