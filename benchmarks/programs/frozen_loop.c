/* frozen_loop.c - ns of a sample of a loop whose specimen, a spring, is outside of the model: set,
 * advance and command; the least mean of REPETITIONS. Arguments: model, samples. */
#define _POSIX_C_SOURCE 200809L
#include <pmalpha.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { REPETITIONS = 5 };

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

int main(int count, char **words)
{
    pmalpha_model *m;
    double c[3], least = 1e300;
    if (count < 3 || pmalpha_open(words[1], NULL, &m) != PMALPHA_OK)
        return 1;
    const long samples = atol(words[2]);
    pmalpha_command(m, 0, c);
    for (int i = 0; i < REPETITIONS; i++) {
        const double begin = now();
        for (long k = 0; k < samples; k++) {
            pmalpha_set(m, 0, 50.0 * c[0]);
            if (pmalpha_advance(m, 1) != PMALPHA_OK)
                return 1;
            pmalpha_command(m, 0, c);
        }
        const double taken = (now() - begin) / (double)samples;
        least = taken < least ? taken : least;
    }
    printf("%.0f\n", least);
    pmalpha_close(m);
    return 0;
}
