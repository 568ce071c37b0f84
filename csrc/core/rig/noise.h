/* noise.h - random numbers that follow from a seed and a counter, and nothing else. */
#ifndef PMA_NOISE_H
#define PMA_NOISE_H

#include <stdint.h>

/* Number `number` of a normal distribution of mean 0 and deviation 1                        (Y3) */
double pma_noise_normal(uint64_t seed, uint64_t number);

#endif
