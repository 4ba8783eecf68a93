#include "fit_stable.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/residual.h"
#include "backend/backend.h"
#include "fit_run.h"
#include "fit_sections.h"
#include "gsid/host/fit.h"

#ifndef GSID_WITH_NLOPT

gsid_status gsid_fit_stable(const gsid_frd *data, const gsid_fit_bounds *bounds, gsid_rational *model, double *cost) {
    (void)data;
    (void)bounds;
    (void)model;
    (void)cost;
    return GSID_E_BACKEND;
}

#else

#define EVALUATIONS_MAX 3000
#define TOLERANCE 1e-4 /* of V, or of V per line where that is less: a fiftieth of that of Gauss-Newton */
#define FAR 1000 /* times the V of the start: where reflected poles leave more, numerator and delay must follow them */

#define PARAMETERS_MAX (2 * GSID_ORDER_MAX + 2)

typedef struct {
    const gsid_frd *data;
    gsid_rational model; /* domain, orders, scale; num, den and delay are those of the last evaluation */
    const gsid_fit_bounds *bounds;
    gsid_cplx *variable;          /* [n_lines] */
    int free_delay;
    uint32_t n;                   /* n_poles + n_zeros + 1 + free_delay */
    double scale[PARAMETERS_MAX]; /* the search runs over x / scale, whose curvatures are alike */
} search;

/* Sections in x -> coefficients of the denominator.  Eq: EST-4 */
void gsid_fit_sections(const double *x, gsid_rational *model) {
    double den[GSID_ORDER_MAX + 3] = {1};
    for (uint32_t first = 0; first < model->n_poles; first += 2) {
        double c[3];
        gsid_fit_section_coefficients(model->domain, gsid_fit_section_order(model->n_poles, first), x + first, c);
        for (uint32_t i = GSID_ORDER_MAX + 3; i-- > 0;) {
            den[i] = c[0] * den[i] + (i >= 1 ? c[1] * den[i - 1] : 0) + (i >= 2 ? c[2] * den[i - 2] : 0);
        }
    }
    memcpy(model->den, den, sizeof model->den);
}

static void unpack(const search *s, const double *x, gsid_rational *model) {
    gsid_fit_sections(x, model);
    for (uint32_t i = 0; i <= model->n_zeros; i++) {
        model->num[i] = x[model->n_poles + i];
    }
    if (s->free_delay) {
        model->delay_s = x[s->n - 1];
    }
}

/* Error at one line, and the response's derivatives by every parameter. */
static gsid_residual line_derivatives(const search *s, const double *x, uint32_t k, gsid_cplx *by) {
    const gsid_rational *m = &s->model;
    const double w_rad_s = GSID_TWO_PI * s->data->f_hz[k];
    const gsid_cplx v = s->variable[k];
    gsid_cplx by_num = gsid_cplx_cis(-w_rad_s * m->delay_s);
    by_num = gsid_cplx_div(by_num, gsid_cplx_polynomial(m->n_poles, m->den, v));
    const gsid_cplx g = gsid_cplx_mul(by_num, gsid_cplx_polynomial(m->n_zeros, m->num, v));
    for (uint32_t first = 0; first < m->n_poles; first += 2) {
        const uint32_t order = gsid_fit_section_order(m->n_poles, first);
        double c[3];
        gsid_fit_section_coefficients(m->domain, order, x + first, c);
        gsid_fit_section_derivatives(m->domain, order, x + first, v, by + first);
        const gsid_cplx minus_g = gsid_cplx_div(gsid_cplx_scale(-1, g), gsid_cplx_polynomial(order, c, v));
        for (uint32_t i = 0; i < order; i++) {
            by[first + i] = gsid_cplx_mul(minus_g, by[first + i]);
        }
    }
    gsid_cplx power = by_num;
    for (uint32_t i = 0; i <= m->n_zeros; i++, power = gsid_cplx_mul(power, v)) {
        by[m->n_poles + i] = power;
    }
    if (s->free_delay) {
        by[s->n - 1] = gsid_cplx_make(w_rad_s * g.im, -w_rad_s * g.re);
    }
    return gsid_residual_at(s->data, k, g);
}

