/* Complex arithmetic on {re, im} and polynomials with real coefficients. */
#ifndef GSID_COMPLEX_MATH_H
#define GSID_COMPLEX_MATH_H

#include "gsid/types.h"
#include "real.h"

#define GSID_TWO_PI GSID_R(6.28318530717958647693)

static inline gsid_cplx gsid_cplx_make(gsid_real re, gsid_real im) {
    const gsid_cplx z = {re, im};
    return z;
}

static inline gsid_cplx gsid_cplx_add(gsid_cplx a, gsid_cplx b) {
    return gsid_cplx_make(a.re + b.re, a.im + b.im);
}

static inline gsid_cplx gsid_cplx_sub(gsid_cplx a, gsid_cplx b) {
    return gsid_cplx_make(a.re - b.re, a.im - b.im);
}

static inline gsid_cplx gsid_cplx_scale(gsid_real s, gsid_cplx a) {
    return gsid_cplx_make(s * a.re, s * a.im);
}

static inline gsid_cplx gsid_cplx_mul(gsid_cplx a, gsid_cplx b) {
    return gsid_cplx_make(a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re);
}

static inline gsid_cplx gsid_cplx_conj(gsid_cplx a) {
    return gsid_cplx_make(a.re, -a.im);
}

static inline gsid_real gsid_cplx_abs2(gsid_cplx a) {
    return a.re * a.re + a.im * a.im;
}

static inline int gsid_cplx_is_finite(gsid_cplx a) {
    return gsid_is_finite(a.re) && gsid_is_finite(a.im);
}

/* Smith's division: |b|^2 is never formed, which would leave the range of float for |b| below 1e-19. */
static inline gsid_cplx gsid_cplx_div(gsid_cplx a, gsid_cplx b) {
    if (gsid_fabs(b.re) >= gsid_fabs(b.im)) {
        const gsid_real r = b.im / b.re, d = b.re + r * b.im;
        return gsid_cplx_make((a.re + r * a.im) / d, (a.im - r * a.re) / d);
    }
    const gsid_real r = b.re / b.im, d = b.im + r * b.re;
    return gsid_cplx_make((r * a.re + a.im) / d, (r * a.im - a.re) / d);
}

/* exp(j angle) */
static inline gsid_cplx gsid_cplx_cis(gsid_real angle) {
    return gsid_cplx_make(gsid_cos(angle), gsid_sin(angle));
}

/* sum coef[i] v^i, by Horner's rule. */
static inline gsid_cplx gsid_cplx_polynomial(uint32_t degree, const gsid_real *coef, gsid_cplx v) {
    gsid_cplx sum = gsid_cplx_make(coef[degree], 0);
    for (uint32_t i = degree; i-- > 0;) {
        sum = gsid_cplx_mul(sum, v);
        sum.re += coef[i];
    }
    return sum;
}

#endif
