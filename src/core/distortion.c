#include "gsid/distortion.h"

#include <string.h>

#include "complex_math.h"
#include "frf_private.h"
#include "real.h"

static gsid_frf_cfg frf_cfg(const gsid_distortion_cfg *cfg, const gsid_cplx *u_known) {
    gsid_frf_cfg f = {.n_period = cfg->n_period,
                      .n_lines = cfg->n_lines,
                      .n_settle = cfg->n_settle,
                      .line = cfg->line,
                      .twiddle = cfg->twiddle,
                      .u_known = u_known};
    return f;
}

static int is_ascending(const uint32_t *line, uint32_t first, uint32_t end) {
    for (uint32_t i = first + 1; i < end; i++) {
        if (line[i] <= line[i - 1]) {
            return 0;
        }
    }
    return 1;
}

/* frf_size: bytes of the measurement of one realisation, 0 if its engine refuses the configuration. */
static gsid_status check_cfg(const gsid_distortion_cfg *cfg, size_t frf_size) {
    if (cfg->n_excited < 1 || cfg->n_excited > cfg->n_lines || cfg->input_is_known > 1 || frf_size == 0 ||
        cfg->n_lines > (SIZE_MAX - frf_size) / GSID_DISTORTION_MEAN_SIZE(1, 1) ||
        !is_ascending(cfg->line, 0, cfg->n_excited) || !is_ascending(cfg->line, cfg->n_excited, cfg->n_lines)) {
        return GSID_E_CONFIG;
    }
    return GSID_OK;
}

static int has_pointers(const gsid_distortion_cfg *cfg) {
    return cfg != NULL && cfg->line != NULL && cfg->twiddle != NULL;
}

/* Checked as for a measured input, because gsid_distortion_start supplies the lines of a known one. */
static size_t direct_size(const gsid_distortion_cfg *cfg) {
    const gsid_frf_cfg f = frf_cfg(cfg, NULL);
    return gsid_frf_mem_size(&f) > 0 ? GSID_FRF_MEM_SIZE(cfg->n_lines, (size_t)1 - cfg->input_is_known) : 0;
}

static size_t spread_size(const gsid_distortion_cfg *cfg) {
    const gsid_frf_cfg f = frf_cfg(cfg, NULL);
    return gsid_frf_spread_mem_size(&f) > 0
               ? GSID_FRF_SPREAD_MEM_SIZE(cfg->n_period, cfg->n_lines, (size_t)1 - cfg->input_is_known)
               : 0;
}

static size_t size_with(const gsid_distortion_cfg *cfg, size_t frf_size) {
    return check_cfg(cfg, frf_size) == GSID_OK ? GSID_DISTORTION_MEAN_SIZE(cfg->n_lines, cfg->n_excited) + frf_size : 0;
}

size_t gsid_distortion_mem_size(const gsid_distortion_cfg *cfg) {
    return has_pointers(cfg) ? size_with(cfg, direct_size(cfg)) : 0;
}

size_t gsid_distortion_spread_mem_size(const gsid_distortion_cfg *cfg) {
    return has_pointers(cfg) ? size_with(cfg, spread_size(cfg)) : 0;
}

static gsid_status init_with(gsid_distortion *d, const gsid_distortion_cfg *cfg, size_t frf_size, void *mem,
                             size_t mem_size) {
    gsid_status status = check_cfg(cfg, frf_size);
    if (status != GSID_OK) {
        return status;
    }
    if (mem_size < size_with(cfg, frf_size) || !gsid_is_aligned(mem)) {
        return GSID_E_MEMORY;
    }
    const size_t n_excited = cfg->n_excited, n_free = cfg->n_lines - cfg->n_excited;
    memset(d, 0, sizeof *d);
    memset(mem, 0, GSID_DISTORTION_MEAN_SIZE(n_excited + n_free, n_excited));
    d->cfg = *cfg;
    d->frf_size = frf_size;
    d->mean = (gsid_cplx *)mem; /* a complex number has the alignment of a real: nothing needs padding */
    d->m2 = (gsid_real *)(void *)(d->mean + n_excited);
    d->noise = d->m2 + n_excited;
    d->power = d->noise + n_excited;
    d->power_noise = d->power + n_free;
    d->frf_mem = d->power_noise + n_free;
    return GSID_OK;
}

gsid_status gsid_distortion_init(gsid_distortion *d, const gsid_distortion_cfg *cfg, void *mem, size_t mem_size) {
    if (d == NULL || mem == NULL || !has_pointers(cfg)) {
        return GSID_E_NULL;
    }
    gsid_status status = init_with(d, cfg, direct_size(cfg), mem, mem_size);
    d->frf_init = status == GSID_OK ? gsid_frf_init : d->frf_init;
    return status;
}

