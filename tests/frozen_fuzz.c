/* frozen_fuzz.c - opens and steps damaged copies of a frozen model: frozen_fuzz KIND FILE SEED COUNT.
 *
 * KIND is what is damaged. "bytes": bytes, words, nodes and ends of the file, whose check sum is made
 * right in three of four copies. "numbers": one number of its data, with the sum made right. "states":
 * one number of a state that the model has saved, and then restores, likewise. To be compiled with
 * the sanitizers. Prints how many were opened or restored, how many then stepped, and the largest
 * memory of an opening by the size of the file; whatever goes wrong ends it, after the seed. */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "describe/file.h"
#include "library/pmalpha.h"

enum { HEADER = 64, STEPS = 9, LONGEST = 120 };
static uint64_t state;

/* ---- memory that an opening asks for: what SECURITY.md promises ------------------------------- */

enum { AT_LEAST = 1 << 28, BY_SIZE = 512 };
static size_t asked, most_by_size;

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *old, size_t size);

void *__wrap_malloc(size_t size)
{
    asked += size;
    return __real_malloc(size);
}

void *__wrap_calloc(size_t count, size_t size)
{
    asked += count * size;
    return __real_calloc(count, size);
}

void *__wrap_realloc(void *old, size_t size)
{
    asked += size;
    return __real_realloc(old, size);
}

static int is_bounded(size_t size)
{
    if (asked / size > most_by_size)
        most_by_size = asked / size;
    if (asked <= AT_LEAST + BY_SIZE * size)
        return 1;
    fprintf(stderr, "%zu bytes for a file of %zu\n", asked, size);
    return 0;
}

/* ---- damage ----------------------------------------------------------------------------------- */

static uint64_t draw(uint64_t below)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return below > 0 ? state % below : 0;
}

static uint64_t odd_number(void)
{
    static const uint64_t ODD[] = {0,
                                   1,
                                   2,
                                   7,
                                   8,
                                   64,
                                   (uint64_t)1 << 31,
                                   (uint64_t)1 << 32,
                                   (uint64_t)1 << 62,
                                   INT64_MAX,
                                   UINT64_MAX,
                                   0x7ff8000000000000u,
                                   0x7ff0000000000000u,
                                   0x8000000000000000u};
    return draw(2) ? ODD[draw(sizeof ODD / sizeof *ODD)] : draw(100);
}

/* A number of some node, of the header or of the data. */
static uint64_t *some_word(uint64_t *words, size_t count)
{
    return &words[8 + draw(count - 8)];
}

static void damage_nodes(uint64_t *words)
{
    pma_node *nodes = (pma_node *)(void *)(words + 8);
    const uint64_t count = words[3];
    pma_node *x = &nodes[draw(count)];
    const pma_node *other = &nodes[draw(count)];
    switch (draw(6)) {
    case 0:
        x->kind = (uint32_t)draw(11);
        break;
    case 1:
        x->axes = (uint32_t)draw(5);
        break;
    case 2:
        x->extent[draw(3)] = (int64_t)(draw(2) ? odd_number() : (uint64_t)other->extent[0]);
        break;
    case 3:
        x->is.at = draw(2) ? odd_number() : other->is.at;
        break;
    case 4:
        *x = *other;
        break;
    default:
        x->extent[0] += draw(2) ? 1 : -1;
    }
}

/* Returns the new number of words. */
static size_t damage(uint64_t *words, size_t count)
{
    for (uint64_t k = 1 + draw(3); k > 0; k--) {
        switch (draw(4)) {
        case 0:
            ((unsigned char *)words)[HEADER + draw(8 * count - HEADER)] = (unsigned char)draw(256);
            break;
        case 1:
            *some_word(words, count) = draw(2) ? odd_number() : *some_word(words, count);
            break;
        default:
            damage_nodes(words);
        }
    }
    if (draw(20) == 0) {
        count = 9 + draw(count - 9);
        words[2] = 8 * count;
    }
    if (draw(4) > 0)
        words[5] = pma_file_sum(words + 8, 8 * (count - 8));
    return count;
}

