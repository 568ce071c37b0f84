/* What a coupler is made of, besides its members, from its fields. */
#include "describe/describe.h"

/* ---- options and motions -------------------------------------------------------------------- */

static const struct {
    const char *word;
    const pma_schedule *schedule;
} SCHEDULES[] = {{"fine", &pma_fine_schedule},      {"iterated", &pma_iterated_schedule},
                 {"macro", &pma_macro_schedule},    {"shooting", &pma_shooting_schedule},
                 {"mean", &pma_mean_schedule},      {"mean shooting", &pma_mean_shooting_schedule},
                 {"contact", &pma_contact_schedule}};

static pma_status take_schedule(const pma_field *f, const pma_schedule **out)
{
    for (size_t i = 0; i < sizeof SCHEDULES / sizeof *SCHEDULES; i++) {
        if (pma_field_is_word(f, SCHEDULES[i].word)) {
            *out = SCHEDULES[i].schedule;
            return PMA_OK;
        }
    }
    return pma_field_refuse(f, "must be that of some coupling");
}

static pma_status take_option(const pma_field *f, const pma_option *option, pma_coupler_parts *to)
{
    char *at = (char *)to + option->at;
    if (option->kind == PMA_NUMBER)
        return pma_field_real(f, (double *)(void *)at);
    if (option->kind == PMA_COUNT)
        return pma_field_count(f, 0, (size_t *)(void *)at);
    return pma_field_flag(f, (bool *)(void *)at);
}

/* What is not there is zero. */
static pma_status take_options(const pma_field *f, pma_coupler_parts *out)
{
    const size_t count = sizeof PMA_COUPLER_OPTIONS / sizeof *PMA_COUPLER_OPTIONS;
    size_t found = 0;
    PMA_TRY(pma_field_dict(f));
    for (size_t i = 0; i < count; i++) {
        const pma_field option = pma_field_at(f, PMA_COUPLER_OPTIONS[i].name);
        found += pma_field_has(f, PMA_COUPLER_OPTIONS[i].name);
        if (!pma_field_is_none(&option))
            PMA_TRY(take_option(&option, &PMA_COUPLER_OPTIONS[i], out));
    }
    return found == pma_field_entries(f) ? PMA_OK
                                         : pma_field_refuse(f, "must be those of the core");
}

static pma_status take_motion(const pma_field *f, pma_motion *out)
{
    const pma_field rows = pma_field_at(f, "rows"), velocity = pma_field_at(f, "velocity");
    const void *data = NULL;
    size_t count;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_vector(&rows, PMA_INT64S, &count, &data));
    out->rows = data;
    PMA_TRY(pma_parts_load(&velocity, count, &out->load));
    return pma_load_has(&out->load, PMA_LOAD_CALLED)
               ? pma_field_refuse(&velocity, "must not be a compiled function")
               : PMA_OK;
}

static pma_status take_motions(const pma_field *f, pma_coupler_parts *out)
{
    pma_motion *motions;
    PMA_TRY(pma_field_tuple(f, &out->motion_count));
    PMA_TRY(pma_field_allocate(f, out->motion_count, sizeof *motions, (void *)&motions));
    out->motions = motions;
    for (size_t i = 0; i < out->motion_count; i++) {
        const pma_field motion = pma_field_item(f, i);
        PMA_TRY(take_motion(&motion, &motions[i]));
    }
    return PMA_OK;
}

/* ---- iteration ------------------------------------------------------------------------------ */

/* {response_start, response, H_size}: responses to multipliers that are linear over a macro step */
static pma_status take_responses(const pma_field *f, size_t p, pma_iteration_parts *out)
{
    const pma_field start = pma_field_at(f, "response_start"), later = pma_field_at(f, "response");
    const pma_field size = pma_field_at(f, "H_size");
    PMA_TRY(pma_parts_matrix(&start, p, &out->response_start));
    PMA_TRY(pma_parts_matrix(&later, p, &out->response));
    return pma_parts_matrix(&size, p, &out->H_size);
}

/* {pattern, start, later}: the constant part of H */
static pma_status take_constant_part(const pma_field *f, size_t p, pma_iteration_parts *out)
{
    const pma_field pattern = pma_field_at(f, "pattern"), start = pma_field_at(f, "start");
    const pma_field later = pma_field_at(f, "later");
    PMA_TRY(pma_parts_numeric(&pattern, p, p, &out->H));
    PMA_TRY(pma_field_doubles(&start, (size_t)out->H.ptr[p], &out->start));
    return pma_field_doubles(&later, (size_t)out->H.ptr[p], &out->later);
}

/* With a schedule that iterates, and no other */
static pma_status take_iteration(const pma_field *f, pma_coupler_taken *out)
{
    const pma_field tolerance = pma_field_at(f, "tolerance"), reuse = pma_field_at(f, "reuse");
    const pma_field iterations = pma_field_at(f, "iterations");
    const pma_schedule *schedule = out->parts.schedule;
    const bool shooting =
        schedule == &pma_shooting_schedule || schedule == &pma_mean_shooting_schedule;
    pma_iteration_parts *it = &out->iteration;
    if (pma_field_is_none(f) == (shooting || schedule == &pma_iterated_schedule))
        return pma_field_refuse(f, "must be given to a schedule that iterates, and no other");
    if (pma_field_is_none(f))
        return PMA_OK;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_real(&tolerance, &it->newton.tolerance));
    PMA_TRY(pma_field_count(&iterations, 1, &it->newton.iterations));
    PMA_TRY(pma_field_flag(&reuse, &it->newton.reuse));
    if (!(it->newton.tolerance > 0.0))
        return pma_field_refuse(&tolerance, "must be positive");
    if (it->newton.iterations > PMA_MOST_ITERATIONS)
        return pma_field_refuse(&iterations, "is too large");
    out->parts.iteration = it;
    return shooting ? take_responses(f, out->parts.p, it) : take_constant_part(f, out->parts.p, it);
}