gsid_status gsid_distortion_init_spread(gsid_distortion *d, const gsid_distortion_cfg *cfg, void *mem,
                                        size_t mem_size) {
    if (d == NULL || mem == NULL || !has_pointers(cfg)) {
        return GSID_E_NULL;
    }
    gsid_status status = init_with(d, cfg, spread_size(cfg), mem, mem_size);
    d->frf_init = status == GSID_OK ? gsid_frf_init_spread : d->frf_init;
    return status;
}

gsid_status gsid_distortion_start(gsid_distortion *d, const gsid_cplx *u_known) {
    if (d == NULL || (u_known == NULL && d->cfg.input_is_known)) {
        return GSID_E_NULL;
    }
    if (d->mean == NULL) {
        return GSID_E_STATE;
    }
    const gsid_frf_cfg f = frf_cfg(&d->cfg, d->cfg.input_is_known ? u_known : NULL);
    return d->frf_init(&d->frf, &f, d->frf_mem, d->frf_size);
}

gsid_status gsid_distortion_step(gsid_distortion *d, gsid_real u, gsid_real y) {
    return d == NULL ? GSID_E_NULL : gsid_frf_step(&d->frf, u, y);
}

gsid_status gsid_distortion_skip(gsid_distortion *d, uint32_t n_samples) {
    return d == NULL ? GSID_E_NULL : gsid_frf_skip(&d->frf, n_samples);
}

gsid_status gsid_distortion_add_period(gsid_distortion *d, const gsid_cplx *lines) {
    return d == NULL ? GSID_E_NULL : gsid_frf_add_period(&d->frf, lines);
}

/* DIS-2, 5.14: mean and deviations over realisations by Welford's update, as FRF-2 over periods. */
static void add_excited(gsid_distortion *d) {
    const gsid_real m = (gsid_real)d->n_realisations;
    for (uint32_t i = 0; i < d->cfg.n_excited; i++) {
        const gsid_frf_line line = gsid_frf_line_at(&d->frf, i);
        const gsid_cplx away = gsid_cplx_sub(line.g, d->mean[i]);
        d->mean[i] = gsid_cplx_add(d->mean[i], gsid_cplx_make(away.re / m, away.im / m));
        d->m2[i] += gsid_cplx_abs2(away) * ((m - GSID_R(1.0)) / m);
        d->noise[i] += line.var_g;
    }
}

/* The response at a line that is not excited: interpolated linearly between the excited lines on both sides, and equal to
 * the nearest one beyond the ends. `above` is the first excited line above it, kept from line to line. */
static gsid_cplx response_between(const gsid_distortion *d, uint32_t line, uint32_t *above) {
    const uint32_t n = d->cfg.n_excited;
    const uint32_t *excited = d->cfg.line;
    while (*above < n && excited[*above] < line) {
        (*above)++;
    }
    if (*above == 0) {
        return gsid_frf_line_at(&d->frf, 0).g;
    }
    const gsid_cplx low = gsid_frf_line_at(&d->frf, *above - 1).g;
    if (*above == n) {
        return low;
    }
    const gsid_cplx high = gsid_frf_line_at(&d->frf, *above).g;
    const gsid_real share =
        (gsid_real)(line - excited[*above - 1]) / (gsid_real)(excited[*above] - excited[*above - 1]);
    return gsid_cplx_add(low, gsid_cplx_scale(share, gsid_cplx_sub(high, low)));
}

/* DIS-3 at line i and its noise, of one realisation. Returns whether they are in the range of numbers. */
static int free_power(const gsid_distortion *d, uint32_t i, uint32_t *above, gsid_real *power, gsid_real *noise) {
    const gsid_frf_line line = gsid_frf_line_at(&d->frf, i);
    const gsid_cplx g = response_between(d, d->cfg.line[i], above);
    const gsid_cplx left = gsid_cplx_sub(line.y, gsid_cplx_mul(g, line.u));
    const gsid_real p = (gsid_real)d->frf.n_periods;
    *power = gsid_cplx_abs2(left);
    *noise = gsid_frf_error_variance(&line, g) / p;
    const gsid_real size_y = gsid_frf_size(line.y);
    const int is_kept = *power >= GSID_SMALLEST || (left.re == 0 && left.im == 0);
    return (size_y == 0 || gsid_frf_is_kept(*noise, size_y)) && is_kept && gsid_is_finite(*power) &&
           gsid_is_finite(*noise);
}

