#include "rig/noise.h"

#include <math.h>

/* Equidistributed in (0, 1): a hash of a counter, so that nothing else is remembered of it. */
static double uniform(uint64_t seed, uint64_t number)
{
    uint64_t z = seed + (number + 1) * UINT64_C(0x9E3779B97F4A7C15);
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    z ^= z >> 31;
    return ((double)(z >> 12) + 0.5) * 0x1p-52;
}

/* Box and Muller */
double pma_noise_normal(uint64_t seed, uint64_t number)
{
    const double two_pi = 6.283185307179586;
    return sqrt(-2.0 * log(uniform(seed, 2 * number))) *
           cos(two_pi * uniform(seed, 2 * number + 1));
}
