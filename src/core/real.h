/* Maths in the precision of the build, so that a float build never computes in double unnoticed. */
#ifndef GSID_REAL_H
#define GSID_REAL_H

#include <float.h>
#include <math.h>

#include "gsid/types.h"

#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "not with -ffast-math: numbers that are not finite could not be refused"
#endif

#ifdef GSID_SINGLE
#define GSID_LIBM(name) name##f
#define GSID_EPSILON FLT_EPSILON
#define GSID_SMALLEST FLT_MIN
#define GSID_LARGEST FLT_MAX
#else
#define GSID_LIBM(name) name
#define GSID_EPSILON DBL_EPSILON
#define GSID_SMALLEST DBL_MIN
#define GSID_LARGEST DBL_MAX
#endif

#define gsid_sin GSID_LIBM(sin)
#define gsid_cos GSID_LIBM(cos)
#define gsid_pow GSID_LIBM(pow)
#define gsid_exp GSID_LIBM(exp)
#define gsid_expm1 GSID_LIBM(expm1)
#define gsid_log GSID_LIBM(log)
#define gsid_tanh GSID_LIBM(tanh)
#define gsid_atan2 GSID_LIBM(atan2)
#define gsid_sqrt GSID_LIBM(sqrt)
#define gsid_fabs GSID_LIBM(fabs)
#define gsid_floor GSID_LIBM(floor)
#define gsid_fma GSID_LIBM(fma)

/* Longest period [samples]: a phase index plus a line number stays inside 32 bits. */
#define GSID_N_PERIOD_MAX (UINT32_C(1) << 30)

/* Whether gsid_is_finite detects a NaN: GSID_OK or GSID_E_BUILD. -fno-honor-nans disables that and defines
 * no macro, so objects check it when they are initialised.  In types.c. */
#define gsid_check_build GSID_NAME(gsid_check_build)
gsid_status gsid_check_build(void);

/* A count that saturates: a wrap to 0 after 2^32 would give a weight of 1/0. */
static inline uint32_t gsid_count(uint32_t n, uint32_t more) {
    return more > UINT32_MAX - n ? UINT32_MAX : n + more;
}

/* Strictest alignment of the objects laid out in a caller's memory; C99 has no alignof. */
struct gsid_align_cplx {
    char c;
    gsid_cplx z;
};
#define GSID_ALIGN_CPLX offsetof(struct gsid_align_cplx, z)

static inline int gsid_is_aligned(const void *mem) {
    return (uintptr_t)mem % GSID_ALIGN_CPLX == 0;
}

/* Length of (a, b) without overflow on the way; not libm's, whose last bit depends on the library. */
static inline gsid_real gsid_hypot(gsid_real a, gsid_real b) {
    const gsid_real size_a = gsid_fabs(a), size_b = gsid_fabs(b);
    const gsid_real large = size_a > size_b ? size_a : size_b, small = size_a > size_b ? size_b : size_a;
    const gsid_real ratio = large > 0 ? small / large : 0;
    return large * gsid_sqrt(1 + ratio * ratio);
}

/* Infinity minus itself is not a number. This needs one instruction and one constant less than isfinite. */
static inline int gsid_is_finite(gsid_real x) {
    return x - x == 0;
}

#endif
