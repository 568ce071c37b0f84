/* field.h - a tree of None, numbers, words, arrays, tuples and dicts, and what is taken from it.
 *
 * Parts are taken from a tree by the names of their fields. The tree is made by a binding, of its
 * language's objects, or is read from a file; a field does not know which. Every function below
 * returns PMA_OK, PMA_NO_MEMORY, or PMA_REFUSED after it has written to the tree which field is not
 * as it has to be. */
#ifndef PMA_FIELD_H
#define PMA_FIELD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "describe/store.h"
#include "status.h"

typedef enum {
    PMA_NONE,
    PMA_INTEGER, /* flags too */
    PMA_REAL,
    PMA_WORD,
    PMA_TUPLE,
    PMA_DICT,
    PMA_DOUBLES, /* arrays by rows */
    PMA_INT64S,
    PMA_INT32S,
    PMA_FOREIGN /* what the tree was made of and no file has: a function */
} pma_kind;

enum { PMA_AXES = 3, PMA_REFUSAL = 256 };

/* 40 bytes, in memory as in a file. */
typedef struct {
    uint32_t kind;
    uint16_t axes;            /* of an array, 1 to 3 */
    uint16_t is_writeable;    /* an array, which no file has */
    int64_t extent[PMA_AXES]; /* of an array; [0]: bytes of a word, children of a tuple, twice the
                                 entries of a dict, whose children are key, value, key, ... */
    union {
        int64_t integer;
        double real;
        uint64_t at; /* tuple, dict: the first child, the others follow; else bytes from `base` */
    } is;
} pma_node;

/* What a foreign node stands for. */
typedef enum {
    PMA_RESTORING_ROLE, /* out: pma_function, which is filled */
    PMA_INTERNAL_ROLE,  /* out: pma_internal_force with its sizes, whose function is filled */
    PMA_POTENTIAL_ROLE, /* the same force, whose potential is filled */
    PMA_LOAD_ROLE,      /* out: pma_load, whose function is filled */
    PMA_DGEMM_ROLE,     /* out: pma_blas */
    PMA_DTRSM_ROLE,
    PMA_OBJECT_ROLE /* out: void *, what the binding has for it */
} pma_role;

typedef struct pma_fields pma_fields;

/* nodes[0] is the root. The tree is checked: children and bytes are there. */
struct pma_fields {
    const pma_node *nodes;
    uintptr_t base;
    pma_store *store; /* what is taken points into it, and into the arrays */
    /* Fills `out` by the role, of a foreign node or, where functions are `named`, of a word; NULL:
     * these are refused. */
    bool named;
    pma_status (*find)(pma_fields *fields, const pma_node *node, pma_role role, void *out);
    void *ctx;
    size_t room;     /* bytes that all numbers together may ask for which stand for no array, or of
                        which memory grows faster than its arrays; 0: any */
    size_t taken;    /* of these */
    bool wrong_type; /* the refusal is of a type, not of a value */
    char refusal[PMA_REFUSAL];
};

/* A place in the tree; its name is for refusals. */
typedef struct pma_field {
    pma_fields *fields;
    const pma_node *node;
    const char *name;
    const struct pma_field *of; /* NULL: named by itself */
} pma_field;

/* name: that the names of all others begin with, or NULL. */
pma_field pma_field_root(pma_fields *fields, const char *name);

/* The value of a dict at this key, which has to outlive it as `of` has to; None where there is
 * none, also where `of` is no dict. */
pma_field pma_field_at(const pma_field *of, const char *key);
bool pma_field_has(const pma_field *of, const char *key);
/* The child of a tuple. */
pma_field pma_field_item(const pma_field *of, size_t i);

static inline bool pma_field_is_none(const pma_field *f)
{
    return f->node->kind == PMA_NONE;
}

static inline bool pma_field_is_array(const pma_field *f, uint32_t axes)
{
    return f->node->kind >= PMA_DOUBLES && f->node->kind <= PMA_INT32S && f->node->axes == axes;
}

/* A word that is this one; the entries of a dict. */
bool pma_field_is_word(const pma_field *f, const char *word);
size_t pma_field_entries(const pma_field *f);

/* A refusal of the value, for this reason ("must be positive"). */
pma_status pma_field_refuse(const pma_field *f, const char *reason);

pma_status pma_field_dict(const pma_field *f);
pma_status pma_field_tuple(const pma_field *f, size_t *count);
pma_status pma_field_integer(const pma_field *f, int64_t least, int64_t *out);
pma_status pma_field_count(const pma_field *f, size_t least, size_t *out);
pma_status pma_field_flag(const pma_field *f, bool *out); /* None: false */
pma_status pma_field_real(const pma_field *f, double *out);

/* An array of this kind; an extent of -1 is any, and is set. */
pma_status pma_field_array(const pma_field *f, pma_kind kind, uint32_t axes, int64_t *extent,
                           const void **out);
pma_status pma_field_vector(const pma_field *f, pma_kind kind, size_t *length, const void **out);
pma_status pma_field_doubles(const pma_field *f, size_t n, const double **out);
pma_status pma_field_longs(const pma_field *f, size_t n, const int64_t **out);
pma_status pma_field_ints(const pma_field *f, size_t n, const int32_t **out);

/* Integers in 0..size-1, any number of them. */
pma_status pma_field_positions(const pma_field *f, size_t size, size_t *count, const int64_t **out);

/* One that may be written. */
pma_status pma_field_output(const pma_field *f, uint32_t axes, int64_t *extent, double **out);

/* What a foreign node stands for; see pma_role. */
pma_status pma_field_find(const pma_field *f, pma_role role, void *out);

/* Takes `count` elements of `size` bytes of the room; a refusal where there is not so much left. */
pma_status pma_field_room(const pma_field *f, size_t count, size_t size);

/* Memory of the tree's store, zeroed. */
pma_status pma_field_allocate(const pma_field *f, size_t count, size_t size, void *out);

#endif
