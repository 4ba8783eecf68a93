#include "gsid/host/fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/complex_math.h"
#include "../core/equations.h"
#include "fit_run.h"
#include "fit_stable.h"

#define REFINED_STARTS 5
#define ITERATIONS 100
#define ITERATIONS_FIRST 15
#define HOPELESS 2 /* times the least cost so far: a start still above it after the first iterations is given up */
#define HOLD_ROUNDS_MAX 12
#define HOLD_SETTLED 0.005 /* of V, or of V per line where that is less: as in gsid_estimate_ml */
#define FEW_PARAMETERS 8 /* with more, a model is often over-parameterised, and far roots do no harm */
#define BEGUN_MAX 8 /* most restarts of a fit from another delay */
#define FAST_POLE 2 /* over the sample time: beyond, there may be a lower minimum */
#define HOLD_SETTLED_LINEAR 1e-6 /* of the response: linear methods stop at a fixed point, not at the least V */

static void run_free(fit_run *r) {
    free(r->g);
    free(r->hold);
    free(r->images);
    free(r->moved);
    free(r->drift);
    free(r->sigma);
    free(r->cov_yu);
    free(r->thin_f);
    free(r->thin_sigma);
    free(r->thin_g);
    free(r->mem);
}

/* Check the data that a method needs besides the response. */
static gsid_status check_needs(const gsid_frd *data, const gsid_fit_cfg *cfg) {
    if (cfg->method == GSID_METHOD_ML_INPUT_OUTPUT && (data->var_u == NULL || data->cov_yu == NULL)) {
        return GSID_E_NULL;
    }
    if (cfg->method == GSID_METHOD_NLS_OUTPUT) {
        if (cfg->input == NULL) {
            return GSID_E_NULL;
        }
        for (uint32_t k = 0; k < data->n_lines; k++) {
            if (!(cfg->input[k] > 0 && isfinite(cfg->input[k]))) {
                return GSID_E_CONFIG;
            }
        }
    }
    const gsid_rational *start = cfg->start;
    if (start != NULL &&
        (start->domain != cfg->domain || start->n_poles != cfg->n_poles || start->n_zeros != cfg->n_zeros)) {
        return GSID_E_CONFIG;
    }
    return GSID_OK;
}

static gsid_status check_lines(const gsid_frd *data) {
    for (uint32_t k = 0; k < data->n_lines; k++) {
        if (!isfinite(data->f_hz[k]) || !isfinite(data->g[k].re) || !isfinite(data->g[k].im) ||
            !isfinite(data->sigma[k])) {
            return GSID_E_NONFINITE;
        }
        if (!(data->sigma[k] > 0)) {
            return GSID_E_CONFIG;
        }
    }
    return GSID_OK;
}

static gsid_status check(const gsid_frd *data, const gsid_fit_cfg *cfg) {
    if (data == NULL || cfg == NULL || data->f_hz == NULL || data->g == NULL || data->sigma == NULL) {
        return GSID_E_NULL;
    }
    const gsid_status status = check_lines(data);
    if (status != GSID_OK) {
        return status;
    }
    const int needs_sample = cfg->hold || cfg->domain == GSID_DOMAIN_Z;
    const double f_max = gsid_fit_highest_frequency(data);
    if (cfg->n_poles > GSID_ORDER_MAX || cfg->n_zeros > GSID_ORDER_MAX || !(f_max > 0) ||
        (unsigned)cfg->domain > GSID_DOMAIN_Z || (unsigned)cfg->method >= GSID_METHOD_COUNT ||
        (unsigned)cfg->solver > GSID_SOLVER_NLOPT || (unsigned)cfg->delay > GSID_DELAY_FREE ||
        !isfinite(cfg->delay_s) || !isfinite(cfg->delay_min_s) || !(cfg->exponent >= 0) || !isfinite(cfg->exponent) ||
        !(cfg->sigma_dof >= 0) || !isfinite(cfg->sigma_dof)) {
        return GSID_E_CONFIG;
    }
    if (!(cfg->delay_max_s >= 0 && cfg->delay_max_s <= GSID_FIT_DELAYS_MAX / (8 * f_max))) {
        return GSID_E_CONFIG;
    }
    if (needs_sample && !(cfg->sample_s > 0 && f_max * cfg->sample_s < 0.5)) {
        return GSID_E_CONFIG;
    }
    if (cfg->hold && (cfg->domain == GSID_DOMAIN_Z || cfg->n_zeros > cfg->n_poles)) {
        return GSID_E_CONFIG;
    }
    if (2 * data->n_lines < gsid_fit_n_parameters(cfg)) {
        return GSID_E_TOO_FEW;
    }
    return check_needs(data, cfg);
}

