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

/* a conj(b) */
static inline gsid_cplx gsid_cplx_mul_conj(gsid_cplx a, gsid_cplx b) {
    return gsid_cplx_make(a.re * b.re + a.im * b.im, a.im * b.re - a.re * b.im);
}

/* a - j b */
static inline gsid_cplx gsid_cplx_minus_j(gsid_cplx a, gsid_cplx b) {
    return gsid_cplx_make(a.re + b.im, a.im - b.re);
}

/* a + j b */
static inline gsid_cplx gsid_cplx_plus_j(gsid_cplx a, gsid_cplx b) {
    return gsid_cplx_make(a.re - b.im, a.im + b.re);
}

static inline gsid_real gsid_cplx_abs2(gsid_cplx a) {
    return a.re * a.re + a.im * a.im;
}

static inline int gsid_cplx_is_finite(gsid_cplx a) {
    return gsid_is_finite(a.re) && gsid_is_finite(a.im);
}

/* Smith's division: |b|^2 is never formed, which would leave the range of float for |b| below 1e-19. */
static inline gsid_cplx gsid_cplx_div(gsid_cplx a, gsid_cplx b) {
    if (gsid_fabs(b.re) < gsid_fabs(b.im)) { /* rotate both by a quarter turn */
        a = gsid_cplx_make(a.im, -a.re);
        b = gsid_cplx_make(b.im, -b.re);
    }
    const gsid_real r = b.im / b.re, d = b.re + r * b.im;
    return gsid_cplx_make((a.re + r * a.im) / d, (a.im - r * a.re) / d);
}

/* exp(j (x + rest)) for |x| <= pi/4 or a rounding more, rest a rounding of x, by Taylor's series to below the rounding unit. No two C libraries agree on
 * the last bit of a sine: with the core's own, the same samples give the same bits on target and desktop. */
static inline gsid_cplx gsid_cplx_cis_octant(gsid_real x, gsid_real rest) {
#ifdef GSID_SINGLE
    enum { N_TERMS = 4 };
#else
    enum { N_TERMS = 8 };
#endif
    static const gsid_real sine[8] = { /* of x^3, x^5, ... */
                                      GSID_R(-1.66666666666666667e-1),  GSID_R(8.33333333333333333e-3),
                                      GSID_R(-1.98412698412698413e-4),  GSID_R(2.75573192239858907e-6),
                                      GSID_R(-2.50521083854417188e-8),  GSID_R(1.60590438368216146e-10),
                                      GSID_R(-7.64716373181981648e-13), GSID_R(2.81145725434552076e-15)};
    static const gsid_real cosine[8] = { /* of x^4, x^6, ... */
                                        GSID_R(4.16666666666666667e-2),  GSID_R(-1.38888888888888889e-3),
                                        GSID_R(2.48015873015873016e-5),  GSID_R(-2.75573192239858907e-7),
                                        GSID_R(2.08767569878680990e-9),  GSID_R(-1.14707455977297247e-11),
                                        GSID_R(4.77947733238738530e-14), GSID_R(-1.56192069685862265e-16)};
    const gsid_real x2 = x * x, half = GSID_R(0.5) * x2, near_one = 1 - half;
    gsid_real s = sine[N_TERMS - 1], c = cosine[N_TERMS - 1];
    for (int i = N_TERMS - 1; i-- > 0;) {
        s = sine[i] + x2 * s;
        c = cosine[i] + x2 * c;
    }
    /* The rounding error of 1 - x^2/2 is added with the small terms. */
    return gsid_cplx_make(near_one + (((1 - near_one) - half) + (x2 * x2 * c - rest * x)),
                          x + (x * x2 * s + rest * near_one));
}

/* exp(j angle). Beyond some million radians the angle, and so the result, is only known to a fraction of a turn. */
static inline gsid_cplx gsid_cplx_cis(gsid_real angle) {
    /* pi/2 in three pieces, the first two so short that their multiples are exact up to 10^4 quarter turns (10^6). */
#ifdef GSID_SINGLE
    const gsid_real first = GSID_R(1.5703125), second = GSID_R(0.000483751297), third = GSID_R(7.54978995e-08);
#else
    const gsid_real first = GSID_R(1.5707963267341256), second = GSID_R(6.077100506303966e-11);
    const gsid_real third = GSID_R(2.0222662487959506e-21);
#endif
    const gsid_real largest = GSID_R(0.8); /* pi/4 plus rounding */
    const gsid_real n_quarters = gsid_floor(angle * GSID_R(0.636619772367581343) + GSID_R(0.5));
    const gsid_real quadrant = n_quarters - 4 * gsid_floor(n_quarters * GSID_R(0.25));
    gsid_real rest = ((angle - n_quarters * first) - n_quarters * second) - n_quarters * third;
    rest = rest > largest ? largest : rest < -largest ? -largest : rest;
    const gsid_cplx z = gsid_cplx_cis_octant(rest, 0);
    if (quadrant == 0) {
        return z;
    }
    if (quadrant == 1) {
        return gsid_cplx_make(-z.im, z.re);
    }
    if (quadrant == 2) {
        return gsid_cplx_make(-z.re, -z.im);
    }
    return gsid_cplx_make(z.im, -z.re);
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
