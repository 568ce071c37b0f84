/* test_fields.c - what is taken from a tree of fields, and which field a refusal names. */
#include "describe/field.h"

#include <stdint.h>
#include <string.h>

#include "check.h"
#include "describe/describe.h"
#include "tests.h"

/* A tree that is written by hand: nodes in their order, arrays and words by their addresses. */
enum { MOST_NODES = 59 };

typedef struct {
    pma_node nodes[MOST_NODES];
    pma_store store;
    pma_fields fields;
} tree;

static void begin(tree *t)
{
    memset(t, 0, sizeof *t);
    t->fields = (pma_fields){.nodes = t->nodes, .store = &t->store};
}

static pma_node word(const char *text)
{
    return (pma_node){
        .kind = PMA_WORD, .extent = {(int64_t)strlen(text)}, .is.at = (uint64_t)(uintptr_t)text};
}

static pma_node integer(int64_t value)
{
    return (pma_node){.kind = PMA_INTEGER, .is.integer = value};
}

static pma_node array(pma_kind kind, int64_t rows, int64_t columns, const void *data)
{
    return (pma_node){.kind = (uint32_t)kind,
                      .axes = columns < 0 ? 1 : 2,
                      .extent = {rows, columns},
                      .is.at = (uint64_t)(uintptr_t)data};
}

static pma_node children(pma_kind kind, int64_t count, size_t first)
{
    return (pma_node){.kind = (uint32_t)kind, .extent = {count}, .is.at = first};
}

static const double VALUES[] = {4.0, 9.0, 1.0, 2.0};
static const int64_t PTR[] = {0, 1, 2};
static const int32_t INDEX[] = {0, 1};

/* {K: {ptr, indices, values}, n: 2} */
static void make_matrix(tree *t)
{
    begin(t);
    t->nodes[0] = children(PMA_DICT, 4, 1);
    t->nodes[1] = word("K");
    t->nodes[2] = children(PMA_DICT, 6, 5);
    t->nodes[3] = word("n");
    t->nodes[4] = integer(2);
    t->nodes[5] = word("ptr");
    t->nodes[6] = array(PMA_INT64S, 3, -1, PTR);
    t->nodes[7] = word("indices");
    t->nodes[8] = array(PMA_INT32S, 2, -1, INDEX);
    t->nodes[9] = word("values");
    t->nodes[10] = array(PMA_DOUBLES, 2, -1, VALUES);
}

static void fields_are_found_by_their_names(void)
{
    tree t;
    make_matrix(&t);
    const pma_field root = pma_field_root(&t.fields, NULL);
    const pma_field n = pma_field_at(&root, "n"), nothing = pma_field_at(&root, "nb");
    const pma_field below = pma_field_at(&nothing, "deeper");
    size_t count = 0;
    bool flag = true;
    CHECK_STATUS(pma_field_count(&n, 1, &count), PMA_OK);
    CHECK_INT(count, 2);
    CHECK(pma_field_has(&root, "K") && !pma_field_has(&root, "k") && !pma_field_has(&n, "K"));
    CHECK(pma_field_is_none(&nothing) && pma_field_is_none(&below));
    CHECK_STATUS(pma_field_flag(&nothing, &flag), PMA_OK);
    CHECK(!flag);
    double real = 0.0;
    CHECK_STATUS(pma_field_real(&n, &real), PMA_OK); /* a whole number is one */
    CHECK_NEAR(real, 2.0, 0.0);
}

static pma_matrix take_matrix(tree *t, pma_status expected)
{
    pma_matrix A;
    const pma_field root = pma_field_root(&t->fields, NULL), K = pma_field_at(&root, "K");
    CHECK_STATUS(pma_parts_matrix(&K, 2, &A), expected);
    return A;
}

static void matrices_are_taken_in_their_forms(void)
{
    tree t;
    make_matrix(&t);
    pma_matrix A = take_matrix(&t, PMA_OK);
    CHECK(A.form == PMA_SPARSE && A.ptr == PTR && A.index == INDEX && A.values == VALUES);
    t.nodes[2] = array(PMA_DOUBLES, 2, -1, VALUES);
    A = take_matrix(&t, PMA_OK);
    CHECK(A.form == PMA_DIAGONAL && A.values == VALUES);
    t.nodes[2] = array(PMA_DOUBLES, 2, 2, VALUES);
    A = take_matrix(&t, PMA_OK);
    CHECK(A.form == PMA_DENSE && A.values == VALUES);
    t.nodes[2] = children(PMA_DICT, 2, 5);
    t.nodes[5] = word("band");
    t.nodes[6] = array(PMA_DOUBLES, 2, 2, VALUES);
    A = take_matrix(&t, PMA_OK);
    CHECK(A.form == PMA_BAND && A.width == 1 && A.below == 0);
    t.nodes[2].kind = PMA_NONE;
    CHECK(take_matrix(&t, PMA_OK).form == PMA_ZERO);
}

