#include "gsid/host/fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/complex_math.h"
#include "fit_stable.h"

#define DELAY_MAX_S 0.012
#define DELAYS_MAX 4096
#define SCAN_LINES_PER_PARAMETER 8
#define SCAN_REWEIGHTINGS 8
#define REWEIGHTINGS 30
#define REFINED_STARTS 5
#define ITERATIONS 100
#define ITERATIONS_FIRST 15
#define HOPELESS 2 /* times the least cost so far: a start still above it after the first iterations is given up */
#define HOLD_ROUNDS_MAX 12
#define HOLD_SETTLED 0.005 /* of V, or of V per line where that is less: as in gsid_estimate_ml */

/* What one run works on. `work` is the data as the estimators see them: without the hold, with the method's weights. */
typedef struct {
    const gsid_frd *data;
    gsid_fit_cfg cfg;
    gsid_frd work;
    gsid_cplx *g; /* [n_lines] the response freed of the hold */
    gsid_cplx *hold; /* [n_lines] response of the hold itself; 1 without hold */
    gsid_cplx *moved; /* [n_lines] for images of a model next to it */
    gsid_cplx *images; /* [n_lines] what sampling folds back of a held input, by the last model */
    gsid_cplx *drift; /* [n_lines][n_slopes] of g by the parameters, through the images */
    int follow_images; /* 1: Gauss-Newton takes its model's own images off */
    double *sigma; /* [n_lines] of g, by the method: measured, or 1 */
    gsid_frd thin; /* every few of the lines of work, for the scan of delays */
    double *thin_f, *thin_sigma; /* [n_lines] at most */
    gsid_cplx *thin_g; /* [n_lines] at most */
    uint32_t stride; /* from one line of thin to the next */
    double delay_limit_s;
    void *mem;
    size_t mem_size;
} run;

typedef struct {
    gsid_rational model;
    double cost;
} candidate;

static void run_free(run *r) {
    free(r->g);
    free(r->hold);
    free(r->images);
    free(r->moved);
    free(r->drift);
    free(r->sigma);
    free(r->thin_f);
    free(r->thin_sigma);
    free(r->thin_g);
    free(r->mem);
}

static double highest_frequency(const gsid_frd *data) {
    double f = 0;
    for (uint32_t k = 0; k < data->n_lines; k++)
        f = fmax(f, fabs(data->f_hz[k]));
    return f;
}

static uint32_t n_parameters(const gsid_fit_cfg *cfg) {
    return cfg->n_poles + cfg->n_zeros + 1 + (cfg->delay == GSID_DELAY_FREE ? 1u : 0u);
}

/* Parameters as gsid_rational_gradient counts them: the delay is always one. */
static uint32_t n_slopes(const gsid_fit_cfg *cfg) {
    return cfg->n_poles + cfg->n_zeros + 2;
}

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

static gsid_status check(const gsid_frd *data, const gsid_fit_cfg *cfg) {
    if (data == NULL || cfg == NULL || data->f_hz == NULL || data->g == NULL || data->sigma == NULL)
        return GSID_E_NULL;
    for (uint32_t k = 0; k < data->n_lines; k++) {
        if (!isfinite(data->f_hz[k]) || !isfinite(data->g[k].re) || !isfinite(data->g[k].im) ||
            !isfinite(data->sigma[k]))
            return GSID_E_NONFINITE;
        if (!(data->sigma[k] > 0))
            return GSID_E_CONFIG;
    }
    const int needs_sample = cfg->hold || cfg->domain == GSID_DOMAIN_Z;
    const double f_max = highest_frequency(data);
    if (cfg->n_poles > GSID_ORDER_MAX || cfg->n_zeros > GSID_ORDER_MAX || !(f_max > 0) ||
        (unsigned)cfg->domain > GSID_DOMAIN_Z || (unsigned)cfg->method > GSID_METHOD_ML ||
        (unsigned)cfg->delay > GSID_DELAY_FREE || !isfinite(cfg->delay_s))
        return GSID_E_CONFIG;
    if (!(cfg->delay_max_s >= 0 && cfg->delay_max_s <= DELAYS_MAX / (8 * f_max)))
        return GSID_E_CONFIG;
    if (needs_sample && !(cfg->sample_s > 0 && f_max * cfg->sample_s < 0.5))
        return GSID_E_CONFIG;
    if (cfg->hold && (cfg->domain == GSID_DOMAIN_Z || cfg->n_zeros > cfg->n_poles))
        return GSID_E_CONFIG;
    return 2 * data->n_lines < n_parameters(cfg) ? GSID_E_TOO_FEW : GSID_OK;
}

