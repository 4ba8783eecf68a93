/* The direct engine of gsid_frf: each sample is added to every line; a period enters the means at its last sample. */
#include "streaming.h"

static gsid_status init(gsid_frf *frf, const gsid_spectrum_cfg *cfg, void *mem, size_t mem_size) {
    return gsid_spectrum_init(&frf->spectrum, cfg, mem, mem_size);
}

/* The last sample of a period with missing samples only advances the phases; the sums are discarded. */
gsid_status gsid_frf_leave_out(gsid_frf *frf, gsid_real u, gsid_real y) {
    gsid_spectrum_sum(&frf->spectrum, u, y);
    gsid_spectrum_clear(&frf->spectrum);
    frf->spoiled = 0;
    frf->n_spoiled = gsid_count(frf->n_spoiled, 1);
    return GSID_SPOILED;
}

/* Count one more good period. Returns its weight in the means. */
static gsid_real count_period(gsid_frf *frf) {
    frf->spectrum.n = 0;
    frf->n_periods = gsid_count(frf->n_periods, 1);
    return gsid_frf_share(frf->n_periods);
}

/* The last sample of a period enters the sums, and the sums enter the means, line by line. This tick costs the most, so nothing
 * is read or written twice. Two functions, and local copies of the object's fields, for the reasons given at
 * gsid_spectrum_sum. */
static gsid_status step_known(gsid_frf *frf, gsid_real u, gsid_real y) {
    const gsid_spectrum *s = &frf->spectrum;
    const uint32_t n_period = s->cfg.n_period, *line = s->cfg.line;
    if (s->n + 1 < n_period) {
        return gsid_spectrum_sum(&frf->spectrum, u, y);
    }
    if (frf->spoiled) {
        return gsid_frf_leave_out(frf, u, y);
    }
    const uint32_t *end = line + s->cfg.n_lines;
    const gsid_cplx *twiddle = s->cfg.twiddle;
    const gsid_real scale = s->scale, share = count_period(frf);
    uint32_t *at = s->phase;
    gsid_cplx *sum = s->sum, *mean = frf->mean;
    gsid_real *m2 = frf->m2;
    do {
        const gsid_cplx w = gsid_spectrum_turn(n_period, twiddle, *line++, at++);
        gsid_frf_welford(share, gsid_cplx_scale(scale, gsid_spectrum_add(*sum, y, w)), mean, m2);
        mean++;
        m2++;
        *sum = gsid_cplx_make(GSID_R(0.0), GSID_R(0.0));
        sum++;
    } while (line < end);
    return GSID_DONE;
}

static gsid_status step_measured(gsid_frf *frf, gsid_real u, gsid_real y) {
    const gsid_spectrum *s = &frf->spectrum;
    const uint32_t n_period = s->cfg.n_period, n_lines = s->cfg.n_lines;
    if (s->n + 1 < n_period) {
        return gsid_spectrum_sum(&frf->spectrum, u, y);
    }
    if (frf->spoiled) {
        return gsid_frf_leave_out(frf, u, y);
    }
    const gsid_real scale = s->scale, share = count_period(frf);
    const gsid_cplx zero = gsid_cplx_make(GSID_R(0.0), GSID_R(0.0));
    gsid_cplx *sum = s->sum;
    for (uint32_t i = 0; i < n_lines; i++, sum += 2) {
        const gsid_cplx w = gsid_spectrum_turn(n_period, s->cfg.twiddle, s->cfg.line[i], &s->phase[i]);
        const gsid_cplx line_y = gsid_cplx_scale(scale, gsid_spectrum_add(sum[0], y, w));
        const gsid_cplx line_u = gsid_cplx_scale(scale, gsid_spectrum_add(sum[1], u, w));
        gsid_frf_add_measured(frf, share, i, line_y, line_u);
        sum[0] = sum[1] = zero;
    }
    return GSID_DONE;
}

static gsid_status skip(gsid_frf *frf, uint32_t n_samples) {
    const uint32_t n_period = frf->cfg.n_period;
    const uint64_t n = (uint64_t)frf->spectrum.n % n_period + n_samples;
    const gsid_status status = gsid_spectrum_skip(&frf->spectrum, n_samples);
    frf->n_spoiled = gsid_count(frf->n_spoiled, (uint32_t)(n / n_period));
    frf->spoiled = n % n_period > 0;
    return status == GSID_DONE ? GSID_SPOILED : status;
}

static gsid_status finish(gsid_frf *frf) {
    (void)frf;
    return GSID_OK;
}

static const struct gsid_frf_engine known = {gsid_spectrum_mem_size, init, step_known, skip, finish};
static const struct gsid_frf_engine measured = {gsid_spectrum_mem_size, init, step_measured, skip, finish};

size_t gsid_frf_mem_size(const gsid_frf_cfg *cfg) {
    return gsid_frf_size_with(&known, cfg);
}

gsid_status gsid_frf_init(gsid_frf *frf, const gsid_frf_cfg *cfg, void *mem, size_t mem_size) {
    return gsid_frf_init_with(cfg != NULL && cfg->u_known == NULL ? &measured : &known, frf, cfg, mem, mem_size);
}