/* The refusal of K with this node changed. */
static const char *refusal_of(tree *t, size_t node, pma_node changed)
{
    make_matrix(t);
    t->nodes[node] = changed;
    (void)take_matrix(t, PMA_REFUSED);
    return t->fields.refusal;
}

static void a_refusal_names_the_field_the_rule_and_what_is_there(void)
{
    tree t;
    const int64_t falling[] = {0, 1, -1};
    const pma_node none = {.kind = PMA_NONE};
    CHECK(strcmp(refusal_of(&t, 6, array(PMA_INT64S, 2, -1, PTR)),
                 "K.ptr must have extent 3 along axis 0, got 2") == 0);
    CHECK(!t.fields.wrong_type);
    CHECK(strcmp(refusal_of(&t, 10, none), "K.values must be an array of float64, C-contiguous and "
                                           "aligned, got None") == 0);
    CHECK(t.fields.wrong_type);
    CHECK(strcmp(refusal_of(&t, 6, array(PMA_INT64S, 3, -1, falling)),
                 "K.ptr must not end with a negative number") == 0);
    CHECK(strcmp(refusal_of(&t, 10, array(PMA_DOUBLES, 2, 2, VALUES)),
                 "K.values must have 1 dimensions, got 2") == 0);
    CHECK(strcmp(refusal_of(&t, 2, integer(7)),
                 "K must be an array of float64, C-contiguous and aligned, got a whole number") ==
          0);
}

static void the_items_of_a_tuple_have_numbers_in_refusals(void)
{
    tree t;
    pma_springs springs;
    begin(&t);
    t.nodes[0] = children(PMA_TUPLE, 2, 1);
    t.nodes[1] = children(PMA_DICT, 0, 3);
    t.nodes[2] = integer(5);
    const pma_field root = pma_field_root(&t.fields, "springs");
    CHECK_STATUS(pma_parts_springs(&root, &springs), PMA_REFUSED);
    CHECK(strcmp(t.fields.refusal, "springs[0].law must be a whole number, got None") == 0);
    pma_store_release(&t.store);
}

static void numbers_out_of_range_are_refused(void)
{
    tree t;
    size_t count;
    bool flag;
    begin(&t);
    const pma_field root = pma_field_root(&t.fields, "n");
    t.nodes[0] = integer(-1);
    CHECK_STATUS(pma_field_count(&root, 0, &count), PMA_REFUSED);
    CHECK(strcmp(t.fields.refusal, "n must be at least 0, got -1") == 0);
    t.nodes[0] = (pma_node){.kind = PMA_REAL, .is.real = 2.0};
    CHECK_STATUS(pma_field_count(&root, 0, &count), PMA_REFUSED);
    CHECK_STATUS(pma_field_flag(&root, &flag), PMA_REFUSED);
}

static void a_function_is_refused_where_nothing_finds_it(void)
{
    tree t;
    pma_function function;
    begin(&t);
    t.nodes[0].kind = PMA_FOREIGN;
    const pma_field root = pma_field_root(&t.fields, "restoring");
    CHECK_STATUS(pma_field_find(&root, PMA_RESTORING_ROLE, &function), PMA_REFUSED);
    CHECK(strcmp(t.fields.refusal, "restoring is a function, which no file has") == 0);
}

/* {n, nb, substeps, single, link}, one mass without constraints */
static void make_subdomain(tree *t)
{
    static const int64_t none[] = {0};
    static const char *const fields[] = {"n", "nb", "substeps", "single", "link"};
    static const char *const constants[] = {"h",   "al1", "al2", "u_a", "u_w",
                                            "v_a", "v_w", "a_a", "a_w", "a_w1"};
    begin(t);
    t->nodes[0] = children(PMA_DICT, 10, 1);
    for (size_t i = 0; i < 5; i++)
        t->nodes[1 + 2 * i] = word(fields[i]);
    t->nodes[2] = integer(1);
    t->nodes[4] = integer(0);
    t->nodes[6] = integer(3);
    t->nodes[8] = children(PMA_DICT, 4, 11);
    t->nodes[11] = word("step");
    t->nodes[12] = children(PMA_DICT, 20, 15);
    t->nodes[13] = word("inverse");
    t->nodes[14] = array(PMA_DOUBLES, 1, -1, VALUES);
    for (size_t i = 0; i < 10; i++) {
        t->nodes[15 + 2 * i] = word(constants[i]);
        t->nodes[16 + 2 * i] = (pma_node){.kind = PMA_REAL, .is.real = 0.5 + (double)i};
    }
    t->nodes[10] = children(PMA_DICT, 8, 35);
    t->nodes[35] = word("p");
    t->nodes[36] = integer(0);
    t->nodes[37] = word("ptr");
    t->nodes[38] = array(PMA_INT64S, 1, -1, none);
    t->nodes[39] = word("indices");
    t->nodes[40] = array(PMA_INT32S, 0, -1, INDEX);
    t->nodes[41] = word("values");
    t->nodes[42] = array(PMA_DOUBLES, 0, -1, VALUES);
}