/* ---- contacts ------------------------------------------------------------------------------- */

/* {member, N}, N as link with `rows` rows on the interface dofs of the member */
static pma_status take_side(const pma_field *f, const pma_members *members, size_t rows,
                            pma_contact_side *out)
{
    const pma_field member = pma_field_at(f, "member"), N = pma_field_at(f, "N");
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_count(&member, 0, &out->member));
    if (out->member >= members->count)
        return pma_field_refuse(&member, "is no subdomain");
    PMA_TRY(pma_parts_link(&N, members->nb(members->of, out->member), &out->N));
    return out->N.p == rows ? PMA_OK : pma_field_refuse(&N, "has other rows than the contacts");
}

/* Square ones of all rows of contacts: two, and a factor. */
enum { MATRICES = 3 };

/* With the schedule of contacts, and no other */
static pma_status take_contact(const pma_field *f, const pma_members *members,
                               pma_coupler_taken *out)
{
    const pma_field first = pma_field_at(f, "first"), gap = pma_field_at(f, "gap");
    const pma_field restitution = pma_field_at(f, "restitution");
    const pma_field friction = pma_field_at(f, "friction"), sides = pma_field_at(f, "sides");
    const pma_field friction_static = pma_field_at(f, "friction_static");
    const pma_field obstacle = pma_field_at(f, "obstacle");
    pma_contact_parts *contact = &out->contact;
    pma_contact_side *side;
    const void *data = NULL;
    size_t starts;
    if (pma_field_is_none(f) == (out->parts.schedule == &pma_contact_schedule))
        return pma_field_refuse(f, "must be given to the schedule of contacts, and no other");
    if (pma_field_is_none(f))
        return PMA_OK;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_vector(&first, PMA_INT64S, &starts, &data));
    if (starts < 2)
        return pma_field_refuse(&first, "must have at least two numbers");
    contact->first = data;
    contact->contacts = starts - 1;
    const int64_t last = contact->first[contact->contacts];
    const size_t rows = last > 0 ? (size_t)last : 0;
    PMA_TRY(pma_field_room(&first, rows, sizeof(double)));
    PMA_TRY(pma_field_room(&first, rows, MATRICES * rows * sizeof(double)));
    PMA_TRY(pma_field_doubles(&gap, contact->contacts, &contact->gap));
    PMA_TRY(pma_field_doubles(&restitution, contact->contacts, &contact->restitution));
    PMA_TRY(pma_field_doubles(&friction, contact->contacts, &contact->friction));
    PMA_TRY(pma_field_doubles(&friction_static, contact->contacts, &contact->friction_static));
    PMA_TRY(pma_parts_blas(f, &contact->blas));
    PMA_TRY(pma_parts_load(&obstacle, 2 * contact->contacts, &contact->obstacle));
    if (pma_load_has(&contact->obstacle, PMA_LOAD_CALLED))
        return pma_field_refuse(&obstacle, "must not be a compiled function");
    PMA_TRY(pma_field_tuple(&sides, &contact->sides));
    PMA_TRY(pma_field_allocate(f, contact->sides, sizeof *side, (void *)&side));
    contact->side = side;
    for (size_t i = 0; i < contact->sides; i++) {
        const pma_field item = pma_field_item(&sides, i);
        PMA_TRY(take_side(&item, members, (size_t)contact->first[contact->contacts], &side[i]));
    }
    out->parts.contact = contact;
    return PMA_OK;
}

/* ---- all of it ------------------------------------------------------------------------------ */

pma_status pma_parts_coupler(const pma_field *f, const pma_members *members, pma_coupler_taken *out)
{
    const pma_field options = pma_field_at(f, "options"), motions = pma_field_at(f, "motions");
    const pma_field schedule = pma_field_at(f, "schedule"), p = pma_field_at(f, "p");
    const pma_field iteration = pma_field_at(f, "iteration"), contact = pma_field_at(f, "contact");
    const pma_field H_start = pma_field_at(f, "H_start"), H = pma_field_at(f, "H");
    const pma_field doubled = pma_field_at(f, "doubled");
    pma_coupler_parts *parts = &out->parts;
    *out = (pma_coupler_taken){.parts = {.p = 0}};
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_count(&p, 0, &parts->p));
    PMA_TRY(take_options(&options, parts));
    PMA_TRY(take_schedule(&schedule, &parts->schedule));
    PMA_TRY(pma_parts_factor(&H_start, parts->p, parts->p, &out->H_start));
    PMA_TRY(pma_parts_factor(&H, parts->p, parts->p, &out->H));
    PMA_TRY(take_motions(&motions, parts));
    if (pma_field_has(f, "doubled"))
        PMA_TRY(pma_parts_matrix(&doubled, parts->p, &parts->doubled));
    PMA_TRY(take_iteration(&iteration, out));
    return take_contact(&contact, members, out);
}
