#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/complex_math.h"
#include "fit_run.h"

/* Linear methods: the influence of each line's error on the estimate, from which its covariance and bias follow.
 * Eq: EST-6, EST-11 */
typedef struct {
    const fit_run *r;
    const gsid_rational *model;
    uint32_t n, n_linear;           /* parameters; without the delay */
    double *inverse;                /* [n_linear][n_linear] M^-1 */
    double along[GSID_RATIONAL_PARAMETERS_MAX];    /* [n_linear] change of the linear parameters with the delay */
    double coupling[GSID_RATIONAL_PARAMETERS_MAX]; /* [n_linear] M^-1 q, q as in second_pass */
    double slope2; /* sum of |z|^2, z the derivative of the response by the delay with all others following */
} influence;

/* The terms of one line. */
typedef struct {
    gsid_cplx x[GSID_RATIONAL_PARAMETERS_MAX]; /* derivatives of the model minus those of the data */
    gsid_cplx z;
    gsid_cplx v, a; /* variable, and denominator at it */
    double u2; /* weight of the output error, squared */
    double variance; /* of the response without the hold */
} line;

static gsid_status take_line(const influence *in, uint32_t k, line *l) {
    const fit_run *r = in->r;
    gsid_cplx g;
    const gsid_status status = gsid_rational_gradient(in->model, r->data->f_hz[k], &g, l->x);
    if (status != GSID_OK) {
        return status;
    }
    const gsid_cplx *drift = r->drift + (size_t)k * (r->cfg.n_poles + r->cfg.n_zeros + 2);
    l->v = gsid_rational_variable(in->model, GSID_TWO_PI * r->data->f_hz[k]);
    l->a = gsid_cplx_polynomial(in->model->n_poles, in->model->den, l->v);
    const double weight = gsid_fit_equivalent_weight(r, in->model, k), sigma = r->data->sigma[k];
    l->u2 = weight * weight;
    l->variance = sigma * sigma / gsid_cplx_abs2(r->hold[k]);
    for (uint32_t i = 0; i < in->n; i++) {
        l->x[i] = gsid_cplx_sub(l->x[i], drift[i]);
    }
    l->z = in->n > in->n_linear ? l->x[in->n_linear] : gsid_cplx_make(0, 0);
    for (uint32_t i = 0; i < in->n_linear && in->n > in->n_linear; i++) {
        l->z = gsid_cplx_add(l->z, gsid_cplx_scale(in->along[i], l->x[i]));
    }
    return GSID_OK;
}

static double inner(gsid_cplx a, gsid_cplx b) {
    return a.re * b.re + a.im * b.im;
}

/* y <- M^-1 x */
static void apply_inverse(const influence *in, const double *x, double *y) {
    for (uint32_t i = 0; i < in->n_linear; i++) {
        y[i] = 0;
        for (uint32_t j = 0; j < in->n_linear; j++) {
            y[i] += in->inverse[i * in->n_linear + j] * x[j];
        }
    }
}

/* M^-1; mixed <- sum u^2 Re(conj(x) x_delay); noise <- expected gradient of the equation error at the truth. */
static gsid_status first_pass(influence *in, double *mixed, double *noise) {
    gsid_lsq rows;
    gsid_lsq_init(&rows, in->n_linear, in->r->mem, in->r->mem_size);
    const uint32_t held = gsid_rational_held(in->model);
    for (uint32_t k = 0; k < in->r->data->n_lines; k++) {
        double re[GSID_RATIONAL_PARAMETERS_MAX], im[GSID_RATIONAL_PARAMETERS_MAX];
        line l;
        gsid_status status = take_line(in, k, &l);
        if (status != GSID_OK) {
            return status;
        }
        const double u = sqrt(l.u2), w2 = l.u2 / gsid_cplx_abs2(l.a);
        gsid_cplx power = {1, 0};
        for (uint32_t i = 0, column = 0; i <= in->model->n_poles; i++, power = gsid_cplx_mul(power, l.v)) {
            if (i != held) {
                noise[column++] += w2 * l.variance * inner(power, l.a);
            }
        }
        for (uint32_t i = 0; i < in->n_linear; i++) {
            re[i] = u * l.x[i].re;
            im[i] = u * l.x[i].im;
            mixed[i] += l.u2 * inner(l.x[i], l.z); /* z is the derivative by the delay alone, as long as `along` is 0 */
        }
        status = gsid_lsq_add(&rows, re, 0);
        if (status == GSID_OK) {
            status = gsid_lsq_add(&rows, im, 0);
        }
        if (status != GSID_OK) {
            return status;
        }
    }
    return gsid_lsq_covariance(&rows, in->inverse);
}

