/* The arrays of a record, as the core writes into them, from its fields. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include "algebra/lists.h"

/* ---- arrays --------------------------------------------------------------------------------- */

/* Rows of this many columns; *rows < 0 is any number of them, and is set. */
static pma_status take_rows(const pma_field *of, const char *name, int64_t *rows, size_t columns,
                            double **out)
{
    const pma_field values = pma_field_at(of, name);
    int64_t extents[2] = {*rows, (int64_t)columns};
    PMA_TRY(pma_field_output(&values, 2, extents, out));
    *rows = extents[0];
    return PMA_OK;
}

static pma_status check_rows(const pma_field *f, int64_t rows, size_t last_row)
{
    return rows >= 0 && (size_t)rows > last_row ? PMA_OK : pma_field_refuse(f, "has too few rows");
}

/* ---- of a subdomain ------------------------------------------------------------------------- */

/* {number, deformation, force} */
static pma_status take_springs(const pma_field *f, int64_t *rows, pma_selection *out)
{
    const pma_field number = pma_field_at(f, "number");
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_positions(&number, out->of_springs, &out->springs, &out->spring));
    PMA_TRY(take_rows(f, "deformation", rows, out->springs, &out->deformation));
    return take_rows(f, "force", rows, out->springs, &out->force);
}

/* None or {start, position, weight}, the rows of a matrix with `size` columns */
static pma_status take_combination(const pma_field *of, const char *name, size_t size, size_t rows,
                                   pma_combination *out)
{
    const pma_field f = pma_field_at(of, name), start = pma_field_at(&f, "start");
    const pma_field position = pma_field_at(&f, "position"), weight = pma_field_at(&f, "weight");
    size_t count;
    if (pma_field_is_none(&f))
        return PMA_OK;
    PMA_TRY(pma_field_dict(&f));
    PMA_TRY(pma_field_longs(&start, rows + 1, &out->start));
    PMA_TRY(pma_field_positions(&position, size, &count, &out->position));
    PMA_TRY(pma_field_doubles(&weight, count, &out->weight));
    if (pma_are_starts(rows, out->start) && out->start[rows] == (int64_t)count)
        return PMA_OK;
    return pma_field_refuse(&start, "must rise from 0 to the number of weights");
}

/* {values, of_u, of_v, of_a} */
static pma_status take_outputs(const pma_field *f, size_t n, int64_t *rows, pma_selection *out)
{
    const pma_field values = pma_field_at(f, "values");
    int64_t extents[2] = {*rows, -1};
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_output(&values, 2, extents, &out->output));
    *rows = extents[0];
    out->outputs = (size_t)extents[1];
    PMA_TRY(take_combination(f, "of_u", n, out->outputs, &out->of_u));
    PMA_TRY(take_combination(f, "of_v", n, out->outputs, &out->of_v));
    return take_combination(f, "of_a", n, out->outputs, &out->of_w);
}

/* {iterations, q}, each or None */
static pma_status take_internal(const pma_field *f, const pma_parts *parts, int64_t *rows,
                                pma_selection *out)
{
    const pma_field iterations = pma_field_at(f, "iterations"), q = pma_field_at(f, "q");
    PMA_TRY(pma_field_dict(f));
    if (!pma_field_is_none(&iterations) && !parts->iterate)
        return pma_field_refuse(&iterations, "must be of a subdomain that is iterated");
    if (!pma_field_is_none(&iterations))
        PMA_TRY(take_rows(f, "iterations", rows, 1, &out->corrections));
    if (pma_field_is_none(&q))
        return PMA_OK;
    out->history = out->of_history;
    return take_rows(f, "q", rows, out->history, &out->q);
}

