#include "gsid/frf.h"

#include <string.h>

#include "complex_math.h"
#include "frf_private.h"
#include "streaming.h"

/* Settling need not be a whole number of periods: the lines stay referred to the excitation's first sample. */
static gsid_spectrum_cfg spectrum_cfg(const gsid_frf_cfg *cfg) {
    gsid_spectrum_cfg s = {.n_period = cfg->n_period,
                           .n_lines = cfg->n_lines,
                           .n_channels = gsid_frf_channels(cfg),
                           .n_first = cfg->n_settle % cfg->n_period,
                           .line = cfg->line,
                           .twiddle = cfg->twiddle};
    return s;
}

/* Checks, and gives the bytes of the means and of the engine. */
static gsid_status measure(const struct gsid_frf_engine *engine, const gsid_frf_cfg *cfg, size_t *of_means,
                           size_t *of_engine) {
    if (cfg == NULL || cfg->line == NULL || cfg->twiddle == NULL) {
        return GSID_E_NULL;
    }
    const gsid_status build = gsid_check_build();
    if (build != GSID_OK) {
        return build;
    }
    if (cfg->n_period < 2) {
        return GSID_E_CONFIG;
    }
    const gsid_spectrum_cfg s = spectrum_cfg(cfg);
    *of_engine = engine->mem_size(&s);
    if (*of_engine == 0 || cfg->n_lines > (SIZE_MAX - *of_engine) / GSID_FRF_MEAN_SIZE(1, 1)) {
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
    *of_means = GSID_FRF_MEAN_SIZE(cfg->n_lines, gsid_frf_channels(cfg) - 1);
    return GSID_OK;
}

size_t gsid_frf_size_with(const struct gsid_frf_engine *engine, const gsid_frf_cfg *cfg) {
    size_t of_means, of_engine;
    return measure(engine, cfg, &of_means, &of_engine) == GSID_OK ? of_means + of_engine : 0;
}

gsid_status gsid_frf_init_with(const struct gsid_frf_engine *engine, gsid_frf *frf, const gsid_frf_cfg *cfg, void *mem,
                               size_t mem_size) {
    if (frf == NULL || mem == NULL) {
        return GSID_E_NULL;
    }
    size_t of_means, of_engine;
    gsid_status status = measure(engine, cfg, &of_means, &of_engine);
    if (status != GSID_OK) {
        return status;
    }
    if (mem_size < of_means + of_engine || !gsid_is_aligned(mem)) {
        return GSID_E_MEMORY;
    }
    memset(frf, 0, sizeof *frf);
    memset(mem, 0, of_means);
    frf->cfg = *cfg;
    frf->engine = engine;
    frf->settle_left = cfg->n_settle;
    /* Complex numbers first, integers (in the engine) last: nothing needs padding. */
    const size_t n = (size_t)cfg->n_lines * gsid_frf_channels(cfg);
    frf->mean = (gsid_cplx *)mem;
    gsid_cplx *end = frf->mean + n;
    if (cfg->u_known == NULL) {
        frf->cross = end;
        end += cfg->n_lines;
    }
    frf->m2 = (gsid_real *)(void *)end;
    const gsid_spectrum_cfg s = spectrum_cfg(cfg);
    return engine->init(frf, &s, frf->m2 + n, of_engine);
}

void gsid_frf_add_measured(gsid_frf *frf, gsid_real share, uint32_t i, gsid_cplx y, gsid_cplx u) {
    gsid_cplx *mean = frf->mean + 2 * (size_t)i;
    gsid_real *m2 = frf->m2 + 2 * (size_t)i;
    const gsid_cplx d[2] = {gsid_frf_welford(share, y, mean, m2), gsid_frf_welford(share, u, mean + 1, m2 + 1)};
    gsid_frf_add_product(share, d, frf->cross + i);
}

gsid_status gsid_frf_step(gsid_frf *frf, gsid_real u, gsid_real y) {
    if (frf == NULL) {
        return GSID_E_NULL;
    }
    if (frf->engine == NULL) {
        return GSID_E_STATE;
    }
    if (!gsid_is_finite(y) || (frf->cross != NULL && !gsid_is_finite(u))) {
        frf->n_refused = gsid_count(frf->n_refused, 1);
        return GSID_E_NONFINITE;
    }
    if (frf->settle_left > 0) {
        frf->settle_left--;
        return GSID_SETTLING;
    }
    return frf->engine->step(frf, u, y);
}

gsid_status gsid_frf_skip(gsid_frf *frf, uint32_t n_samples) {
    if (frf == NULL) {
        return GSID_E_NULL;
    }
    if (frf->engine == NULL) {
        return GSID_E_STATE;
    }
    uint32_t n_settling = n_samples < frf->settle_left ? n_samples : frf->settle_left;
    frf->settle_left -= n_settling;
    n_samples -= n_settling;
    if (n_samples == 0) {
        return n_settling > 0 || frf->settle_left > 0 ? GSID_SETTLING : GSID_OK;
    }
    return frf->engine->skip(frf, n_samples);
}

gsid_status gsid_frf_finish(gsid_frf *frf) {
    if (frf == NULL) {
        return GSID_E_NULL;
    }
    return frf->engine == NULL ? GSID_E_STATE : frf->engine->finish(frf);
}

/* Returns whether all of the line is in the range of numbers. */
static int result_line(const gsid_frf *frf, uint32_t i, const gsid_frf_out *out) {
    const gsid_frf_line line = gsid_frf_line_at(frf, i);
    if (out->g != NULL) {
        out->g[i] = line.g;
    }
    if (out->var_g != NULL) {
        out->var_g[i] = line.var_g;
    }
    if (out->y != NULL) {
        out->y[i] = line.y;
    }
    if (out->u != NULL) {
        out->u[i] = line.u;
    }
    if (out->var_y != NULL) {
        out->var_y[i] = line.var_y;
    }
    if (out->var_u != NULL) {
        out->var_u[i] = line.var_u;
    }
    if (out->cov_yu != NULL) {
        out->cov_yu[i] = line.cov_yu;
    }
    return line.is_in_range;
}

gsid_status gsid_frf_result(const gsid_frf *frf, const gsid_frf_out *out) {
    if (frf == NULL || out == NULL) {
        return GSID_E_NULL;
    }
    if (frf->engine == NULL) {
        return GSID_E_STATE;
    }
    int variance_asked = out->var_g != NULL || out->var_y != NULL || out->var_u != NULL || out->cov_yu != NULL;
    if (frf->n_periods < (variance_asked ? 2u : 1u)) {
        return GSID_E_TOO_FEW;
    }
    int is_in_range = 1;
    for (uint32_t i = 0; i < frf->cfg.n_lines; i++) {
        is_in_range &= result_line(frf, i, out);
    }
    return is_in_range ? GSID_OK : GSID_RANGE;
}