static gsid_status run_init(fit_run *r, const gsid_frd *data, const gsid_fit_cfg *cfg) {
    r->data = data;
    r->cfg = *cfg;
    r->mem_size = gsid_estimate_mem_size(cfg->n_poles, cfg->n_zeros);
    r->g = malloc(data->n_lines * sizeof *r->g);
    r->hold = malloc(data->n_lines * sizeof *r->hold);
    r->images = calloc(data->n_lines, sizeof *r->images);
    r->moved = malloc(data->n_lines * sizeof *r->moved);
    r->drift = calloc((size_t)data->n_lines * (cfg->n_poles + cfg->n_zeros + 2), sizeof *r->drift);
    r->sigma = malloc(data->n_lines * sizeof *r->sigma);
    r->cov_yu = malloc(data->n_lines * sizeof *r->cov_yu);
    r->thin_f = malloc(data->n_lines * sizeof *r->thin_f);
    r->thin_sigma = malloc(data->n_lines * sizeof *r->thin_sigma);
    r->thin_g = malloc(data->n_lines * sizeof *r->thin_g);
    r->mem = malloc(r->mem_size);
    if (r->g == NULL || r->hold == NULL || r->images == NULL || r->moved == NULL || r->drift == NULL ||
        r->sigma == NULL || r->cov_yu == NULL || r->thin_f == NULL || r->thin_sigma == NULL || r->thin_g == NULL ||
        r->mem == NULL) {
        return GSID_E_NO_MEMORY;
    }
    for (uint32_t k = 0; k < data->n_lines; k++) {
        r->hold[k] = gsid_cplx_make(1, 0);
    }
    if (cfg->hold) {
        gsid_hold_factor(cfg->sample_s, data->n_lines, data->f_hz, r->hold);
    }
    r->work.n_lines = data->n_lines;
    r->work.f_hz = data->f_hz;
    r->work.g = r->g;
    r->work.sigma = r->sigma;
    r->work.logarithmic = cfg->method == GSID_METHOD_LOG;
    if (cfg->method == GSID_METHOD_ML_INPUT_OUTPUT) {
        r->work.var_u = data->var_u;
        r->work.cov_yu = r->cov_yu;
    }
    gsid_fit_free_of_hold(r);
    gsid_fit_plan_scan(r);
    return GSID_OK;
}

/* The model given as the start, with the run's scale. */
static gsid_status take_start(fit_run *r, fit_candidate *c) {
    const gsid_rational *start = r->cfg.start;
    const double rate = gsid_fit_rate(r);
    gsid_status status = gsid_rational_init(&c->model, r->cfg.domain, r->cfg.n_poles, r->cfg.n_zeros, rate);
    if (status != GSID_OK) {
        return status;
    }
    const double ratio = r->cfg.domain == GSID_DOMAIN_S ? rate / start->scale_rad_s : 1;
    const uint32_t held = gsid_rational_held(start);
    const double top = start->den[held] * pow(ratio, held);
    for (uint32_t i = 0; i <= start->n_poles; i++) {
        c->model.den[i] = start->den[i] * pow(ratio, i) / top;
    }
    for (uint32_t i = 0; i <= start->n_zeros; i++) {
        c->model.num[i] = start->num[i] * pow(ratio, i) / top;
    }
    c->model.delay_s = r->cfg.delay == GSID_DELAY_FIXED ? r->cfg.delay_s : start->delay_s;
    if (r->cfg.hold) { /* without its images a model whose poles are as fast as the hold is no minimum */
        r->follow_images = 1;
        status = gsid_fit_take_images(r, &c->model, 0);
    }
    return status != GSID_OK ? status : gsid_estimate_cost(&r->work, &c->model, &c->cost);
}

