/* The direct engine of gsid_frf: every line at every sample, the whole period into the means at its last sample. */
#include "complex_math.h"
#include "streaming.h"

static gsid_status init(gsid_frf *frf, const gsid_spectrum_cfg *cfg, void *mem, size_t mem_size) {
    return gsid_spectrum_init(&frf->spectrum, cfg, mem, mem_size);
}

static void add_period(gsid_frf *frf) {
    const gsid_real scale = GSID_R(2.0) / (gsid_real)frf->cfg.n_period;
    const uint32_t n = gsid_frf_channels(&frf->cfg);
    const gsid_cplx *sum = frf->spectrum.sum;
    for (uint32_t i = 0; i < frf->cfg.n_lines; i++, sum += n) {
        const gsid_cplx x[2] = {gsid_cplx_scale(scale, sum[0]), gsid_cplx_scale(scale, sum[n - 1])};
        gsid_frf_add_line(frf, i, x);
    }
    frf->n_periods++;
}

static gsid_status step(gsid_frf *frf, gsid_real u, gsid_real y) {
    const gsid_status status = gsid_spectrum_sum(&frf->spectrum, u, y);
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

static gsid_status skip(gsid_frf *frf, uint32_t n_samples) {
    const uint32_t n_period = frf->cfg.n_period;
    const uint64_t n = (uint64_t)frf->spectrum.n % n_period + n_samples;
    const gsid_status status = gsid_spectrum_skip(&frf->spectrum, n_samples);
    frf->n_spoiled += (uint32_t)(n / n_period);
    frf->spoiled = n % n_period > 0;
    return status == GSID_DONE ? GSID_SPOILED : status;
}

static gsid_status finish(gsid_frf *frf) {
    (void)frf;
    return GSID_OK;
}

static const struct gsid_frf_engine direct = {gsid_spectrum_mem_size, init, step, skip, finish};

size_t gsid_frf_mem_size(const gsid_frf_cfg *cfg) {
    return gsid_frf_size_with(&direct, cfg);
}

gsid_status gsid_frf_init(gsid_frf *frf, const gsid_frf_cfg *cfg, void *mem, size_t mem_size) {
    return gsid_frf_init_with(&direct, frf, cfg, mem, mem_size);
}
