#include "describe/field.h"

#include <string.h>

#include "text.h"

static const pma_node NONE = {.kind = PMA_NONE};
static const char *const KINDS[] = {"None",
                                    "a whole number",
                                    "a number",
                                    "a word",
                                    "a tuple",
                                    "a dict",
                                    "an array of float64",
                                    "an array of int64",
                                    "an array of int32",
                                    "another object"};

pma_field pma_field_root(pma_fields *fields, const char *name)
{
    return (pma_field){fields, fields->nodes, name, NULL};
}

/* ---- children ------------------------------------------------------------------------------- */

static bool is_word(const pma_fields *t, const pma_node *node, const char *word)
{
    const size_t length = strlen(word);
    return node->kind == PMA_WORD && (uint64_t)node->extent[0] == length &&
           memcmp((const void *)(t->base + (uintptr_t)node->is.at), word, length) == 0;
}

bool pma_field_is_word(const pma_field *f, const char *word)
{
    return is_word(f->fields, f->node, word);
}

size_t pma_field_entries(const pma_field *f)
{
    return f->node->kind == PMA_DICT ? (size_t)f->node->extent[0] / 2 : 0;
}

static const pma_node *find_key(const pma_field *of, const char *key)
{
    const pma_fields *t = of->fields;
    if (of->node->kind != PMA_DICT)
        return NULL;
    const pma_node *child = t->nodes + of->node->is.at;
    for (int64_t i = 0; i + 1 < of->node->extent[0]; i += 2) {
        if (is_word(t, &child[i], key))
            return &child[i + 1];
    }
    return NULL;
}

pma_field pma_field_at(const pma_field *of, const char *key)
{
    const pma_node *found = find_key(of, key);
    return (pma_field){of->fields, found ? found : &NONE, key, of};
}

bool pma_field_has(const pma_field *of, const char *key)
{
    return find_key(of, key) != NULL;
}

pma_field pma_field_item(const pma_field *of, size_t i)
{
    return (pma_field){of->fields, of->fields->nodes + of->node->is.at + i, NULL, of};
}

/* ---- refusals ------------------------------------------------------------------------------- */

/* The path of a field, as in "single.R.ptr" or "springs[2].first". */
static void write_path(const pma_field *f, pma_text *text)
{
    const bool is_inner = f->of && (f->of->of || f->of->name);
    if (f->of)
        write_path(f->of, text);
    if (f->name) {
        pma_text_word(text, is_inner ? "." : "");
        pma_text_word(text, f->name);
    } else if (f->of) {
        pma_text_word(text, "[");
        pma_text_integer(text, f->node - (f->fields->nodes + f->of->node->is.at));
        pma_text_word(text, "]");
    }
}

static pma_text begin_refusal(const pma_field *f, bool of_type)
{
    pma_fields *t = f->fields;
    pma_text text = pma_text_begin(t->refusal, sizeof t->refusal);
    t->wrong_type = of_type;
    write_path(f, &text);
    return text;
}

pma_status pma_field_refuse(const pma_field *f, const char *reason)
{
    pma_text text = begin_refusal(f, false);
    pma_text_word(&text, " ");
    pma_text_word(&text, reason);
    return PMA_REFUSED;
}

/* Of its type, for what is wanted instead. */
static pma_status refuse_type(const pma_field *f, const char *wanted, const char *more)
{
    pma_text text = begin_refusal(f, true);
    pma_text_word(&text, " must be ");
    pma_text_word(&text, wanted);
    pma_text_word(&text, more);
    pma_text_word(&text, ", got ");
    pma_text_word(&text, KINDS[f->node->kind]);
    return PMA_REFUSED;
}

/* Of a number, for that which is wanted. */
static pma_status refuse_number(const pma_field *f, const char *rule, int64_t wanted,
                                const char *more, int64_t got)
{
    pma_text text = begin_refusal(f, false);
    pma_text_word(&text, rule);
    pma_text_integer(&text, wanted);
    pma_text_word(&text, more);
    pma_text_word(&text, ", got ");
    pma_text_integer(&text, got);
    return PMA_REFUSED;
}

/* ---- numbers -------------------------------------------------------------------------------- */

pma_status pma_field_dict(const pma_field *f)
{
    return f->node->kind == PMA_DICT ? PMA_OK : refuse_type(f, "a dict", "");
}

pma_status pma_field_tuple(const pma_field *f, size_t *count)
{
    if (f->node->kind != PMA_TUPLE)
        return refuse_type(f, "a tuple", "");
    *count = (size_t)f->node->extent[0];
    return PMA_OK;
}

pma_status pma_field_integer(const pma_field *f, int64_t least, int64_t *out)
{
    if (f->node->kind != PMA_INTEGER)
        return refuse_type(f, "a whole number", "");
    *out = f->node->is.integer;
    return *out >= least ? PMA_OK : refuse_number(f, " must be at least ", least, "", *out);
}

