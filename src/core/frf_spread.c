/* The spread engine of gsid_frf: a slice of the last period's transform, or a few of its lines into the means, in a tick. */
#include "streaming.h"

static gsid_status init(gsid_frf *frf, const gsid_spectrum_cfg *cfg, void *mem, size_t mem_size) {
    frf->line_next = cfg->n_lines;
    return gsid_spread_init(&frf->spread, cfg, mem, mem_size);
}

static int has_lines(const gsid_frf *frf) {
    return frf->line_next < frf->cfg.n_lines;
}

static gsid_status add_lines(gsid_frf *frf) {
    const uint32_t n_lines = frf->cfg.n_lines, n = gsid_frf_channels(&frf->cfg);
    if (frf->line_next >= n_lines) {
        return GSID_OK;
    }
    for (uint32_t i = frf->spread.lines_per_tick; i > 0 && frf->line_next < n_lines; i--) {
        gsid_cplx x[2];
        for (uint32_t channel = 0; channel < n; channel++) {
            x[channel] = gsid_spread_read(&frf->spread, frf->line_next, channel);
        }
        gsid_frf_add_line(frf, frf->line_next++, x);
    }
    if (frf->line_next < n_lines) {
        return GSID_OK;
    }
    frf->n_periods++;
    return GSID_DONE;
}

/* What a tick returns whose lines were added with the one status and whose transform went on with the other. The transform
 * is complete before the first line is added, and the last one is before the period ends: at most one of them has news. */
static gsid_status conclude(gsid_frf *frf, gsid_status added, gsid_status transformed) {
    if (transformed == GSID_OK) {
        return added;
    }
    if (transformed == GSID_DONE) {
        frf->line_next = 0;
        return GSID_OK;
    }
    frf->n_spoiled++;
    return transformed;
}

static gsid_status step(gsid_frf *frf, gsid_real u, gsid_real y) {
    const gsid_status added = add_lines(frf);
    return conclude(frf, added, gsid_spread_take(&frf->spread, u, y));
}

/* Tick by tick while there is work that belongs to them, then at once. */
static gsid_status skip(gsid_frf *frf, uint32_t n_samples) {
    gsid_status status = GSID_OK;
    for (; n_samples > 0 && (frf->spread.stage < frf->spread.n_stages || has_lines(frf)); n_samples--) {
        const gsid_status added = add_lines(frf);
        const gsid_status now = conclude(frf, added, gsid_spread_skip(&frf->spread, 1));
        status = now != GSID_OK ? now : status;
    }
    const uint32_t n_period = frf->cfg.n_period;
    frf->n_spoiled += n_samples / n_period + (frf->spread.n + n_samples % n_period) / n_period;
    return gsid_spread_skip(&frf->spread, n_samples) == GSID_SPOILED ? GSID_SPOILED : status;
}

static gsid_status finish(gsid_frf *frf) {
    if (gsid_spread_finish(&frf->spread) == GSID_DONE) {
        frf->line_next = 0;
    }
    gsid_status status = GSID_OK;
    while (has_lines(frf)) {
        status = add_lines(frf);
    }
    return status;
}

static const struct gsid_frf_engine spread = {gsid_spread_mem_size, init, step, skip, finish};

size_t gsid_frf_spread_mem_size(const gsid_frf_cfg *cfg) {
    return gsid_frf_size_with(&spread, cfg);
}

gsid_status gsid_frf_init_spread(gsid_frf *frf, const gsid_frf_cfg *cfg, void *mem, size_t mem_size) {
    return gsid_frf_init_with(&spread, frf, cfg, mem, mem_size);
}