/* {command, sent, measured, force} of all specimens behind filters */
static pma_status take_rig(const pma_field *f, const pma_parts *parts, int64_t *rows,
                           pma_selection *out)
{
    PMA_TRY(pma_field_dict(f));
    out->of_rig = &parts->restoring;
    out->rig_begin = pma_springs_numbers(&parts->springs);
    for (size_t k = 0; k < parts->restoring.traces; k++)
        out->commands += parts->restoring.trace[k].width;
    PMA_TRY(take_rows(f, "command", rows, out->commands, &out->command));
    PMA_TRY(take_rows(f, "sent", rows, out->commands, &out->sent));
    PMA_TRY(take_rows(f, "measured", rows, out->commands, &out->measured));
    return take_rows(f, "force", rows, out->commands, &out->rig_force);
}

/* None or {position, u, v, a, springs, outputs, internal, rig} */
static pma_status take_selection(const pma_field *f, const pma_parts *parts, size_t last_row,
                                 pma_selection *out)
{
    const pma_field springs = pma_field_at(f, "springs"), outputs = pma_field_at(f, "outputs");
    const pma_field internal = pma_field_at(f, "internal"), rig = pma_field_at(f, "rig");
    const pma_field position = pma_field_at(f, "position");
    int64_t rows = -1;
    *out =
        (pma_selection){.of_springs = parts->springs.total, .of_history = parts->internal.history};
    if (pma_field_is_none(f))
        return PMA_OK;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_positions(&position, parts->n, &out->count, &out->position));
    PMA_TRY(take_rows(f, "u", &rows, out->count, &out->u));
    PMA_TRY(take_rows(f, "v", &rows, out->count, &out->v));
    PMA_TRY(take_rows(f, "a", &rows, out->count, &out->w));
    if (!pma_field_is_none(&springs))
        PMA_TRY(take_springs(&springs, &rows, out));
    if (!pma_field_is_none(&internal))
        PMA_TRY(take_internal(&internal, parts, &rows, out));
    if (!pma_field_is_none(&outputs))
        PMA_TRY(take_outputs(&outputs, parts->n, &rows, out));
    if (!pma_field_is_none(&rig))
        PMA_TRY(take_rig(&rig, parts, &rows, out));
    return check_rows(f, rows, last_row);
}

/* In lanes a tuple of PMA_LANES of them, the others of which are in `more`. */
static pma_status take_selections(const pma_field *f, const SubdomainObject *s, size_t last_row,
                                  pma_selection *out, pma_selection *more)
{
    const pma_parts *parts = pma_subdomain_parts(s->core);
    size_t count;
    if (!s->of)
        return take_selection(f, parts, last_row, out);
    PMA_TRY(pma_field_tuple(f, &count));
    if (count != PMA_LANES)
        return pma_field_refuse(f, "must have one for each lane");
    for (size_t l = 0; l < PMA_LANES; l++) {
        const pma_field item = pma_field_item(f, l);
        PMA_TRY(take_selection(&item, parts, last_row, out));
        out->next = l + 1 < PMA_LANES ? more + l : NULL;
        out = more + l;
    }
    return PMA_OK;
}

/* ---- of a coupler --------------------------------------------------------------------------- */

/* The last row written by an interval up to macro step `end`, with `levels` time levels in a macro
 * step. */
static size_t last_row(const pma_record *record, int64_t end, size_t levels)
{
    if (record->ring)
        return (size_t)record->ring->size * (record->every == 0 ? levels : 1);
    if (record->every == 0) {
        const size_t steps = (size_t)(end - record->begin);
        return steps > SIZE_MAX / levels ? SIZE_MAX : steps * levels;
    }
    return (size_t)(end / record->every - record->begin / record->every);
}

static pma_status take_members(CouplerObject *self, const pma_field *f, int64_t end,
                               pma_record *record)
{
    const size_t own = (size_t)PyTuple_Size(self->subdomains);
    const size_t lanes = own > 0 && pma_subdomain_of(self, 0)->of ? PMA_LANES : 1;
    const size_t first = pma_processes_first(self->processes);
    const size_t all = pma_processes_count(self->processes, own);
    size_t count;
    PMA_TRY(pma_field_tuple(f, &count));
    if (count != own)
        return pma_field_refuse(f, "must have one for each subdomain");
    PMA_TRY(pma_field_allocate(f, all * lanes, sizeof(pma_selection), (void *)&record->selections));
    for (size_t i = 0; i < own; i++) {
        const SubdomainObject *s = pma_subdomain_of(self, (Py_ssize_t)i);
        const size_t last = last_row(record, end, pma_subdomain_parts(s->core)->substeps);
        const pma_field item = pma_field_item(f, i);
        PMA_TRY(take_selections(&item, s, last, &record->selections[first + i],
                                record->selections + all + i * (lanes - 1)));
    }
    return PMA_OK;
}

