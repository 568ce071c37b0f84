/* allocations.h - counts what is allocated, under AddressSanitizer. */
#ifndef PMA_TEST_ALLOCATIONS_H
#define PMA_TEST_ALLOCATIONS_H

#include <stdbool.h>
#include <stddef.h>

/* From now on; false without AddressSanitizer, where nothing is counted and a test shows nothing. */
bool count_allocations(void);

/* Until now, by all threads. */
size_t allocations_counted(void);

#endif
