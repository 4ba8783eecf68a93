/* The spread engine of gsid_frf: a slice of the last period's transform, or a few of its lines into the means, in a tick. */
#include "streaming.h"

static gsid_status init(gsid_frf *frf, const gsid_spectrum_cfg *cfg, void *mem, size_t mem_size) {
    return gsid_spread_init(&frf->spread, cfg, mem, mem_size);
}

static void add_line(gsid_frf *frf, gsid_real share, uint32_t i) {
    const gsid_spread *s = &frf->spread;
    const uint32_t *place = s->place[i], n = s->cfg.n_channels;
    const gsid_cplx turn = s->cfg.twiddle[s->cfg.line[i]], *work = s->work;
    const uint32_t half = s->cfg.n_period / 2;
    const gsid_real scale = s->scale;
    gsid_cplx *mean = frf->mean + i * n, d[2];
    gsid_real *m2 = frf->m2 + i * n;
    for (uint32_t c = 0; c < n; c++) {
        d[c] = gsid_frf_welford(share, gsid_spread_read(work, place, turn, scale), mean++, m2++);
        work += half;
    }
    if (n == 2) {
        gsid_frf_add_product(share, d, frf->cross + i);
    }
}

static uint32_t lines_left(const gsid_frf *frf) {
    return frf->spread.has_lines ? frf->cfg.n_lines - frf->line_next : 0;
}

static gsid_status add_lines(gsid_frf *frf) {
    const uint32_t n_left = lines_left(frf);
    if (n_left == 0) {
        return GSID_OK;
    }
    const uint32_t n_periods = gsid_count(frf->n_periods, 1);
    const gsid_real share = gsid_frf_share(n_periods);
    for (uint32_t i = 0; i < frf->spread.lines_per_tick && i < n_left; i++) {
        add_line(frf, share, frf->line_next++);
    }
    if (frf->line_next < frf->cfg.n_lines) {
        return GSID_OK;
    }
    frf->n_periods = n_periods;
    return GSID_DONE;
}

/* Do the work of n_ticks ticks, or what is left of it. */
static gsid_status work_off(gsid_frf *frf, uint32_t n_ticks) {
    gsid_spread *s = &frf->spread;
    gsid_status status = GSID_OK;
    for (; n_ticks > 0 && (s->stage < s->n_stages || lines_left(frf) > 0); n_ticks--) {
        status = s->stage < s->n_stages ? gsid_spread_slice(s) : add_lines(frf);
    }
    return status;
}

/* Take the sample, then do one tick's work: first the transform, then the lines. All of it is done before the period ends. */
static gsid_status step(gsid_frf *frf, gsid_real u, gsid_real y) {
    gsid_spread *s = &frf->spread;
    if (!gsid_spread_put(s, u, y)) {
        return s->stage < s->n_stages ? gsid_spread_slice(s) : add_lines(frf);
    }
    frf->line_next = 0;
    frf->n_spoiled = gsid_count(frf->n_spoiled, s->has_gap ? 1u : 0u);
    return gsid_spread_end(s);
}

static gsid_status skip(gsid_frf *frf, uint32_t n_samples) {
    const gsid_status status = work_off(frf, n_samples);
    const uint32_t n_period = frf->cfg.n_period;
    const uint32_t n_ends = n_samples / n_period + (gsid_spread_n(&frf->spread) + n_samples % n_period) / n_period;
    frf->n_spoiled = gsid_count(frf->n_spoiled, n_ends);
    if (gsid_spread_pass(&frf->spread, n_samples) == GSID_OK) {
        return status;
    }
    frf->line_next = 0;
    return GSID_SPOILED;
}

static gsid_status finish(gsid_frf *frf) {
    return work_off(frf, frf->cfg.n_period);
}

static const struct gsid_frf_engine spread = {gsid_spread_mem_size, init, step, skip, finish};

size_t gsid_frf_spread_mem_size(const gsid_frf_cfg *cfg) {
    return gsid_frf_size_with(&spread, cfg);
}

gsid_status gsid_frf_init_spread(gsid_frf *frf, const gsid_frf_cfg *cfg, void *mem, size_t mem_size) {
    return gsid_frf_init_with(&spread, frf, cfg, mem, mem_size);
}
