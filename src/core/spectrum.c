#include "gsid/spectrum.h"

#include <string.h>

#include "complex_math.h"
#include "streaming.h"

static gsid_status check_cfg(const gsid_spectrum_cfg *cfg) {
    if (cfg == NULL || cfg->line == NULL || cfg->twiddle == NULL) {
        return GSID_E_NULL;
    }
    if (cfg->n_period < 2 || cfg->n_period > GSID_N_PERIOD_MAX || cfg->n_first >= cfg->n_period || cfg->n_lines < 1 ||
        (cfg->n_channels != 1 && cfg->n_channels != 2) ||
        cfg->n_lines > SIZE_MAX / GSID_SPECTRUM_MEM_SIZE(1, cfg->n_channels)) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < cfg->n_lines; i++) {
        if (cfg->line[i] > cfg->n_period / 2) {
            return GSID_E_CONFIG;
        }
    }
    return GSID_OK;
}

size_t gsid_spectrum_mem_size(const gsid_spectrum_cfg *cfg) {
    return check_cfg(cfg) == GSID_OK ? GSID_SPECTRUM_MEM_SIZE(cfg->n_lines, cfg->n_channels) : 0;
}

gsid_status gsid_spectrum_init(gsid_spectrum *s, const gsid_spectrum_cfg *cfg, void *mem, size_t mem_size) {
    if (s == NULL || mem == NULL) {
        return GSID_E_NULL;
    }
    gsid_status status = check_cfg(cfg);
    if (status != GSID_OK) {
        return status;
    }
    if (mem_size < GSID_SPECTRUM_MEM_SIZE(cfg->n_lines, cfg->n_channels) || !gsid_is_aligned(mem)) {
        return GSID_E_MEMORY;
    }
    status = gsid_check_build();
    if (status != GSID_OK) {
        return status;
    }
    s->cfg = *cfg;
    s->sum = (gsid_cplx *)mem;
    s->phase = (uint32_t *)(void *)(s->sum + (size_t)cfg->n_lines * cfg->n_channels);
    s->scale = GSID_R(2.0) / (gsid_real)cfg->n_period;
    return gsid_spectrum_reset(s);
}

void gsid_spectrum_clear(gsid_spectrum *s) {
    memset(s->sum, 0, (size_t)s->cfg.n_lines * s->cfg.n_channels * sizeof *s->sum);
    s->n = 0;
}

gsid_status gsid_spectrum_reset(gsid_spectrum *s) {
    if (s == NULL) {
        return GSID_E_NULL;
    }
    if (s->sum == NULL) {
        return GSID_E_STATE;
    }
    for (uint32_t i = 0; i < s->cfg.n_lines; i++) {
        s->phase[i] = (uint32_t)((uint64_t)s->cfg.line[i] * s->cfg.n_first % s->cfg.n_period);
    }
    gsid_spectrum_clear(s);
    return GSID_OK;
}

/* FRF-1. Two loops, because an inner loop over channels halves the speed. Local copies of the fields, because the compiler
 * must otherwise assume that writing a sum changes them. */
gsid_status gsid_spectrum_sum(gsid_spectrum *s, gsid_real u, gsid_real y) {
    const uint32_t n_period = s->cfg.n_period, *line = s->cfg.line, *end = line + s->cfg.n_lines;
    const gsid_cplx *twiddle = s->cfg.twiddle;
    uint32_t *at = s->phase;
    gsid_cplx *sum = s->sum;
    if (s->cfg.n_channels == 1) {
        do { /* there is at least one line */
            const gsid_cplx w = gsid_spectrum_turn(n_period, twiddle, *line++, at++);
            *sum = gsid_spectrum_add(*sum, y, w);
            sum++;
        } while (line < end);
    } else {
        do {
            const gsid_cplx w = gsid_spectrum_turn(n_period, twiddle, *line++, at++);
            sum[0] = gsid_spectrum_add(sum[0], y, w);
            sum[1] = gsid_spectrum_add(sum[1], u, w);
            sum += 2;
        } while (line < end);
    }
    s->n++;
    return s->n == n_period ? GSID_DONE : GSID_OK;
}

gsid_status gsid_spectrum_step(gsid_spectrum *s, const gsid_real *x) {
    if (s == NULL || x == NULL) {
        return GSID_E_NULL;
    }
    if (s->sum == NULL) {
        return GSID_E_STATE;
    }
    const gsid_real x1 = s->cfg.n_channels == 2 ? x[1] : GSID_R(0.0);
    if (!gsid_is_finite(x[0]) || !gsid_is_finite(x1)) {
        return GSID_E_NONFINITE;
    }
    if (s->n == s->cfg.n_period) {
        gsid_spectrum_clear(s);
    }
    return gsid_spectrum_sum(s, x1, x[0]);
}

gsid_status gsid_spectrum_skip(gsid_spectrum *s, uint32_t n_samples) {
    if (s == NULL) {
        return GSID_E_NULL;
    }
    if (s->sum == NULL) {
        return GSID_E_STATE;
    }
    if (n_samples == 0) {
        return GSID_OK;
    }
    const uint32_t n_period = s->cfg.n_period;
    for (uint32_t i = 0; i < s->cfg.n_lines; i++) {
        s->phase[i] = (uint32_t)((s->phase[i] + (uint64_t)s->cfg.line[i] * n_samples) % n_period);
    }
    uint64_t n = (uint64_t)s->n % n_period + n_samples; /* a complete period stands at the start of the next one */
    if (n >= n_period || s->n == n_period) {
        gsid_spectrum_clear(s);
    }
    s->n = (uint32_t)(n % n_period);
    return n >= n_period ? GSID_DONE : GSID_OK;
}

gsid_status gsid_spectrum_result(const gsid_spectrum *s, gsid_cplx *lines) {
    if (s == NULL || lines == NULL) {
        return GSID_E_NULL;
    }
    if (s->sum == NULL || s->n != s->cfg.n_period) {
        return GSID_E_STATE;
    }
    for (uint32_t i = 0; i < s->cfg.n_lines; i++) {
        int is_single = s->cfg.line[i] == 0 || 2 * s->cfg.line[i] == s->cfg.n_period;
        gsid_real scale = is_single ? s->scale / 2 : s->scale;
        for (uint32_t c = 0; c < s->cfg.n_channels; c++) {
            size_t at = (size_t)i * s->cfg.n_channels + c;
            lines[at] = gsid_cplx_scale(scale, s->sum[at]);
        }
    }
    return GSID_OK;
}