/* What may be wrong with a number that is counted with, and with one that is computed with. */
static double odd_double(double x)
{
    static const double ODD[] = {0.0,    1.0,    2.0,   3.0,    13.0,   -1.0,
                                 0.5,    1e9,    -1e9,  0x1p31, 0x1p32, 0x1p53,
                                 0x1p63, 0x1p64, 1e300, -1e300, 1e-300, -0.0};
    switch (draw(4)) {
    case 0:
        return x + (draw(2) ? 1.0 : -1.0);
    case 1:
        return draw(2) ? -x : x * 1e6;
    default:
        return ODD[draw(sizeof ODD / sizeof *ODD)];
    }
}

static void change_number(uint64_t *word)
{
    double x;
    if (draw(3) == 0) {
        *word = odd_number();
        return;
    }
    memcpy(&x, word, sizeof x);
    x = odd_double(x);
    memcpy(word, &x, sizeof x);
}

/* One number behind the nodes, or of a node that is one. */
static void damage_number(uint64_t *words, size_t count)
{
    pma_node *nodes = (pma_node *)(void *)(words + 8);
    const size_t data = words[4] / 8, nodes_count = words[3];
    pma_node *x = &nodes[draw(nodes_count)];
    if (draw(3) == 0 && (x->kind == PMA_INTEGER || x->kind == PMA_REAL))
        change_number(&x->is.at);
    else
        change_number(&words[data + draw(count - data)]);
    words[5] = pma_file_sum(words + 8, 8 * (count - 8));
}

static int attach(double t, const double c[3], double *force, void *user)
{
    (void)t, (void)user;
    *force = 100.0 * c[0];
    return 0;
}

/* Every function of the library. */
static int use(pmalpha_model *m)
{
    double c[3];
    int steps = 0;
    const size_t size = pmalpha_state_size(m);
    void *block = malloc(size);
    for (int i = 0; i < (int)pmalpha_inputs(m); i++) {
        pmalpha_find_input(m, pmalpha_input_name(m, i));
        pmalpha_command(m, i, c);
        if (i % 2)
            pmalpha_set(m, i, 1.0);
        else
            pmalpha_attach(m, i, attach, NULL);
    }
    pmalpha_begin(m);
    while (steps < STEPS && pmalpha_advance(m, 1) == PMALPHA_OK)
        steps++;
    for (int i = 0; i < (int)pmalpha_outputs(m); i++)
        pmalpha_get(m, pmalpha_find_output(m, pmalpha_output_name(m, i)));
    if (pmalpha_save(m, block, size) == PMALPHA_OK)
        pmalpha_restore(m, block, size);
    pmalpha_reset(m);
    free(block);
    return steps == STEPS;
}

/* What a refusal must not change. */
static void require_same(pmalpha_model *m, const uint64_t *before, uint64_t *block, size_t size)
{
    if (pmalpha_save(m, block, size) == PMALPHA_OK && memcmp(block, before, size) == 0)
        return;
    fprintf(stderr, "a refused state has changed the model\n");
    exit(1);
}

/* Returns how many steps followed a state with one wrong number, or -1 where it is refused; then the
 * model goes on from the right one. Blocks: the right state, and room for two. */
static int use_state(pmalpha_model *m, const uint64_t *good, uint64_t *block, size_t size)
{
    const size_t count = size / 8;
    uint64_t *before = block + count;
    int steps = 0;
    pmalpha_save(m, before, size);
    memcpy(block, good, size);
    change_number(&block[draw(count - 1)]);
    block[count - 1] = pma_file_sum(block, size - 8);
    const int status = pmalpha_restore(m, block, size);
    if (status == PMALPHA_BAD_ARGUMENT)
        require_same(m, before, block, size);
    while (status == PMALPHA_OK && steps < STEPS && pmalpha_advance(m, 1) == PMALPHA_OK)
        steps++;
    if (pmalpha_restore(m, good, size) != PMALPHA_OK || pmalpha_advance(m, 1) != PMALPHA_OK) {
        fprintf(stderr, "does not go on: %s\n", pmalpha_message(m));
        exit(1);
    }
    return status == PMALPHA_OK ? steps : -1;
}

