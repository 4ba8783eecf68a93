#include "gsid/host/mimo.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/residual.h"
#include "fit_sections.h"
#include "fit_run.h"
#include "mimo_run.h"

#define FARTHEST 100 /* of a pole, in units of the highest frequency */

/* ---- the model, at one line */

gsid_cplx gsid_mimo_variable(const mimo_run *r, double f_hz) {
    const double w_rad_s = GSID_TWO_PI * f_hz;
    if (r->cfg.domain == GSID_DOMAIN_Z)
        return gsid_cplx_cis(w_rad_s * r->cfg.sample_s);
    return gsid_cplx_make(0, w_rad_s / r->scale_rad_s);
}

void gsid_mimo_sections(const mimo_run *r, const double *x, double *q) {
    const int in_s = r->cfg.domain == GSID_DOMAIN_S;
    for (uint32_t first = 0; first < r->cfg.n_poles; first += 2) {
        double c[3];
        const uint32_t order = gsid_fit_section_order(r->cfg.n_poles, first);
        gsid_fit_section_coefficients(r->cfg.domain, order, x + first, c);
        q[first] = in_s ? c[0] : c[order];
        if (order == 2)
            q[first + 1] = c[1];
    }
}

void gsid_mimo_bounds(const mimo_run *r, uint32_t j, double *lower, double *upper) {
    const int is_product = j % 2 == 0 && gsid_fit_section_order(r->cfg.n_poles, j) == 2;
    gsid_fit_section_bounds(r->cfg.domain, lower, upper);
    *lower = r->cfg.allow_unstable ? -HUGE_VAL : *lower;
    *upper = r->cfg.allow_unstable ? HUGE_VAL : fmin(*upper, is_product ? FARTHEST * FARTHEST : FARTHEST);
}

void gsid_mimo_basis(const mimo_run *r, const double *q, gsid_cplx v, gsid_cplx *phi) {
    const uint32_t n = r->cfg.n_poles;
    for (uint32_t first = 0; first < n; first += 2) {
        gsid_cplx section = {v.re + q[first], v.im};
        if (gsid_fit_section_order(n, first) == 2) {
            section = gsid_cplx_mul(v, gsid_cplx_make(v.re + q[first + 1], v.im));
            section.re += q[first];
        }
        phi[first] = gsid_cplx_div(gsid_cplx_make(1, 0), section);
        if (first + 1 < n)
            phi[first + 1] = gsid_cplx_mul(v, phi[first]);
    }
    if (r->cfg.direct)
        phi[n] = gsid_cplx_make(1, 0);
}

/* ---- equations */

gsid_status gsid_mimo_begin(mimo_run *r, uint32_t channel, uint32_t n_shared) {
    r->n_waiting = 0;
    return gsid_lsq_init(&r->equations[channel], r->n_local + n_shared, r->mem[channel], r->mem_size);
}

void gsid_mimo_put(mimo_run *r, uint32_t column, gsid_cplx value) {
    double *at = r->block + (size_t)column * GSID_LSQ_BLOCK + r->n_waiting;
    at[0] = value.re;
    at[1] = value.im;
}

gsid_status gsid_mimo_end(mimo_run *r, gsid_lsq *equations) {
    const uint32_t n_rows = r->n_waiting;
    r->n_waiting = 0;
    return n_rows > 0 ? gsid_lsq_add_block(equations, n_rows, r->block) : GSID_OK;
}

gsid_status gsid_mimo_next(mimo_run *r, gsid_lsq *equations) {
    r->n_waiting += 2;
    return r->n_waiting < GSID_LSQ_BLOCK ? GSID_OK : gsid_mimo_end(r, equations);
}

