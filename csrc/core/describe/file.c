#include "describe/file.h"

#include <stdbool.h>
#include <string.h>

#include "text.h"

enum { HEADER = 64, ORDER = 0x01020304, WORD_ALIGNMENT = 8, ALIGNMENT = 64, SUMS = 4 };

typedef struct {
    char name[8];
    uint32_t version, order;
    uint64_t size, nodes, data, sum, zero[2];
} file_header;

/* ---- check sum ------------------------------------------------------------------------------ */

uint64_t pma_file_sum(const void *bytes, size_t size)
{
    const uint64_t prime = 1099511628211u, *words = bytes;
    uint64_t h[SUMS] = {14695981039346656037u, 1, 2, 3};
    for (size_t i = 0; i < size / sizeof *words; i++)
        h[i % SUMS] = (h[i % SUMS] ^ words[i]) * prime;
    for (size_t j = 1; j < SUMS; j++)
        h[0] = (h[0] ^ h[j]) * prime;
    return h[0] ^ (h[0] >> 29);
}

uint64_t pma_file_sum_of(const void *bytes)
{
    return ((const file_header *)bytes)->sum;
}

/* ---- header --------------------------------------------------------------------------------- */

static pma_status refuse(pma_fields *out, const char *reason)
{
    pma_text text = pma_text_begin(out->refusal, sizeof out->refusal);
    pma_text_word(&text, reason);
    return PMA_REFUSED;
}

static pma_status check_header(const void *bytes, size_t size, pma_fields *out)
{
    const file_header *h = bytes;
    if ((uintptr_t)bytes % sizeof(uint64_t) != 0)
        return refuse(out, "the bytes must be at a multiple of 8");
    if (size < sizeof *h || memcmp(h->name, "pmalpha", sizeof h->name) != 0)
        return refuse(out, "not a frozen model of pmalpha");
    if (h->order != ORDER)
        return refuse(out, "this processor has another order of bytes than the file");
    if (h->version != PMA_FILE_VERSION) {
        pma_text text = pma_text_begin(out->refusal, sizeof out->refusal);
        pma_text_word(&text, "the file has format ");
        pma_text_integer(&text, h->version);
        pma_text_word(&text, ", this library reads format ");
        pma_text_integer(&text, PMA_FILE_VERSION);
        return PMA_REFUSED;
    }
    if (h->size != size || size % sizeof(uint64_t) != 0)
        return refuse(out, "the file is not whole");
    if (h->nodes < 1 || h->nodes > (size - HEADER) / sizeof(pma_node) || h->data > size ||
        h->data < HEADER + h->nodes * sizeof(pma_node))
        return refuse(out, "the file is damaged: its header is wrong");
    if (pma_file_sum((const char *)bytes + HEADER, size - HEADER) != h->sum)
        return refuse(out, "the file is damaged: its check sum is wrong");
    return PMA_OK;
}

/* ---- nodes ---------------------------------------------------------------------------------- */

/* `count` bytes at `at`, aligned, among the data? */
static bool is_inside(const file_header *h, uint64_t at, uint64_t count, uint64_t alignment)
{
    return at >= h->data && at <= h->size && count <= h->size - at && at % alignment == 0;
}

static bool is_word(const file_header *h, const pma_node *x)
{
    const uint64_t at = x->is.at, length = (uint64_t)x->extent[0];
    return x->extent[0] >= 0 && length < h->size && is_inside(h, at, length + 1, WORD_ALIGNMENT) &&
           ((const char *)h)[at + length] == 0;
}

/* What nodes have had so far: children up to this one, and bytes of arrays that are left. */
typedef struct {
    uint64_t children, bytes;
} tally;

static bool is_family(const file_header *h, const pma_node *x, uint64_t number, tally *left)
{
    const uint64_t count = (uint64_t)x->extent[0];
    if (x->extent[0] < 0 || (x->kind != PMA_TUPLE && count % 2 != 0) || x->is.at <= number ||
        x->is.at != left->children || count > h->nodes - left->children)
        return false;
    left->children += count;
    return true;
}

static bool is_array(const file_header *h, const pma_node *x, tally *left)
{
    uint64_t bytes = x->kind == PMA_INT32S ? sizeof(int32_t) : sizeof(int64_t);
    if (x->axes < 1 || x->axes > PMA_AXES)
        return false;
    for (uint32_t i = 0; i < x->axes; i++) {
        const uint64_t extent = (uint64_t)x->extent[i];
        if (x->extent[i] < 0 || extent > h->size || (bytes > 0 && extent > h->size / bytes))
            return false;
        bytes *= extent;
    }
    if (bytes > left->bytes)
        return false;
    left->bytes -= bytes;
    return is_inside(h, x->is.at, bytes, ALIGNMENT);
}

static bool is_node(const file_header *h, const pma_node *x, uint64_t number, tally *left)
{
    switch (x->kind) {
    case PMA_NONE:
    case PMA_INTEGER:
    case PMA_REAL:
        return true;
    case PMA_WORD:
        return is_word(h, x);
    case PMA_TUPLE:
    case PMA_DICT:
        return is_family(h, x, number, left);
    case PMA_DOUBLES:
    case PMA_INT64S:
    case PMA_INT32S:
        return is_array(h, x, left);
    default:
        return false;
    }
}

pma_status pma_file_read(const void *bytes, size_t size, pma_fields *out)
{
    *out = (pma_fields){.base = (uintptr_t)bytes, .named = true};
    PMA_TRY(check_header(bytes, size, out));
    const file_header *h = bytes;
    out->nodes = (const pma_node *)(const void *)((const char *)bytes + HEADER);
    tally left = {.children = 1, .bytes = (uint64_t)PMA_FILE_SHARES * size};
    for (uint64_t i = 0; i < h->nodes; i++) {
        if (!is_node(h, &out->nodes[i], i, &left))
            return refuse(out, "the file is damaged: a part of it is outside, or used too often");
    }
    return PMA_OK;
}
