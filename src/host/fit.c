#include "gsid/host/fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/complex_math.h"
#include "fit_stable.h"

#define DELAY_MAX_S 0.012
#define DELAYS_MAX 4096
#define SCAN_REWEIGHTINGS 8
#define REWEIGHTINGS 30
#define REFINED_STARTS 5
#define HOLD_ROUNDS_MAX 12
#define HOLD_SETTLED 0.01 /* images that move by less than this many sigma are settled */

/* What one run works on. `work` is the data as the estimators see them: without the hold, with the method's weights. */
typedef struct {
    const gsid_frd *data;
    gsid_fit_cfg cfg;
    gsid_frd work;
    gsid_cplx *g; /* [n_lines] the response freed of the hold */
    gsid_cplx *hold; /* [n_lines] response of the hold itself; 1 without hold */
    gsid_cplx *images; /* [n_lines] what sampling folds back of a held input, by the current model */
    double *sigma; /* [n_lines] of g, by the method: measured, or 1 */
    void *mem;
    size_t mem_size;
    uint32_t n_evaluations;
} run;

typedef struct {
    gsid_rational model;
    double cost;
} candidate;

static void run_free(run *r) {
    free(r->g);
    free(r->hold);
    free(r->images);
    free(r->sigma);
    free(r->mem);
}

static double highest_frequency(const gsid_frd *data) {
    double f = 0;
    for (uint32_t k = 0; k < data->n_lines; k++)
        f = fmax(f, fabs(data->f_hz[k]));
    return f;
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
        (unsigned)cfg->method > GSID_METHOD_ML || (unsigned)cfg->delay > GSID_DELAY_FREE || !isfinite(cfg->delay_s) ||
        !isfinite(cfg->delay_max_s) || cfg->delay_max_s < 0)
        return GSID_E_CONFIG;
    if (needs_sample && !(cfg->sample_s > 0 && f_max * cfg->sample_s < 0.5))
        return GSID_E_CONFIG;
    if (cfg->hold && (cfg->domain == GSID_DOMAIN_Z || cfg->n_zeros > cfg->n_poles))
        return GSID_E_CONFIG;
    if (2 * data->n_lines < cfg->n_poles + cfg->n_zeros + 2)
        return GSID_E_TOO_FEW;
    return GSID_OK;
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

static gsid_status run_init(run *r, const gsid_frd *data, const gsid_fit_cfg *cfg) {
    r->data = data;
    r->cfg = *cfg;
    r->mem_size = gsid_estimate_mem_size(cfg->n_poles, cfg->n_zeros);
    r->g = malloc(data->n_lines * sizeof *r->g);
    r->hold = malloc(data->n_lines * sizeof *r->hold);
    r->images = calloc(data->n_lines, sizeof *r->images);
    r->sigma = malloc(data->n_lines * sizeof *r->sigma);
    r->mem = malloc(r->mem_size);
    if (r->g == NULL || r->hold == NULL || r->images == NULL || r->sigma == NULL || r->mem == NULL)
        return GSID_E_NO_MEMORY;
    for (uint32_t k = 0; k < data->n_lines; k++)
        r->hold[k] = cfg->hold ? hold_response(GSID_TWO_PI * data->f_hz[k], cfg->sample_s) : gsid_cplx_make(1, 0);
    free_of_hold(r);
    r->work.n_lines = data->n_lines;
    r->work.f_hz = data->f_hz;
    r->work.g = r->g;
    r->work.sigma = r->sigma;
    return GSID_OK;
}

static gsid_status linear_fit(run *r, double delay_s, uint32_t n_reweightings, candidate *c) {
    const gsid_iwls_cfg iwls = {.n_iterations = r->cfg.method == GSID_METHOD_LS ? 0 : n_reweightings};
    const double rate = r->cfg.domain == GSID_DOMAIN_S ? GSID_TWO_PI * highest_frequency(r->data) : r->cfg.sample_s;
    gsid_status status = gsid_rational_init(&c->model, r->cfg.domain, r->cfg.n_poles, r->cfg.n_zeros, rate);
    if (status != GSID_OK)
        return status;
    c->model.delay_s = delay_s;
    r->n_evaluations += iwls.n_iterations + 1;
    return gsid_estimate_iwls(&r->work, &iwls, &c->model, &c->cost, r->mem, r->mem_size);
}

