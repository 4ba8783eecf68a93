#include "gsid/estimate.h"

#include "equations.h"
#include "residual.h"

/* Whether the variance of g - G is positive for every G: the covariance of the errors of g and of the input is within the limit
 * that their variances set, apart from the rounding of two numbers that cancel. */
static int is_covariance(const gsid_frd *data, uint32_t k) {
    const gsid_real var_u = data->var_u[k];
    const gsid_cplx cov = data->cov_yu[k], common = gsid_cplx_sub(cov, gsid_cplx_scale(var_u, data->g[k]));
    const gsid_real rounding = 128 * GSID_EPSILON * (gsid_fabs(cov.re) + gsid_fabs(cov.im));
    return gsid_hypot(common.re, common.im) <= GSID_R(1.0001) * data->sigma[k] * gsid_sqrt(var_u) + rounding;
}

static gsid_status check_errors(const gsid_frd *data, uint32_t k) {
    if (data->sigma != NULL && !(data->sigma[k] > 0 && gsid_is_finite(data->sigma[k]))) {
        return GSID_E_CONFIG;
    }
    if (data->logarithmic && data->g[k].re == 0 && data->g[k].im == 0) {
        return GSID_E_NONFINITE;
    }
    if (data->var_u == NULL) {
        return GSID_OK;
    }
    if (!gsid_is_finite(data->var_u[k]) || !gsid_cplx_is_finite(data->cov_yu[k])) {
        return GSID_E_NONFINITE;
    }
    return data->var_u[k] >= 0 && is_covariance(data, k) ? GSID_OK : GSID_E_CONFIG;
}

static gsid_status check_data(const gsid_frd *data) {
    if (data == NULL || data->f_hz == NULL || data->g == NULL) {
        return GSID_E_NULL;
    }
    if (data->var_u != NULL && (data->cov_yu == NULL || data->sigma == NULL)) {
        return GSID_E_NULL;
    }
    for (uint32_t k = 0; k < data->n_lines; k++) {
        if (!gsid_is_finite(data->f_hz[k]) || !gsid_cplx_is_finite(data->g[k])) {
            return GSID_E_NONFINITE;
        }
        const gsid_status status = check_errors(data, k);
        if (status != GSID_OK) {
            return status;
        }
    }
    return GSID_OK;
}

static gsid_status check_model(const gsid_rational *model) {
    if (model == NULL) {
        return GSID_E_NULL;
    }
    if (model->n_poles > GSID_ORDER_MAX || model->n_zeros > GSID_ORDER_MAX || !gsid_is_finite(model->delay_s)) {
        return GSID_E_CONFIG;
    }
    const gsid_real rate = model->domain == GSID_DOMAIN_S ? model->scale_rad_s : model->sample_s;
    return rate > 0 && gsid_is_finite(rate) ? GSID_OK : GSID_E_CONFIG;
}

gsid_status gsid_equations_check(const gsid_frd *data, const gsid_rational *model) {
    const gsid_status status = check_data(data);
    return status != GSID_OK ? status : check_model(model);
}

gsid_status gsid_equations_init(gsid_equations *q, const gsid_frd *data, const gsid_rational *model, int free_delay,
                                void *mem, size_t mem_size) {
    const gsid_status status = gsid_equations_check(data, model);
    if (status != GSID_OK) {
        return status;
    }
    if (mem == NULL) {
        return GSID_E_NULL;
    }
    if (mem_size < GSID_ESTIMATE_MEM_SIZE(model->n_poles, model->n_zeros) || (uintptr_t)mem % sizeof(gsid_real) != 0) {
        return GSID_E_MEMORY;
    }
    q->n_den = model->n_poles;
    q->n_num = model->n_zeros + 1;
    q->n = q->n_den + q->n_num + (free_delay ? 1u : 0u);
    q->held = gsid_rational_held(model);
    q->n_rows = 0;
    if (2 * data->n_lines < q->n) {
        return GSID_E_TOO_FEW;
    }
    const size_t lsq_size = GSID_LSQ_MEM_SIZE(q->n);
    unsigned char *bytes = (unsigned char *)mem;
    gsid_lsq_init(&q->normal, q->n, bytes, lsq_size);
    gsid_lsq_init(&q->damped, q->n, bytes + lsq_size, lsq_size);
    q->block = (gsid_real *)(void *)(bytes + 2 * lsq_size);
    q->step = q->block + ((size_t)q->n + 1) * GSID_LSQ_BLOCK;
    q->bend = q->step + q->n;
    q->length = q->bend + q->n;
    return GSID_OK;
}

gsid_status gsid_equations_end(gsid_equations *q) {
    const uint32_t n_rows = q->n_rows;
    q->n_rows = 0;
    return n_rows > 0 ? gsid_lsq_add_block(&q->normal, n_rows, q->block) : GSID_OK;
}

gsid_status gsid_equations_next(gsid_equations *q) {
    q->n_rows += 2;
    return q->n_rows < GSID_LSQ_BLOCK ? GSID_OK : gsid_equations_end(q);
}

void gsid_equations_set(const gsid_equations *q, const gsid_real *x, gsid_rational *model) {
    model->den[q->held] = 1;
    for (uint32_t i = 0; i < q->n_den; i++) {
        model->den[i < q->held ? i : i + 1] = x[i];
    }
    for (uint32_t i = 0; i < q->n_num; i++) {
        model->num[i] = x[q->n_den + i];
    }
    if (q->n > q->n_den + q->n_num) {
        model->delay_s = x[q->n - 1];
    }
}

gsid_real gsid_equations_cost(const gsid_frd *data, const gsid_rational *model) {
    gsid_real cost = 0;
    for (uint32_t k = 0; k < data->n_lines; k++) {
        gsid_cplx g;
        if (gsid_rational_eval(model, 1, &data->f_hz[k], &g) != GSID_OK) {
            return INFINITY;
        }
        cost += gsid_cplx_abs2(gsid_residual_at(data, k, g).value);
    }
    return gsid_is_finite(cost) ? cost : (gsid_real)INFINITY;
}

int gsid_equations_is_finite(const gsid_rational *model) {
    gsid_real sum = 0 * model->delay_s; /* 0 times a number that is not finite is not 0 */
    for (uint32_t i = 0; i <= model->n_poles; i++) {
        sum += 0 * model->den[i];
    }
    for (uint32_t i = 0; i <= model->n_zeros; i++) {
        sum += 0 * model->num[i];
    }
    return sum == 0;
}

int gsid_equations_are_alike(const gsid_frd *data, const gsid_rational *a, const gsid_rational *b,
                             gsid_real tolerance) {
    gsid_real difference = 0, size = 0;
    for (uint32_t k = 0; k < data->n_lines; k++) {
        const gsid_real weight = gsid_residual_weight(data, k);
        gsid_cplx g[2];
        if (gsid_rational_eval(a, 1, &data->f_hz[k], &g[0]) != GSID_OK ||
            gsid_rational_eval(b, 1, &data->f_hz[k], &g[1]) != GSID_OK) {
            return 0;
        }
        difference += gsid_cplx_abs2(gsid_cplx_scale(weight, gsid_cplx_sub(g[0], g[1])));
        size += gsid_cplx_abs2(gsid_cplx_scale(weight, data->g[k]));
    }
    return difference < tolerance * tolerance * size;
}
