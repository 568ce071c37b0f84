/* Springs from their fields. */
#include "describe/describe.h"
#include "forces/laws.h"

/* As many elements as there are parameters for; false where these do not fit. */
static bool take_elements(size_t law, size_t count, pma_spring_set *set)
{
    const size_t own = pma_laws[law].parameters, each = pma_laws[law].each_parameters;
    set->law = (pma_spring_law)law;
    set->elements = each > 0 && count > own ? (count - own) / each : 0;
    return count <= PMA_SPRING_PARAMETERS && pma_spring_parameters(set) == count;
}

static pma_status take_set(const pma_field *f, pma_spring_set *set)
{
    const pma_field law = pma_field_at(f, "law"), parameters = pma_field_at(f, "parameters");
    const pma_field first = pma_field_at(f, "first"), second = pma_field_at(f, "second");
    const void *data = NULL;
    size_t number, count;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_count(&law, 0, &number));
    PMA_TRY(pma_field_vector(&first, PMA_INT32S, &set->count, &data));
    set->first = data;
    PMA_TRY(pma_field_ints(&second, set->count, &set->second));
    PMA_TRY(pma_field_tuple(&parameters, &count));
    if (number >= PMA_SPRING_LAWS || !take_elements(number, count, set))
        return pma_field_refuse(&parameters, "must be as many as the law has");
    for (size_t k = 0; k < count; k++) {
        const pma_field parameter = pma_field_item(&parameters, k);
        PMA_TRY(pma_field_doubles(&parameter, set->count, &set->parameters[k]));
    }
    return PMA_OK;
}

pma_status pma_parts_springs(const pma_field *f, pma_springs *out)
{
    pma_spring_set *sets;
    *out = (pma_springs){.count = 0};
    if (pma_field_is_none(f))
        return PMA_OK;
    PMA_TRY(pma_field_tuple(f, &out->count));
    PMA_TRY(pma_field_allocate(f, out->count, sizeof *sets, (void *)&sets));
    out->sets = sets;
    for (size_t i = 0; i < out->count; i++) {
        const pma_field set = pma_field_item(f, i);
        PMA_TRY(take_set(&set, &sets[i]));
        out->total += sets[i].count;
    }
    return PMA_OK;
}
