#include <math.h>

#include "../core/complex_math.h"
#include "gsid/host/fit.h"

#define ITERATIONS_MAX 500

/* Where Aberth's iteration starts: on a circle of the roots' geometric mean, off the real axis so that pairs can part. */
static void start_on_circle(uint32_t n, const double *coef, gsid_cplx *z) {
    const double radius = coef[0] != 0 ? pow(fabs(coef[0] / coef[n]), 1.0 / n) : 1.0;
    for (uint32_t i = 0; i < n; i++)
        z[i] = gsid_cplx_scale(radius, gsid_cplx_cis(GSID_TWO_PI * (i + 0.25) / n + 0.1));
}

static gsid_cplx newton_step(uint32_t n, const double *coef, gsid_cplx z) {
    gsid_cplx p = {coef[n], 0}, dp = {0, 0};
    for (uint32_t i = n; i-- > 0;) {
        dp = gsid_cplx_add(gsid_cplx_mul(dp, z), p);
        p = gsid_cplx_mul(p, z);
        p.re += coef[i];
    }
    return gsid_cplx_div(p, dp);
}

/* One simultaneous correction of every root; returns the largest relative correction. */
static double aberth_sweep(uint32_t n, const double *coef, gsid_cplx *z) {
    double largest = 0;
    for (uint32_t i = 0; i < n; i++) {
        const gsid_cplx step = newton_step(n, coef, z[i]);
        if (!gsid_cplx_is_finite(step))
            continue; /* on a stationary point: the other roots' moves free it */
        gsid_cplx repulsion = {0, 0};
        for (uint32_t j = 0; j < n; j++)
            if (j != i)
                repulsion = gsid_cplx_add(repulsion, gsid_cplx_div(gsid_cplx_make(1, 0), gsid_cplx_sub(z[i], z[j])));
        gsid_cplx denominator = gsid_cplx_scale(-1, gsid_cplx_mul(step, repulsion));
        denominator.re += 1;
        const gsid_cplx move = gsid_cplx_div(step, denominator);
        if (!gsid_cplx_is_finite(move))
            continue;
        z[i] = gsid_cplx_sub(z[i], move);
        largest = fmax(largest, sqrt(gsid_cplx_abs2(move) / fmax(gsid_cplx_abs2(z[i]), 1e-300)));
    }
    return largest;
}

/* Real coefficients have real roots and conjugate pairs: make them exactly so. Each root above the axis takes the nearest
 * one below as its partner; what is left over is real. */
static void pair_conjugates(uint32_t n, gsid_cplx *z) {
    int paired[GSID_ORDER_MAX] = {0};
    for (uint32_t i = 0; i < n; i++)
        if (fabs(z[i].im) <= 1e-11 * sqrt(gsid_cplx_abs2(z[i])))
            z[i].im = 0;
    for (uint32_t i = 0; i < n; i++) {
        if (paired[i] || z[i].im <= 0)
            continue;
        uint32_t partner = n;
        for (uint32_t j = 0; j < n; j++)
            if (!paired[j] && z[j].im < 0 &&
                (partner == n || gsid_cplx_abs2(gsid_cplx_sub(z[j], gsid_cplx_conj(z[i]))) <
                                     gsid_cplx_abs2(gsid_cplx_sub(z[partner], gsid_cplx_conj(z[i])))))
                partner = j;
        if (partner == n)
            continue;
        z[i].re = (z[i].re + z[partner].re) / 2;
        z[i].im = (z[i].im - z[partner].im) / 2;
        z[partner] = gsid_cplx_conj(z[i]);
        paired[i] = paired[partner] = 1;
    }
    for (uint32_t i = 0; i < n; i++)
        if (!paired[i])
            z[i].im = 0;
}

gsid_status gsid_poly_roots(uint32_t degree, const double *coef, gsid_cplx *roots, uint32_t *n_roots) {
    if (coef == NULL || n_roots == NULL || (degree > 0 && roots == NULL))
        return GSID_E_NULL;
    if (degree > GSID_ORDER_MAX)
        return GSID_E_CONFIG;
    for (uint32_t i = 0; i <= degree; i++)
        if (!isfinite(coef[i]))
            return GSID_E_NONFINITE;
    uint32_t n = degree, n_at_zero = 0;
    while (n > 0 && coef[n] == 0)
        n--;
    while (n_at_zero < n && coef[n_at_zero] == 0)
        n_at_zero++;
    for (uint32_t i = 0; i < n_at_zero; i++)
        roots[i].re = roots[i].im = 0;
    *n_roots = n;
    n -= n_at_zero;
    if (n == 0)
        return GSID_OK;

    gsid_cplx *z = roots + n_at_zero;
    const double *reduced = coef + n_at_zero;
    start_on_circle(n, reduced, z);
    double largest = 1;
    for (uint32_t i = 0; i < ITERATIONS_MAX && largest > 1e-15; i++)
        largest = aberth_sweep(n, reduced, z);
    pair_conjugates(n, z);
    return largest <= 1e-10 ? GSID_OK
                            : GSID_MAX_ITER; /* repeated roots stop near the square root of the rounding unit */
}