/* g and sigma freed of the hold: (measured - images) / hold.  Eq: MOD-2 */
static void free_of_hold(run *r) {
    for (uint32_t k = 0; k < r->data->n_lines; k++) {
        r->g[k] = gsid_cplx_div(gsid_cplx_sub(r->data->g[k], r->images[k]), r->hold[k]);
        const int measured = r->cfg.method == GSID_METHOD_ML;
        r->sigma[k] = measured ? r->data->sigma[k] / sqrt(gsid_cplx_abs2(r->hold[k])) : 1;
    }
}

/* (1 - exp(-j w T)) / (j w T), the response of the zero-order hold. */
static gsid_cplx hold_response(double w_rad_s, double sample_s) {
    const double x = w_rad_s * sample_s / 2;
    return gsid_cplx_scale(x == 0 ? 1 : sin(x) / x, gsid_cplx_cis(-x));
}

/* What sampling folds back of a held input: the held response less hold times G. */
static gsid_status images_of(const run *r, const gsid_rational *model, gsid_cplx *images) {
    const uint32_t n = r->data->n_lines;
    gsid_status status = gsid_hold_response(model, r->cfg.sample_s, n, r->data->f_hz, images);
    for (uint32_t k = 0; k < n && status == GSID_OK; k++) {
        gsid_cplx g;
        status = gsid_rational_eval(model, 1, &r->data->f_hz[k], &g);
        images[k] = gsid_cplx_sub(images[k], gsid_cplx_mul(r->hold[k], g));
    }
    return status;
}

static double *parameter(gsid_rational *model, uint32_t i) {
    if (i < model->n_poles)
        return &model->den[i < gsid_rational_held(model) ? i : i + 1];
    i -= model->n_poles;
    return i <= model->n_zeros ? &model->num[i] : &model->delay_s;
}

/* Steps of the parameters that change the response by a millionth of its size: small for the model, large for rounding. */
static gsid_status difference_steps(const run *r, const gsid_rational *model, double *step) {
    const uint32_t n = n_slopes(&r->cfg);
    double size = 0, by_parameter[GSID_RATIONAL_PARAMETERS_MAX] = {0};
    for (uint32_t k = 0; k < r->data->n_lines; k++) {
        gsid_cplx g, slope[GSID_RATIONAL_PARAMETERS_MAX];
        const gsid_status status = gsid_rational_gradient(model, r->data->f_hz[k], &g, slope);
        if (status != GSID_OK)
            return status;
        size += gsid_cplx_abs2(g);
        for (uint32_t i = 0; i < n; i++)
            by_parameter[i] += gsid_cplx_abs2(slope[i]);
    }
    for (uint32_t i = 0; i < n; i++)
        step[i] = by_parameter[i] > 0 ? 1e-6 * sqrt(size / by_parameter[i]) : 0;
    return GSID_OK;
}

