/* iterated_models.h - what a coupled model iterates with when subdomains of it have internal
 * forces. */
#ifndef PMA_TEST_ITERATED_MODELS_H
#define PMA_TEST_ITERATED_MODELS_H

#include <stdbool.h>
#include <stddef.h>

#include "couple/coupler.h"
#include "couple/iteration.h"
#include "inner.h"
#include "subdomains.h"

typedef struct model model;
typedef struct chain chain;

/* Memory of the caller's of a coupler that iterates; the first macro step, the later ones. */
typedef struct {
    pma_iteration_parts parts;
    full_pattern pattern;
    double constant[2][CONSTRAINTS * CONSTRAINTS]; /* of the subdomains that are not iterated */
    double response[2][CONSTRAINTS * CONSTRAINTS]; /* of those without internal forces */
    double H_size[CONSTRAINTS * CONSTRAINTS];
} iteration_memory;

bool has_inner(const model *m);

/* Internal forces of a subdomain of a chain, if `used`, and springs that are iterated with them. */
void fill_inner(subdomain *x, bool used, const chain *chosen);

/* NULL where no subdomain has internal forces. */
const pma_iteration_parts *describe_iteration(model *m);

const pma_schedule *schedule_of(const model *m);

/* The histories as the start finds them, what they belong to evaluated once (N17). */
void start_histories(model *m);

/* What the present consists of besides the states: springs, histories and numbers of iterations,
 * energy scales, and what the coupler keeps. Returns how many numbers. */
enum {
    MOST_SPRINGS = 2, /* of a subdomain */
    MORE = 3 * (SPRING_FIELDS * MOST_SPRINGS + HISTORY + 2) + 1 + CONSTRAINTS +
           CONSTRAINTS * CONSTRAINTS
};
size_t copy_iteration(const model *m, double *out);

/* The present of one model becomes that of another one, which is made alike. */
void carry_over(const model *from, model *to);

#endif
