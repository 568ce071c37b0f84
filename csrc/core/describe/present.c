/* What is of the present, from its fields. */
#include <math.h>
#include <string.h>

#include "describe/describe.h"
#include "text.h"

/* A count with all of its digits. */
static void add_number(pma_text *text, double x)
{
    if (fabs(x) < 1e15 && x == floor(x))
        pma_text_integer(text, (int64_t)x);
    else
        pma_text_real(text, x);
}

static pma_status take_array(const pma_field *f, const pma_state_array *array, const double **out)
{
    char reason[96];
    double most;
    PMA_TRY(pma_field_doubles(f, array->count, out));
    const double *wrong = pma_state_wrong_count(array, *out, &most);
    if (!wrong)
        return PMA_OK;
    pma_text text = pma_text_begin(reason, sizeof reason);
    pma_text_word(&text, "must have a whole number in 0..");
    add_number(&text, most);
    pma_text_word(&text, " at ");
    pma_text_integer(&text, wrong - *out);
    pma_text_word(&text, ", got ");
    add_number(&text, *wrong);
    return pma_field_refuse(f, reason);
}

pma_status pma_parts_check_arrays(const pma_field *f, const pma_state_array *arrays, size_t count)
{
    const double *values = NULL;
    PMA_TRY(pma_field_dict(f));
    if (pma_field_entries(f) != count)
        return pma_field_refuse(f, "must have the arrays of the state, and no others");
    for (size_t i = 0; i < count; i++) {
        const pma_field array = pma_field_at(f, arrays[i].name);
        PMA_TRY(take_array(&array, &arrays[i], &values));
    }
    return PMA_OK;
}

pma_status pma_parts_arrays(const pma_field *f, const pma_state_array *arrays, size_t count)
{
    const double *values = NULL;
    PMA_TRY(pma_parts_check_arrays(f, arrays, count));
    for (size_t i = 0; i < count; i++) {
        const pma_field array = pma_field_at(f, arrays[i].name);
        PMA_TRY(pma_field_doubles(&array, arrays[i].count, &values));
        memmove(arrays[i].values, values, arrays[i].count * sizeof *values);
    }
    return PMA_OK;
}

pma_status pma_parts_kept(const pma_field *f, const pma_iterate *it, pma_kept_iteration *out)
{
    const pma_field scale = pma_field_at(f, "scale"), twice = pma_field_at(f, "twice");
    const pma_field entries = pma_field_at(f, "entries");
    *out = (pma_kept_iteration){.entries = NULL};
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_real(&scale, &out->scale));
    PMA_TRY(pma_field_flag(&twice, &out->twice));
    return pma_field_is_none(&entries)
               ? PMA_OK
               : pma_field_doubles(&entries, pma_iterate_entries(it), &out->entries);
}
