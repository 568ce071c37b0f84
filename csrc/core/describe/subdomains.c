/* A whole subdomain from its fields. */
#include "describe/describe.h"

static pma_status take_step(const pma_field *f, pma_step *out)
{
    const struct {
        const char *name;
        double *to;
    } constants[] = {{"h", &out->h},      {"al1", &out->al1}, {"al2", &out->al2},
                     {"u_a", &out->u_a},  {"u_w", &out->u_w}, {"v_a", &out->v_a},
                     {"v_w", &out->v_w},  {"a_a", &out->a_a}, {"a_w", &out->a_w},
                     {"a_w1", &out->a_w1}};
    PMA_TRY(pma_field_dict(f));
    for (size_t i = 0; i < sizeof constants / sizeof *constants; i++) {
        const pma_field constant = pma_field_at(f, constants[i].name);
        PMA_TRY(pma_field_real(&constant, constants[i].to));
    }
    return PMA_OK;
}

/* {step, inverse, R}; without the factor of an iterated subdomain, which follows its tangents */
static pma_status take_operator(const pma_field *f, const pma_parts *parts, pma_operator *out)
{
    const pma_field step = pma_field_at(f, "step");
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(take_step(&step, &out->step));
    return parts->iterate ? PMA_OK : pma_parts_factor(f, parts->n, parts->nb, &out->factor);
}

static pma_status take_operators(const pma_field *f, pma_parts *parts)
{
    const pma_field single = pma_field_at(f, "single"), twice = pma_field_at(f, "twice");
    const pma_field second = pma_field_at(f, "second");
    PMA_TRY(take_operator(&single, parts, &parts->single));
    parts->staged = !pma_field_is_none(&second);
    if (parts->staged)
        PMA_TRY(take_step(&second, &parts->second));
    return parts->doubled ? take_operator(&twice, parts, &parts->twice) : PMA_OK;
}

static pma_status take_sizes(const pma_field *f, pma_parts *parts)
{
    const pma_field n = pma_field_at(f, "n"), nb = pma_field_at(f, "nb");
    const pma_field substeps = pma_field_at(f, "substeps");
    PMA_TRY(pma_field_count(&n, 1, &parts->n));
    PMA_TRY(pma_field_count(&nb, 0, &parts->nb));
    PMA_TRY(pma_field_count(&substeps, 1, &parts->substeps));
    PMA_TRY(pma_field_room(&substeps, parts->substeps, parts->n * sizeof(double)));
    return parts->nb > parts->n ? pma_field_refuse(&nb, "must not exceed n") : PMA_OK;
}

static pma_status take_flags(const pma_field *f, pma_parts *parts)
{
    const pma_field lagged = pma_field_at(f, "lagged"), responds = pma_field_at(f, "has_responses");
    const pma_field deferred = pma_field_at(f, "deferred"),
                    continues = pma_field_at(f, "continues");
    PMA_TRY(pma_field_flag(&lagged, &parts->lagged));
    PMA_TRY(pma_field_flag(&responds, &parts->has_responses));
    PMA_TRY(pma_field_flag(&deferred, &parts->deferred));
    return pma_field_flag(&continues, &parts->continues);
}

static pma_status take_matrices(const pma_field *f, pma_parts *parts)
{
    const pma_field K = pma_field_at(f, "K"), C = pma_field_at(f, "C"), M = pma_field_at(f, "M");
    const pma_field K_r = pma_field_at(f, "K_r"), D_r = pma_field_at(f, "D_r");
    PMA_TRY(pma_parts_matrix(&K, parts->n, &parts->K));
    PMA_TRY(pma_parts_matrix(&C, parts->n, &parts->C));
    PMA_TRY(pma_parts_matrix(&D_r, parts->n, &parts->D_r));
    PMA_TRY(pma_parts_matrix(&K_r, parts->n, &parts->K_r));
    return pma_parts_matrix(&M, parts->n, &parts->M);
}

/* Of the constraints that reach an iterated subdomain: blocks of all pairs, and columns of nb. */
static pma_status take_room_of_constraints(const pma_field *f, const pma_parts *parts)
{
    const pma_link *L = &parts->link;
    const int64_t entries = L->ptr[L->nb];
    const size_t most = entries > 0 ? (size_t)entries : 0, count = most < L->p ? most : L->p;
    return pma_field_room(f, count, (2 * count + 4 * parts->nb) * sizeof(double));
}

static pma_status take_iterate(const pma_field *f, pma_subdomain_taken *out)
{
    const pma_field springs = pma_field_at(f, "springs"), keeps = pma_field_at(f, "keeps");
    const pma_field pattern = pma_field_at(f, "pattern"), M_size = pma_field_at(f, "M_size");
    const pma_field base = pma_field_at(f, "base"), twice = pma_field_at(f, "base_twice");
    const pma_field threads = pma_field_at(f, "threads");
    const pma_parts *parts = &out->parts;
    pma_iterate_parts *it = &out->iterate;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_flag(&springs, &it->springs));
    PMA_TRY(pma_field_flag(&keeps, &it->keeps));
    PMA_TRY(pma_field_count(&threads, 1, &out->threads));
    PMA_TRY(pma_parts_numeric(&pattern, parts->n, parts->nb, &it->tangent));
    const size_t entries = (size_t)it->tangent.ptr[parts->n];
    PMA_TRY(pma_field_doubles(&base, entries, &it->base));
    PMA_TRY(pma_parts_matrix(&M_size, parts->n, &it->M_size));
    PMA_TRY(take_room_of_constraints(f, parts));
    return parts->doubled ? pma_field_doubles(&twice, entries, &it->base_twice) : PMA_OK;
}