static double objective(unsigned n, const double *scaled, double *gradient, void *user) {
    search *s = user;
    double x[PARAMETERS_MAX], v = 0;
    gsid_cplx by[PARAMETERS_MAX];
    for (unsigned i = 0; i < n; i++) {
        x[i] = scaled[i] * s->scale[i];
        if (gradient != NULL) {
            gradient[i] = 0;
        }
    }
    unpack(s, x, &s->model);
    for (uint32_t k = 0; k < s->data->n_lines; k++) {
        const gsid_residual error = line_derivatives(s, x, k, by);
        const gsid_cplx q = gsid_residual_project(&error, error.value);
        v += gsid_cplx_abs2(error.value);
        for (unsigned i = 0; gradient != NULL && i < n; i++) {
            gradient[i] += 2 * (by[i].re * q.re - by[i].im * q.im) * s->scale[i];
        }
    }
    return isfinite(v) ? v : HUGE_VAL;
}

/* Scale each parameter by the change of it that moves V by about 1. */
static void set_scales(search *s, const double *x) {
    double curvature[PARAMETERS_MAX] = {0};
    gsid_cplx by[PARAMETERS_MAX];
    unpack(s, x, &s->model);
    for (uint32_t k = 0; k < s->data->n_lines; k++) {
        const gsid_residual error = line_derivatives(s, x, k, by);
        for (uint32_t i = 0; i < s->n; i++) {
            curvature[i] += gsid_cplx_abs2(gsid_residual_slope(&error, by[i]));
        }
    }
    for (uint32_t i = 0; i < s->n; i++) {
        s->scale[i] = curvature[i] > 0 && isfinite(curvature[i]) ? 1 / sqrt(curvature[i]) : 1;
    }
}

/* Poles as roots of den in v (domain s), or of z^n den(1/z) (domain z). */
static gsid_status find_poles(const gsid_rational *model, gsid_cplx *pole) {
    double coef[GSID_ORDER_MAX + 1];
    uint32_t n_found;
    for (uint32_t i = 0; i <= model->n_poles; i++) {
        coef[i] = model->den[model->domain == GSID_DOMAIN_S ? i : model->n_poles - i];
    }
    const gsid_status status = gsid_poly_roots(model->n_poles, coef, pole, &n_found);
    return status < 0 || n_found < model->n_poles ? GSID_E_SINGULAR : GSID_OK;
}

static gsid_status start_from(const search *s, const gsid_rational *model, double *x) {
    gsid_cplx pole[GSID_ORDER_MAX];
    const gsid_status status = find_poles(model, pole);
    if (status != GSID_OK) {
        return status;
    }
    gsid_fit_sections_from_poles(model->domain, model->n_poles, s->bounds->unstable, pole, x);
    for (uint32_t i = 0; i <= model->n_zeros; i++) {
        x[model->n_poles + i] = model->num[i];
    }
    if (s->free_delay) {
        x[s->n - 1] = model->delay_s;
    }
    return GSID_OK;
}

static void set_bounds(const search *s, double *lower, double *upper) {
    double least, most;
    gsid_fit_section_bounds(s->model.domain, &least, &most);
    for (uint32_t i = 0; i < s->n; i++) {
        const int is_bounded = i < s->model.n_poles && !s->bounds->unstable;
        lower[i] = is_bounded ? least / s->scale[i] : -HUGE_VAL;
        upper[i] = is_bounded ? most / s->scale[i] : HUGE_VAL;
    }
    if (s->free_delay) {
        lower[s->n - 1] = s->bounds->delay_min_s / s->scale[s->n - 1];
        upper[s->n - 1] = s->bounds->delay_max_s / s->scale[s->n - 1];
    }
}

/* Numerator and delay for reflected poles, used if they lower V from v. An unstable pole has a phase lead where its reflection
 * has a lag, and a shorter delay compensates this. Without it the search starts many decades above the least V and converges
 * slowly. The numerator is that of least squares, which need not minimise V: errors may be logarithmic, or of the input too.
 * Eq: EST-4 */