/* How the images change with the parameters, by differences. */
static gsid_status set_drift(run *r, const gsid_rational *model) {
    const uint32_t n = r->data->n_lines, stride = n_slopes(&r->cfg);
    double step[GSID_RATIONAL_PARAMETERS_MAX];
    gsid_status status = difference_steps(r, model, step);
    for (uint32_t i = 0; i < stride && status == GSID_OK; i++) {
        gsid_rational near = *model;
        *parameter(&near, i) += step[i];
        status = images_of(r, &near, r->moved);
        for (uint32_t k = 0; k < n && status == GSID_OK; k++) {
            const gsid_cplx change = gsid_cplx_div(gsid_cplx_sub(r->images[k], r->moved[k]), r->hold[k]);
            r->drift[k * stride + i] = gsid_cplx_scale(step[i] > 0 ? 1 / step[i] : 0, change);
        }
    }
    return status;
}

/* Take the images of a model off the data; a gsid_ml_cfg's update. */
static gsid_status take_images(void *user, const gsid_rational *model, int with_drift) {
    run *r = user;
    gsid_status status = images_of(r, model, r->images);
    free_of_hold(r);
    if (status == GSID_OK && with_drift)
        status = set_drift(r, model);
    return status;
}

/* The range of delays, and how many lines the scan looks at. Lines a distance apart tell delays apart up to one over the
 * distance: the default range ends there, and the lines of the scan are near enough for twice the range. */
static void plan_scan(run *r) {
    const double f_max = highest_frequency(r->data);
    memcpy(r->thin_f, r->data->f_hz, r->data->n_lines * sizeof *r->thin_f);
    const double spacing = line_spacing(r->data->n_lines, r->thin_f);
    r->delay_limit_s = r->cfg.delay_max_s;
    if (!(r->delay_limit_s > 0))
        r->delay_limit_s = fmin(fmin(DELAY_MAX_S, 1 / spacing), DELAYS_MAX / (8 * f_max));
    const double by_count = r->data->n_lines / (SCAN_LINES_PER_PARAMETER * (double)n_parameters(&r->cfg));
    const double by_delay = 1 / (2 * r->delay_limit_s * spacing);
    r->stride = (uint32_t)fmax(1, fmin(by_count, by_delay));
}

static gsid_status run_init(run *r, const gsid_frd *data, const gsid_fit_cfg *cfg) {
    r->data = data;
    r->cfg = *cfg;
    r->mem_size = gsid_estimate_mem_size(cfg->n_poles, cfg->n_zeros);
    r->g = malloc(data->n_lines * sizeof *r->g);
    r->hold = malloc(data->n_lines * sizeof *r->hold);
    r->images = calloc(data->n_lines, sizeof *r->images);
    r->moved = malloc(data->n_lines * sizeof *r->moved);
    r->drift = calloc((size_t)data->n_lines * n_slopes(cfg), sizeof *r->drift);
    r->sigma = malloc(data->n_lines * sizeof *r->sigma);
    r->thin_f = malloc(data->n_lines * sizeof *r->thin_f);
    r->thin_sigma = malloc(data->n_lines * sizeof *r->thin_sigma);
    r->thin_g = malloc(data->n_lines * sizeof *r->thin_g);
    r->mem = malloc(r->mem_size);
    if (r->g == NULL || r->hold == NULL || r->images == NULL || r->moved == NULL || r->drift == NULL ||
        r->sigma == NULL || r->thin_f == NULL || r->thin_sigma == NULL || r->thin_g == NULL || r->mem == NULL)
        return GSID_E_NO_MEMORY;
    for (uint32_t k = 0; k < data->n_lines; k++)
        r->hold[k] = cfg->hold ? hold_response(GSID_TWO_PI * data->f_hz[k], cfg->sample_s) : gsid_cplx_make(1, 0);
    free_of_hold(r);
    r->work.n_lines = data->n_lines;
    r->work.f_hz = data->f_hz;
    r->work.g = r->g;
    r->work.sigma = r->sigma;
    plan_scan(r);
    return GSID_OK;
}

