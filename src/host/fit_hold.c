#include <math.h>

#include "../core/complex_math.h"
#include "fit_run.h"

/* Standard deviation of g / hold with which the method weights its squares. */
static double sigma_of(const fit_run *r, uint32_t k, double hold_size) {
    switch (r->cfg.method) {
    case GSID_METHOD_ML:
    case GSID_METHOD_ML_INPUT_OUTPUT:
        return r->data->sigma[k] / hold_size;
    case GSID_METHOD_NLS_OUTPUT:
        return 1 / (r->cfg.input[k] * hold_size);
    case GSID_METHOD_LOG: /* so that weighted linear starts have relative errors too */
        return sqrt(gsid_cplx_abs2(r->g[k]));
    default:
        return 1;
    }
}

/* g, its errors and their covariance with the input, without the hold: (measured - images) / hold.  Eq: MOD-2 */
void gsid_fit_free_of_hold(fit_run *r) {
    for (uint32_t k = 0; k < r->data->n_lines; k++) {
        r->g[k] = gsid_cplx_div(gsid_cplx_sub(r->data->g[k], r->images[k]), r->hold[k]);
        r->sigma[k] = sigma_of(r, k, sqrt(gsid_cplx_abs2(r->hold[k])));
        if (r->work.cov_yu != NULL) { /* of the output less the images' part of it */
            const gsid_cplx of_images = gsid_cplx_scale(r->data->var_u[k], r->images[k]);
            r->cov_yu[k] = gsid_cplx_div(gsid_cplx_sub(r->data->cov_yu[k], of_images), r->hold[k]);
        }
    }
}

/* What sampling folds back of a held input: the held response less hold times G. */
static gsid_status images_of(const fit_run *r, const gsid_rational *model, gsid_cplx *images) {
    const uint32_t n = r->data->n_lines;
    gsid_status status = gsid_hold_response(model, r->cfg.sample_s, n, r->data->f_hz, images);
    for (uint32_t k = 0; k < n && status == GSID_OK; k++) {
        gsid_cplx g;
        status = gsid_rational_eval(model, 1, &r->data->f_hz[k], &g);
        images[k] = gsid_cplx_sub(images[k], gsid_cplx_mul(r->hold[k], g));
    }
    return status;
}

static double *parameter(gsid_rational *model, uint32_t i) {
    if (i < model->n_poles) {
        return &model->den[i < gsid_rational_held(model) ? i : i + 1];
    }
    i -= model->n_poles;
    return i <= model->n_zeros ? &model->num[i] : &model->delay_s;
}

/* Steps of the parameters that change the response by a millionth: small for the model, large against rounding. */
static gsid_status difference_steps(const fit_run *r, const gsid_rational *model, double *step) {
    const uint32_t n = r->cfg.n_poles + r->cfg.n_zeros + 2;
    double size = 0, by_parameter[GSID_RATIONAL_PARAMETERS_MAX] = {0};
    for (uint32_t k = 0; k < r->data->n_lines; k++) {
        gsid_cplx g, slope[GSID_RATIONAL_PARAMETERS_MAX];
        const gsid_status status = gsid_rational_gradient(model, r->data->f_hz[k], &g, slope);
        if (status != GSID_OK) {
            return status;
        }
        size += gsid_cplx_abs2(g);
        for (uint32_t i = 0; i < n; i++) {
            by_parameter[i] += gsid_cplx_abs2(slope[i]);
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        step[i] = by_parameter[i] > 0 ? 1e-6 * sqrt(size / by_parameter[i]) : 0;
    }
    return GSID_OK;
}

/* Derivatives of the images by the parameters, from finite differences. */
static gsid_status set_drift(fit_run *r, const gsid_rational *model) {
    const uint32_t n = r->data->n_lines, stride = r->cfg.n_poles + r->cfg.n_zeros + 2;
    double step[GSID_RATIONAL_PARAMETERS_MAX];
    gsid_status status = difference_steps(r, model, step);
    for (uint32_t i = 0; i < stride && status == GSID_OK; i++) {
        gsid_rational near = *model;
        *parameter(&near, i) += step[i];
        status = images_of(r, &near, r->moved);
        for (uint32_t k = 0; k < n && status == GSID_OK; k++) {
            const gsid_cplx change = gsid_cplx_div(gsid_cplx_sub(r->images[k], r->moved[k]), r->hold[k]);
            r->drift[k * stride + i] = gsid_cplx_scale(step[i] > 0 ? 1 / step[i] : 0, change);
        }
    }
    return status;
}

/* Subtract the images of a model from the data: the `update` of a gsid_ml_cfg. */
gsid_status gsid_fit_take_images(void *user, const gsid_rational *model, int with_drift) {
    fit_run *r = user;
    gsid_status status = images_of(r, model, r->images);
    gsid_fit_free_of_hold(r);
    if (status == GSID_OK && with_drift) {
        status = set_drift(r, model);
    }
    return status;
}