static gsid_status gauss_newton(fit_run *r, uint32_t n_iterations, fit_candidate *c) {
    const gsid_ml_cfg ml = {.n_iterations = n_iterations,
                            .free_delay = r->cfg.delay == GSID_DELAY_FREE,
                            .update = r->follow_images ? gsid_fit_take_images : NULL,
                            .user = r,
                            .drift = r->follow_images ? r->drift : NULL};
    const gsid_status status = gsid_estimate_ml(&r->work, &ml, &c->model, &c->cost, r->mem, r->mem_size);
    return status >= 0 && r->follow_images && gsid_fit_take_images(r, &c->model, 0) < 0 ? GSID_E_NONFINITE : status;
}

/* The least cost near a start among admissible models, by NLopt. */
static gsid_status search_bounded(const fit_run *r, fit_candidate *c) {
    const gsid_fit_bounds bounds = {.free_delay = r->cfg.delay == GSID_DELAY_FREE,
                                    .delay_min_s = r->cfg.bound_delay ? r->cfg.delay_min_s : fmin(0, c->model.delay_s),
                                    .delay_max_s = fmax(r->delay_limit_s, c->model.delay_s),
                                    .unstable = r->cfg.allow_unstable,
                                    .delay_step_s = gsid_fit_delay_step(r),
                                    .stride = r->stride};
    const gsid_status status = gsid_fit_stable(&r->work, &bounds, &c->model, &c->cost);
    return status >= 0 && !gsid_fit_is_admissible(r, &c->model) ? GSID_E_UNSTABLE : status;
}

/* The least cost near a start, among admissible models unless it cannot beat the best. */
static gsid_status refine(fit_run *r, double best_cost, fit_candidate *c) {
    if (r->cfg.solver == GSID_SOLVER_NLOPT) {
        return search_bounded(r, c);
    }
    gsid_status status = gauss_newton(r, ITERATIONS_FIRST, c);
    if (status == GSID_MAX_ITER && c->cost < HOPELESS * best_cost) {
        status = gauss_newton(r, ITERATIONS, c);
    }
    if (status < 0 || gsid_fit_is_admissible(r, &c->model) || !(c->cost < best_cost)) {
        return status;
    }
    return search_bounded(r, c);
}

