#include "gsid/host/mimo.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/residual.h"
#include "mimo_run.h"

static gsid_status estimate(mimo_run *r, mimo_candidate *c, double *low_s, double *high_s) {
    gsid_status status = gsid_mimo_start(r, c);
    if (status == GSID_OK && r->cfg.method != GSID_METHOD_IWLS) {
        status = gsid_mimo_search(r, c);
    }
    memcpy(low_s, c->delay_s, sizeof c->delay_s);
    memcpy(high_s, c->delay_s, sizeof c->delay_s);
    if (status < 0 || r->cfg.method == GSID_METHOD_IWLS || r->cfg.n_delays == 0) {
        return status;
    }
    return gsid_mimo_settle_delays(r, c, low_s, high_s);
}

static gsid_status check_channel(const gsid_frd *data) {
    if (data->f_hz == NULL || data->g == NULL || data->sigma == NULL) {
        return GSID_E_NULL;
    }
    for (uint32_t k = 0; k < data->n_lines; k++) {
        if (!isfinite(data->f_hz[k]) || !gsid_cplx_is_finite(data->g[k]) || !isfinite(data->sigma[k])) {
            return GSID_E_NONFINITE;
        }
        if (!(data->sigma[k] > 0)) {
            return GSID_E_CONFIG;
        }
    }
    return data->var_u != NULL || data->logarithmic ? GSID_E_CONFIG : GSID_OK;
}

static gsid_status check(uint32_t n_channels, const gsid_frd *channel, const gsid_mimo_cfg *cfg,
                         const gsid_mimo_result *result) {
    if (channel == NULL || cfg == NULL || result == NULL || result->section == NULL || result->num == NULL ||
        result->delay_s == NULL || (cfg->n_delays > 0 && cfg->delay_of == NULL)) {
        return GSID_E_NULL;
    }
    if (n_channels == 0 || n_channels > GSID_MIMO_CHANNELS_MAX || cfg->n_poles == 0 ||
        cfg->n_poles > GSID_MIMO_POLES_MAX || cfg->n_delays > n_channels || (unsigned)cfg->domain > GSID_DOMAIN_Z ||
        (cfg->method != GSID_METHOD_IWLS && cfg->method != GSID_METHOD_NLS && cfg->method != GSID_METHOD_ML)) {
        return GSID_E_CONFIG;
    }
    const size_t n = (size_t)n_channels * (cfg->n_poles + (cfg->direct != 0)) + cfg->n_poles + cfg->n_delays;
    if (result->cov != NULL && n > GSID_LSQ_COLUMNS_MAX) {
        return GSID_E_CONFIG;
    }
    uint64_t used = 0; /* numbers of free delays */
    for (uint32_t i = 0; i < n_channels; i++) {
        const gsid_status status = check_channel(&channel[i]);
        if (status != GSID_OK) {
            return status;
        }
        if (!isfinite(result->delay_s[i])) {
            return GSID_E_NONFINITE;
        }
        if (cfg->n_delays > 0 && cfg->delay_of[i] >= cfg->n_delays) {
            return GSID_E_CONFIG;
        }
        used |= cfg->n_delays > 0 ? UINT64_C(1) << cfg->delay_of[i] : 0;
        if (2 * channel[i].n_lines < 2 * cfg->n_poles + 2) {
            return GSID_E_TOO_FEW;
        }
    }
    if (cfg->n_delays > 0 && used != UINT64_MAX >> (64 - cfg->n_delays)) {
        return GSID_E_CONFIG;
    }
    const double f_max_hz = gsid_mimo_highest_frequency(n_channels, channel);
    if (!(f_max_hz > 0) ||
        !(cfg->delay_max_s >= 0 && GSID_MIMO_SCAN_STEPS * cfg->delay_max_s * f_max_hz <= GSID_MIMO_DELAYS_MAX) ||
        (cfg->domain == GSID_DOMAIN_Z && !(cfg->sample_s > 0 && f_max_hz * cfg->sample_s < 0.5))) {
        return GSID_E_CONFIG;
    }
    return GSID_OK;
}

static void run_free(mimo_run *r, gsid_frd *weighted) {
    for (uint32_t i = 0; r->mem != NULL && i < r->n_channels; i++) {
        free(r->mem[i]);
    }
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
        r->shared == NULL || r->block == NULL || r->num == NULL || r->lsq_mem == NULL) {
        return GSID_E_NO_MEMORY;
    }
    for (uint32_t i = 0; i < n_channels; i++) {
        r->mem[i] = malloc(r->mem_size);
        if (r->mem[i] == NULL) {
            return GSID_E_NO_MEMORY;
        }
    }
    return GSID_OK;
}

/* V with the measured variance: the weights of ML, whatever the method was. */
static double cost_by_measured_variance(mimo_run *r, const gsid_frd *measured, const mimo_candidate *best) {
    double q[GSID_MIMO_POLES_MAX], cost = 0;
    gsid_mimo_sections(r, best->x, q);
    for (uint32_t i = 0; i < r->n_channels; i++) {
        const gsid_mimo_channel model = gsid_mimo_channel_at(r, i, q, best->delay_s[i]);
        for (uint32_t k = 0; k < measured[i].n_lines; k++) {
            mimo_terms t;
            gsid_mimo_terms(&model, measured[i].f_hz[k], &t);
            cost += gsid_cplx_abs2(gsid_residual_at(&measured[i], k, t.g).value);
        }
    }
    return cost;
}

static gsid_status answer(mimo_run *r, const gsid_frd *measured, mimo_candidate *best, gsid_mimo_result *result) {
    gsid_mimo_solve(r, best);
    if (result->cov != NULL) {
        const gsid_status status = gsid_mimo_covariance(r, best, result->cov);
        if (status != GSID_OK) {
            return status;
        }
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
    if (status != GSID_OK) {
        return status;
    }
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
        if (cfg->method == GSID_METHOD_NLS) {
            weighted[i].sigma = NULL;
        }
    }
    if (status == GSID_OK) {
        status = run_init(&r, n_channels, weighted, cfg);
    }
    gsid_status how = GSID_OK;
    if (status == GSID_OK) {
        status = how = estimate(&r, &best, low_s, high_s);
    }
    if (status >= 0) {
        status = answer(&r, channel, &best, result);
    }
    if (status == GSID_OK) {
        result->converged = how == GSID_OK;
        if (result->delay_low_s != NULL) {
            memcpy(result->delay_low_s, low_s, n_channels * sizeof *low_s);
        }
        if (result->delay_high_s != NULL) {
            memcpy(result->delay_high_s, high_s, n_channels * sizeof *high_s);
        }
    }
    run_free(&r, weighted);
    return status == GSID_OK && how == GSID_MAX_ITER ? GSID_MAX_ITER : status;
}