/* None or {impulse, gap}: rows of contacts */
static pma_status take_contacts(CouplerObject *self, const pma_field *f, size_t last,
                                pma_record *record)
{
    size_t rows;
    int64_t count = -1;
    if (pma_field_is_none(f))
        return PMA_OK;
    (void)pma_coupler_contact_compliance(self->core, true, &rows);
    PMA_TRY(pma_field_dict(f));
    if (rows == 0)
        return pma_field_refuse(f, "must be of a coupler with contacts");
    PMA_TRY(take_rows(f, "impulse", &count, rows, &record->contact_impulse));
    PMA_TRY(take_rows(f, "gap", &count, pma_coupler_contacts(self->core), &record->contact_gap));
    return check_rows(f, count, last);
}

static pma_status take_interface(CouplerObject *self, const pma_field *f, int64_t end,
                                 pma_record *record)
{
    const size_t p = pma_coupler_get_parts(self->core)->p;
    const size_t fine = pma_coupler_instants(self->core);
    int64_t rows = -1, macro_rows = -1;
    PMA_TRY(take_rows(f, "multipliers", &rows, p, &record->multipliers));
    PMA_TRY(take_rows(f, "velocity_jump", &rows, p, &record->velocity_jump));
    PMA_TRY(take_rows(f, "displacement_jump", &macro_rows, p, &record->displacement_jump));
    PMA_TRY(check_rows(f, rows, last_row(record, end, fine)));
    return check_rows(f, macro_rows, last_row(record, end, 1));
}

/* None or an array (rows, subdomains, PMA_ENERGIES), if all subdomains sum their works */
static pma_status take_energy(CouplerObject *self, const pma_field *f, size_t last,
                              pma_record *record)
{
    int64_t extents[3] = {-1, PyTuple_Size(self->subdomains), PMA_ENERGIES};
    if (pma_field_is_none(f))
        return PMA_OK;
    PMA_TRY(pma_field_output(f, 3, extents, &record->energy));
    for (Py_ssize_t i = 0; i < PyTuple_Size(self->subdomains); i++) {
        if (!pma_subdomain_energy(pma_subdomain_of(self, i)->core))
            return pma_field_refuse(f, "needs begin_energy of all subdomains");
    }
    return check_rows(f, extents[0], last);
}

static pma_status take_record(CouplerObject *self, const pma_field *f, int64_t end,
                              pma_record *record)
{
    const pma_field begin = pma_field_at(f, "begin"), every = pma_field_at(f, "every");
    const pma_field selections = pma_field_at(f, "selections"), energy = pma_field_at(f, "energy");
    const pma_field contacts = pma_field_at(f, "contacts");
    *record = (pma_record){.ring = self->slots ? &self->ring : NULL};
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_integer(&begin, 0, &record->begin));
    PMA_TRY(pma_field_integer(&every, 0, &record->every));
    if (record->begin > pma_coupler_step_count(self->core))
        return pma_field_refuse(&begin, "must not be after the present");
    PMA_TRY(take_members(self, &selections, end, record));
    PMA_TRY(take_energy(self, &energy, last_row(record, end, 1), record));
    PMA_TRY(take_contacts(self, &contacts, last_row(record, end, pma_coupler_instants(self->core)),
                          record));
    return take_interface(self, f, end, record);
}

int pma_take_record(CouplerObject *self, PyObject *obj, int64_t end, PyObject *arrays,
                    pma_record *record)
{
    pma_argument arg;
    const pma_field root = pma_read(&arg, obj, "record", arrays);
    return pma_end(&arg, take_record(self, &root, end, record));
}