/* One linear fit to the lines given; a failure costs HUGE_VAL. */
static gsid_status linear_fit(run *r, const gsid_frd *lines, double delay_s, uint32_t n_reweightings, candidate *c) {
    const gsid_iwls_cfg iwls = {.n_iterations = r->cfg.method == GSID_METHOD_LS ? 0 : n_reweightings};
    const double rate = r->cfg.domain == GSID_DOMAIN_S ? GSID_TWO_PI * highest_frequency(r->data) : r->cfg.sample_s;
    c->cost = HUGE_VAL;
    gsid_status status = gsid_rational_init(&c->model, r->cfg.domain, r->cfg.n_poles, r->cfg.n_zeros, rate);
    c->model.delay_s = delay_s;
    if (status == GSID_OK)
        status = gsid_estimate_iwls(lines, &iwls, &c->model, &c->cost, r->mem, r->mem_size);
    return status;
}

static gsid_status gauss_newton(run *r, uint32_t n_iterations, candidate *c) {
    const gsid_ml_cfg ml = {.n_iterations = n_iterations,
                            .free_delay = r->cfg.delay == GSID_DELAY_FREE,
                            .update = r->follow_images ? take_images : NULL,
                            .user = r,
                            .drift = r->follow_images ? r->drift : NULL};
    const gsid_status status = gsid_estimate_ml(&r->work, &ml, &c->model, &c->cost, r->mem, r->mem_size);
    return status >= 0 && r->follow_images && take_images(r, &c->model, 0) < 0 ? GSID_E_NONFINITE : status;
}

static int is_stable(const gsid_rational *model) {
    int stable = 0;
    return gsid_rational_is_stable(model, &stable) == GSID_OK && stable;
}

static void keep_best(const candidate *c, uint32_t n_kept, candidate *kept) {
    if (!(c->cost < kept[n_kept - 1].cost))
        return;
    uint32_t i = n_kept - 1;
    for (; i > 0 && c->cost < kept[i - 1].cost; i--)
        kept[i] = kept[i - 1];
    kept[i] = *c;
}

static void thin_out(run *r) {
    uint32_t n = 0;
    for (uint32_t k = 0; k < r->work.n_lines; k += r->stride, n++) {
        r->thin_f[n] = r->work.f_hz[k];
        r->thin_g[n] = r->work.g[k];
        r->thin_sigma[n] = r->work.sigma[k];
    }
    r->thin = (gsid_frd){.n_lines = n, .f_hz = r->thin_f, .g = r->thin_g, .sigma = r->thin_sigma};
}

/* Steps of at most 1/(8 f_max), half the width of the basin of the least cost. */
static uint32_t n_scan_steps(const run *r) {
    return (uint32_t)ceil(r->delay_limit_s * 8 * highest_frequency(r->data));
}

static void forget(uint32_t n, candidate *kept) {
    for (uint32_t i = 0; i < n; i++)
        kept[i].cost = HUGE_VAL;
}

/* The best linear fits at delays from 0 to the limit: to a few lines at every delay, then to all lines at the best ones. Fails
 * only when every one does. */
static gsid_status scan(run *r, uint32_t n_kept, candidate *kept) {
    gsid_status last = GSID_E_SINGULAR, status;
    candidate coarse[REFINED_STARTS], c;
    thin_out(r);
    forget(n_kept, coarse);
    const uint32_t n_steps = n_scan_steps(r);
    for (uint32_t i = 0; i <= n_steps; i++) {
        status = linear_fit(r, &r->thin, r->delay_limit_s * i / n_steps, SCAN_REWEIGHTINGS, &c);
        last = status < 0 ? status : last;
        keep_best(&c, n_kept, coarse);
    }
    forget(n_kept, kept);
    for (uint32_t i = 0; i < n_kept && coarse[i].cost < HUGE_VAL; i++) {
        status = linear_fit(r, &r->work, coarse[i].model.delay_s, SCAN_REWEIGHTINGS, &c);
        last = status < 0 ? status : last;
        keep_best(&c, n_kept, kept);
    }
    return kept[0].cost < HUGE_VAL ? GSID_OK : last;
}

