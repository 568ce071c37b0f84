/* allocations.h - counts what is allocated, under AddressSanitizer, and lets it fail, where the
 * linker leads the allocators here. */
#ifndef PMA_TEST_ALLOCATIONS_H
#define PMA_TEST_ALLOCATIONS_H

#include <stdbool.h>
#include <stddef.h>

/* From now on; false without AddressSanitizer, where nothing is counted and a test shows
 * nothing. */
bool count_allocations(void);

/* Until now, by all threads. */
size_t allocations_counted(void);

/* The k-th allocation of the core or of a test from now on fails, and no other; 0: none. False
 * where none can be made to fail. */
bool fail_allocation(size_t k);

/* Has it, since then? */
bool allocation_has_failed(void);

#endif