pma_status pma_field_count(const pma_field *f, size_t least, size_t *out)
{
    int64_t number = 0;
    PMA_TRY(pma_field_integer(f, (int64_t)least, &number));
    *out = (size_t)number;
    if ((uint64_t)number > SIZE_MAX)
        return pma_field_refuse(f, "is too large");
    return PMA_OK;
}

pma_status pma_field_flag(const pma_field *f, bool *out)
{
    *out = f->node->kind == PMA_INTEGER && f->node->is.integer != 0;
    return f->node->kind == PMA_INTEGER || pma_field_is_none(f) ? PMA_OK
                                                                : refuse_type(f, "a flag", "");
}

pma_status pma_field_real(const pma_field *f, double *out)
{
    if (f->node->kind != PMA_REAL && f->node->kind != PMA_INTEGER)
        return refuse_type(f, "a number", "");
    *out = f->node->kind == PMA_REAL ? f->node->is.real : (double)f->node->is.integer;
    return PMA_OK;
}

/* ---- arrays --------------------------------------------------------------------------------- */

pma_status pma_field_array(const pma_field *f, pma_kind kind, uint32_t axes, int64_t *extent,
                           const void **out)
{
    const pma_node *x = f->node;
    if (x->kind != (uint32_t)kind)
        return refuse_type(f, KINDS[kind], ", C-contiguous and aligned");
    if (x->axes != axes)
        return refuse_number(f, " must have ", axes, " dimensions", x->axes);
    for (uint32_t i = 0; i < axes; i++) {
        if (extent[i] >= 0 && x->extent[i] != extent[i]) {
            static const char *const ALONG[] = {" along axis 0", " along axis 1", " along axis 2"};
            return refuse_number(f, " must have extent ", extent[i], ALONG[i], x->extent[i]);
        }
        extent[i] = x->extent[i];
    }
    *out = (const void *)(f->fields->base + (uintptr_t)x->is.at);
    return PMA_OK;
}

pma_status pma_field_vector(const pma_field *f, pma_kind kind, size_t *length, const void **out)
{
    int64_t extent = -1;
    PMA_TRY(pma_field_array(f, kind, 1, &extent, out));
    *length = (size_t)extent;
    return PMA_OK;
}

static pma_status take(const pma_field *f, pma_kind kind, size_t n, const void **out)
{
    int64_t extent = (int64_t)n;
    return (uint64_t)n > INT64_MAX ? pma_field_refuse(f, "is too large")
                                   : pma_field_array(f, kind, 1, &extent, out);
}

pma_status pma_field_doubles(const pma_field *f, size_t n, const double **out)
{
    const void *data = NULL;
    PMA_TRY(take(f, PMA_DOUBLES, n, &data));
    *out = data;
    return PMA_OK;
}

pma_status pma_field_longs(const pma_field *f, size_t n, const int64_t **out)
{
    const void *data = NULL;
    PMA_TRY(take(f, PMA_INT64S, n, &data));
    *out = data;
    return PMA_OK;
}

pma_status pma_field_ints(const pma_field *f, size_t n, const int32_t **out)
{
    const void *data = NULL;
    PMA_TRY(take(f, PMA_INT32S, n, &data));
    *out = data;
    return PMA_OK;
}

pma_status pma_field_positions(const pma_field *f, size_t size, size_t *count, const int64_t **out)
{
    const void *data = NULL;
    PMA_TRY(pma_field_vector(f, PMA_INT64S, count, &data));
    *out = data;
    for (size_t i = 0; i < *count; i++) {
        if ((*out)[i] < 0 || (size_t)(*out)[i] >= size)
            return pma_field_refuse(f, "has a position that is out of range");
    }
    return PMA_OK;
}

pma_status pma_field_output(const pma_field *f, uint32_t axes, int64_t *extent, double **out)
{
    const void *data = NULL;
    PMA_TRY(pma_field_array(f, PMA_DOUBLES, axes, extent, &data));
    *out = (double *)(uintptr_t)data;
    return f->node->is_writeable ? PMA_OK : pma_field_refuse(f, "must be writeable");
}

/* ---- what is no data ------------------------------------------------------------------------ */

pma_status pma_field_find(const pma_field *f, pma_role role, void *out)
{
    pma_fields *t = f->fields;
    if (f->node->kind != (t->named ? PMA_WORD : PMA_FOREIGN))
        return refuse_type(f, "a function", "");
    return t->find ? t->find(t, f->node, role, out)
                   : pma_field_refuse(f, "is a function, which no file has");
}

pma_status pma_field_room(const pma_field *f, size_t count, size_t size)
{
    pma_fields *t = f->fields;
    const size_t left = (t->room > 0 ? t->room : SIZE_MAX) - t->taken;
    if (size > 0 && count > left / size)
        return pma_field_refuse(f, "is too large");
    t->taken += count * size;
    return PMA_OK;
}

pma_status pma_field_allocate(const pma_field *f, size_t count, size_t size, void *out)
{
    void *memory = pma_store_add(f->fields->store, count, size);
    memcpy(out, (const void *)&memory, sizeof memory);
    return memory ? PMA_OK : PMA_NO_MEMORY;
}
