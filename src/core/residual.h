/* Error of a model's response at one line, and how it moves with the response: what the estimators sum the squares of. */
#ifndef GSID_RESIDUAL_H
#define GSID_RESIDUAL_H

#include "complex_math.h"
#include "gsid/frd.h"

/* d value = by_model dG + by_data dg + value Re(tilt dG) */
typedef struct {
    gsid_cplx value;
    gsid_cplx by_model;
    gsid_cplx by_data;
    gsid_cplx tilt; /* half the change of -ln sigma^2; 0 but for errors in the input */
} gsid_residual;

static inline gsid_real gsid_residual_weight(const gsid_frd *data, uint32_t k) {
    return data->sigma == NULL ? GSID_R(1.0) : 1 / data->sigma[k];
}

/* s ln(G/g): its imaginary part is the phase error to the nearest turn, that is, the measured phase unwrapped along the
 * model.  Eq: EST-8 */
static inline gsid_residual gsid_residual_logarithmic(const gsid_frd *data, uint32_t k, gsid_cplx g) {
    const gsid_cplx measured = data->g[k], ratio = gsid_cplx_div(g, measured);
    const gsid_real size = gsid_hypot(measured.re, measured.im);
    const gsid_real weight = data->sigma == NULL ? GSID_R(1.0) : size / data->sigma[k];
    gsid_residual e = {{0, 0}, {0, 0}, {0, 0}, {0, 0}};
    e.value.re = weight * gsid_log(gsid_hypot(ratio.re, ratio.im));
    e.value.im = weight * gsid_atan2(ratio.im, ratio.re);
    e.by_model = gsid_cplx_div(gsid_cplx_make(weight, 0), g);
    e.by_data = gsid_cplx_div(gsid_cplx_make(-weight, 0), measured);
    return e;
}

/* Errors of the input too: sigma^2 is that of the error at the model's G, not at the measured one.  Eq: EST-9 */
static inline void gsid_residual_tilt(const gsid_frd *data, uint32_t k, gsid_cplx g, gsid_cplx error,
                                      gsid_residual *e) {
    const gsid_real var_u = data->var_u[k], sigma = data->sigma[k];
    const gsid_cplx cov = data->cov_yu[k];
    const gsid_real more = var_u * (gsid_cplx_abs2(g) - gsid_cplx_abs2(data->g[k]));
    const gsid_real variance = sigma * sigma + more - 2 * (cov.re * error.re + cov.im * error.im);
    const gsid_real weight = 1 / gsid_sqrt(variance); /* not a number where rounding makes it negative */
    e->value = gsid_cplx_scale(weight, error);
    e->by_model.re = weight;
    e->by_data.re = -weight;
    e->tilt = gsid_cplx_sub(gsid_cplx_conj(cov), gsid_cplx_scale(var_u, gsid_cplx_conj(g)));
    e->tilt = gsid_cplx_scale(weight * weight, e->tilt);
}

/* The error at line k when the model's response is g. */
static inline gsid_residual gsid_residual_at(const gsid_frd *data, uint32_t k, gsid_cplx g) {
    if (data->logarithmic) {
        return gsid_residual_logarithmic(data, k, g);
    }
    const gsid_real weight = gsid_residual_weight(data, k);
    const gsid_cplx error = gsid_cplx_sub(g, data->g[k]);
    gsid_residual e = {{weight * error.re, weight * error.im}, {weight, 0}, {-weight, 0}, {0, 0}};
    if (data->var_u != NULL) {
        gsid_residual_tilt(data, k, g, error, &e);
    }
    return e;
}

/* Its derivative, where the response moves by dg. */
static inline gsid_cplx gsid_residual_slope(const gsid_residual *e, gsid_cplx dg) {
    const gsid_real tilt = e->tilt.re * dg.re - e->tilt.im * dg.im;
    return gsid_cplx_add(gsid_cplx_mul(e->by_model, dg), gsid_cplx_scale(tilt, e->value));
}

/* The q for which Re(conj(s) d value) = Re(q dG): what a sum over the lines needs of many derivatives at once. */
static inline gsid_cplx gsid_residual_project(const gsid_residual *e, gsid_cplx s) {
    const gsid_cplx q = gsid_cplx_mul(gsid_cplx_conj(s), e->by_model);
    return gsid_cplx_add(q, gsid_cplx_scale(e->value.re * s.re + e->value.im * s.im, e->tilt));
}

#endif