/* ---- what it is given once it is made ------------------------------------------------------- */

static pma_status take_limit(const pma_field *f, const char *name, size_t n, const double **out)
{
    const pma_field limit = pma_field_at(f, name);
    return pma_field_is_none(&limit) ? PMA_OK : pma_field_doubles(&limit, n, out);
}

static pma_status take_limits(const pma_field *f, const pma_parts *parts, pma_limits_parts *out)
{
    const pma_field energy = pma_field_at(f, "energy");
    *out = (pma_limits_parts){.n = parts->n, .h = parts->single.step.h};
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(take_limit(f, "displacement", parts->n, &out->displacement));
    PMA_TRY(take_limit(f, "velocity", parts->n, &out->velocity));
    PMA_TRY(take_limit(f, "acceleration", parts->n, &out->acceleration));
    PMA_TRY(take_limit(f, "force", parts->n, &out->force));
    return pma_field_real(&energy, &out->energy);
}

static pma_status take_watch(const pma_field *f, size_t n, pma_subdomain_taken *out)
{
    const pma_field M = pma_field_at(f, "M"), K_r = pma_field_at(f, "K_r");
    const pma_field is_explicit = pma_field_at(f, "is_explicit");
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_flag(&is_explicit, &out->watched_explicit));
    PMA_TRY(pma_parts_matrix(&M, n, &out->watched_M));
    return pma_parts_matrix(&K_r, n, &out->watched_K_r);
}

pma_status pma_parts_responses(const pma_field *f, const pma_parts *parts, pma_unit_responses *out)
{
    const pma_field rows = pma_field_at(f, "rows"), states = pma_field_at(f, "states");
    const void *data = NULL;
    PMA_TRY(pma_field_dict(f));
    if (!parts->has_responses)
        return pma_field_refuse(f, "must be of a subdomain that has them");
    PMA_TRY(pma_field_positions(&rows, parts->link.p, &out->count, &out->rows));
    int64_t extents[3] = {(int64_t)out->count, 4, (int64_t)parts->n};
    PMA_TRY(pma_field_array(&states, PMA_DOUBLES, 3, extents, &data));
    out->values = data;
    return PMA_OK;
}

static pma_status take_additions(const pma_field *f, pma_subdomain_taken *out)
{
    const pma_field limits = pma_field_at(f, "limits"), watch = pma_field_at(f, "watch");
    const pma_field responses = pma_field_at(f, "responses"), load = pma_field_at(f, "load");
    const pma_parts *parts = &out->parts;
    out->is_limited = !pma_field_is_none(&limits);
    out->is_watched = !pma_field_is_none(&watch);
    if (out->is_limited)
        PMA_TRY(take_limits(&limits, parts, &out->limits));
    if (out->is_watched)
        PMA_TRY(take_watch(&watch, parts->n, out));
    if (!pma_field_is_none(&responses))
        PMA_TRY(pma_parts_responses(&responses, parts, &out->responses));
    return pma_parts_load(&load, parts->n, &out->load);
}

static pma_status add(const pma_subdomain_taken *taken, pma_subdomain *s)
{
    if (taken->is_limited)
        PMA_TRY(pma_subdomain_limit(s, &taken->limits));
    if (taken->is_watched)
        PMA_TRY(
            pma_subdomain_watch(s, taken->watched_M, taken->watched_K_r, taken->watched_explicit));
    if (taken->responses.count > 0)
        pma_response_store(pma_subdomain_response(s), taken->responses);
    pma_subdomain_set_load(s, taken->load);
    return PMA_OK;
}

pma_status pma_parts_make_subdomain(const pma_subdomain_taken *taken, pma_subdomain **out)
{
    PMA_TRY(pma_subdomain_create(&taken->parts, out));
    const pma_status status = add(taken, *out);
    if (status != PMA_OK) {
        pma_subdomain_destroy(*out);
        *out = NULL;
    }
    return status;
}

/* ---- all of it ------------------------------------------------------------------------------ */

pma_status pma_parts_subdomain(const pma_field *f, pma_subdomain_taken *out)
{
    const pma_field twice = pma_field_at(f, "twice"), link = pma_field_at(f, "link");
    const pma_field restoring = pma_field_at(f, "restoring"), springs = pma_field_at(f, "springs");
    const pma_field internal = pma_field_at(f, "internal"), iterate = pma_field_at(f, "iterate");
    const pma_field mass = pma_field_at(f, "mass"), impulse = pma_field_at(f, "impulse");
    pma_parts *parts = &out->parts;
    *out = (pma_subdomain_taken){.threads = 1};
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(take_sizes(f, parts));
    PMA_TRY(take_flags(f, parts));
    parts->doubled = !pma_field_is_none(&twice);
    parts->has_internal = pma_field_has(f, "M");
    parts->mean = !pma_field_is_none(&mass);
    PMA_TRY(take_matrices(f, parts));
    PMA_TRY(pma_parts_link(&link, parts->nb, &parts->link));
    PMA_TRY(pma_parts_restoring(&restoring, parts->n, &parts->restoring));
    PMA_TRY(pma_parts_springs(&springs, &parts->springs));
    PMA_TRY(pma_parts_internal(&internal, parts->n, &parts->internal));
    PMA_TRY(pma_parts_impulse(&impulse, parts->nb, &parts->impulse));
    if (!pma_field_is_none(&iterate)) {
        PMA_TRY(take_iterate(&iterate, out));
        parts->iterate = &out->iterate;
    }
    if (parts->mean)
        PMA_TRY(pma_parts_factor(&mass, parts->n, parts->nb, &parts->mass));
    PMA_TRY(take_operators(f, parts));
    return take_additions(f, out);
}
