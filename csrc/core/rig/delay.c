#include "rig/delay.h"

double pma_delay_sum(const pma_delay *delay, const double *ring, size_t now)
{
    double sum = 0.0;
    for (size_t i = 0; i < delay->taps; i++)
        sum +=
            delay->weight[i] * ring[(now + delay->length - (size_t)delay->lag[i]) % delay->length];
    return sum;
}