static void add_free(gsid_distortion *d) {
    const gsid_real m = (gsid_real)d->n_realisations;
    uint32_t above = 0;
    for (uint32_t i = d->cfg.n_excited; i < d->cfg.n_lines; i++) {
        const uint32_t at = i - d->cfg.n_excited;
        gsid_real power, noise;
        free_power(d, i, &above, &power, &noise);
        d->power[at] += (power - d->power[at]) / m;
        d->power_noise[at] += (noise - d->power_noise[at]) / m;
    }
}

/* Whether all that this realisation adds is in the range of numbers. Checked before it is added, because a loss inside a sum
 * cannot be detected in its results. */
static gsid_status check_lines(const gsid_distortion *d) {
    uint32_t above = 0;
    for (uint32_t i = 0; i < d->cfg.n_excited; i++) {
        const gsid_frf_line line = gsid_frf_line_at(&d->frf, i);
        if (!(gsid_frf_size(line.u) > GSID_R(0.0))) {
            return GSID_E_TOO_FEW;
        }
        if (!line.is_in_range) {
            return GSID_E_NONFINITE;
        }
    }
    for (uint32_t i = d->cfg.n_excited; i < d->cfg.n_lines; i++) {
        gsid_real power, noise;
        if (!free_power(d, i, &above, &power, &noise)) {
            return GSID_E_NONFINITE;
        }
    }
    return GSID_OK;
}

gsid_status gsid_distortion_finish(gsid_distortion *d) {
    if (d == NULL) {
        return GSID_E_NULL;
    }
    if (d->frf.engine == NULL) {
        return GSID_E_STATE;
    }
    gsid_frf_finish(&d->frf); /* completes the work left to the spread engine */
    if (d->frf.n_periods < 2) {
        return GSID_E_TOO_FEW;
    }
    const gsid_status status = check_lines(d);
    if (status != GSID_OK) {
        return status;
    }
    d->n_realisations = gsid_count(d->n_realisations, 1);
    d->n_periods = gsid_count(d->n_periods, d->frf.n_periods);
    add_excited(d);
    add_free(d);
    d->frf.engine = NULL; /* no realisation is in progress */
    return GSID_OK;
}

static void result_excited(const gsid_distortion *d, uint32_t i, const gsid_distortion_out *out) {
    const gsid_real m = (gsid_real)d->n_realisations;
    const gsid_real var_noise = d->noise[i] / (m * m);
    const gsid_real var_total = m > GSID_R(1.0) ? d->m2[i] / (m * (m - GSID_R(1.0))) : GSID_R(0.0);
    if (out->bla != NULL) {
        out->bla[i] = d->mean[i];
    }
    if (out->var_noise != NULL) {
        out->var_noise[i] = var_noise;
    }
    if (out->var_total != NULL) {
        out->var_total[i] = var_total;
    }
    if (out->std_nonlinear != NULL) { /* 5.16 */
        out->std_nonlinear[i] = var_total > var_noise ? gsid_sqrt(m * (var_total - var_noise)) : GSID_R(0.0);
    }
}

static int is_in_range(const gsid_distortion *d) {
    gsid_real sum = 0; /* 0 times a number that is not finite is not 0 */
    for (uint32_t i = 0; i < d->cfg.n_excited; i++) {
        sum += 0 * d->m2[i] + 0 * d->noise[i];
    }
    return sum == 0;
}

gsid_status gsid_distortion_result(const gsid_distortion *d, const gsid_distortion_out *out) {
    if (d == NULL || out == NULL) {
        return GSID_E_NULL;
    }
    if (d->mean == NULL) {
        return GSID_E_STATE;
    }
    const int scatter_asked = out->var_total != NULL || out->std_nonlinear != NULL;
    if (d->n_realisations < (scatter_asked ? 2u : 1u)) {
        return GSID_E_TOO_FEW;
    }
    if (!is_in_range(d)) {
        return GSID_E_NONFINITE;
    }
    for (uint32_t i = 0; i < d->cfg.n_excited; i++) {
        result_excited(d, i, out);
    }
    for (uint32_t i = 0; i < d->cfg.n_lines - d->cfg.n_excited; i++) {
        if (out->level != NULL) {
            out->level[i] = gsid_sqrt(d->power[i]);
        }
        if (out->level_noise != NULL) {
            out->level_noise[i] = gsid_sqrt(d->power_noise[i]);
        }
    }
    return GSID_OK;
}
