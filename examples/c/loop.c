/* loop.c - a frozen model in a loop of one's own, at times of the clock.
 *
 *     cc loop.c $(pkg-config --cflags --libs pmalpha) -o loop
 *     loop model.pma 1000
 *
 * Each sample gives the command, sets the force that answers it (here that of a spring), and takes
 * a fine step of 1 ms. Prints the first output, the longest step and how many samples
 * began late. */
#define _GNU_SOURCE
#include <inttypes.h>
#include <pmalpha.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

enum { PERIOD = 1000000 }; /* ns */

static int64_t now(void *user)
{
    struct timespec t;
    (void)user;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

int main(int count, char **words)
{
    pmalpha_model *m;
    char why[PMALPHA_MESSAGE];
    const long samples = count > 2 ? atol(words[2]) : 1000;
    long missed = 0;
    if (count < 2 || pmalpha_open(words[1], why, &m) != PMALPHA_OK)
        return fprintf(stderr, "%s\n", count < 2 ? "which model?" : why), 1;
    const int column = pmalpha_find_input(m, "column");
    sched_setscheduler(0, SCHED_FIFO, &(struct sched_param){.sched_priority = 80}); /* if allowed */
    mlockall(MCL_CURRENT | MCL_FUTURE);
    pmalpha_clock(m, now, NULL);
    int64_t due = now(NULL);
    for (long k = 0; k < samples; k++, due += PERIOD) {
        double d[3], force;
        struct timespec at = {.tv_sec = due / 1000000000, .tv_nsec = due % 1000000000};
        missed += now(NULL) > due + PERIOD;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL);
        pmalpha_command(m, column, d);
        force = 300.0 * d[0]; /* in a laboratory: d[0] to the actuator, and what its load cell says */
        if (pmalpha_set(m, column, force) != PMALPHA_OK || pmalpha_advance(m, 1) != PMALPHA_OK)
            return fprintf(stderr, "%s\n", pmalpha_message(m)), 1;
    }
    printf("%.17g\n", pmalpha_get(m, 0));
    fprintf(stderr, "longest %" PRId64 " ns, %ld samples late\n", pmalpha_longest(m), missed);
    pmalpha_close(m);
    return 0;
}
