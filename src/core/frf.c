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

/* Bytes of the engine asked for; 0: it refuses. */
static size_t engine_size(const gsid_frf_cfg *cfg) {
    const gsid_spectrum_cfg s = spectrum_cfg(cfg);
    switch (cfg->engine) {
    case GSID_ENGINE_DIRECT:
        return gsid_spectrum_mem_size(&s);
    case GSID_ENGINE_SPREAD:
        return gsid_spread_mem_size(&s);
    default:
        return 0;
    }
}

static gsid_status check_cfg(const gsid_frf_cfg *cfg) {
    if (cfg == NULL || cfg->line == NULL || cfg->twiddle == NULL) {
        return GSID_E_NULL;
    }
    if (cfg->n_period < 2) {
        return GSID_E_CONFIG;
    }
    const size_t engine = engine_size(cfg);
    if (engine == 0 || cfg->n_lines > (SIZE_MAX - engine) / GSID_FRF_MEAN_SIZE(1, 1)) {
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

static size_t mean_size(const gsid_frf_cfg *cfg) {
    return GSID_FRF_MEAN_SIZE(cfg->n_lines, n_channels(cfg) - 1);
}

size_t gsid_frf_mem_size(const gsid_frf_cfg *cfg) {
    return check_cfg(cfg) == GSID_OK ? mean_size(cfg) + engine_size(cfg) : 0;
}

gsid_status gsid_frf_init(gsid_frf *frf, const gsid_frf_cfg *cfg, void *mem, size_t mem_size) {
    if (frf == NULL || mem == NULL) {
        return GSID_E_NULL;
    }
    gsid_status status = check_cfg(cfg);
    if (status != GSID_OK) {
        return status;
    }
    if (mem_size < gsid_frf_mem_size(cfg) || !gsid_is_aligned(mem)) {
        return GSID_E_MEMORY;
    }
    size_t n = (size_t)cfg->n_lines * n_channels(cfg);
    memset(frf, 0, sizeof *frf);
    memset(mem, 0, mean_size(cfg));
    frf->cfg = *cfg;
    frf->settle_left = cfg->n_settle;
    frf->line_next = cfg->n_lines;
    /* Complex numbers first, integers (in the engine) last: nothing needs padding. */
    frf->mean = mem;
    gsid_cplx *end = frf->mean + n;
    if (cfg->u_known == NULL) {
        frf->cross = end;
        end += cfg->n_lines;
    }
    frf->m2 = (gsid_real *)(void *)end;
    const gsid_spectrum_cfg s = spectrum_cfg(cfg);
    return cfg->engine == GSID_ENGINE_SPREAD ? gsid_spread_init(&frf->spread, &s, frf->m2 + n, engine_size(cfg))
                                             : gsid_spectrum_init(&frf->spectrum, &s, frf->m2 + n, engine_size(cfg));
}

/* FRF-2: mean += d/P, m2 += |d|^2 (P - 1)/P, with d the distance of the new period from the old mean. Nothing is ever
 * the difference of two large sums, as it would be with sums of squares. */
static gsid_cplx welford(gsid_cplx x, gsid_real n_periods, gsid_cplx *mean, gsid_real *m2) {
    gsid_cplx d = gsid_cplx_sub(x, *mean);
    *mean = gsid_cplx_add(*mean, gsid_cplx_make(d.re / n_periods, d.im / n_periods));
    *m2 += gsid_cplx_abs2(d) * ((n_periods - GSID_R(1.0)) / n_periods);
    return d;
}

/* Line i of y, and of u when it is measured, of the p-th good period. */
static void add_line(gsid_frf *frf, uint32_t i, const gsid_cplx *x, gsid_real p) {
    if (frf->cross == NULL) {
        welford(x[0], p, &frf->mean[i], &frf->m2[i]);
        return;
    }
    const size_t y = 2 * (size_t)i, u = y + 1;
    const gsid_cplx dy = welford(x[0], p, &frf->mean[y], &frf->m2[y]);
    const gsid_cplx du = welford(x[1], p, &frf->mean[u], &frf->m2[u]);
    const gsid_cplx product = gsid_cplx_mul(dy, gsid_cplx_conj(du));
    frf->cross[i] = gsid_cplx_add(frf->cross[i], gsid_cplx_scale((p - GSID_R(1.0)) / p, product));
}

/* ---- direct engine: the whole period at its last sample ---- */

static void add_period(gsid_frf *frf) {
    const gsid_real p = (gsid_real)(frf->n_periods + 1);
    const gsid_real scale = GSID_R(2.0) / (gsid_real)frf->cfg.n_period;
    const uint32_t n = n_channels(&frf->cfg);
    const gsid_cplx *sum = frf->spectrum.sum;
    for (uint32_t i = 0; i < frf->cfg.n_lines; i++, sum += n) {
        const gsid_cplx x[2] = {gsid_cplx_scale(scale, sum[0]), gsid_cplx_scale(scale, sum[n - 1])};
        add_line(frf, i, x, p);
    }
    frf->n_periods++;
}

static gsid_status step_direct(gsid_frf *frf, const gsid_real *x) {
    const gsid_status status = gsid_spectrum_step(&frf->spectrum, x);
    if (status != GSID_DONE) {
        return status;
    }
    if (frf->spoiled) {
        frf->spoiled = 0;
        frf->n_spoiled++;
        return GSID_SPOILED;
    }
    add_period(frf);
    return GSID_DONE;
}

static gsid_status skip_direct(gsid_frf *frf, uint32_t n_samples) {
    const uint32_t n_period = frf->cfg.n_period;
    const uint64_t n = (uint64_t)frf->spectrum.n % n_period + n_samples;
    const gsid_status status = gsid_spectrum_skip(&frf->spectrum, n_samples);
    frf->n_spoiled += (uint32_t)(n / n_period);
    frf->spoiled = n % n_period > 0;
    return status == GSID_DONE ? GSID_SPOILED : status;
}

/* ---- spread engine: a few lines of the last period a tick ---- */

static gsid_status add_ready_lines(gsid_frf *frf) {
    const gsid_real p = (gsid_real)(frf->n_periods + 1);
    const uint32_t left = frf->cfg.n_lines - frf->line_next, n = n_channels(&frf->cfg);
    for (uint32_t i = left < frf->spread.lines_per_tick ? left : frf->spread.lines_per_tick; i > 0; i--) {
        gsid_cplx x[2];
        for (uint32_t channel = 0; channel < n; channel++) {
            gsid_spread_line(&frf->spread, frf->line_next, channel, &x[channel]);
        }
        add_line(frf, frf->line_next++, x, p);
    }
    if (frf->line_next < frf->cfg.n_lines) {
        return GSID_OK;
    }
    frf->n_periods++;
    return GSID_DONE;
}

/* One tick; x is NULL when its sample was lost. The transform is complete before the first line is added, and all lines
 * are before the period ends: of these three at most one happens in a tick. */
static gsid_status tick_spread(gsid_frf *frf, const gsid_real *x) {
    const int has_lines = frf->line_next < frf->cfg.n_lines;
    const gsid_status added = has_lines ? add_ready_lines(frf) : GSID_OK;
    const gsid_status status = x != NULL ? gsid_spread_step(&frf->spread, x) : gsid_spread_skip(&frf->spread, 1);
    if (status == GSID_DONE) {
        frf->line_next = 0;
        return GSID_OK;
    }
    frf->n_spoiled += status == GSID_SPOILED;
    return status == GSID_OK ? added : status;
}

static int is_busy(const gsid_frf *frf) {
    return frf->spread.stage < frf->spread.n_stages || frf->line_next < frf->cfg.n_lines;
}

/* Tick by tick while there is work that belongs to them, then at once. */
static gsid_status skip_spread(gsid_frf *frf, uint32_t n_samples) {
    gsid_status status = GSID_OK;
    for (; n_samples > 0 && is_busy(frf); n_samples--) {
        const gsid_status tick = tick_spread(frf, NULL);
        status = tick != GSID_OK ? tick : status;
    }
    if (n_samples == 0) {
        return status;
    }
    const uint64_t n = (uint64_t)frf->spread.n + n_samples;
    frf->n_spoiled += (uint32_t)(n / frf->cfg.n_period);
    const gsid_status rest = gsid_spread_skip(&frf->spread, n_samples);
    return rest != GSID_OK ? rest : status;
}

gsid_status gsid_frf_finish(gsid_frf *frf) {
    if (frf == NULL) {
        return GSID_E_NULL;
    }
    if (frf->mean == NULL) {
        return GSID_E_STATE;
    }
    if (frf->cfg.engine == GSID_ENGINE_DIRECT) {
        return GSID_OK;
    }
    if (gsid_spread_finish(&frf->spread) == GSID_DONE) {
        frf->line_next = 0;
    }
    gsid_status status = GSID_OK;
    while (frf->line_next < frf->cfg.n_lines) {
        status = add_ready_lines(frf);
    }
    return status;
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
    return frf->cfg.engine == GSID_ENGINE_SPREAD ? tick_spread(frf, x) : step_direct(frf, x);
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
    return frf->cfg.engine == GSID_ENGINE_SPREAD ? skip_spread(frf, n_samples) : skip_direct(frf, n_samples);
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
