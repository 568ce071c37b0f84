/* kernel_avx2.c - the loops of a kernel in registers of four numbers. */
#include "algebra/kernel.h"

#include "algebra/lanes.h"

typedef pma_four piece;
#define WIDTH 4
#define TARGET PMA_AVX2
#define GATHERED(x, at) ((piece){(x)[(at)[0]], (x)[(at)[1]], (x)[(at)[2]], (x)[(at)[3]]})

#include "algebra/kernel_loops.h"

const pma_kernel *pma_kernel_avx2(void)
{
    return &KERNEL;
}
