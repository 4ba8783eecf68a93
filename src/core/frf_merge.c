/* Add what was measured elsewhere to the means: whole periods, and other measurements. */
#include "frf_private.h"

/* The spread engine adds a period over several ticks: some lines already include it. */
static int is_adding(const gsid_frf *frf) {
    return frf->line_next > 0 && frf->line_next < frf->cfg.n_lines;
}

gsid_status gsid_frf_add_period(gsid_frf *frf, const gsid_cplx *lines) {
    if (frf == NULL || lines == NULL) {
        return GSID_E_NULL;
    }
    if (frf->engine == NULL || is_adding(frf)) {
        return GSID_E_STATE;
    }
    const uint32_t n = gsid_frf_channels(&frf->cfg);
    for (size_t i = 0; i < (size_t)frf->cfg.n_lines * n; i++) {
        if (!gsid_cplx_is_finite(lines[i])) {
            return GSID_E_NONFINITE;
        }
    }
    const uint32_t n_periods = gsid_count(frf->n_periods, 1);
    const gsid_real share = gsid_frf_share(n_periods);
    for (uint32_t i = 0; i < frf->cfg.n_lines; i++) {
        if (frf->cross == NULL) {
            gsid_frf_welford(share, lines[i], &frf->mean[i], &frf->m2[i]);
        } else {
            gsid_frf_add_measured(frf, share, i, lines[2 * (size_t)i], lines[2 * (size_t)i + 1]);
        }
    }
    frf->n_periods = n_periods;
    return GSID_OK;
}

static int is_same_input(const gsid_frf *a, const gsid_frf *b) {
    if ((a->cross == NULL) != (b->cross == NULL)) {
        return 0;
    }
    for (uint32_t i = 0; a->cross == NULL && i < a->cfg.n_lines; i++) {
        const gsid_cplx ua = a->cfg.u_known[i], ub = b->cfg.u_known[i];
        if (ua.re < ub.re || ua.re > ub.re || ua.im < ub.im || ua.im > ub.im) {
            return 0;
        }
    }
    return 1;
}

static int is_same_measurement(const gsid_frf *a, const gsid_frf *b) {
    if (a->cfg.n_period != b->cfg.n_period || a->cfg.n_lines != b->cfg.n_lines || !is_same_input(a, b)) {
        return 0;
    }
    for (uint32_t i = 0; i < a->cfg.n_lines; i++) {
        if (a->cfg.line[i] != b->cfg.line[i]) {
            return 0;
        }
    }
    return 1;
}

gsid_status gsid_frf_merge(gsid_frf *frf, const gsid_frf *other) {
    if (frf == NULL || other == NULL) {
        return GSID_E_NULL;
    }
    if (frf->engine == NULL || other->engine == NULL || is_adding(frf) || is_adding(other)) {
        return GSID_E_STATE;
    }
    if (frf == other || !is_same_measurement(frf, other)) {
        return GSID_E_CONFIG;
    }
    frf->n_spoiled = gsid_count(frf->n_spoiled, other->n_spoiled);
    frf->n_refused = gsid_count(frf->n_refused, other->n_refused);
    if (other->n_periods == 0) {
        return GSID_OK;
    }
    const gsid_frf_parts parts = gsid_frf_parts_of((gsid_real)frf->n_periods, (gsid_real)other->n_periods);
    for (uint32_t i = 0; i < frf->cfg.n_lines; i++) {
        if (frf->cross == NULL) {
            gsid_frf_merge_mean(parts, &frf->mean[i], &frf->m2[i], other->mean[i], other->m2[i]);
            continue;
        }
        const size_t y = 2 * (size_t)i, u = y + 1;
        gsid_cplx dy = gsid_frf_merge_mean(parts, &frf->mean[y], &frf->m2[y], other->mean[y], other->m2[y]);
        gsid_cplx du = gsid_frf_merge_mean(parts, &frf->mean[u], &frf->m2[u], other->mean[u], other->m2[u]);
        gsid_frf_merge_cross(parts, dy, du, &frf->cross[i], other->cross[i]);
    }
    frf->n_periods = gsid_count(frf->n_periods, other->n_periods);
    return GSID_OK;
}
