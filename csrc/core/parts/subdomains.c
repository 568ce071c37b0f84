/* A whole subdomain from its fields. */
#include "parts/parts.h"

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
    PMA_TRY(take_operator(&single, parts, &parts->single));
    return parts->doubled ? take_operator(&twice, parts, &parts->twice) : PMA_OK;
}

static pma_status take_sizes(const pma_field *f, pma_parts *parts)
{
    const pma_field n = pma_field_at(f, "n"), nb = pma_field_at(f, "nb");
    const pma_field substeps = pma_field_at(f, "substeps");
    PMA_TRY(pma_field_count(&n, 1, &parts->n));
    PMA_TRY(pma_field_count(&nb, 0, &parts->nb));
    PMA_TRY(pma_field_count(&substeps, 1, &parts->substeps));
    return parts->nb > parts->n ? pma_field_refuse(&nb, "must not exceed n") : PMA_OK;
}

static pma_status take_flags(const pma_field *f, pma_parts *parts)
{
    const pma_field lagged = pma_field_at(f, "lagged"), responds = pma_field_at(f, "has_responses");
    const pma_field defers = pma_field_at(f, "defers"), continues = pma_field_at(f, "continues");
    PMA_TRY(pma_field_flag(&lagged, &parts->lagged));
    PMA_TRY(pma_field_flag(&responds, &parts->has_responses));
    PMA_TRY(pma_field_flag(&defers, &parts->defers));
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
    return parts->doubled ? pma_field_doubles(&twice, entries, &it->base_twice) : PMA_OK;
}

pma_status pma_parts_subdomain(const pma_field *f, pma_subdomain_taken *out)
{
    const pma_field twice = pma_field_at(f, "twice"), link = pma_field_at(f, "link");
    const pma_field restoring = pma_field_at(f, "restoring"), springs = pma_field_at(f, "springs");
    const pma_field internal = pma_field_at(f, "internal"), iterate = pma_field_at(f, "iterate");
    const pma_field mass = pma_field_at(f, "mass"), struck = pma_field_at(f, "struck");
    pma_parts *parts = &out->parts;
    *out = (pma_subdomain_taken){.threads = 1};
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(take_sizes(f, parts));
    PMA_TRY(take_flags(f, parts));
    parts->doubled = !pma_field_is_none(&twice);
    parts->shoots = pma_field_has(f, "M");
    parts->mean = !pma_field_is_none(&mass);
    PMA_TRY(take_matrices(f, parts));
    PMA_TRY(pma_parts_link(&link, parts->nb, &parts->link));
    PMA_TRY(pma_parts_restoring(&restoring, parts->n, &parts->restoring));
    PMA_TRY(pma_parts_springs(&springs, &parts->springs));
    PMA_TRY(pma_parts_internal(&internal, parts->n, &parts->internal));
    PMA_TRY(pma_parts_struck(&struck, parts->nb, &parts->struck));
    if (!pma_field_is_none(&iterate)) {
        PMA_TRY(take_iterate(&iterate, out));
        parts->iterate = &out->iterate;
    }
    if (parts->mean)
        PMA_TRY(pma_parts_factor(&mass, parts->n, parts->nb, &parts->mass));
    return take_operators(f, parts);
}
