/* check.h - checks that print what they saw, count and go on.
 *
 * A failed check prints file:line, the expression and the values. Of one test the first few are
 * printed: a fault in a loop would fill the screen. */
#ifndef PMA_CHECK_H
#define PMA_CHECK_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "status.h"

#define CHECK(expression) check_true((expression), #expression, __FILE__, __LINE__)

#define CHECK_INT(actual, expected)                                                           \
    check_int((long long)(actual), (long long)(expected), #actual " == " #expected, __FILE__, \
              __LINE__)

#define CHECK_STATUS(actual, expected) \
    check_status((actual), (expected), #actual " == " #expected, __FILE__, __LINE__)

#define CHECK_NEAR(actual, expected, tolerance) \
    check_near((actual), (expected), (tolerance), #actual " == " #expected, __FILE__, __LINE__)

/* count doubles are bitwise identical; so -0.0 differs from 0.0, and a NaN agrees with itself */
#define CHECK_BITS(count, actual, expected) \
    check_bits((count), (actual), (expected), #actual " == " #expected, __FILE__, __LINE__)

enum { CHECKS_SHOWN = 5 };

/* The calls at which a run fails or is stopped are taken in turn, with a thread sanitizer each
 * twentieth: a run takes ten times as long there, and other builds compare the states. */
#ifdef __SANITIZE_THREAD__
enum { STRIDE = 20 };
#else
enum { STRIDE = 1 };
#endif

extern size_t checks_failed; /* in the test at hand; test_core.c has it */

/* Counts a failure; true if it is to be printed, and then begins the line. */
static inline bool check_failed(const char *expression, const char *file, int line)
{
    checks_failed++;
    if (checks_failed > CHECKS_SHOWN)
        return false;
    printf("%s:%d: %s", file, line, expression);
    return true;
}

static inline void check_true(bool holds, const char *expression, const char *file, int line)
{
    if (!holds && check_failed(expression, file, line))
        printf(": false\n");
}

static inline void check_int(long long actual, long long expected, const char *expression,
                             const char *file, int line)
{
    if (actual != expected && check_failed(expression, file, line))
        printf(": %lld, expected %lld\n", actual, expected);
}

static inline void check_status(pma_status actual, pma_status expected, const char *expression,
                                const char *file, int line)
{
    if (actual != expected && check_failed(expression, file, line))
        printf(": \"%s\", expected \"%s\"\n", pma_status_text(actual), pma_status_text(expected));
}

/* positively, so that NaN fails */
static inline void check_near(double actual, double expected, double tolerance,
                              const char *expression, const char *file, int line)
{
    if (!(fabs(actual - expected) <= tolerance) && check_failed(expression, file, line))
        printf(": %.17g, expected %.17g, off by %.3g, allowed %.3g\n", actual, expected,
               fabs(actual - expected), tolerance);
}

static inline void check_bits(size_t count, const double *actual, const double *expected,
                              const char *expression, const char *file, int line)
{
    for (size_t i = 0; i < count; i++) {
        if (memcmp(&actual[i], &expected[i], sizeof actual[i]) == 0)
            continue;
        if (check_failed(expression, file, line))
            printf(" [%zu]: %a, expected %a\n", i, actual[i], expected[i]);
        return;
    }
}

#endif