static void a_subdomain_is_taken_whole(void)
{
    tree t;
    pma_subdomain_taken taken;
    pma_subdomain *s = NULL;
    make_subdomain(&t);
    const pma_field root = pma_field_root(&t.fields, NULL);
    CHECK_STATUS(pma_parts_subdomain(&root, &taken), PMA_OK);
    CHECK_INT(taken.parts.substeps, 3);
    CHECK(taken.parts.single.step.h == 0.5 && taken.parts.single.step.a_w1 == 9.5);
    CHECK(taken.parts.single.factor.form == PMA_DIAGONAL && !taken.parts.doubled);
    CHECK(!taken.parts.mean && !taken.parts.iterate && !taken.parts.restoring.function);
    CHECK_STATUS(pma_subdomain_create(&taken.parts, &s), PMA_OK);
    pma_subdomain_destroy(s);
    for (size_t i = 0; i < 5; i++) { /* each of these fields is needed */
        make_subdomain(&t);
        t.nodes[1 + 2 * i] = word("other");
        CHECK_STATUS(pma_parts_subdomain(&root, &taken), PMA_REFUSED);
    }
    pma_store_release(&t.store);
}

/* ---- loads, and what a subdomain has besides ------------------------------------------------- */

/* {values, dt, begin}: three samples of one series */
static void make_sampled(tree *t)
{
    static const double samples[] = {1.0, 2.0, 3.0};
    begin(t);
    t->nodes[0] = children(PMA_DICT, 6, 1);
    t->nodes[1] = word("values");
    t->nodes[2] = array(PMA_DOUBLES, 3, 1, samples);
    t->nodes[3] = word("dt");
    t->nodes[4] = (pma_node){.kind = PMA_REAL, .is.real = 0.5};
    t->nodes[5] = word("begin");
    t->nodes[6] = integer(2);
}

static void loads_are_taken_in_their_forms(void)
{
    tree t;
    pma_load load;
    double g = 0.0;
    make_sampled(&t);
    const pma_field root = pma_field_root(&t.fields, "load");
    CHECK_STATUS(pma_parts_load(&root, 1, &load), PMA_OK);
    CHECK(load.kind == PMA_LOAD_SAMPLED && !load.hold && !load.shape);
    pma_load_add(&load, 2.75, 0, &g);
    CHECK_NEAR(g, 2.5, 0.0);
    pma_load_add(&load, -1e300, 0, &g); /* before its first sample, which then acts */
    CHECK_NEAR(g, 3.5, 0.0);
    t.nodes[4].is.real = 0.0;
    CHECK_STATUS(pma_parts_load(&root, 1, &load), PMA_REFUSED);
    CHECK(strcmp(t.fields.refusal, "load.dt must be positive") == 0);
    make_sampled(&t);
    CHECK_STATUS(pma_parts_load(&root, 2, &load), PMA_REFUSED); /* no shape for two dofs */

    begin(&t); /* (VALUES, {rows, first}, None) */
    t.nodes[0] = children(PMA_TUPLE, 3, 1);
    t.nodes[1] = array(PMA_DOUBLES, 2, -1, VALUES);
    t.nodes[2] = children(PMA_DICT, 4, 4);
    t.nodes[4] = word("rows");
    t.nodes[5] = array(PMA_DOUBLES, 2, 2, VALUES);
    t.nodes[6] = word("first");
    t.nodes[7] = integer(-3);
    CHECK_STATUS(pma_parts_load(&root, 2, &load), PMA_OK);
    double sum[2] = {0.0, 0.0};
    const double expected[2] = {4.0 + 1.0, 9.0 + 2.0};
    CHECK(pma_load_covers(&load, -3, -1) && !pma_load_covers(&load, -3, 0));
    pma_load_add(&load, 0.0, -2, sum);
    CHECK_BITS(2, sum, expected);
    t.nodes[2] = children(PMA_TUPLE, 0, 1); /* a sum in a sum */
    CHECK_STATUS(pma_parts_load(&root, 2, &load), PMA_REFUSED);
    pma_store_release(&t.store);
}