/* slope2; q <- sum Re(conj(z) x) */
static gsid_status second_pass(influence *in, double *q) {
    for (uint32_t k = 0; k < in->r->data->n_lines; k++) {
        line l;
        const gsid_status status = take_line(in, k, &l);
        if (status != GSID_OK) {
            return status;
        }
        in->slope2 += gsid_cplx_abs2(l.z);
        for (uint32_t i = 0; i < in->n_linear; i++) {
            q[i] += inner(l.z, l.x[i]);
        }
    }
    return in->slope2 > 0 ? GSID_OK : GSID_E_SINGULAR;
}

/* c <- influence: an error e of this line changes parameter i by Re(conj(c_i) e). */
static void influence_of(const influence *in, const line *l, gsid_cplx *c) {
    gsid_cplx by_delay = {0, 0};
    if (in->n > in->n_linear) {
        by_delay = l->z;
        for (uint32_t i = 0; i < in->n_linear; i++) {
            by_delay = gsid_cplx_sub(by_delay, gsid_cplx_scale(l->u2 * in->coupling[i], l->x[i]));
        }
        by_delay = gsid_cplx_scale(1 / in->slope2, by_delay);
        c[in->n_linear] = by_delay;
    }
    for (uint32_t i = 0; i < in->n_linear; i++) {
        c[i] = gsid_cplx_scale(in->along[i], by_delay);
        for (uint32_t j = 0; j < in->n_linear; j++) {
            c[i] = gsid_cplx_add(c[i], gsid_cplx_scale(l->u2 * in->inverse[i * in->n_linear + j], l->x[j]));
        }
    }
}

static gsid_status sum_covariance(const influence *in, double *cov) {
    memset(cov, 0, (size_t)in->n * in->n * sizeof *cov);
    for (uint32_t k = 0; k < in->r->data->n_lines; k++) {
        gsid_cplx c[GSID_RATIONAL_PARAMETERS_MAX];
        line l;
        const gsid_status status = take_line(in, k, &l);
        if (status != GSID_OK) {
            return status;
        }
        influence_of(in, &l, c);
        for (uint32_t i = 0; i < in->n; i++) {
            for (uint32_t j = 0; j < in->n; j++) {
                cov[i * in->n + j] += l.variance / 2 * inner(c[i], c[j]);
            }
        }
    }
    return GSID_OK;
}

gsid_status gsid_fit_influence(const fit_run *r, const gsid_rational *model, gsid_fit_result *result) {
    const uint32_t n = result->n_parameters, n_linear = model->n_poles + model->n_zeros + 1;
    influence in = {.r = r, .model = model, .n = n, .n_linear = n_linear};
    double mixed[GSID_RATIONAL_PARAMETERS_MAX] = {0}, noise[GSID_RATIONAL_PARAMETERS_MAX] = {0};
    double q[GSID_RATIONAL_PARAMETERS_MAX] = {0};
    in.inverse = malloc((size_t)n_linear * n_linear * sizeof *in.inverse);
    if (in.inverse == NULL) {
        return GSID_E_NO_MEMORY;
    }
    gsid_status status = first_pass(&in, mixed, noise);
    if (status == GSID_OK) {
        apply_inverse(&in, noise, result->bias);
    }
    double delay_bias = 0;
    if (status == GSID_OK && n > n_linear) {
        apply_inverse(&in, mixed, in.along);
        for (uint32_t i = 0; i < n_linear; i++) {
            in.along[i] = -in.along[i];
        }
        status = second_pass(&in, q);
        apply_inverse(&in, q, in.coupling);
        for (uint32_t i = 0; i < n_linear; i++) {
            delay_bias += q[i] * result->bias[i] / in.slope2;
        }
        result->bias[n_linear] = delay_bias;
    }
    for (uint32_t i = 0; i < n_linear; i++) {
        result->bias[i] = in.along[i] * delay_bias - result->bias[i];
    }
    if (status == GSID_OK) {
        status = sum_covariance(&in, result->cov);
    }
    free(in.inverse);
    return status;
}