/* Numerators of one channel; returns its V. */
double gsid_mimo_solve_channel(mimo_run *r, uint32_t channel, const double *q, double delay_s) {
    const gsid_frd *data = &r->channel[channel];
    gsid_lsq *equations = &r->equations[channel];
    double cost = HUGE_VAL;
    gsid_status status = gsid_mimo_begin(r, channel, 0);
    for (uint32_t k = 0; k < data->n_lines && status == GSID_OK; k++) {
        gsid_cplx phi[GSID_MIMO_POLES_MAX + 1];
        const gsid_cplx turn = gsid_cplx_cis(-GSID_TWO_PI * data->f_hz[k] * delay_s);
        const gsid_residual error = gsid_residual_at(data, k, gsid_cplx_make(0, 0));
        gsid_mimo_basis(r, q, gsid_mimo_variable(r, data->f_hz[k]), phi);
        for (uint32_t i = 0; i < r->n_local; i++)
            gsid_mimo_put(r, i, gsid_residual_slope(&error, gsid_cplx_mul(turn, phi[i])));
        gsid_mimo_put(r, r->n_local, gsid_cplx_scale(-1, error.value));
        status = gsid_mimo_next(r, equations);
    }
    if (status == GSID_OK)
        status = gsid_mimo_end(r, equations);
    if (status == GSID_OK)
        status = gsid_lsq_solve(equations, 0, r->num + (size_t)channel * r->n_local, &cost);
    return status >= 0 && isfinite(cost) ? cost : HUGE_VAL;
}

void gsid_mimo_solve(mimo_run *r, mimo_candidate *c) {
    double q[GSID_MIMO_POLES_MAX];
    gsid_mimo_sections(r, c->x, q);
    c->cost = 0;
    for (uint32_t channel = 0; channel < r->n_channels; channel++)
        c->cost += gsid_mimo_solve_channel(r, channel, q, c->delay_s[channel]);
}

gsid_status gsid_mimo_reduce(mimo_run *r, uint32_t n_shared) {
    const size_t first = (size_t)r->n_channels * r->n_local, width = first + n_shared + 1;
    for (uint32_t channel = 0; channel < r->n_channels; channel++) {
        r->row[channel] = r->equations[channel].r; /* a triangle is as good as the rows it came from */
        r->n_rows[channel] = r->n_local + n_shared + 1;
    }
    const gsid_arrow arrow = {r->n_channels, r->n_local, n_shared, r->n_rows, r->row};
    const gsid_status status = gsid_arrow_reduce(&arrow, r->triangle);
    for (size_t i = 0; i <= n_shared && status == GSID_OK; i++)
        memcpy(r->shared + i * (n_shared + 1), r->triangle + (first + i) * width + first,
               ((size_t)n_shared + 1) * sizeof *r->shared);
    return status;
}

/* ---- the run */

double gsid_mimo_highest_frequency(uint32_t n_channels, const gsid_frd *channel) {
    double f_hz = 0;
    for (uint32_t i = 0; i < n_channels; i++)
        f_hz = fmax(f_hz, gsid_fit_highest_frequency(&channel[i]));
    return f_hz;
}

static gsid_status estimate(mimo_run *r, mimo_candidate *c, double *low_s, double *high_s) {
    gsid_status status = gsid_mimo_start(r, c);
    if (status == GSID_OK && r->cfg.method != GSID_METHOD_IWLS)
        status = gsid_mimo_search(r, c);
    memcpy(low_s, c->delay_s, sizeof c->delay_s);
    memcpy(high_s, c->delay_s, sizeof c->delay_s);
    if (status < 0 || r->cfg.method == GSID_METHOD_IWLS || r->cfg.n_delays == 0)
        return status;
    return gsid_mimo_settle_delays(r, c, low_s, high_s);
}

static gsid_status check_channel(const gsid_frd *data) {
    if (data->f_hz == NULL || data->g == NULL || data->sigma == NULL)
        return GSID_E_NULL;
    for (uint32_t k = 0; k < data->n_lines; k++) {
        if (!isfinite(data->f_hz[k]) || !gsid_cplx_is_finite(data->g[k]) || !isfinite(data->sigma[k]))
            return GSID_E_NONFINITE;
        if (!(data->sigma[k] > 0))
            return GSID_E_CONFIG;
    }
    return data->var_u != NULL || data->logarithmic ? GSID_E_CONFIG : GSID_OK;
}

