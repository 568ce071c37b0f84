#include "algebra/kernel.h"

#include "algebra/lanes.h"

/* Registers of two numbers, which every processor has: by gcc wider vectors would be in memory. */
typedef pma_two piece;
#define WIDTH 2
#define TARGET
#define GATHERED(x, at) ((piece){(x)[(at)[0]], (x)[(at)[1]]})

#include "algebra/kernel_loops.h"

const pma_kernel *pma_kernel_plain(void)
{
    return &KERNEL;
}

const pma_kernel *pma_kernel_best(void)
{
    return pma_has_avx2() ? pma_kernel_avx2() : &KERNEL;
}