/* Where to start from, best first: the scan when the delay is free. */
static gsid_status find_starts(run *r, uint32_t n_kept, candidate *kept) {
    if (r->cfg.delay == GSID_DELAY_FREE)
        return scan(r, n_kept, kept);
    forget(n_kept, kept);
    return linear_fit(r, &r->work, r->cfg.delay == GSID_DELAY_FIXED ? r->cfg.delay_s : 0, REWEIGHTINGS, kept);
}

/* LS and IWLS have no delay of their own: the delay of least output error, by golden section around the scan's best. */
static gsid_status linear_with_best_delay(run *r, candidate *best) {
    const gsid_status status = find_starts(r, 1, best);
    if (status < 0 || r->cfg.delay != GSID_DELAY_FREE)
        return status < 0 ? status : GSID_OK;
    const double step_s = r->delay_limit_s / n_scan_steps(r);
    const double golden = 0.3819660112501051;
    double lo = fmax(best->model.delay_s - step_s, 0), hi = best->model.delay_s + step_s;
    candidate a, b;
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
    keep_best(&a, 1, best);
    keep_best(&b, 1, best);
    return GSID_OK;
}

/* The least cost near a start: among stable models, unless unstable ones are allowed or it cannot beat the best. */
static gsid_status refine(run *r, double best_cost, candidate *c) {
    gsid_status status = gauss_newton(r, ITERATIONS_FIRST, c);
    if (status == GSID_MAX_ITER && c->cost < HOPELESS * best_cost)
        status = gauss_newton(r, ITERATIONS, c);
    if (status < 0 || r->cfg.allow_unstable || is_stable(&c->model) || !(c->cost < best_cost))
        return status;
    const double bound = r->cfg.delay == GSID_DELAY_FREE ? fmax(r->delay_limit_s, c->model.delay_s) : 0;
    status = gsid_fit_stable(&r->work, bound, &c->model, &c->cost);
    return status >= 0 && !is_stable(&c->model) ? GSID_E_UNSTABLE : status;
}

static gsid_status refine_best(run *r, uint32_t n, const candidate *starts, candidate *best) {
    gsid_status best_status = GSID_E_UNSTABLE;
    best->cost = HUGE_VAL;
    for (uint32_t i = 0; i < n && starts[i].cost < HUGE_VAL; i++) {
        candidate c = starts[i];
        const gsid_status status = refine(r, best->cost, &c);
        if (status >= 0 && c.cost < best->cost) {
            *best = c;
            best_status = status;
        } else if (status < 0 && !(best->cost < HUGE_VAL)) {
            best_status = status;
        }
    }
    return best_status;
}

static gsid_status estimate(run *r, candidate *best) {
    if (r->cfg.method == GSID_METHOD_LS || r->cfg.method == GSID_METHOD_IWLS)
        return linear_with_best_delay(r, best);
    candidate starts[REFINED_STARTS];
    const gsid_status status = find_starts(r, REFINED_STARTS, starts);
    return status < 0 ? status : refine_best(r, REFINED_STARTS, starts, best);
}

static gsid_status fit_again(run *r, candidate *c) {
    if (r->cfg.method == GSID_METHOD_LS || r->cfg.method == GSID_METHOD_IWLS)
        return linear_with_best_delay(r, c);
    const candidate start = *c;
    return refine_best(r, 1, &start, c);
}

/* Fit again with the model's images taken off, until V falls no further. V is that of a model with its own images off. `how` is
 * the status of the first fit; returns that of the best, or GSID_MAX_ITER. */
