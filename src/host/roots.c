#include <float.h>
#include <math.h>

#include "../core/complex_math.h"
#include "fit_sections.h"
#include "gsid/host/fit.h"
#include "roots.h"

#define SWEEPS_MAX 500

static double size_of(gsid_cplx z) {
    return hypot(z.re, z.im);
}

/* Where Aberth's iteration starts: on a circle of the roots' geometric mean, off the real axis so that pairs can part. */
static void start_on_circle(uint32_t n, const double *coef, gsid_cplx *z) {
    const double radius = exp((log(fabs(coef[0])) - log(fabs(coef[n]))) / n);
    for (uint32_t i = 0; i < n; i++) {
        z[i] = gsid_cplx_scale(radius, gsid_cplx_cis(GSID_TWO_PI * (i + 0.25) / n + 0.1));
    }
}

/* Newton's step p/p' at z. Returns 1 when p is no more than the rounding of z and of p itself: z is as good as it
 * gets. */
static int newton_step(uint32_t n, const double *coef, gsid_cplx z, gsid_cplx *step) {
    gsid_cplx p = {coef[n], 0}, dp = {0, 0};
    const double z_size = size_of(z);
    double terms = fabs(coef[n]); /* sum |coef[i] z^i| */
    for (uint32_t i = n; i-- > 0;) {
        dp = gsid_cplx_add(gsid_cplx_mul(dp, z), p);
        p = gsid_cplx_mul(p, z);
        p.re += coef[i];
        terms = terms * z_size + fabs(coef[i]);
    }
    *step = gsid_cplx_div(p, dp);
    return size_of(p) <= 2 * n * DBL_EPSILON * terms;
}

/* One correction of every root that needs one; returns how many did. */
static uint32_t aberth_sweep(uint32_t n, const double *coef, gsid_cplx *z) {
    uint32_t n_moving = 0;
    for (uint32_t i = 0; i < n; i++) {
        gsid_cplx step;
        if (newton_step(n, coef, z[i], &step)) {
            continue;
        }
        n_moving++;
        gsid_cplx repulsion = {0, 0};
        for (uint32_t j = 0; j < n; j++) {
            if (j != i) {
                repulsion = gsid_cplx_add(repulsion, gsid_cplx_div(gsid_cplx_make(1, 0), gsid_cplx_sub(z[i], z[j])));
            }
        }
        gsid_cplx denominator = gsid_cplx_scale(-1, gsid_cplx_mul(step, repulsion));
        denominator.re += 1;
        const gsid_cplx move = gsid_cplx_div(step, denominator);
        if (gsid_cplx_is_finite(move)) { /* else on a stationary point: the other roots' moves free it */
            z[i] = gsid_cplx_sub(z[i], move);
        }
    }
    return n_moving;
}

/* The conjugate of a root is the root nearest to that place: itself when it is real, whatever imaginary part rounding
 * gave it. */
void gsid_pair_conjugates(uint32_t n, gsid_cplx *z) {
    int done[GSID_FIT_SECTIONS_POLES_MAX] = {0};
    for (uint32_t i = 0; i < n; i++) {
        if (done[i]) {
            continue;
        }
        const gsid_cplx conjugate = gsid_cplx_conj(z[i]);
        uint32_t partner = i;
        for (uint32_t j = i + 1; j < n; j++) {
            if (!done[j] && size_of(gsid_cplx_sub(z[j], conjugate)) < size_of(gsid_cplx_sub(z[partner], conjugate))) {
                partner = j;
            }
        }
        z[i].re = (z[i].re + z[partner].re) / 2;
        z[i].im = partner == i ? 0 : (z[i].im - z[partner].im) / 2;
        z[partner] = partner == i ? z[i] : gsid_cplx_conj(z[i]);
        done[i] = done[partner] = 1;
    }
}

gsid_status gsid_poly_roots(uint32_t degree, const double *coef, gsid_cplx *roots, uint32_t *n_roots) {
    if (coef == NULL || n_roots == NULL || (degree > 0 && roots == NULL)) {
        return GSID_E_NULL;
    }
    if (degree > GSID_ORDER_MAX) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i <= degree; i++) {
        if (!isfinite(coef[i])) {
            return GSID_E_NONFINITE;
        }
    }
    uint32_t n = degree, n_at_zero = 0;
    while (n > 0 && coef[n] == 0) {
        n--;
    }
    while (n_at_zero < n && coef[n_at_zero] == 0) {
        n_at_zero++;
    }
    for (uint32_t i = 0; i < n_at_zero; i++) {
        roots[i].re = roots[i].im = 0;
    }
    *n_roots = n;
    n -= n_at_zero;
    if (n == 0) {
        return GSID_OK;
    }

    gsid_cplx *z = roots + n_at_zero;
    const double *reduced = coef + n_at_zero;
    start_on_circle(n, reduced, z);
    uint32_t n_moving = n;
    for (uint32_t i = 0; i < SWEEPS_MAX && n_moving > 0; i++) {
        n_moving = aberth_sweep(n, reduced, z);
    }
    gsid_pair_conjugates(n, z);
    return n_moving == 0 ? GSID_OK : GSID_MAX_ITER;
}