static gsid_status refine_best(fit_run *r, uint32_t n, const fit_candidate *starts, fit_candidate *best) {
    gsid_status best_status = GSID_E_UNSTABLE;
    best->cost = HUGE_VAL;
    for (uint32_t i = 0; i < n && starts[i].cost < HUGE_VAL; i++) {
        fit_candidate c = starts[i];
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

static gsid_status estimate(fit_run *r, fit_candidate *best) {
    fit_candidate starts[REFINED_STARTS];
    if (gsid_fit_is_linear(r)) {
        return gsid_fit_linear(r, best);
    }
    gsid_status status;
    const uint32_t n_starts = r->cfg.start != NULL ? 1 : REFINED_STARTS;
    if (r->cfg.start != NULL) {
        status = take_start(r, starts);
    } else if (r->cfg.method == GSID_METHOD_GA) {
        status = gsid_fit_evolve(r, n_starts, starts);
    } else {
        status = gsid_fit_starts(r, n_starts, starts);
    }
    return status < 0 ? status : refine_best(r, n_starts, starts, best);
}

static gsid_status fit_again(fit_run *r, fit_candidate *c) {
    const fit_candidate start = *c;
    return refine_best(r, 1, &start, c);
}

/* Linear methods: repeat the fit with the images of the model subtracted, until the model no longer changes. */
static gsid_status settle_images_linear(fit_run *r, gsid_status how, fit_candidate *best) {
    int settled = 0;
    for (int i = 0; i < HOLD_ROUNDS_MAX && !settled && how >= 0; i++) {
        const gsid_rational last = best->model;
        gsid_status status = gsid_fit_take_images(r, &last, 0);
        if (status == GSID_OK) {
            status = how = gsid_fit_linear_again(r, best);
        }
        if (status < 0) {
            return status;
        }
        settled = gsid_equations_are_alike(&r->work, &last, &best->model, HOLD_SETTLED_LINEAR);
    }
    gsid_status status = gsid_fit_take_images(r, &best->model, 1);
    if (status == GSID_OK) {
        status = gsid_estimate_cost(&r->work, &best->model, &best->cost);
    }
    return status != GSID_OK ? status : settled ? how : GSID_MAX_ITER;
}

/* Repeat the fit with the images of the model subtracted, until V no longer falls. V is that of a model less
 * its own images. `how` is the status of the first fit; returns that of the best, or GSID_MAX_ITER. */
static gsid_status settle_images(fit_run *r, gsid_status how, fit_candidate *best) {
    fit_candidate c = *best;
    gsid_status status = GSID_OK, best_how = how;
    int settled = 0;
    best->cost = HUGE_VAL;
    r->follow_images = 1;
    for (int i = 0; i < HOLD_ROUNDS_MAX && !settled && how >= 0; i++) {
        status = gsid_fit_take_images(r, &c.model, 0);
        if (status == GSID_OK) {
            status = gsid_estimate_cost(&r->work, &c.model, &c.cost);
        }
        if (status != GSID_OK) {
            return status;
        }
        settled = !(c.cost < best->cost - HOLD_SETTLED * fmin(1, c.cost / r->work.n_lines));
        if (c.cost < best->cost) {
            *best = c;
            best_how = how;
        }
        if (!settled) {
            how = fit_again(r, &c);
        }
    }
    status = gsid_fit_take_images(r, &best->model, 1);
    return status != GSID_OK ? status : settled ? best_how : GSID_MAX_ITER;
}

/* Whether a pole settles well within a sample. */
static int has_fast_pole(const fit_run *r, const gsid_rational *model) {
    gsid_cplx pole[GSID_ORDER_MAX];
    uint32_t n = 0;
    if (gsid_poly_roots(model->n_poles, model->den, pole, &n) < 0) {
        return 0;
    }
    double fastest = 0;
    for (uint32_t i = 0; i < n; i++) {
        fastest = fmax(fastest, gsid_cplx_abs2(pole[i]));
    }
    return sqrt(fastest) * model->scale_rad_s * r->cfg.sample_s > FAST_POLE;
}

/* Restart with the delay fixed, then free it. Keeps the better of this fit and the one before. */
static gsid_status begin_from_delay(fit_run *r, double delay_s, gsid_status how, fit_candidate *best) {
    fit_candidate c;
    r->cfg.delay = GSID_DELAY_FIXED;
    r->cfg.delay_s = delay_s;
    gsid_status status = estimate(r, &c);
    if (status >= 0 && r->cfg.hold) {
        status = settle_images(r, status, &c);
    }
    r->cfg.delay = GSID_DELAY_FREE;
    if (status >= 0) {
        status = r->cfg.hold ? settle_images(r, status, &c) : fit_again(r, &c);
    }
    if (status >= 0 && c.cost < best->cost && gsid_fit_is_admissible(r, &c.model)) {
        *best = c;
        how = status;
    }
    status = r->cfg.hold ? gsid_fit_take_images(r, &best->model, 1) : GSID_OK;
    return status != GSID_OK ? status : how;
}

/* Behind a hold V has another minimum, where a delay replaces a fast pole. Restart with the delay at the sample before, from
 * where the fit finds the pole. */
static gsid_status settle_from_sample(fit_run *r, gsid_status how, fit_candidate *best) {
    const size_t n_drift = (size_t)r->data->n_lines * (r->cfg.n_poles + r->cfg.n_zeros + 2);
    memset(r->images, 0, r->data->n_lines * sizeof *r->images);
    memset(r->drift, 0, n_drift * sizeof *r->drift);
    r->follow_images = 0;
    gsid_fit_free_of_hold(r);
    return begin_from_delay(r, fmax(0, floor(best->model.delay_s / r->cfg.sample_s)) * r->cfg.sample_s, how, best);
}

/* Sum of Re(1/x) over the roots x [rad/s] beyond the highest frequency: their contribution to the slope of the phase at 0. */
static gsid_status slope_of_far_roots(const fit_run *r, uint32_t degree, const double *coef, double scale,
                                      double *slope_s) {
    const double w_max = GSID_TWO_PI * gsid_fit_highest_frequency(r->data);
    gsid_cplx root[GSID_ORDER_MAX];
    uint32_t n = 0;
    const gsid_status status = gsid_poly_roots(degree, coef, root, &n);
    *slope_s = 0;
    for (uint32_t i = 0; i < n; i++) {
        const double size2 = gsid_cplx_abs2(root[i]);
        if (sqrt(size2) * scale > w_max) {
            *slope_s += root[i].re / (size2 * scale);
        }
    }
    return status;
}

/* The delay equivalent to the roots beyond the highest frequency; 0 without such roots. */
static double delay_of_far_roots(const fit_run *r, const gsid_rational *m) {
    double by_zeros, by_poles;
    if (m->domain != GSID_DOMAIN_S || slope_of_far_roots(r, m->n_zeros, m->num, m->scale_rad_s, &by_zeros) < 0 ||
        slope_of_far_roots(r, m->n_poles, m->den, m->scale_rad_s, &by_poles) < 0) {
        return 0;
    }
    return by_zeros - by_poles;
}

/* Whether V, with the measured variance, exceeds that of a correct model by more than a standard deviation. */
static int leaves_more_than_noise(const fit_run *r, const gsid_rational *model) {
    const double n = r->data->n_lines - gsid_fit_n_parameters(&r->cfg) / 2.0, dof = r->cfg.sigma_dof;
    const double mean = dof > 1 ? dof / (dof - 1) : 1, variance = dof > 2 ? dof / (dof - 2) : 1;
    return gsid_fit_cost_by_variance(r, model) > mean * (n + sqrt(n * variance));
}

/* V has local minima in which a pole and a zero far above the lines compensate a wrong delay, while those of the plant are not
 * found. Restart with the delay equivalent to these roots, and with fractions of it if V is more than noise leaves, until V no
 * longer falls. */
static gsid_status settle_far_roots(fit_run *r, gsid_status how, fit_candidate *best) {
    static const double parts[] = {1, 0.9, 0.75};
    const int has_few = gsid_fit_n_parameters(&r->cfg) <= FEW_PARAMETERS;
    uint32_t i = 0;
    for (int n_begun = 0; i < sizeof parts / sizeof *parts && n_begun < BEGUN_MAX && how >= 0; n_begun++) {
        const double last = best->cost, shift_s = delay_of_far_roots(r, &best->model);
        if (shift_s == 0 || ((i > 0 || !has_few) && !leaves_more_than_noise(r, &best->model))) {
            break;
        }
        how = begin_from_delay(r, best->model.delay_s + parts[i] * shift_s, how, best);
        const int is_lower = best->cost < last - HOLD_SETTLED * fmin(1, last / r->work.n_lines);
        i = is_lower ? 0 : i + 1; /* the lower minimum may have such roots too */
    }
    return how;
}

gsid_status gsid_fit_run(const gsid_frd *data, const gsid_fit_cfg *cfg, gsid_fit_result *result) {
    gsid_status status = check(data, cfg);
    if (status != GSID_OK) {
        return status;
    }
    if (result == NULL) {
        return GSID_E_NULL;
    }
    fit_run r;
    memset(&r, 0, sizeof r);
    gsid_fit_result *answer = calloc(1, sizeof *answer);
    status = answer == NULL ? GSID_E_NO_MEMORY : run_init(&r, data, cfg);
    fit_candidate best;
    gsid_status how = GSID_OK;
    if (status == GSID_OK) {
        status = how = estimate(&r, &best);
    }
    if (status >= 0 && cfg->hold) {
        status = how = gsid_fit_is_linear(&r) ? settle_images_linear(&r, how, &best) : settle_images(&r, how, &best);
    }
    const int is_searched = cfg->start == NULL && cfg->method != GSID_METHOD_GA && !gsid_fit_is_linear(&r);
    if (status >= 0 && cfg->hold && cfg->delay == GSID_DELAY_FREE && is_searched && has_fast_pole(&r, &best.model)) {
        status = how = settle_from_sample(&r, how, &best);
    }
    if (status >= 0 && cfg->delay == GSID_DELAY_FREE && is_searched) {
        status = how = settle_far_roots(&r, how, &best);
    }
    if (status >= 0) {
        status = gsid_fit_answer(&r, &best, answer);
    }
    if (status == GSID_OK && !gsid_fit_is_admissible(&r, &answer->model)) {
        status = GSID_E_UNSTABLE; /* linear methods only: the others search among stable models */
    }
    if (status == GSID_OK) {
        answer->converged = how == GSID_OK;
        *result = *answer;
    }
    run_free(&r);
    free(answer);
    return status == GSID_OK && how == GSID_MAX_ITER ? GSID_MAX_ITER : status;
}