static gsid_status check(uint32_t n_channels, const gsid_frd *channel, const gsid_mimo_cfg *cfg,
                         const gsid_mimo_result *result) {
    if (channel == NULL || cfg == NULL || result == NULL || result->section == NULL || result->num == NULL ||
        result->delay_s == NULL || (cfg->n_delays > 0 && cfg->delay_of == NULL))
        return GSID_E_NULL;
    if (n_channels == 0 || n_channels > GSID_MIMO_CHANNELS_MAX || cfg->n_poles == 0 ||
        cfg->n_poles > GSID_MIMO_POLES_MAX || cfg->n_delays > n_channels || (unsigned)cfg->domain > GSID_DOMAIN_Z ||
        (cfg->method != GSID_METHOD_IWLS && cfg->method != GSID_METHOD_NLS && cfg->method != GSID_METHOD_ML))
        return GSID_E_CONFIG;
    const size_t n = (size_t)n_channels * (cfg->n_poles + (cfg->direct != 0)) + cfg->n_poles + cfg->n_delays;
    if (result->cov != NULL && n > GSID_LSQ_COLUMNS_MAX)
        return GSID_E_CONFIG;
    uint64_t used = 0; /* numbers of free delays */
    for (uint32_t i = 0; i < n_channels; i++) {
        const gsid_status status = check_channel(&channel[i]);
        if (status != GSID_OK)
            return status;
        if (!isfinite(result->delay_s[i]))
            return GSID_E_NONFINITE;
        if (cfg->n_delays > 0 && cfg->delay_of[i] >= cfg->n_delays)
            return GSID_E_CONFIG;
        used |= cfg->n_delays > 0 ? UINT64_C(1) << cfg->delay_of[i] : 0;
        if (2 * channel[i].n_lines < 2 * cfg->n_poles + 2)
            return GSID_E_TOO_FEW;
    }
    if (cfg->n_delays > 0 && used != UINT64_MAX >> (64 - cfg->n_delays))
        return GSID_E_CONFIG;
    const double f_max_hz = gsid_mimo_highest_frequency(n_channels, channel);
    if (!(f_max_hz > 0) ||
        !(cfg->delay_max_s >= 0 && GSID_MIMO_SCAN_STEPS * cfg->delay_max_s * f_max_hz <= GSID_MIMO_DELAYS_MAX) ||
        (cfg->domain == GSID_DOMAIN_Z && !(cfg->sample_s > 0 && f_max_hz * cfg->sample_s < 0.5)))
        return GSID_E_CONFIG;
    return GSID_OK;
}

static void run_free(mimo_run *r, gsid_frd *weighted) {
    for (uint32_t i = 0; r->mem != NULL && i < r->n_channels; i++)
        free(r->mem[i]);
    free(r->mem);
    free(r->equations);
    free(r->row);
    free(r->n_rows);
    free(r->triangle);
    free(r->shared);
    free(r->block);
    free(r->num);
    free(r->lsq_mem);
    free(weighted);
}

static gsid_status run_init(mimo_run *r, uint32_t n_channels, const gsid_frd *weighted, const gsid_mimo_cfg *cfg) {
    r->cfg = *cfg;
    r->channel = weighted;
    r->scale_rad_s = GSID_TWO_PI * gsid_mimo_highest_frequency(n_channels, weighted);
    r->cfg.direct = cfg->direct != 0;
    r->n_local = cfg->n_poles + (r->cfg.direct ? 1 : 0);
    r->n_shared = cfg->n_poles + cfg->n_delays;
    const uint32_t n_columns = r->n_local + r->n_shared;
    const size_t n = (size_t)n_channels * r->n_local + r->n_shared;
    r->lsq_size = gsid_lsq_mem_size(r->n_shared);
    r->mem_size = gsid_lsq_mem_size(n_columns);
    r->mem = calloc(n_channels, sizeof *r->mem);
    r->equations = calloc(n_channels, sizeof *r->equations);
    r->row = calloc(n_channels, sizeof *r->row);
    r->n_rows = calloc(n_channels, sizeof *r->n_rows);
    r->triangle = malloc((n + 1) * (n + 1) * sizeof *r->triangle);
    r->shared = malloc(((size_t)r->n_shared + 1) * ((size_t)r->n_shared + 1) * sizeof *r->shared);
    r->block = malloc(((size_t)n_columns + 1) * GSID_LSQ_BLOCK * sizeof *r->block);
    r->num = calloc((size_t)n_channels * r->n_local, sizeof *r->num);
    r->lsq_mem = malloc(r->lsq_size);
    if (r->mem == NULL || r->equations == NULL || r->row == NULL || r->n_rows == NULL || r->triangle == NULL ||
        r->shared == NULL || r->block == NULL || r->num == NULL || r->lsq_mem == NULL)
        return GSID_E_NO_MEMORY;
    for (uint32_t i = 0; i < n_channels; i++) {
        r->mem[i] = malloc(r->mem_size);
        if (r->mem[i] == NULL)
            return GSID_E_NO_MEMORY;
    }
    return GSID_OK;
}