static gsid_status gauss_newton(run *r, uint32_t n_iterations, candidate *c) {
    const gsid_ml_cfg ml = {.n_iterations = n_iterations, .free_delay = r->cfg.delay == GSID_DELAY_FREE};
    r->n_evaluations += n_iterations;
    return gsid_estimate_ml(&r->work, &ml, &c->model, &c->cost, r->mem, r->mem_size);
}

static int is_stable(const gsid_rational *model) {
    int stable = 0;
    return gsid_rational_is_stable(model, &stable) == GSID_OK && stable;
}

static double delay_limit(const run *r) {
    return r->cfg.delay_max_s > 0 ? r->cfg.delay_max_s : DELAY_MAX_S;
}

/* Delays from 0 to the limit in steps of at most 1/(8 f_max), half the width of the basin of the least cost. */
static uint32_t delays_to_scan(const run *r, double *step_s) {
    const double limit = delay_limit(r), widest = 1 / (8 * highest_frequency(r->data));
    const double n = fmin(ceil(limit / widest), DELAYS_MAX - 1);
    *step_s = limit / n;
    return (uint32_t)n + 1;
}

static void keep_best(const candidate *c, uint32_t n_kept, candidate *kept) {
    if (!(c->cost < kept[n_kept - 1].cost))
        return;
    uint32_t i = n_kept - 1;
    for (; i > 0 && c->cost < kept[i - 1].cost; i--)
        kept[i] = kept[i - 1];
    kept[i] = *c;
}

/* The delays of least cost, each a linear fit at that delay; a free delay is scanned. Fails only when every one does. */
static gsid_status scan(run *r, uint32_t n_kept, candidate *kept) {
    for (uint32_t i = 0; i < n_kept; i++)
        kept[i].cost = HUGE_VAL;
    double step_s = 0;
    const double first_s = r->cfg.delay == GSID_DELAY_FIXED ? r->cfg.delay_s : 0;
    const uint32_t n = r->cfg.delay == GSID_DELAY_FREE ? delays_to_scan(r, &step_s) : 1;
    gsid_status last = GSID_E_SINGULAR;
    for (uint32_t i = 0; i < n; i++) {
        candidate c = {.cost = HUGE_VAL};
        const gsid_status status = linear_fit(r, first_s + i * step_s, n == 1 ? REWEIGHTINGS : SCAN_REWEIGHTINGS, &c);
        if (status >= 0)
            keep_best(&c, n_kept, kept);
        else
            last = status;
    }
    return kept[0].cost < HUGE_VAL ? GSID_OK : last;
}

/* LS and IWLS have no delay of their own: the delay of least output error, by golden section around the scan's best. */
static gsid_status linear_with_best_delay(run *r, candidate *best) {
    gsid_status status = scan(r, 1, best);
    if (status != GSID_OK || r->cfg.delay != GSID_DELAY_FREE)
        return status;
    double step_s;
    delays_to_scan(r, &step_s);
    const double golden = 0.3819660112501051;
    double lo = fmax(best->model.delay_s - step_s, 0), hi = best->model.delay_s + step_s;
    candidate a = {.cost = HUGE_VAL}, b = {.cost = HUGE_VAL};
    linear_fit(r, lo + golden * (hi - lo), REWEIGHTINGS, &a);
    linear_fit(r, hi - golden * (hi - lo), REWEIGHTINGS, &b);
    while (hi - lo > 1e-6 * step_s) {
        if (a.cost < b.cost) {
            hi = b.model.delay_s;
            b = a;
            linear_fit(r, lo + golden * (hi - lo), REWEIGHTINGS, &a);
        } else {
            lo = a.model.delay_s;
            a = b;
            linear_fit(r, hi - golden * (hi - lo), REWEIGHTINGS, &b);
        }
    }
    keep_best(&a, 1, best);
    keep_best(&b, 1, best);
    return GSID_OK;
}

/* The least cost among stable models, searched from an unstable or a stable one. */
static gsid_status constrained(run *r, candidate *c) {
    uint32_t n_evaluations = 0;
    const double bound = r->cfg.delay == GSID_DELAY_FREE ? fmax(delay_limit(r), c->model.delay_s) : 0;
    const gsid_status status = gsid_fit_stable(&r->work, bound, &c->model, &c->cost, &n_evaluations);
    r->n_evaluations += n_evaluations;
    return status;
}