/* The subdomain above with the fields {name: {key: value, other: value}}. */
static void add_field(tree *t, const char *name, const char *const *keys, const pma_node *values)
{
    const size_t first = MOST_NODES - 16;
    make_subdomain(t);
    memmove(t->nodes + first, t->nodes + 1, 10 * sizeof *t->nodes);
    t->nodes[0] = children(PMA_DICT, 12, first);
    t->nodes[first + 10] = word(name);
    t->nodes[first + 11] = children(PMA_DICT, 4, first + 12);
    for (size_t i = 0; i < 2; i++) {
        t->nodes[first + 12 + 2 * i] = word(keys[i]);
        t->nodes[first + 13 + 2 * i] = values[i];
    }
}

static void limits_and_the_watch_are_those_of_the_subdomain_that_is_made(void)
{
    static const char *const limits[] = {"velocity", "energy"}, *const watch[] = {"M", "K_r"};
    tree t;
    pma_subdomain_taken taken;
    pma_subdomain *s = NULL;
    const pma_node values[] = {array(PMA_DOUBLES, 1, -1, VALUES), integer(5)};
    add_field(&t, "limits", limits, values);
    const pma_field root = pma_field_root(&t.fields, NULL);
    CHECK_STATUS(pma_parts_subdomain(&root, &taken), PMA_OK);
    CHECK(taken.is_limited && taken.limits.velocity == VALUES && !taken.limits.force);
    CHECK(taken.limits.energy == 5.0 && taken.limits.h == 0.5);
    CHECK_STATUS(pma_parts_make_subdomain(&taken, &s), PMA_OK);
    CHECK(!pma_subdomain_balance(s));
    pma_subdomain_destroy(s);
    const pma_node matrices[] = {array(PMA_DOUBLES, 1, -1, VALUES), {.kind = PMA_NONE}};
    add_field(&t, "watch", watch, matrices);
    CHECK_STATUS(pma_parts_subdomain(&root, &taken), PMA_OK);
    CHECK_STATUS(pma_parts_make_subdomain(&taken, &s), PMA_OK);
    CHECK(pma_subdomain_balance(s));
    pma_subdomain_destroy(s);
    add_field(&t, "responses", watch, matrices); /* of one that has none */
    CHECK_STATUS(pma_parts_subdomain(&root, &taken), PMA_REFUSED);
    pma_store_release(&t.store);
}

static void a_number_that_stands_for_no_array_has_limited_room(void)
{
    tree t;
    pma_subdomain_taken taken;
    make_subdomain(&t);
    const pma_field root = pma_field_root(&t.fields, NULL);
    t.fields.room = 3 * sizeof(double); /* of three substeps of one dof */
    CHECK_STATUS(pma_parts_subdomain(&root, &taken), PMA_OK);
    CHECK(t.fields.taken == t.fields.room);
    CHECK_STATUS(pma_parts_subdomain(&root, &taken), PMA_REFUSED); /* there is none left */
    t.fields.taken = 0;
    t.nodes[6] = integer(4);
    CHECK_STATUS(pma_parts_subdomain(&root, &taken), PMA_REFUSED);
    CHECK(strcmp(t.fields.refusal, "substeps is too large") == 0);
}

static void a_store_gives_zeroed_memory_and_refuses_what_no_size_has(void)
{
    pma_store store = {NULL};
    const double zeros[3] = {0.0};
    double *first = pma_store_add(&store, 3, sizeof *first);
    CHECK(first && pma_store_add(&store, 0, 8));
    CHECK_BITS(3, first, zeros);
    CHECK(!pma_store_add(&store, SIZE_MAX / 2, 8));
    pma_store_release(&store);
    CHECK(!store.last);
}

const test FIELDS_TESTS[] = {
    TEST(fields_are_found_by_their_names),
    TEST(matrices_are_taken_in_their_forms),
    TEST(a_refusal_names_the_field_the_rule_and_what_is_there),
    TEST(the_items_of_a_tuple_have_numbers_in_refusals),
    TEST(numbers_out_of_range_are_refused),
    TEST(a_function_is_refused_where_nothing_finds_it),
    TEST(a_subdomain_is_taken_whole),
    TEST(loads_are_taken_in_their_forms),
    TEST(limits_and_the_watch_are_those_of_the_subdomain_that_is_made),
    TEST(a_number_that_stands_for_no_array_has_limited_room),
    TEST(a_store_gives_zeroed_memory_and_refuses_what_no_size_has),
    END_OF_TESTS,
};
