#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/complex_math.h"
#include "fit_run.h"

/* Rows w dG/dtheta into `rows`, and N = sum w^4 sigma^2 Re(x x^H), x = dG/dtheta, into inner. */
static gsid_status weighted_sums(const fit_run *r, const gsid_rational *model, uint32_t n, gsid_lsq *rows,
                                 double *inner) {
    memset(inner, 0, n * n * sizeof *inner);
    for (uint32_t k = 0; k < r->data->n_lines; k++) {
        gsid_cplx g, x[GSID_RATIONAL_PARAMETERS_MAX];
        double re[GSID_RATIONAL_PARAMETERS_MAX], im[GSID_RATIONAL_PARAMETERS_MAX];
        gsid_status status = gsid_rational_gradient(model, r->data->f_hz[k], &g, x);
        for (uint32_t i = 0; i < n; i++) {
            x[i] = gsid_cplx_sub(x[i], r->drift[k * (r->cfg.n_poles + r->cfg.n_zeros + 2) + i]);
        }
        const double w = gsid_fit_equivalent_weight(r, model, k);
        const double noise = w * r->data->sigma[k] / sqrt(gsid_cplx_abs2(r->hold[k]));
        for (uint32_t i = 0; i < n && status == GSID_OK; i++) {
            re[i] = w * x[i].re;
            im[i] = w * x[i].im;
            for (uint32_t j = 0; j <= i; j++) {
                inner[i * n + j] += noise * noise * (re[i] * re[j] + im[i] * im[j]);
            }
        }
        if (status == GSID_OK) {
            status = gsid_lsq_add(rows, re, 0);
        }
        if (status == GSID_OK) {
            status = gsid_lsq_add(rows, im, 0);
        }
        if (status != GSID_OK) {
            return status;
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < i; j++) {
            inner[j * n + i] = inner[i * n + j];
        }
    }
    return GSID_OK;
}

/* product <- a b, square. */
static void multiply(uint32_t n, const double *a, const double *b, double *product) {
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++) {
            double sum = 0;
            for (uint32_t k = 0; k < n; k++) {
                sum += a[i * n + k] * b[k * n + j];
            }
            product[i * n + j] = sum;
        }
    }
}

/* Covariance of an estimate that minimises sum w^2 |g - G|^2 while the errors of g have variance sigma^2:
 * M^-1 N M^-1 / 2, M = sum w^2 Re(x x^H). For ML it is the inverse of Fisher's information.  Eq: EST-6 */
static gsid_status covariance(fit_run *r, const gsid_rational *model, gsid_fit_result *result) {
    const uint32_t n = result->n_parameters;
    double *memory = malloc(3 * (size_t)n * n * sizeof *memory);
    if (memory == NULL) {
        return GSID_E_NO_MEMORY;
    }
    double *inner = memory, *inverse = memory + n * n, *half = memory + 2 * n * n;
    gsid_lsq rows;
    gsid_lsq_init(&rows, n, r->mem, r->mem_size);
    gsid_status status = weighted_sums(r, model, n, &rows, inner);
    if (status == GSID_OK) {
        status = gsid_lsq_covariance(&rows, inverse);
    }
    if (status == GSID_OK && r->cfg.method == GSID_METHOD_ML) { /* N = M */
        memcpy(result->cov, inverse, (size_t)n * n * sizeof *inverse);
    } else if (status == GSID_OK) {
        multiply(n, inverse, inner, half);
        multiply(n, half, inverse, result->cov);
    }
    for (uint32_t i = 0; i < n * n; i++) {
        result->cov[i] /= 2;
    }
    free(memory);
    return status;
}

/* Roots of num or den in rad/s, or in z. */
static gsid_status roots_of(const gsid_rational *model, uint32_t degree, const double *coef, gsid_cplx *roots,
                            uint32_t *n_roots) {
    double descending[GSID_ORDER_MAX + 1];
    for (uint32_t i = 0; i <= degree; i++) {
        descending[i] = coef[degree - i];
    }
    const int in_s = model->domain == GSID_DOMAIN_S;
    const gsid_status status = gsid_poly_roots(degree, in_s ? coef : descending, roots, n_roots);
    for (uint32_t i = 0; status >= 0 && in_s && i < *n_roots; i++) {
        roots[i] = gsid_cplx_scale(model->scale_rad_s, roots[i]);
    }
    return status;
}

double gsid_fit_cost_by_variance(const fit_run *r, const gsid_rational *model) {
    double cost = 0;
    for (uint32_t k = 0; k < r->data->n_lines; k++) {
        gsid_cplx g;
        if (gsid_rational_eval(model, 1, &r->data->f_hz[k], &g) != GSID_OK) {
            return HUGE_VAL;
        }
        const double hold2 = gsid_cplx_abs2(r->hold[k]), sigma = r->data->sigma[k];
        cost += gsid_cplx_abs2(gsid_cplx_sub(r->g[k], g)) * hold2 / (sigma * sigma);
    }
    return cost;
}

gsid_status gsid_fit_answer(fit_run *r, const fit_candidate *best, gsid_fit_result *result) {
    const gsid_rational *model = &best->model;
    result->model = *model;
    result->cost = best->cost;
    result->cost_ml = gsid_fit_cost_by_variance(r, model);
    result->n_parameters = gsid_fit_n_parameters(&r->cfg);
    gsid_rational_is_stable(model, &result->is_stable);
    uint32_t n_poles;
    gsid_status status = roots_of(model, model->n_poles, model->den, result->poles, &n_poles);
    if (status >= 0) {
        status = roots_of(model, model->n_zeros, model->num, result->zeros, &result->n_zeros_found);
    }
    if (status < 0) {
        return status;
    }
    return gsid_fit_is_linear(r) ? gsid_fit_influence(r, model, result) : covariance(r, model, result);
}
