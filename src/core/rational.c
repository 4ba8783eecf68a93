#include "gsid/rational.h"

#include "complex_math.h"

gsid_status gsid_rational_init(gsid_rational *model, gsid_domain domain, uint32_t n_poles, uint32_t n_zeros,
                               gsid_real rate) {
    if (model == NULL) {
        return GSID_E_NULL;
    }
    if (n_poles > GSID_ORDER_MAX || n_zeros > GSID_ORDER_MAX || !(rate > 0) || !gsid_is_finite(rate) ||
        (domain != GSID_DOMAIN_S && domain != GSID_DOMAIN_Z)) {
        return GSID_E_CONFIG;
    }
    model->domain = domain;
    model->n_poles = n_poles;
    model->n_zeros = n_zeros;
    model->scale_rad_s = domain == GSID_DOMAIN_S ? rate : GSID_R(1.0);
    model->sample_s = domain == GSID_DOMAIN_Z ? rate : GSID_R(0.0);
    model->delay_s = 0;
    for (uint32_t i = 0; i <= GSID_ORDER_MAX; i++) {
        model->num[i] = model->den[i] = 0;
    }
    model->den[0] = 1;
    return GSID_OK;
}

gsid_cplx gsid_rational_variable(const gsid_rational *model, gsid_real w_rad_s) {
    if (model->domain == GSID_DOMAIN_Z) {
        return gsid_cplx_cis(-w_rad_s * model->sample_s);
    }
    const gsid_cplx p = {0, w_rad_s / model->scale_rad_s};
    return p;
}

/* Eq: MOD-1 */
/* Checks the orders before they index the arrays: the caller may have written any value into the struct. */
static int has_orders(const gsid_rational *model) {
    return model->n_poles <= GSID_ORDER_MAX && model->n_zeros <= GSID_ORDER_MAX;
}

static gsid_cplx response(const gsid_rational *model, gsid_real f_hz) {
    const gsid_real w = GSID_TWO_PI * f_hz;
    const gsid_cplx v = gsid_rational_variable(model, w);
    const gsid_cplx ratio = gsid_cplx_div(gsid_cplx_polynomial(model->n_zeros, model->num, v),
                                          gsid_cplx_polynomial(model->n_poles, model->den, v));
    return gsid_cplx_mul(gsid_cplx_cis(-w * model->delay_s), ratio);
}

gsid_status gsid_rational_eval(const gsid_rational *model, uint32_t n_freq, const gsid_real *f_hz, gsid_cplx *g) {
    if (model == NULL || (n_freq > 0 && (f_hz == NULL || g == NULL))) {
        return GSID_E_NULL;
    }
    if (!has_orders(model)) {
        return GSID_E_CONFIG;
    }
    if (n_freq == 1) { /* the same in half the time: fits evaluate line by line */
        const gsid_cplx one = response(model, f_hz[0]);
        if (!gsid_cplx_is_finite(one)) {
            return GSID_E_NONFINITE;
        }
        *g = one;
        return GSID_OK;
    }
    for (uint32_t k = 0; k < n_freq; k++) {
        if (!gsid_cplx_is_finite(response(model, f_hz[k]))) {
            return GSID_E_NONFINITE;
        }
    }
    for (uint32_t k = 0; k < n_freq; k++) {
        g[k] = response(model, f_hz[k]);
    }
    return GSID_OK;
}

uint32_t gsid_rational_held(const gsid_rational *model) {
    return model->domain == GSID_DOMAIN_S ? model->n_poles : 0;
}

