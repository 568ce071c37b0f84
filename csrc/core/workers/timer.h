/* timer.h - a clock that only goes forward, and sleep until a time of it. POSIX or Windows. */
#ifndef PMA_TIMER_H
#define PMA_TIMER_H

#include <stdint.h>

/* ns since some time; the same in all threads. Needs no lock and, where the system maps its clock,
 * no call of it. */
int64_t pma_timer_now(void);

/* Returns at that time, or earlier when a signal arrives. */
void pma_timer_sleep(int64_t until);

#endif