static gsid_status settle_images(run *r, gsid_status how, candidate *best) {
    candidate c = *best;
    gsid_status status = GSID_OK, best_how = how;
    int settled = 0;
    best->cost = HUGE_VAL;
    r->follow_images = 1;
    for (int i = 0; i < HOLD_ROUNDS_MAX && !settled && how >= 0; i++) {
        status = take_images(r, &c.model, 0);
        if (status == GSID_OK)
            status = gsid_estimate_cost(&r->work, &c.model, &c.cost);
        if (status != GSID_OK)
            return status;
        settled = !(c.cost < best->cost - HOLD_SETTLED * fmin(1, c.cost / r->work.n_lines));
        if (c.cost < best->cost) {
            *best = c;
            best_how = how;
        }
        if (!settled)
            how = fit_again(r, &c);
    }
    status = take_images(r, &best->model, 1);
    return status != GSID_OK ? status : settled ? best_how : GSID_MAX_ITER;
}

/* Weight of the output error that a method amounts to: |A| for LS, 1 for IWLS and NLS, 1/sigma for ML. */
static double equivalent_weight(const run *r, const gsid_rational *model, uint32_t k) {
    if (r->cfg.method == GSID_METHOD_LS) {
        const gsid_cplx v = gsid_rational_variable(model, GSID_TWO_PI * r->data->f_hz[k]);
        return sqrt(gsid_cplx_abs2(gsid_cplx_polynomial(model->n_poles, model->den, v)));
    }
    return r->cfg.method == GSID_METHOD_ML ? 1 / r->sigma[k] : 1;
}

/* Rows w dG/dtheta into `rows`, and N = sum w^4 sigma^2 Re(x x^H), x = dG/dtheta, into inner. */
static gsid_status weighted_sums(const run *r, const gsid_rational *model, uint32_t n, gsid_lsq *rows, double *inner) {
    memset(inner, 0, n * n * sizeof *inner);
    for (uint32_t k = 0; k < r->data->n_lines; k++) {
        gsid_cplx g, x[GSID_RATIONAL_PARAMETERS_MAX];
        double re[GSID_RATIONAL_PARAMETERS_MAX], im[GSID_RATIONAL_PARAMETERS_MAX];
        gsid_status status = gsid_rational_gradient(model, r->data->f_hz[k], &g, x);
        for (uint32_t i = 0; i < n; i++)
            x[i] = gsid_cplx_sub(x[i], r->drift[k * n_slopes(&r->cfg) + i]);
        const double w = equivalent_weight(r, model, k);
        const double noise = w * r->data->sigma[k] / sqrt(gsid_cplx_abs2(r->hold[k]));
        for (uint32_t i = 0; i < n && status == GSID_OK; i++) {
            re[i] = w * x[i].re;
            im[i] = w * x[i].im;
            for (uint32_t j = 0; j <= i; j++)
                inner[i * n + j] += noise * noise * (re[i] * re[j] + im[i] * im[j]);
        }
        if (status == GSID_OK)
            status = gsid_lsq_add(rows, re, 0);
        if (status == GSID_OK)
            status = gsid_lsq_add(rows, im, 0);
        if (status != GSID_OK)
            return status;
    }
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = 0; j < i; j++)
            inner[j * n + i] = inner[i * n + j];
    return GSID_OK;
}

/* product <- a b, square. */
static void multiply(uint32_t n, const double *a, const double *b, double *product) {
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = 0; j < n; j++) {
            double sum = 0;
            for (uint32_t k = 0; k < n; k++)
                sum += a[i * n + k] * b[k * n + j];
            product[i * n + j] = sum;
        }
}

/* Covariance of an estimate that minimises sum w^2 |g - G|^2 while the errors of g have variance sigma^2:
 * M^-1 N M^-1 / 2, M = sum w^2 Re(x x^H). For ML it is Fisher's.  Eq: EST-6 */
