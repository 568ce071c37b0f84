#include "member/scheme.h"

pma_step pma_step_make(pma_scheme s, double h)
{
    const double d = 1.0 - s.am;
    return (pma_step){
        .h = h,
        .al1 = h * h * s.beta * (1.0 - s.af) / d,
        .al2 = h * s.gamma * (1.0 - s.af) / d,
        .u_a = h * h * (0.5 - s.beta / d),
        .u_w = h * h * s.beta * s.af / d,
        .v_a = h * (1.0 - s.gamma / d),
        .v_w = h * s.gamma * s.af / d,
        .a_a = -s.am / d,
        .a_w = s.af / d,
        .a_w1 = (1.0 - s.af) / d,
    };
}
