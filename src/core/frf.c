#include "gsid/frf.h"

#include <string.h>

#include "complex_math.h"
#include "real.h"

static uint32_t n_channels(const gsid_frf_cfg *cfg) {
    return cfg->u_known == NULL ? 2 : 1;
}

/* Settling need not be a whole number of periods: the lines stay referred to the excitation's first sample. */
static gsid_spectrum_cfg spectrum_cfg(const gsid_frf_cfg *cfg) {
    gsid_spectrum_cfg s = {.n_period = cfg->n_period,
                           .n_lines = cfg->n_lines,
                           .n_channels = n_channels(cfg),
                           .n_first = cfg->n_settle % cfg->n_period,
                           .line = cfg->line,
                           .twiddle = cfg->twiddle};
    return s;
}

static gsid_status check_cfg(const gsid_frf_cfg *cfg) {
    if (cfg == NULL || cfg->line == NULL || cfg->twiddle == NULL) {
        return GSID_E_NULL;
    }
    if (cfg->n_period < 2) {
        return GSID_E_CONFIG;
    }
    gsid_spectrum_cfg s = spectrum_cfg(cfg);
    if (gsid_spectrum_mem_size(&s) == 0 || cfg->n_lines > SIZE_MAX / GSID_FRF_MEM_SIZE(1, n_channels(cfg) - 1)) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < cfg->n_lines; i++) {
        if (cfg->line[i] < 1 || cfg->line[i] >= (cfg->n_period + 1) / 2) {
            return GSID_E_CONFIG;
        }
        if (cfg->u_known != NULL && !gsid_cplx_is_finite(cfg->u_known[i])) {
            return GSID_E_NONFINITE;
        }
    }
    return GSID_OK;
}

size_t gsid_frf_mem_size(const gsid_frf_cfg *cfg) {
    return check_cfg(cfg) == GSID_OK ? GSID_FRF_MEM_SIZE(cfg->n_lines, n_channels(cfg) - 1) : 0;
}

gsid_status gsid_frf_init(gsid_frf *frf, const gsid_frf_cfg *cfg, void *mem, size_t mem_size) {
    if (frf == NULL || mem == NULL) {
        return GSID_E_NULL;
    }
    gsid_status status = check_cfg(cfg);
    if (status != GSID_OK) {
        return status;
    }
    size_t size = gsid_frf_mem_size(cfg);
    if (mem_size < size || !gsid_is_aligned(mem)) {
        return GSID_E_MEMORY;
    }
    size_t n = (size_t)cfg->n_lines * n_channels(cfg);
    memset(frf, 0, sizeof *frf);
    memset(mem, 0, size);
    frf->cfg = *cfg;
    frf->settle_left = cfg->n_settle;
    /* Complex numbers first, integers (in the spectrum) last: nothing needs padding. */
    frf->mean = mem;
    gsid_cplx *end = frf->mean + n;
    if (cfg->u_known == NULL) {
        frf->cross = end;
        end += cfg->n_lines;
    }
    frf->m2 = (gsid_real *)(void *)end;
    gsid_spectrum_cfg s = spectrum_cfg(cfg);
    return gsid_spectrum_init(&frf->spectrum, &s, frf->m2 + n, GSID_SPECTRUM_MEM_SIZE(s.n_lines, s.n_channels));
}

/* FRF-2: mean += d/P, m2 += |d|^2 (P - 1)/P, with d the distance of the new period from the old mean. Nothing is ever
 * the difference of two large sums, as it would be with sums of squares. */
static gsid_cplx welford(gsid_cplx x, gsid_real n_periods, gsid_cplx *mean, gsid_real *m2) {
    gsid_cplx d = gsid_cplx_sub(x, *mean);
    *mean = gsid_cplx_add(*mean, gsid_cplx_make(d.re / n_periods, d.im / n_periods));
    *m2 += gsid_cplx_abs2(d) * ((n_periods - GSID_R(1.0)) / n_periods);
    return d;
}

static void add_period(gsid_frf *frf) {
    frf->n_periods++;
    const gsid_real p = (gsid_real)frf->n_periods;
    const gsid_real scale = GSID_R(2.0) / (gsid_real)frf->cfg.n_period;
    const gsid_cplx *sum = frf->spectrum.sum;
    if (frf->cross == NULL) {
        for (uint32_t i = 0; i < frf->cfg.n_lines; i++) {
            welford(gsid_cplx_scale(scale, sum[i]), p, &frf->mean[i], &frf->m2[i]);
        }
        return;
    }
    for (uint32_t i = 0; i < frf->cfg.n_lines; i++) {
        size_t y = 2 * (size_t)i, u = y + 1;
        gsid_cplx dy = welford(gsid_cplx_scale(scale, sum[y]), p, &frf->mean[y], &frf->m2[y]);
        gsid_cplx du = welford(gsid_cplx_scale(scale, sum[u]), p, &frf->mean[u], &frf->m2[u]);
        gsid_cplx product = gsid_cplx_mul(dy, gsid_cplx_conj(du));
        frf->cross[i] = gsid_cplx_add(frf->cross[i], gsid_cplx_scale((p - GSID_R(1.0)) / p, product));
    }
}