/* V with the measured variance: the weights of ML, whatever the method was. */
static double cost_by_measured_variance(mimo_run *r, const gsid_frd *measured, const mimo_candidate *best) {
    double q[GSID_MIMO_POLES_MAX], cost = 0;
    gsid_cplx phi[GSID_MIMO_POLES_MAX + 1];
    gsid_mimo_sections(r, best->x, q);
    for (uint32_t i = 0; i < r->n_channels; i++) {
        const double *num = r->num + (size_t)i * r->n_local;
        for (uint32_t k = 0; k < measured[i].n_lines; k++) {
            gsid_cplx g = {0, 0};
            gsid_mimo_basis(r, q, gsid_mimo_variable(r, measured[i].f_hz[k]), phi);
            for (uint32_t j = 0; j < r->n_local; j++)
                g = gsid_cplx_add(g, gsid_cplx_scale(num[j], phi[j]));
            g = gsid_cplx_mul(g, gsid_cplx_cis(-GSID_TWO_PI * measured[i].f_hz[k] * best->delay_s[i]));
            cost += gsid_cplx_abs2(gsid_residual_at(&measured[i], k, g).value);
        }
    }
    return cost;
}

static gsid_status answer(mimo_run *r, const gsid_frd *measured, mimo_candidate *best, gsid_mimo_result *result) {
    gsid_mimo_solve(r, best);
    if (result->cov != NULL) {
        const gsid_status status = gsid_mimo_covariance(r, best, result->cov);
        if (status != GSID_OK)
            return status;
    }
    result->scale_rad_s = r->cfg.domain == GSID_DOMAIN_S ? r->scale_rad_s : 1;
    gsid_mimo_sections(r, best->x, result->section);
    memcpy(result->num, r->num, (size_t)r->n_channels * r->n_local * sizeof *r->num);
    memcpy(result->delay_s, best->delay_s, r->n_channels * sizeof *best->delay_s);
    result->cost = best->cost;
    result->cost_ml = cost_by_measured_variance(r, measured, best);
    result->n_parameters = r->n_channels * r->n_local + r->n_shared;
    return GSID_OK;
}

gsid_status gsid_mimo_run(uint32_t n_channels, const gsid_frd *channel, const gsid_mimo_cfg *cfg,
                          gsid_mimo_result *result) {
    gsid_status status = check(n_channels, channel, cfg, result);
    if (status != GSID_OK)
        return status;
    mimo_run r;
    mimo_candidate best;
    double low_s[GSID_MIMO_CHANNELS_MAX], high_s[GSID_MIMO_CHANNELS_MAX];
    memset(&r, 0, sizeof r);
    memset(&best, 0, sizeof best);
    r.n_channels = n_channels;
    memcpy(best.delay_s, result->delay_s, n_channels * sizeof *best.delay_s);
    gsid_frd *weighted = malloc(n_channels * sizeof *weighted);
    status = weighted == NULL ? GSID_E_NO_MEMORY : GSID_OK;
    for (uint32_t i = 0; i < n_channels && status == GSID_OK; i++) {
        weighted[i] = channel[i];
        if (cfg->method == GSID_METHOD_NLS)
            weighted[i].sigma = NULL;
    }
    if (status == GSID_OK)
        status = run_init(&r, n_channels, weighted, cfg);
    gsid_status how = GSID_OK;
    if (status == GSID_OK)
        status = how = estimate(&r, &best, low_s, high_s);
    if (status >= 0)
        status = answer(&r, channel, &best, result);
    if (status == GSID_OK) {
        result->converged = how == GSID_OK;
        if (result->delay_low_s != NULL)
            memcpy(result->delay_low_s, low_s, n_channels * sizeof *low_s);
        if (result->delay_high_s != NULL)
            memcpy(result->delay_high_s, high_s, n_channels * sizeof *high_s);
    }
    run_free(&r, weighted);
    return status == GSID_OK && how == GSID_MAX_ITER ? GSID_MAX_ITER : status;
}
