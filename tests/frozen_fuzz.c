/* frozen_fuzz.c - opens and steps damaged copies of a frozen model: frozen_fuzz FILE SEED COUNT.
 *
 * Bytes, words, nodes and ends are changed; the check sum is made right in three of four copies. To
 * be compiled with the sanitizers. Prints how many were opened and how many stepped; whatever goes
 * wrong ends it, after the seed of the copy. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "describe/file.h"
#include "library/pmalpha.h"

enum { HEADER = 64, STEPS = 9, LONGEST = 120 };
static uint64_t state;

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

int main(int arguments, char **words)
{
    size_t count, opened = 0, stepped = 0;
    if (arguments < 4)
        return 1;
    uint64_t *good = read_words(words[1], &count);
    const uint64_t first = strtoull(words[2], NULL, 10), copies = strtoull(words[3], NULL, 10);
    for (uint64_t seed = first; seed < first + copies; seed++) {
        pmalpha_model *m;
        char message[PMALPHA_MESSAGE];
        state = seed * 2654435761u + 88172645463325252u;
        for (int k = 0; k < 9; k++)
            draw(1);
        /* a block of its own size, so that what is beyond it is seen */
        uint64_t *copy = malloc(8 * count);
        memcpy(copy, good, 8 * count);
        const size_t size = damage(copy, count);
        uint64_t *bytes = malloc(8 * size);
        memcpy(bytes, copy, 8 * size);
        free(copy);
        fprintf(stderr, "\rseed %llu ", (unsigned long long)seed);
        alarm(LONGEST);
        if (pmalpha_open_memory(bytes, 8 * size, message, &m) == PMALPHA_OK) {
            opened++;
            stepped += (size_t)use(m);
            pmalpha_close(m);
        } else if (!message[0]) {
            return 1;
        }
        free(bytes);
    }
    free(good);
    printf("%zu %zu\n", opened, stepped);
    return 0;
}
