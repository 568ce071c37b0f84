/* state.h - the numbers of a subdomain at a time level, or of a substep that is open. */
#ifndef PMA_STATE_H
#define PMA_STATE_H

/* All arrays in elimination order.                                                        (E1)
 *
 *        closed                      opened
 *   u    displacement                predictor ut
 *   v    velocity                    predictor vt
 *   w    acceleration                swept right-hand side y
 *   a    acceleration-like variable  its part that is known, (af w - am a)/(1 - am) */
typedef struct {
    double *u, *v, *w, *a; /* n each */
    double *springs;       /* what they remember, and then the restoring function; of an open
                              substep already that of its end */
    double *history;       /* the same of internal forces; of an iterated substep the number of
                              corrections follows */
} pma_state;

#endif
