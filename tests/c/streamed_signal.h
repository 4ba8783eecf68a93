/* What the two engines are fed in their tests, and its lines by the definition. */
#ifndef STREAMED_SIGNAL_H
#define STREAMED_SIGNAL_H

#include "reference.h"

/* A signal that is not periodic: sample n of channel c, within +-1. */
static inline gsid_real sample(uint64_t n, uint32_t c) {
    return (gsid_real)sin(0.7 * (double)(n % 1000003u) + 0.3 * (double)c + 1e-4 * (double)(n % 1009u) * (double)n);
}

/* Line k of one period of that signal, from sample n_start on, by the definition. */
static inline cplx_l slow_line(uint32_t n_period, uint32_t k, uint64_t n_start, uint32_t c) {
    cplx_l sum = {0, 0};
    for (uint64_t n = n_start; n < n_start + n_period; n++) {
        const long double angle = 2 * PI_L * (long double)(k * n % n_period) / n_period;
        sum.re += (long double)sample(n, c) * cosl(angle);
        sum.im -= (long double)sample(n, c) * sinl(angle);
    }
    const long double scale = (k == 0 || 2 * k == n_period ? 1.0L : 2.0L) / n_period;
    return (cplx_l){sum.re * scale, sum.im * scale};
}

#endif