/* Refine each start, and where a start ends unstable search on among the stable models. */
static gsid_status refine_best(run *r, uint32_t n, candidate *starts, candidate *best) {
    gsid_status best_status = GSID_E_UNSTABLE;
    best->cost = HUGE_VAL;
    for (uint32_t i = 0; i < n && starts[i].cost < HUGE_VAL; i++) {
        candidate c = starts[i];
        gsid_status status = gauss_newton(r, 100, &c);
        if (status >= 0 && !r->cfg.allow_unstable && c.cost < best->cost && !is_stable(&c.model))
            status = constrained(r, &c);
        if (status == GSID_E_BACKEND || status == GSID_E_NO_MEMORY)
            best_status = best->cost < HUGE_VAL ? best_status : status;
        if (status >= 0 && c.cost < best->cost && (r->cfg.allow_unstable || is_stable(&c.model))) {
            *best = c;
            best_status = status;
        }
    }
    return best_status;
}

static gsid_status estimate(run *r, candidate *best) {
    if (r->cfg.method == GSID_METHOD_LS || r->cfg.method == GSID_METHOD_IWLS)
        return linear_with_best_delay(r, best);
    candidate starts[REFINED_STARTS];
    const gsid_status status = scan(r, REFINED_STARTS, starts);
    return status != GSID_OK ? status : refine_best(r, REFINED_STARTS, starts, best);
}

/* The images of the model, and how far they moved, in sigmas of the data. */
static gsid_status update_images(run *r, const gsid_rational *model, double *moved) {
    const uint32_t n = r->data->n_lines;
    gsid_cplx *held = malloc(n * sizeof *held);
    if (held == NULL)
        return GSID_E_NO_MEMORY;
    gsid_status status = gsid_hold_response(model, r->cfg.sample_s, n, r->data->f_hz, held);
    *moved = 0;
    for (uint32_t k = 0; k < n && status == GSID_OK; k++) {
        gsid_cplx g;
        status = gsid_rational_eval(model, 1, &r->data->f_hz[k], &g);
        const gsid_cplx image = gsid_cplx_sub(held[k], gsid_cplx_mul(r->hold[k], g));
        const gsid_cplx change = gsid_cplx_sub(image, r->images[k]);
        *moved = fmax(*moved, sqrt(gsid_cplx_abs2(change)) / r->data->sigma[k]);
        r->images[k] = image;
    }
    free(held);
    free_of_hold(r);
    return status;
}

/* Fit again with the images of the last model taken off, until they settle: they are small, so few rounds do. */
static gsid_status settle_images(run *r, candidate *best) {
    gsid_status status = GSID_OK;
    double moved = HUGE_VAL;
    for (int i = 0; i < HOLD_ROUNDS_MAX && moved > HOLD_SETTLED && status >= 0; i++) {
        status = update_images(r, &best->model, &moved);
        if (status != GSID_OK || moved <= HOLD_SETTLED)
            break;
        if (r->cfg.method == GSID_METHOD_LS || r->cfg.method == GSID_METHOD_IWLS) {
            status = linear_with_best_delay(r, best);
            continue;
        }
        candidate c = *best;
        status = gsid_estimate_cost(&r->work, &c.model, &c.cost);
        if (status == GSID_OK)
            status = refine_best(r, 1, &c, best);
    }
    return status;
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
    if (r->cfg.method == GSID_METHOD_ML)
        return gsid_estimate_covariance(&r->work, model, r->cfg.delay == GSID_DELAY_FREE, result->cov, r->mem,
                                        r->mem_size);
    double *memory = malloc(3 * (size_t)n * n * sizeof *memory);
    if (memory == NULL)
        return GSID_E_NO_MEMORY;
    double *inner = memory, *inverse = memory + n * n, *half = memory + 2 * n * n;
    gsid_lsq rows;
    gsid_lsq_init(&rows, n, r->mem, r->mem_size);
    gsid_status status = weighted_sums(r, model, n, &rows, inner);
    if (status == GSID_OK)
        status = gsid_lsq_covariance(&rows, inverse);
    if (status == GSID_OK) {
        multiply(n, inverse, inner, half);
        multiply(n, half, inverse, result->cov);
        for (uint32_t i = 0; i < n * n; i++)
            result->cov[i] /= 2;
    }
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
    result->n_parameters = model->n_poles + model->n_zeros + 1 + (r->cfg.delay == GSID_DELAY_FREE ? 1u : 0u);
    result->is_stable = is_stable(model);
    result->n_evaluations = r->n_evaluations;
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
        status = how = settle_images(&r, &best);
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