static gsid_status covariance(run *r, const gsid_rational *model, gsid_fit_result *result) {
    const uint32_t n = result->n_parameters;
    double *memory = malloc(3 * (size_t)n * n * sizeof *memory);
    if (memory == NULL)
        return GSID_E_NO_MEMORY;
    double *inner = memory, *inverse = memory + n * n, *half = memory + 2 * n * n;
    gsid_lsq rows;
    gsid_lsq_init(&rows, n, r->mem, r->mem_size);
    gsid_status status = weighted_sums(r, model, n, &rows, inner);
    if (status == GSID_OK)
        status = gsid_lsq_covariance(&rows, inverse);
    if (status == GSID_OK && r->cfg.method == GSID_METHOD_ML) { /* N = M */
        memcpy(result->cov, inverse, (size_t)n * n * sizeof *inverse);
    } else if (status == GSID_OK) {
        multiply(n, inverse, inner, half);
        multiply(n, half, inverse, result->cov);
    }
    for (uint32_t i = 0; i < n * n; i++)
        result->cov[i] /= 2;
    free(memory);
    return status;
}

/* Roots of num or den in rad/s, or in z. */
static gsid_status roots_of(const gsid_rational *model, uint32_t degree, const double *coef, gsid_cplx *roots,
                            uint32_t *n_roots) {
    double descending[GSID_ORDER_MAX + 1];
    for (uint32_t i = 0; i <= degree; i++)
        descending[i] = coef[degree - i];
    const int in_s = model->domain == GSID_DOMAIN_S;
    const gsid_status status = gsid_poly_roots(degree, in_s ? coef : descending, roots, n_roots);
    for (uint32_t i = 0; status >= 0 && in_s && i < *n_roots; i++)
        roots[i] = gsid_cplx_scale(model->scale_rad_s, roots[i]);
    return status;
}

static double cost_by_measured_variance(const run *r, const gsid_rational *model) {
    double cost = 0;
    for (uint32_t k = 0; k < r->data->n_lines; k++) {
        gsid_cplx g;
        if (gsid_rational_eval(model, 1, &r->data->f_hz[k], &g) != GSID_OK)
            return HUGE_VAL;
        const double hold2 = gsid_cplx_abs2(r->hold[k]), sigma = r->data->sigma[k];
        cost += gsid_cplx_abs2(gsid_cplx_sub(r->g[k], g)) * hold2 / (sigma * sigma);
    }
    return cost;
}

static gsid_status finish(run *r, const candidate *best, gsid_fit_result *result) {
    const gsid_rational *model = &best->model;
    result->model = *model;
    result->cost = best->cost;
    result->cost_ml = cost_by_measured_variance(r, model);
    result->n_parameters = n_parameters(&r->cfg);
    result->is_stable = is_stable(model);
    uint32_t n_poles;
    gsid_status status = roots_of(model, model->n_poles, model->den, result->poles, &n_poles);
    if (status >= 0)
        status = roots_of(model, model->n_zeros, model->num, result->zeros, &result->n_zeros_found);
    return status < 0 ? status : covariance(r, model, result);
}

gsid_status gsid_fit_run(const gsid_frd *data, const gsid_fit_cfg *cfg, gsid_fit_result *result) {
    gsid_status status = check(data, cfg);
    if (status != GSID_OK)
        return status;
    if (result == NULL)
        return GSID_E_NULL;
    run r;
    memset(&r, 0, sizeof r);
    gsid_fit_result *answer = calloc(1, sizeof *answer);
    status = answer == NULL ? GSID_E_NO_MEMORY : run_init(&r, data, cfg);
    candidate best;
    gsid_status how = GSID_OK;
    if (status == GSID_OK)
        status = how = estimate(&r, &best);
    if (status >= 0 && cfg->hold)
        status = how = settle_images(&r, how, &best);
    if (status >= 0)
        status = finish(&r, &best, answer);
    if (status == GSID_OK && !answer->is_stable && !cfg->allow_unstable)
        status = GSID_E_UNSTABLE; /* linear methods only: the others search among stable models */
    if (status == GSID_OK) {
        answer->converged = how == GSID_OK;
        *result = *answer;
    }
    run_free(&r);
    free(answer);
    return status == GSID_OK && how == GSID_MAX_ITER ? GSID_MAX_ITER : status;
}
