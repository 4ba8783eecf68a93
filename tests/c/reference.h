/* What the C tests share: the precision's epsilon, a comparison that says how far off, and slow references in long
 * double. It brings cmocka.h with what that wants before it. */
#ifndef REFERENCE_H
#define REFERENCE_H

#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "gsid/types.h"

#ifdef GSID_SINGLE
#define EPSILON FLT_EPSILON
#else
#define EPSILON DBL_EPSILON
#endif

#define PI_L 3.14159265358979323846264338327950288L

typedef struct {
    long double re, im;
} cplx_l;

static inline void assert_near(long double got, long double want, long double tolerance) {
    if (!(fabsl(got - want) <= tolerance)) {
        fail_msg("got %.17Lg, want %.17Lg, off by %.3Lg, allowed %.3Lg", got, want, fabsl(got - want), tolerance);
    }
}

/* Fewer repeats of the same code where every instruction costs fifty and no number is judged: under valgrind, where
 * tools/run_c_tests sets GSID_TEST_QUICK. */
static inline int repeats(int full, int quick) {
    return getenv("GSID_TEST_QUICK") == NULL ? full : quick;
}

/* Noise within +-1, one number of its own for each n: SplitMix64's mixer. */
static inline long double noise_at(uint64_t n) {
    uint64_t z = (n + 1) * UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return (long double)((z ^ (z >> 31)) >> 11) / 4503599627370496.0L - 1;
}

#endif
