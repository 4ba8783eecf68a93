#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/complex_math.h"
#include "backend/backend.h"
#include "fit_run.h"

#define DELAY_MAX_S 0.012
#define SCAN_LINES_PER_PARAMETER 8
#define SCAN_REWEIGHTINGS 8
#define REWEIGHTINGS 30
#define REWEIGHTINGS_MAX 200 /* on the way to the fixed point of IWLS */
#define FIXED_POINT 1e-9 /* of the response: a reweighting that changes it by less has reached the fixed point */
#define STARTS_MAX 8
#define LOW_SHARE_MAX 16 /* of the highest frequency: the lowest band that is scanned separately */
#define LOW_BANDS_MAX 4
#define LOW_STARTS 2
#define LOW_STEPS 4 /* where parameters are few, the scans of low bands are finer by this, and there are more bands */
#define LOW_FINE_PARAMETERS 8
#define LOW_ITERATIONS 15
#define LS_STEPS 4 /* the basins of LS, which does not reweight, are narrower by this */
#define SEARCHES 5 /* minima of the scan that LS and IWLS search */

static int ascending(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Least distance of two lines [Hz], infinite when there is one line only; sorts f. */
static double line_spacing(uint32_t n, double *f) {
    double spacing = HUGE_VAL;
    qsort(f, n, sizeof *f, ascending);
    for (uint32_t k = 1; k < n; k++) {
        if (f[k] > f[k - 1]) {
            spacing = fmin(spacing, f[k] - f[k - 1]);
        }
    }
    return spacing;
}

/* The range of delays, and the number of lines that the scan uses. The spacing of the lines determines a delay up to one over
 * the spacing only: the default range ends there, and the lines of the scan are close enough for twice the range. */
void gsid_fit_plan_scan(fit_run *r) {
    const double f_max = gsid_fit_highest_frequency(r->data);
    memcpy(r->thin_f, r->data->f_hz, r->data->n_lines * sizeof *r->thin_f);
    const double spacing = line_spacing(r->data->n_lines, r->thin_f);
    r->delay_limit_s = r->cfg.delay_max_s;
    if (!(r->delay_limit_s > 0)) {
        r->delay_limit_s = fmin(fmin(DELAY_MAX_S, 1 / spacing), GSID_FIT_DELAYS_MAX / (8 * f_max));
    }
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
    if (status == GSID_OK) {
        status = gsid_estimate_iwls(lines, &iwls, &c->model, &c->cost, r->mem, r->mem_size);
    }
    return status;
}

/* LS; or IWLS at its fixed point, iterated from a neighbouring model or, without one, from LS. */
static gsid_status settled_fit(fit_run *r, double delay_s, const gsid_rational *near, fit_candidate *c) {
    if (r->cfg.method == GSID_METHOD_LS) {
        return linear_fit(r, &r->work, delay_s, 0, c);
    }
    const gsid_iwls_cfg iwls = {.n_iterations = REWEIGHTINGS_MAX,
                                .exponent = r->cfg.exponent,
                                .tolerance = FIXED_POINT,
                                .from_model = near != NULL};
    gsid_status status = GSID_OK;
    c->cost = HUGE_VAL;
    if (near != NULL) {
        c->model = *near;
    } else {
        status = gsid_rational_init(&c->model, r->cfg.domain, r->cfg.n_poles, r->cfg.n_zeros, gsid_fit_rate(r));
    }
    c->model.delay_s = delay_s;
    if (status == GSID_OK) {
        status = gsid_estimate_iwls(&r->work, &iwls, &c->model, &c->cost, r->mem, r->mem_size);
    }
    return status;
}

/* Every stride-th of the lines up to a frequency. */
static void thin_out_band(fit_run *r, double f_most_hz, uint32_t stride) {
    uint32_t n = 0, n_within = 0;
    for (uint32_t k = 0; k < r->work.n_lines; k++) {
        if (fabs(r->work.f_hz[k]) > f_most_hz || n_within++ % stride != 0) {
            continue;
        }
        r->thin_f[n] = r->work.f_hz[k];
        r->thin_g[n] = r->work.g[k];
        r->thin_sigma[n++] = r->work.sigma[k];
    }
    r->thin = (gsid_frd){
        .n_lines = n, .f_hz = r->thin_f, .g = r->thin_g, .sigma = r->thin_sigma, .logarithmic = r->work.logarithmic};
}

void gsid_fit_thin_out(fit_run *r) {
    thin_out_band(r, HUGE_VAL, r->stride);
}

/* Half the width of the basin of the least cost [s]. */
double gsid_fit_delay_step(const fit_run *r) {
    return 1 / (8 * gsid_fit_highest_frequency(r->data));
}

static uint32_t n_scan_steps(const fit_run *r) {
    return (uint32_t)ceil(r->delay_limit_s / gsid_fit_delay_step(r));
}

void gsid_fit_forget(uint32_t n, fit_candidate *kept) {
    for (uint32_t i = 0; i < n; i++) {
        kept[i].cost = HUGE_VAL;
    }
}

/* The best linear fits to the thinned lines at delays from 0 to the limit. */
static gsid_status scan_delays(fit_run *r, uint32_t n_steps, uint32_t n_kept, fit_candidate *kept) {
    gsid_status last = GSID_E_SINGULAR;
    fit_candidate c;
    gsid_fit_forget(n_kept, kept);
    for (uint32_t i = 0; i <= n_steps; i++) {
        const gsid_status status = linear_fit(r, &r->thin, r->delay_limit_s * i / n_steps, SCAN_REWEIGHTINGS, &c);
        last = status < 0 ? status : last;
        gsid_fit_keep_best(&c, n_kept, kept);
    }
    return last;
}

/* Delays found in the lines up to a share of the highest frequency, by a scan and Gauss-Newton; failures cost HUGE_VAL. */
static void scan_low_band(fit_run *r, uint32_t share, uint32_t finer, fit_candidate *kept) {
    const double f_most_hz = gsid_fit_highest_frequency(r->data) / share;
    const uint32_t n_parameters = gsid_fit_n_parameters(&r->cfg);
    gsid_fit_forget(LOW_STARTS, kept);
    thin_out_band(r, f_most_hz, 1);
    const uint32_t stride = r->thin.n_lines / (SCAN_LINES_PER_PARAMETER * n_parameters);
    if (stride > 1) {
        thin_out_band(r, f_most_hz, stride);
    }
    if (r->thin.n_lines < n_parameters) {
        return;
    }
    scan_delays(r, finer * (n_scan_steps(r) + share - 1) / share, LOW_STARTS, kept);
    const gsid_ml_cfg ml = {.n_iterations = LOW_ITERATIONS, .free_delay = 1};
    for (uint32_t i = 0; i < LOW_STARTS && kept[i].cost < HUGE_VAL; i++) {
        if (gsid_estimate_ml(&r->thin, &ml, &kept[i].model, &kept[i].cost, r->mem, r->mem_size) < 0) {
            kept[i].cost = HUGE_VAL;
        }
    }
}

/* The best linear fits to all lines, at the best delays of a scan and at those found in the low lines. Where the noise is
 * small against |g| at every line, the basin over the delay is far narrower than a step of the scan: the phase error of the
 * many high lines outweighs the few lines that show the poles. Their share is larger in the low lines, and the delay found
 * there is exact enough for all. Fails only when every fit does. */
static gsid_status scan(fit_run *r, uint32_t n_kept, fit_candidate *kept) {
    fit_candidate found[STARTS_MAX + LOW_BANDS_MAX * LOW_STARTS], c;
    const int has_few = gsid_fit_n_parameters(&r->cfg) <= LOW_FINE_PARAMETERS;
    const uint32_t ratio = has_few ? 2 : 8, finer = has_few ? LOW_STEPS : 1;
    gsid_fit_thin_out(r);
    gsid_status last = scan_delays(r, n_scan_steps(r), n_kept, found);
    uint32_t n = n_kept;
    for (uint32_t share = ratio; share <= LOW_SHARE_MAX; share *= ratio, n += LOW_STARTS) {
        scan_low_band(r, share, finer, found + n);
    }
    gsid_fit_forget(n_kept, kept);
    for (uint32_t i = 0; i < n; i++) {
        if (!(found[i].cost < HUGE_VAL)) {
            continue;
        }
        const gsid_status status = linear_fit(r, &r->work, found[i].model.delay_s, SCAN_REWEIGHTINGS, &c);
        last = status < 0 ? status : last;
        gsid_fit_keep_best(&c, n_kept, kept);
    }
    return kept[0].cost < HUGE_VAL ? GSID_OK : last;
}

/* Starts of the nonlinear methods, best first: those of the scan when the delay is free. */
gsid_status gsid_fit_starts(fit_run *r, uint32_t n_kept, fit_candidate *kept) {
    if (r->cfg.delay == GSID_DELAY_FREE) {
        return scan(r, n_kept, kept);
    }
    gsid_fit_forget(n_kept, kept);
    return linear_fit(r, &r->work, r->cfg.delay == GSID_DELAY_FIXED ? r->cfg.delay_s : 0, REWEIGHTINGS, kept);
}

/* The search of a linear method for its delay, between bounds. */
typedef struct {
    fit_run *r;
    double lower_s, upper_s, unit; /* unit: cost of the start, so that the search sees numbers about 1 */
    const gsid_rational *near;     /* start of the search for fixed points; NULL: a few reweightings suffice */
    fit_candidate best;
    gsid_status how; /* of best */
} delay_search;

static double cost_at_delay(delay_search *s, double delay_s) {
    fit_candidate c;
    const gsid_rational *near = s->best.cost < HUGE_VAL ? &s->best.model : s->near;
    const gsid_status how = s->near != NULL ? settled_fit(s->r, delay_s, near, &c)
                                            : linear_fit(s->r, &s->r->work, delay_s, SCAN_REWEIGHTINGS, &c);
    if (how >= 0 && c.cost < s->best.cost) {
        s->best = c;
        s->how = how;
    }
    return how < 0 ? HUGE_VAL : c.cost;
}

#ifdef GSID_WITH_NLOPT

#define EVALUATIONS_MAX 100
#define NO_FIT 1e6 /* times the cost of the start, where there is no fit: a finite number for the search */

static double objective(unsigned n, const double *share, double *gradient, void *user) {
    delay_search *s = user;
    (void)n;
    (void)gradient;
    const double cost = cost_at_delay(s, s->lower_s + *share * (s->upper_s - s->lower_s));
    return cost < HUGE_VAL ? cost / s->unit : NO_FIT;
}

static gsid_status search_delay(delay_search *s, double start_s, double tolerance) {
    double share = (start_s - s->lower_s) / (s->upper_s - s->lower_s), least;
    const gsid_status status = gsid_nlopt_minimise_scalar(objective, s, tolerance, EVALUATIONS_MAX, &share, &least);
    return status < 0 ? status : status == GSID_MAX_ITER ? GSID_MAX_ITER : s->how;
}

#else

/* The grid alone: the delay is known to a step of it, and has not settled. */
static gsid_status search_delay(delay_search *s, double start_s, double tolerance) {
    (void)s;
    (void)start_s;
    (void)tolerance;
    return GSID_MAX_ITER;
}

#endif

/* The delay of least output error beside that of a start; to_the_end: of fits that have settled. */
static gsid_status search_beside(fit_run *r, const fit_candidate *start, double step_s, int to_the_end,
                                 fit_candidate *found) {
    const double least_s = r->cfg.bound_delay ? r->cfg.delay_min_s : -HUGE_VAL;
    delay_search s = {.r = r,
                      .lower_s = fmax(start->model.delay_s - step_s, least_s),
                      .upper_s = start->model.delay_s + step_s,
                      .near = to_the_end ? &start->model : NULL,
                      .best.cost = HUGE_VAL,
                      .how = GSID_E_SINGULAR};
    if (!(s.lower_s < s.upper_s)) {
        return GSID_E_UNSTABLE;
    }
    const double start_s = fmax(start->model.delay_s, s.lower_s);
    const double cost = cost_at_delay(&s, start_s);
    gsid_status status = s.how;
    s.unit = cost > 0 ? cost : 1;
    if (cost < HUGE_VAL && status != GSID_MAX_ITER) { /* without a fixed point there is nothing to search for */
        status = search_delay(&s, start_s, to_the_end ? 1e-6 : 1e-3);
    }
    *found = s.best;
    return status;
}

/* The minima of the cost over the delay, best first, by linear fits to a few lines. */
static gsid_status scan_minima(fit_run *r, uint32_t n_steps, uint32_t n_kept, fit_candidate *kept) {
    gsid_status last = GSID_E_SINGULAR;
    fit_candidate c[3]; /* at the delay before the last, at the last, and at this one */
    gsid_fit_thin_out(r);
    gsid_fit_forget(n_kept, kept);
    gsid_fit_forget(3, c);
    for (uint32_t i = 0; i <= n_steps + 1; i++) {
        c[0] = c[1];
        c[1] = c[2];
        c[2].cost = HUGE_VAL;
        const gsid_status status =
            i > n_steps ? GSID_OK : linear_fit(r, &r->thin, r->delay_limit_s * i / n_steps, SCAN_REWEIGHTINGS, &c[2]);
        last = status < 0 ? status : last;
        if (c[1].cost <= c[0].cost && c[1].cost <= c[2].cost) {
            gsid_fit_keep_best(&c[1], n_kept, kept);
        }
    }
    return kept[0].cost < HUGE_VAL ? GSID_OK : last;
}

/* The step of the scan of a linear method. */
static double linear_step(const fit_run *r) {
    return r->delay_limit_s / n_scan_steps(r) / (r->cfg.method == GSID_METHOD_LS ? LS_STEPS : 1);
}

gsid_status gsid_fit_linear_again(fit_run *r, fit_candidate *best) {
    const fit_candidate start = *best;
    const gsid_status status = r->cfg.delay == GSID_DELAY_FREE
                                   ? search_beside(r, &start, linear_step(r) / 4, 1, best)
                                   : settled_fit(r, start.model.delay_s, &start.model, best);
    return status == GSID_RANK ? GSID_OK : status; /* gsid_fit_answer refuses what the data do not determine */
}

/* The admissible fit of least output error beside the minima of the scan: linear methods have no delay of their own. */
static gsid_status scan_linear(fit_run *r, fit_candidate *best) {
    fit_candidate minima[SEARCHES], unstable = {.cost = HUGE_VAL}, c;
    const double step_s = linear_step(r);
    gsid_status status = scan_minima(r, (uint32_t)lround(r->delay_limit_s / step_s), SEARCHES, minima);
    if (status != GSID_OK) {
        return status;
    }
    best->cost = HUGE_VAL;
    for (uint32_t i = 0; i < SEARCHES && minima[i].cost < HUGE_VAL; i++) {
        status = search_beside(r, &minima[i], step_s, 0, &c);
        if (status >= 0) {
            gsid_fit_keep_best(&c, 1, gsid_fit_is_admissible(r, &c.model) ? best : &unstable);
        }
    }
    if (!(best->cost < HUGE_VAL)) { /* no fit is admissible: gsid_fit_run refuses it */
        *best = unstable;
    }
    return best->cost < HUGE_VAL ? gsid_fit_linear_again(r, best) : status;
}

/* LS and IWLS. */
gsid_status gsid_fit_linear(fit_run *r, fit_candidate *best) {
    if (r->cfg.delay == GSID_DELAY_FREE) {
        return scan_linear(r, best);
    }
    const double delay_s = r->cfg.delay == GSID_DELAY_FIXED ? r->cfg.delay_s : 0;
    const gsid_status status = settled_fit(r, delay_s, NULL, best);
    return status == GSID_RANK ? GSID_OK : status;
}
