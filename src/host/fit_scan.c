#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/complex_math.h"
#include "fit_run.h"

#define DELAY_MAX_S 0.012
#define SCAN_LINES_PER_PARAMETER 8
#define SCAN_REWEIGHTINGS 8
#define REWEIGHTINGS 30
#define STARTS_MAX 8

static int ascending(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Least distance of two lines [Hz], infinite when there is one line only; sorts f. */
static double line_spacing(uint32_t n, double *f) {
    double spacing = HUGE_VAL;
    qsort(f, n, sizeof *f, ascending);
    for (uint32_t k = 1; k < n; k++)
        if (f[k] > f[k - 1])
            spacing = fmin(spacing, f[k] - f[k - 1]);
    return spacing;
}

/* The range of delays, and how many lines the scan looks at. Lines a distance apart tell delays apart up to one over the
 * distance: the default range ends there, and the lines of the scan are near enough for twice the range. */
void gsid_fit_plan_scan(fit_run *r) {
    const double f_max = gsid_fit_highest_frequency(r->data);
    memcpy(r->thin_f, r->data->f_hz, r->data->n_lines * sizeof *r->thin_f);
    const double spacing = line_spacing(r->data->n_lines, r->thin_f);
    r->delay_limit_s = r->cfg.delay_max_s;
    if (!(r->delay_limit_s > 0))
        r->delay_limit_s = fmin(fmin(DELAY_MAX_S, 1 / spacing), GSID_FIT_DELAYS_MAX / (8 * f_max));
    const double by_count = r->data->n_lines / (SCAN_LINES_PER_PARAMETER * (double)gsid_fit_n_parameters(&r->cfg));
    const double by_delay = 1 / (2 * r->delay_limit_s * spacing);
    r->stride = (uint32_t)fmax(1, fmin(by_count, by_delay));
}

double gsid_fit_rate(const fit_run *r) {
    return r->cfg.domain == GSID_DOMAIN_S ? GSID_TWO_PI * gsid_fit_highest_frequency(r->data) : r->cfg.sample_s;
}

/* One linear fit to the lines given; a failure costs HUGE_VAL. */
static gsid_status linear_fit(fit_run *r, const gsid_frd *lines, double delay_s, uint32_t n_reweightings,
                              fit_candidate *c) {
    const gsid_iwls_cfg iwls = {.n_iterations = r->cfg.method == GSID_METHOD_LS ? 0 : n_reweightings,
                                .exponent = r->cfg.method == GSID_METHOD_IWLS ? r->cfg.exponent : 0};
    const double rate = gsid_fit_rate(r);
    c->cost = HUGE_VAL;
    gsid_status status = gsid_rational_init(&c->model, r->cfg.domain, r->cfg.n_poles, r->cfg.n_zeros, rate);
    c->model.delay_s = delay_s;
    if (status == GSID_OK)
        status = gsid_estimate_iwls(lines, &iwls, &c->model, &c->cost, r->mem, r->mem_size);
    return status;
}

void gsid_fit_thin_out(fit_run *r) {
    uint32_t n = 0;
    for (uint32_t k = 0; k < r->work.n_lines; k += r->stride, n++) {
        r->thin_f[n] = r->work.f_hz[k];
        r->thin_g[n] = r->work.g[k];
        r->thin_sigma[n] = r->work.sigma[k];
    }
    r->thin = (gsid_frd){
        .n_lines = n, .f_hz = r->thin_f, .g = r->thin_g, .sigma = r->thin_sigma, .logarithmic = r->work.logarithmic};
}

/* Half the width of the basin of the least cost [s]. */
double gsid_fit_delay_step(const fit_run *r) {
    return 1 / (8 * gsid_fit_highest_frequency(r->data));
}

static uint32_t n_scan_steps(const fit_run *r) {
    return (uint32_t)ceil(r->delay_limit_s / gsid_fit_delay_step(r));
}

void gsid_fit_forget(uint32_t n, fit_candidate *kept) {
    for (uint32_t i = 0; i < n; i++)
        kept[i].cost = HUGE_VAL;
}

/* The best linear fits at delays from 0 to the limit: to a few lines at every delay, then to all lines at the best ones. Fails
 * only when every one does. */
static gsid_status scan(fit_run *r, uint32_t n_kept, fit_candidate *kept) {
    gsid_status last = GSID_E_SINGULAR, status;
    fit_candidate coarse[STARTS_MAX], c;
    gsid_fit_thin_out(r);
    gsid_fit_forget(n_kept, coarse);
    const uint32_t n_steps = n_scan_steps(r);
    for (uint32_t i = 0; i <= n_steps; i++) {
        status = linear_fit(r, &r->thin, r->delay_limit_s * i / n_steps, SCAN_REWEIGHTINGS, &c);
        last = status < 0 ? status : last;
        gsid_fit_keep_best(&c, n_kept, coarse);
    }
    gsid_fit_forget(n_kept, kept);
    for (uint32_t i = 0; i < n_kept && coarse[i].cost < HUGE_VAL; i++) {
        status = linear_fit(r, &r->work, coarse[i].model.delay_s, SCAN_REWEIGHTINGS, &c);
        last = status < 0 ? status : last;
        gsid_fit_keep_best(&c, n_kept, kept);
    }
    return kept[0].cost < HUGE_VAL ? GSID_OK : last;
}

/* Where to start from, best first: the scan when the delay is free. */
gsid_status gsid_fit_starts(fit_run *r, uint32_t n_kept, fit_candidate *kept) {
    if (r->cfg.delay == GSID_DELAY_FREE)
        return scan(r, n_kept, kept);
    gsid_fit_forget(n_kept, kept);
    return linear_fit(r, &r->work, r->cfg.delay == GSID_DELAY_FIXED ? r->cfg.delay_s : 0, REWEIGHTINGS, kept);
}

/* LS and IWLS have no delay of their own: the delay of least output error, by golden section around the scan's best. */
gsid_status gsid_fit_linear(fit_run *r, fit_candidate *best) {
    const gsid_status status = gsid_fit_starts(r, 1, best);
    if (status < 0 || r->cfg.delay != GSID_DELAY_FREE)
        return status < 0 ? status : GSID_OK;
    const double step_s = r->delay_limit_s / n_scan_steps(r);
    const double golden = 0.3819660112501051;
    double lo = fmax(best->model.delay_s - step_s, 0), hi = best->model.delay_s + step_s;
    fit_candidate a, b;
    linear_fit(r, &r->work, lo + golden * (hi - lo), REWEIGHTINGS, &a);
    linear_fit(r, &r->work, hi - golden * (hi - lo), REWEIGHTINGS, &b);
    while (hi - lo > 1e-6 * step_s) {
        if (a.cost < b.cost) {
            hi = b.model.delay_s;
            b = a;
            linear_fit(r, &r->work, lo + golden * (hi - lo), REWEIGHTINGS, &a);
        } else {
            lo = a.model.delay_s;
            a = b;
            linear_fit(r, &r->work, hi - golden * (hi - lo), REWEIGHTINGS, &b);
        }
    }
    gsid_fit_keep_best(&a, 1, best);
    gsid_fit_keep_best(&b, 1, best);
    return GSID_OK;
}