static gsid_status end_period(gsid_frf *frf) {
    if (frf->spoiled) {
        frf->spoiled = 0;
        frf->n_spoiled++;
        return GSID_SPOILED;
    }
    add_period(frf);
    return GSID_DONE;
}

gsid_status gsid_frf_step(gsid_frf *frf, gsid_real u, gsid_real y) {
    if (frf == NULL) {
        return GSID_E_NULL;
    }
    if (frf->mean == NULL) {
        return GSID_E_STATE;
    }
    if (!gsid_is_finite(y) || (frf->cross != NULL && !gsid_is_finite(u))) {
        frf->n_refused++;
        return GSID_E_NONFINITE;
    }
    if (frf->settle_left > 0) {
        frf->settle_left--;
        return GSID_SETTLING;
    }
    const gsid_real x[2] = {y, u};
    gsid_status status = gsid_spectrum_step(&frf->spectrum, x);
    return status == GSID_DONE ? end_period(frf) : status;
}

gsid_status gsid_frf_skip(gsid_frf *frf, uint32_t n_samples) {
    if (frf == NULL) {
        return GSID_E_NULL;
    }
    if (frf->mean == NULL) {
        return GSID_E_STATE;
    }
    uint32_t n_settling = n_samples < frf->settle_left ? n_samples : frf->settle_left;
    frf->settle_left -= n_settling;
    n_samples -= n_settling;
    if (n_samples == 0) {
        return n_settling > 0 || frf->settle_left > 0 ? GSID_SETTLING : GSID_OK;
    }
    const uint32_t n_period = frf->cfg.n_period;
    uint64_t n = (uint64_t)frf->spectrum.n % n_period + n_samples;
    gsid_status status = gsid_spectrum_skip(&frf->spectrum, n_samples);
    frf->n_spoiled += (uint32_t)(n / n_period);
    frf->spoiled = n % n_period > 0;
    return status == GSID_DONE ? GSID_SPOILED : status;
}

/* 7.29 with mean lines, multiplied out so that no line of Y stands in a denominator: an antiresonance may measure 0.
 * Rounding can take it below zero when the noise of u and y is the same noise. */
static gsid_real variance_of_quotient(gsid_cplx g, gsid_cplx u, gsid_real var_y, gsid_real var_u, gsid_cplx cov_yu) {
    gsid_real v = var_y + gsid_cplx_abs2(g) * var_u - GSID_R(2.0) * gsid_cplx_mul(cov_yu, gsid_cplx_conj(g)).re;
    return v > GSID_R(0.0) ? v / gsid_cplx_abs2(u) : GSID_R(0.0);
}

static void result_line(const gsid_frf *frf, uint32_t i, const gsid_frf_out *out) {
    const size_t at = (size_t)i * n_channels(&frf->cfg);
    const int measured = frf->cross != NULL;
    const gsid_real p = (gsid_real)frf->n_periods;
    const gsid_real per_dof = p > GSID_R(1.0) ? GSID_R(1.0) / (p - GSID_R(1.0)) : GSID_R(0.0); /* 4.11 */
    const gsid_cplx zero = gsid_cplx_make(GSID_R(0.0), GSID_R(0.0));

    gsid_cplx y = frf->mean[at], u = measured ? frf->mean[at + 1] : frf->cfg.u_known[i];
    gsid_real var_y = per_dof * frf->m2[at], var_u = measured ? per_dof * frf->m2[at + 1] : GSID_R(0.0);
    gsid_cplx cov_yu = measured ? gsid_cplx_scale(per_dof, frf->cross[i]) : zero;
    int is_excited = gsid_cplx_abs2(u) > GSID_R(0.0);
    gsid_cplx g = is_excited ? gsid_cplx_div(y, u) : zero; /* 4.10 */

    if (out->g != NULL) {
        out->g[i] = g;
    }
    if (out->var_g != NULL) {
        out->var_g[i] = is_excited ? variance_of_quotient(g, u, var_y, var_u, cov_yu) / p : (gsid_real)INFINITY;
    }
    if (out->y != NULL) {
        out->y[i] = y;
    }
    if (out->u != NULL) {
        out->u[i] = u;
    }
    if (out->var_y != NULL) {
        out->var_y[i] = var_y;
    }
    if (out->var_u != NULL) {
        out->var_u[i] = var_u;
    }
    if (out->cov_yu != NULL) {
        out->cov_yu[i] = cov_yu;
    }
}

gsid_status gsid_frf_result(const gsid_frf *frf, const gsid_frf_out *out) {
    if (frf == NULL || out == NULL) {
        return GSID_E_NULL;
    }
    if (frf->mean == NULL) {
        return GSID_E_STATE;
    }
    int variance_asked = out->var_g != NULL || out->var_y != NULL || out->var_u != NULL || out->cov_yu != NULL;
    if (frf->n_periods < (variance_asked ? 2u : 1u)) {
        return GSID_E_TOO_FEW;
    }
    for (uint32_t i = 0; i < frf->cfg.n_lines; i++) {
        result_line(frf, i, out);
    }
    return GSID_OK;
}
