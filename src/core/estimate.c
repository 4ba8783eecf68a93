#include "gsid/estimate.h"

#include "equations.h"
#include "residual.h"

size_t gsid_estimate_mem_size(uint32_t n_poles, uint32_t n_zeros) {
    if (n_poles > GSID_ORDER_MAX || n_zeros > GSID_ORDER_MAX) {
        return 0;
    }
    return GSID_ESTIMATE_MEM_SIZE(n_poles, n_zeros);
}

gsid_status gsid_estimate_cost(const gsid_frd *data, const gsid_rational *model, gsid_real *cost) {
    const gsid_status status = gsid_equations_check(data, model);
    if (status != GSID_OK) {
        return status;
    }
    if (cost == NULL) {
        return GSID_E_NULL;
    }
    const gsid_real v = gsid_equations_cost(data, model);
    if (!gsid_is_finite(v) || !gsid_equations_is_finite(model)) {
        return GSID_E_NONFINITE;
    }
    *cost = v;
    return GSID_OK;
}

/* One line of the equation error e = A G' - B, G' the response without the delay, weighted by `weight`.  Eq: EST-1 */
static gsid_status add_equation_error(gsid_equations *q, const gsid_rational *model, gsid_cplx v, gsid_cplx g,
                                      gsid_real weight) {
    gsid_cplx power = {weight, 0};
    gsid_cplx rhs = {0, 0};
    for (uint32_t i = 0, column = 0; i <= model->n_poles; i++, power = gsid_cplx_mul(power, v)) {
        const gsid_cplx value = gsid_cplx_mul(power, g);
        if (i == q->held) {
            rhs = gsid_cplx_scale(GSID_R(-1.0), value);
        } else {
            gsid_equations_put(q, column++, value);
        }
    }
    power.re = weight;
    power.im = 0;
    for (uint32_t i = 0; i <= model->n_zeros; i++, power = gsid_cplx_mul(power, v)) {
        gsid_equations_put(q, q->n_den + i, gsid_cplx_scale(GSID_R(-1.0), power));
    }
    gsid_equations_put(q, q->n, rhs);
    return gsid_equations_next(q);
}

/* One linear solution, weighted by 1/(sigma |A_last|^r).  Eq: EST-2 */
static gsid_status solve_reweighted(gsid_equations *q, const gsid_frd *data, gsid_real exponent, int reweight,
                                    gsid_rational *model) {
    gsid_lsq_reset(&q->normal);
    for (uint32_t k = 0; k < data->n_lines; k++) {
        const gsid_real w_rad_s = GSID_TWO_PI * data->f_hz[k];
        const gsid_cplx v = gsid_rational_variable(model, w_rad_s);
        const gsid_cplx g = gsid_cplx_mul(data->g[k], gsid_cplx_cis(w_rad_s * model->delay_s));
        gsid_real weight = gsid_residual_weight(data, k);
        if (reweight) {
            const gsid_real a2 = gsid_cplx_abs2(gsid_cplx_polynomial(model->n_poles, model->den, v));
            /* The usual exponent by a root, which is the same to the bit everywhere. */
            weight /= exponent == 1 ? gsid_sqrt(a2) : gsid_pow(a2, exponent / 2);
        }
        const gsid_status status = add_equation_error(q, model, v, g, weight);
        if (status != GSID_OK) {
            return status;
        }
    }
    gsid_status status = gsid_equations_end(q);
    if (status == GSID_OK) {
        status = gsid_lsq_solve(&q->normal, 0, q->step, NULL);
    }
    if (status >= 0) {
        gsid_equations_set(q, q->step, model);
    }
    return status;
}

static gsid_status check_iwls(const gsid_iwls_cfg *cfg) {
    if (cfg == NULL) {
        return GSID_E_NULL;
    }
    const int is_good = cfg->exponent >= 0 && cfg->tolerance >= 0 && gsid_is_finite(cfg->exponent + cfg->tolerance);
    return is_good ? GSID_OK : GSID_E_CONFIG;
}

gsid_status gsid_estimate_iwls(const gsid_frd *data, const gsid_iwls_cfg *cfg, gsid_rational *model, gsid_real *cost,
                               void *mem, size_t mem_size) {
    gsid_status status = check_iwls(cfg);
    if (status != GSID_OK) {
        return status;
    }
    const gsid_real exponent = cfg->exponent > 0 ? cfg->exponent : GSID_R(1.0);
    gsid_equations q;
    status = gsid_equations_init(&q, data, model, 0, mem, mem_size);
    if (status != GSID_OK) {
        return status;
    }

    gsid_rational trial = *model, best = *model;
    gsid_real best_cost = INFINITY;
    gsid_status best_status = GSID_E_SINGULAR;
    int settled = 0;
    for (uint32_t i = 0; i <= cfg->n_iterations && !settled; i++) {
        const gsid_rational last = trial;
        const int reweight = i > 0 || cfg->from_model;
        status = solve_reweighted(&q, data, exponent, reweight, &trial);
        if (status < 0 && i == 0) {
            return status;
        }
        if (status < 0) {
            break; /* the denominator vanishes on a line: keep the iterate before */
        }
        const gsid_real v = gsid_equations_cost(data, &trial);
        settled = reweight && gsid_equations_are_alike(data, &last, &trial, cfg->tolerance);
        if (settled || v < best_cost) {
            best = trial;
            best_cost = v;
            best_status = status;
        }
    }
    if (!gsid_is_finite(best_cost)) {
        return GSID_E_SINGULAR;
    }
    *model = best;
    if (cost != NULL) {
        *cost = best_cost;
    }
    return settled || !(cfg->tolerance > 0) ? best_status : GSID_MAX_ITER;
}