/* With G = e B / A, e the delay: dG/da_i = -G v^i / A, dG/db_i = e v^i / A, dG/dtau = -j w G. */
gsid_status gsid_rational_gradient(const gsid_rational *model, gsid_real f_hz, gsid_cplx *g, gsid_cplx *gradient) {
    if (model == NULL || g == NULL || gradient == NULL) {
        return GSID_E_NULL;
    }
    if (!has_orders(model)) {
        return GSID_E_CONFIG;
    }
    const gsid_real w = GSID_TWO_PI * f_hz;
    const gsid_cplx v = gsid_rational_variable(model, w);
    const gsid_cplx a = gsid_cplx_polynomial(model->n_poles, model->den, v);
    const gsid_cplx b = gsid_cplx_polynomial(model->n_zeros, model->num, v);
    const gsid_cplx by_num = gsid_cplx_div(gsid_cplx_cis(-w * model->delay_s), a);
    const gsid_cplx response_at_f = gsid_cplx_mul(by_num, b);
    const gsid_cplx by_den = gsid_cplx_scale(GSID_R(-1.0), gsid_cplx_div(response_at_f, a));
    if (!gsid_cplx_is_finite(response_at_f) || !gsid_cplx_is_finite(by_den)) {
        return GSID_E_NONFINITE;
    }

    const uint32_t held = gsid_rational_held(model);
    gsid_cplx power = gsid_cplx_make(1, 0);
    uint32_t column = 0;
    for (uint32_t i = 0; i <= model->n_poles; i++, power = gsid_cplx_mul(power, v)) {
        if (i != held) {
            gradient[column++] = gsid_cplx_mul(power, by_den);
        }
    }
    power = gsid_cplx_make(1, 0);
    for (uint32_t i = 0; i <= model->n_zeros; i++, power = gsid_cplx_mul(power, v)) {
        gradient[column++] = gsid_cplx_mul(power, by_num);
    }
    gradient[column] = gsid_cplx_make(w * response_at_f.im, -w * response_at_f.re);
    *g = response_at_f;
    return GSID_OK;
}

/* Routh's array: its first column has one sign exactly when every root has a negative real part. */
static int is_hurwitz(uint32_t degree, const gsid_real *coef) {
    gsid_real upper[GSID_ORDER_MAX + 2] = {0}, lower[GSID_ORDER_MAX + 2] = {0};
    const gsid_real sign = coef[degree] < 0 ? GSID_R(-1.0) : GSID_R(1.0);
    for (uint32_t i = 0; i <= degree; i++) {
        (i % 2 == 0 ? upper : lower)[i / 2] = sign * coef[degree - i];
    }
    for (uint32_t step = 0; step < degree; step++) {
        if (!(upper[0] > 0 && lower[0] > 0)) {
            return 0;
        }
        const gsid_real ratio = upper[0] / lower[0];
        for (uint32_t i = 0; i <= degree / 2; i++) {
            const gsid_real next = upper[i + 1] - ratio * lower[i + 1];
            upper[i] = lower[i];
            lower[i] = next;
        }
    }
    return 1;
}

/* Schur and Cohn's recursion on z^n den(1/z): every reflection coefficient is below 1 exactly when every pole lies inside
 * the unit circle. */
static int is_schur(uint32_t degree, const gsid_real *coef) {
    gsid_real a[GSID_ORDER_MAX + 1], next[GSID_ORDER_MAX + 1];
    for (uint32_t i = 0; i <= degree; i++) {
        a[i] = coef[i];
    }
    for (uint32_t n = degree; n > 0; n--) {
        const gsid_real k = a[n] / a[0];
        if (!(gsid_fabs(k) < 1)) {
            return 0;
        }
        for (uint32_t i = 0; i < n; i++) {
            next[i] = a[i] - k * a[n - i];
        }
        for (uint32_t i = 0; i < n; i++) {
            a[i] = next[i];
        }
    }
    return 1;
}

gsid_status gsid_rational_is_stable(const gsid_rational *model, int *is_stable) {
    if (model == NULL || is_stable == NULL) {
        return GSID_E_NULL;
    }
    if (model->n_poles > GSID_ORDER_MAX) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i <= model->n_poles; i++) {
        if (!gsid_is_finite(model->den[i])) {
            return GSID_E_NONFINITE;
        }
    }
    if (model->n_poles == 0) {
        *is_stable = 1;
    } else if (model->domain == GSID_DOMAIN_S) {
        *is_stable = is_hurwitz(model->n_poles, model->den);
    } else {
        *is_stable = is_schur(model->n_poles, model->den);
    }
    return GSID_OK;
}