static gsid_status follow_reflection(search *s, double v, double *x) {
    const gsid_fit_bounds *b = s->bounds;
    const double latest_s = s->model.delay_s;
    const double span_s = s->free_delay ? fmax(latest_s - b->delay_min_s, 0) : 0;
    const double steps = b->delay_step_s > 0 ? fmin(ceil(span_s / b->delay_step_s), GSID_FIT_DELAYS_MAX) : 0;
    const size_t mem_size = gsid_lsq_mem_size(s->model.n_zeros + 1);
    void *mem = malloc(mem_size);
    if (mem == NULL) {
        return GSID_E_NO_MEMORY;
    }
    gsid_lsq equations;
    gsid_lsq_init(&equations, s->model.n_zeros + 1, mem, mem_size);
    gsid_rational trial = s->model, best = s->model;
    double least = HUGE_VAL, cost;
    for (uint32_t i = 0; i <= steps; i++) {
        trial.delay_s = i == 0 ? latest_s : latest_s - i / steps * span_s;
        if (gsid_fit_numerator(s->data, b->stride, &equations, &trial, &cost) >= 0 && cost < least) {
            least = cost;
            best = trial;
        }
    }
    free(mem);
    if (gsid_estimate_cost(s->data, &best, &cost) != GSID_OK || !(cost < v)) {
        return GSID_OK;
    }
    s->model = best;
    for (uint32_t i = 0; i <= s->model.n_zeros; i++) {
        x[s->model.n_poles + i] = s->model.num[i];
    }
    if (s->free_delay) {
        x[s->n - 1] = s->model.delay_s;
    }
    return GSID_OK;
}

/* From x to the least point. */
static gsid_status minimise(search *s, double tolerance, double *x, double *least) {
    double lower[PARAMETERS_MAX], upper[PARAMETERS_MAX];
    set_scales(s, x);
    set_bounds(s, lower, upper);
    for (uint32_t i = 0; i < s->n; i++) {
        x[i] = fmin(fmax(x[i] / s->scale[i], lower[i]), upper[i]);
    }
    const gsid_nlopt_search how = {.algorithm = GSID_NLOPT_SLSQP,
                                   .n = s->n,
                                   .lower = lower,
                                   .upper = upper,
                                   .tolerance = tolerance,
                                   .n_max = EVALUATIONS_MAX};
    const gsid_status status = gsid_nlopt_minimise(&how, objective, s, x, least);
    for (uint32_t i = 0; i < s->n; i++) {
        x[i] *= s->scale[i];
    }
    return status;
}

gsid_status gsid_fit_stable(const gsid_frd *data, const gsid_fit_bounds *bounds, gsid_rational *model, double *cost) {
    search s = {.data = data, .model = *model, .bounds = bounds, .free_delay = bounds->free_delay};
    s.n = model->n_poles + model->n_zeros + 1 + (s.free_delay ? 1 : 0);
    double x[PARAMETERS_MAX], least;
    gsid_status status = start_from(&s, model, x);
    if (status != GSID_OK) {
        return status;
    }
    s.variable = malloc(data->n_lines * sizeof *s.variable);
    if (s.variable == NULL) {
        return GSID_E_NO_MEMORY;
    }
    for (uint32_t k = 0; k < data->n_lines; k++) {
        s.variable[k] = gsid_rational_variable(model, GSID_TWO_PI * data->f_hz[k]);
    }
    unpack(&s, x, &s.model);
    if (gsid_estimate_cost(data, &s.model, &least) != GSID_OK) {
        least = HUGE_VAL;
    }
    if (least > FAR * *cost) {
        status = follow_reflection(&s, least, x);
    }
    if (status == GSID_OK) {
        status = minimise(&s, TOLERANCE * fmin(1, *cost / data->n_lines), x, &least);
    }
    free(s.variable);
    if (status < 0) {
        return status;
    }
    unpack(&s, x, &s.model);
    *model = s.model;
    *cost = least;
    return status;
}

#endif
