#include <math.h>

#include "../core/complex_math.h"
#include "gsid/host/fit.h"

/* Partial fractions: G(s) = exp(-s delay) (direct + sum residue_i / (s - pole_i)), in plain s. */
typedef struct {
    uint32_t n;
    double direct;
    gsid_cplx pole[GSID_ORDER_MAX], residue[GSID_ORDER_MAX];
} fractions;

/* Roots nearer than this (relative) are moved apart by it: the response changes by its square only. */
#define POLE_SPLIT 1e-5

static void part_repeated_poles(uint32_t n, gsid_cplx *pole) {
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < i; j++) {
            const double size = sqrt(gsid_cplx_abs2(pole[i])) + 1e-3; /* a scaled pole at 0 still has room around it */
            if (gsid_cplx_abs2(gsid_cplx_sub(pole[i], pole[j])) < pow(POLE_SPLIT * size, 2)) {
                pole[i].re -= POLE_SPLIT * size;
                pole[j].re += POLE_SPLIT * size;
            }
        }
    }
}

static gsid_status expand(const gsid_rational *model, fractions *f) {
    const uint32_t n = model->n_poles;
    gsid_cplx pole[GSID_ORDER_MAX];
    uint32_t n_found;
    const gsid_status status = gsid_poly_roots(n, model->den, pole, &n_found);
    if (status < 0)
        return status;
    if (n_found < n)
        return GSID_E_CONFIG;
    part_repeated_poles(n, pole);

    double remainder[GSID_ORDER_MAX + 1] = {0};
    for (uint32_t i = 0; i <= model->n_zeros; i++)
        remainder[i] = model->num[i];
    f->n = n;
    f->direct = model->n_zeros == n ? model->num[n] / model->den[n] : 0;
    for (uint32_t i = 0; i <= n; i++)
        remainder[i] -= f->direct * model->den[i];
    for (uint32_t i = 0; i < n; i++) {
        gsid_cplx others = {model->den[n], 0}; /* den'(pole_i), from the roots so that it fits poles moved apart */
        for (uint32_t j = 0; j < n; j++)
            if (j != i)
                others = gsid_cplx_mul(others, gsid_cplx_sub(pole[i], pole[j]));
        const gsid_cplx top = n > 0 ? gsid_cplx_polynomial(n - 1, remainder, pole[i]) : pole[i];
        f->residue[i] = gsid_cplx_scale(model->scale_rad_s, gsid_cplx_div(top, others));
        f->pole[i] = gsid_cplx_scale(model->scale_rad_s, pole[i]);
    }
    return GSID_OK;
}

/* exp(z) */
static gsid_cplx exponential(gsid_cplx z) {
    return gsid_cplx_scale(exp(z.re), gsid_cplx_cis(z.im));
}

/* (exp(p t) - 1) / p, the integral of exp(p x) over 0..t; a series where the difference would cancel. */
static gsid_cplx integral_of_exp(gsid_cplx p, double t) {
    const gsid_cplx z = gsid_cplx_scale(t, p);
    if (gsid_cplx_abs2(z) > 0.01) {
        gsid_cplx e = exponential(z);
        e.re -= 1;
        return gsid_cplx_div(e, p);
    }
    gsid_cplx sum = {1, 0}, term = {1, 0};
    for (int i = 2; i < 14; i++) {
        term = gsid_cplx_scale(1.0 / i, gsid_cplx_mul(term, z));
        sum = gsid_cplx_add(sum, term);
    }
    return gsid_cplx_scale(t, sum);
}

/* Eq: MOD-2. A delay of q + d samples, 0 <= d < 1: within a sample the held input is u[n-q-1] for d T, then u[n-q]. */
static gsid_cplx held_response(const fractions *f, double q, double d, double sample_s, double f_hz) {
    const double angle = GSID_TWO_PI * f_hz * sample_s;
    const gsid_cplx z = gsid_cplx_cis(angle), back = gsid_cplx_cis(-angle);
    gsid_cplx sum =
        gsid_cplx_scale(f->direct, back); /* sampled just before the new command, so the direct path is one late */
    for (uint32_t i = 0; i < f->n; i++) {
        const gsid_cplx p = f->pole[i];
        const gsid_cplx late = integral_of_exp(p, (1 - d) * sample_s);
        const gsid_cplx early =
            gsid_cplx_mul(exponential(gsid_cplx_scale((1 - d) * sample_s, p)), integral_of_exp(p, d * sample_s));
        const gsid_cplx driven = gsid_cplx_mul(f->residue[i], gsid_cplx_add(late, gsid_cplx_mul(early, back)));
        sum = gsid_cplx_add(sum, gsid_cplx_div(driven, gsid_cplx_sub(z, exponential(gsid_cplx_scale(sample_s, p)))));
    }
    return gsid_cplx_mul(sum, gsid_cplx_cis(-angle * q));
}

gsid_status gsid_hold_response(const gsid_rational *model, double sample_s, uint32_t n_freq, const double *f_hz,
                               gsid_cplx *g) {
    if (model == NULL || (n_freq > 0 && (f_hz == NULL || g == NULL)))
        return GSID_E_NULL;
    if (model->domain != GSID_DOMAIN_S || model->n_zeros > model->n_poles || model->n_poles > GSID_ORDER_MAX ||
        !(sample_s > 0) || !isfinite(model->delay_s))
        return GSID_E_CONFIG;
    fractions f;
    const gsid_status status = expand(model, &f);
    if (status != GSID_OK)
        return status;
    /* A delay that rounding left a hair below a whole number of samples counts as that number. */
    const double samples = model->delay_s / sample_s;
    const double q = floor(samples + 1e-12), d = fmax(samples - q, 0);
    for (uint32_t k = 0; k < n_freq; k++)
        if (!gsid_cplx_is_finite(held_response(&f, q, d, sample_s, f_hz[k])))
            return GSID_E_NONFINITE;
    for (uint32_t k = 0; k < n_freq; k++)
        g[k] = held_response(&f, q, d, sample_s, f_hz[k]);
    return GSID_OK;
}