static void begin(uint64_t seed)
{
    state = seed * 2654435761u + 88172645463325252u;
    for (int k = 0; k < 9; k++)
        draw(1);
    fprintf(stderr, "\rseed %llu ", (unsigned long long)seed);
    alarm(LONGEST);
}

/* States of the model as it is after some steps. */
static int try_states(uint64_t *file, size_t count, uint64_t first, uint64_t copies)
{
    char message[PMALPHA_MESSAGE];
    size_t restored = 0, stepped = 0;
    pmalpha_model *m;
    if (pmalpha_open_memory(file, 8 * count, message, &m) != PMALPHA_OK ||
        pmalpha_advance(m, 2 * pmalpha_substeps(m) + 1) != PMALPHA_OK)
        return 1;
    const size_t size = pmalpha_state_size(m);
    uint64_t *good = malloc(size), *block = malloc(2 * size);
    pmalpha_save(m, good, size);
    for (uint64_t seed = first; seed < first + copies; seed++) {
        begin(seed);
        const int steps = use_state(m, good, block, size);
        restored += steps >= 0;
        stepped += steps == STEPS;
    }
    pmalpha_close(m);
    free(good);
    free(block);
    printf("%zu %zu 0\n", restored, stepped);
    return 0;
}

static uint64_t *read_words(const char *path, size_t *count)
{
    FILE *file = fopen(path, "rb");
    fseek(file, 0, SEEK_END);
    *count = (size_t)ftell(file) / 8;
    rewind(file);
    uint64_t *words = malloc(8 * *count);
    if (fread(words, 8, *count, file) != *count)
        exit(1);
    fclose(file);
    return words;
}

/* A copy in a block of its own size, so that what is beyond it is seen. */
static uint64_t *copied(const uint64_t *words, size_t count)
{
    uint64_t *copy = malloc(8 * count);
    memcpy(copy, words, 8 * count);
    return copy;
}

static int try_files(const uint64_t *good, size_t count, bool of_numbers, uint64_t first,
                     uint64_t copies)
{
    size_t opened = 0, stepped = 0;
    for (uint64_t seed = first; seed < first + copies; seed++) {
        pmalpha_model *m;
        char message[PMALPHA_MESSAGE];
        size_t size = count;
        begin(seed);
        uint64_t *copy = copied(good, count);
        if (of_numbers)
            damage_number(copy, count);
        else
            size = damage(copy, count);
        uint64_t *bytes = copied(copy, size);
        free(copy);
        asked = 0;
        const int status = pmalpha_open_memory(bytes, 8 * size, message, &m);
        if (!is_bounded(8 * size))
            return 1;
        if (status == PMALPHA_OK) {
            opened++;
            stepped += (size_t)use(m);
            pmalpha_close(m);
        } else if (!message[0]) {
            return 1;
        }
        free(bytes);
    }
    printf("%zu %zu %zu\n", opened, stepped, most_by_size);
    return 0;
}

int main(int arguments, char **words)
{
    size_t count;
    if (arguments < 5)
        return 1;
    uint64_t *good = read_words(words[2], &count);
    const uint64_t first = strtoull(words[3], NULL, 10), copies = strtoull(words[4], NULL, 10);
    const int failed =
        strcmp(words[1], "states") == 0
            ? try_states(good, count, first, copies)
            : try_files(good, count, strcmp(words[1], "numbers") == 0, first, copies);
    free(good);
    return failed;
}
