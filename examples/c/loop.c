/* loop.c - a frozen model in a loop of one's own, at times of the clock.
 *
 *     cc loop.c $(pkg-config --cflags --libs pmalpha) -o loop
 *     loop model.pma 1000
 *
 * Each sample sets the force that answers the command (here that of a spring), takes a fine step of
 * 1 ms, and gives the next command. Prints the first output, the longest step and how many samples
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
    sched_setscheduler(0, SCHED_FIFO, &(struct sched_param){.sched_priority = 80}); /* if allowed */
    mlockall(MCL_CURRENT | MCL_FUTURE);
    pmalpha_clock(m, now, NULL);
    int64_t due = now(NULL);
    for (long k = 0; k < samples; k++, due += PERIOD) {
        double d[3];
        struct timespec at = {.tv_sec = due / 1000000000, .tv_nsec = due % 1000000000};
        missed += now(NULL) > due + PERIOD;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL);
        pmalpha_command(m, 0, d);        /* what was given in the sample before */
        pmalpha_set(m, 0, 300.0 * d[0]); /* in a laboratory: what the load cell says */
        if (pmalpha_advance(m, 1) != PMALPHA_OK)
            return fprintf(stderr, "%s\n", pmalpha_message(m)), 1;
        /* pmalpha_command(m, 0, d), and d[0] to the actuator */
    }
    printf("%.17g\n", pmalpha_get(m, 0));
    fprintf(stderr, "longest %" PRId64 " ns, %ld samples late\n", pmalpha_longest(m), missed);
    pmalpha_close(m);
    return 0;
}
