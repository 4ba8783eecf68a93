#include "fit_stable.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/residual.h"
#include "backend/backend.h"
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

/* Least distance of a pole from the edge of the stable region: from the axis in scaled s, from the unit circle in z. */
#define EDGE 1e-6
#define EVALUATIONS_MAX 3000
#define TOLERANCE 1e-4 /* of V, or of V per line where that is less: a fiftieth of what the Gauss-Newton stage leaves */

/* Eq: EST-4. One factor of the denominator, coef[0] + coef[1] v + coef[2] v^2, in a variable p that has the edge of the
 * region at EDGE inside that of v. Its parameters x:
 *   domain s, p = v + EDGE: order 2: x0 + x1 p + p^2; order 1: x0 + p: within the edge when all are >= 0.
 *   domain z, p = (1 - EDGE) v: order 2: 1 + x0 (1 + x1) p + x1 p^2; order 1: 1 + x0 p: when all are within +-1. */
static void section_coefficients(gsid_domain domain, uint32_t order, const double *x, double *coef) {
    const double r = 1 - EDGE;
    if (domain == GSID_DOMAIN_S) {
        coef[0] = order == 2 ? x[0] + (x[1] + EDGE) * EDGE : x[0] + EDGE;
        coef[1] = order == 2 ? x[1] + 2 * EDGE : 1;
        coef[2] = order == 2 ? 1 : 0;
    } else {
        coef[0] = 1;
        coef[1] = order == 2 ? x[0] * (1 + x[1]) * r : x[0] * r;
        coef[2] = order == 2 ? x[1] * r * r : 0;
    }
}

/* Derivatives of the section by its parameters, at v. */
static void section_derivatives(gsid_domain domain, uint32_t order, const double *x, gsid_cplx v, gsid_cplx *by) {
    if (domain == GSID_DOMAIN_S) {
        by[0] = gsid_cplx_make(1, 0);
        if (order == 2)
            by[1] = gsid_cplx_make(v.re + EDGE, v.im);
        return;
    }
    const gsid_cplx p = gsid_cplx_scale(1 - EDGE, v);
    by[0] = p;
    if (order == 2) {
        by[0] = gsid_cplx_scale(1 + x[1], p);
        by[1] = gsid_cplx_add(gsid_cplx_scale(x[0], p), gsid_cplx_mul(p, p));
    }
}

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

static uint32_t section_order(const gsid_rational *model, uint32_t first) {
    return model->n_poles - first >= 2 ? 2 : 1;
}

/* Sections in x -> coefficients of the denominator. */
void gsid_fit_sections(const double *x, gsid_rational *model) {
    double den[GSID_ORDER_MAX + 3] = {1};
    for (uint32_t first = 0; first < model->n_poles; first += 2) {
        double c[3];
        section_coefficients(model->domain, section_order(model, first), x + first, c);
        for (uint32_t i = GSID_ORDER_MAX + 3; i-- > 0;)
            den[i] = c[0] * den[i] + (i >= 1 ? c[1] * den[i - 1] : 0) + (i >= 2 ? c[2] * den[i - 2] : 0);
    }
    memcpy(model->den, den, sizeof model->den);
}

static void unpack(const search *s, const double *x, gsid_rational *model) {
    gsid_fit_sections(x, model);
    for (uint32_t i = 0; i <= model->n_zeros; i++)
        model->num[i] = x[model->n_poles + i];
    if (s->free_delay)
        model->delay_s = x[s->n - 1];
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
        const uint32_t order = section_order(m, first);
        double c[3];
        section_coefficients(m->domain, order, x + first, c);
        section_derivatives(m->domain, order, x + first, v, by + first);
        const gsid_cplx minus_g = gsid_cplx_div(gsid_cplx_scale(-1, g), gsid_cplx_polynomial(order, c, v));
        for (uint32_t i = 0; i < order; i++)
            by[first + i] = gsid_cplx_mul(minus_g, by[first + i]);
    }
    gsid_cplx power = by_num;
    for (uint32_t i = 0; i <= m->n_zeros; i++, power = gsid_cplx_mul(power, v))
        by[m->n_poles + i] = power;
    if (s->free_delay)
        by[s->n - 1] = gsid_cplx_make(w_rad_s * g.im, -w_rad_s * g.re);
    return gsid_residual_at(s->data, k, g);
}

static double objective(unsigned n, const double *scaled, double *gradient, void *user) {
    search *s = user;
    double x[PARAMETERS_MAX], v = 0;
    gsid_cplx by[PARAMETERS_MAX];
    for (unsigned i = 0; i < n; i++) {
        x[i] = scaled[i] * s->scale[i];
        if (gradient != NULL)
            gradient[i] = 0;
    }
    unpack(s, x, &s->model);
    for (uint32_t k = 0; k < s->data->n_lines; k++) {
        const gsid_residual error = line_derivatives(s, x, k, by);
        const gsid_cplx q = gsid_residual_project(&error, error.value);
        v += gsid_cplx_abs2(error.value);
        for (unsigned i = 0; gradient != NULL && i < n; i++)
            gradient[i] += 2 * (by[i].re * q.re - by[i].im * q.im) * s->scale[i];
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
        for (uint32_t i = 0; i < s->n; i++)
            curvature[i] += gsid_cplx_abs2(gsid_residual_slope(&error, by[i]));
    }
    for (uint32_t i = 0; i < s->n; i++)
        s->scale[i] = curvature[i] > 0 && isfinite(curvature[i]) ? 1 / sqrt(curvature[i]) : 1;
}

static int by_magnitude(const void *a, const void *b) {
    const double x = gsid_cplx_abs2(*(const gsid_cplx *)a), y = gsid_cplx_abs2(*(const gsid_cplx *)b);
    return (x > y) - (x < y);
}

/* A pole as a root of the sections' own variable. */
static gsid_cplx unscaled(gsid_domain domain, gsid_cplx p) {
    if (domain == GSID_DOMAIN_S)
        return gsid_cplx_make(p.re + EDGE, p.im);
    return gsid_cplx_scale(1 / (1 - EDGE), p);
}

/* Reflect a pole into the stable region, and off its edge; then take it as a root of the sections' own variable. */
static gsid_cplx stabilised(gsid_domain domain, gsid_cplx p) {
    if (domain == GSID_DOMAIN_S) {
        p.re = EDGE - fmax(fabs(p.re), 10 * EDGE);
        return p;
    }
    const double r = sqrt(gsid_cplx_abs2(p));
    const double inside = fmin(r > 1 ? 1 / r : r, 1 - 10 * EDGE);
    return r > 0 ? gsid_cplx_scale(inside / r / (1 - EDGE), p) : p;
}

/* Poles as roots of den in v (domain s), or of z^n den(1/z) (domain z). */
static gsid_status find_poles(const gsid_rational *model, gsid_cplx *pole) {
    double coef[GSID_ORDER_MAX + 1];
    uint32_t n_found;
    for (uint32_t i = 0; i <= model->n_poles; i++)
        coef[i] = model->den[model->domain == GSID_DOMAIN_S ? i : model->n_poles - i];
    const gsid_status status = gsid_poly_roots(model->n_poles, coef, pole, &n_found);
    return status < 0 || n_found < model->n_poles ? GSID_E_SINGULAR : GSID_OK;
}

/* Write the section with roots p and q (p alone when the order is 1), the inverse of section_coefficients. */
static void section_from_roots(gsid_domain domain, uint32_t order, gsid_cplx p, gsid_cplx q, double *x) {
    if (order == 1) {
        x[0] = -p.re;
        return;
    }
    const double sum = p.re + q.re, product = gsid_cplx_mul(p, q).re;
    if (domain == GSID_DOMAIN_S) {
        x[0] = product;
        x[1] = -sum;
    } else {
        x[1] = product;
        x[0] = -sum / (1 + product);
    }
}

/* Pairs first, then real poles two by two in order of size. */
static void sections_from_poles(gsid_domain domain, uint32_t n, const gsid_cplx *pole, double *x) {
    gsid_cplx real[GSID_ORDER_MAX];
    uint32_t n_real = 0, first = 0;
    for (uint32_t i = 0; i < n; i++) {
        if (pole[i].im > 0) {
            section_from_roots(domain, 2, pole[i], gsid_cplx_conj(pole[i]), x + first);
            first += 2;
        } else if (pole[i].im == 0) {
            real[n_real++] = pole[i];
        }
    }
    qsort(real, n_real, sizeof *real, by_magnitude);
    for (uint32_t i = 0; i + 1 < n_real; i += 2, first += 2)
        section_from_roots(domain, 2, real[i], real[i + 1], x + first);
    if (n_real % 2 == 1)
        section_from_roots(domain, 1, real[n_real - 1], real[n_real - 1], x + first);
}

static gsid_status start_from(const search *s, const gsid_rational *model, double *x) {
    gsid_cplx pole[GSID_ORDER_MAX];
    const gsid_status status = find_poles(model, pole);
    if (status != GSID_OK)
        return status;
    for (uint32_t i = 0; i < model->n_poles; i++)
        pole[i] = s->bounds->unstable ? unscaled(model->domain, pole[i]) : stabilised(model->domain, pole[i]);
    sections_from_poles(model->domain, model->n_poles, pole, x);
    for (uint32_t i = 0; i <= model->n_zeros; i++)
        x[model->n_poles + i] = model->num[i];
    if (s->free_delay)
        x[s->n - 1] = model->delay_s;
    return GSID_OK;
}

static void set_bounds(const search *s, double *lower, double *upper) {
    const int in_s = s->model.domain == GSID_DOMAIN_S;
    for (uint32_t i = 0; i < s->n; i++) {
        const int is_bounded = i < s->model.n_poles && !s->bounds->unstable;
        lower[i] = is_bounded ? (in_s ? 0 : -1 / s->scale[i]) : -HUGE_VAL;
        upper[i] = is_bounded && !in_s ? 1 / s->scale[i] : HUGE_VAL;
    }
    if (s->free_delay) {
        lower[s->n - 1] = s->bounds->delay_min_s / s->scale[s->n - 1];
        upper[s->n - 1] = s->bounds->delay_max_s / s->scale[s->n - 1];
    }
}

/* From x to the least point. */
static gsid_status minimise(search *s, double tolerance, double *x, double *least) {
    double lower[PARAMETERS_MAX], upper[PARAMETERS_MAX];
    set_scales(s, x);
    set_bounds(s, lower, upper);
    for (uint32_t i = 0; i < s->n; i++)
        x[i] = fmin(fmax(x[i] / s->scale[i], lower[i]), upper[i]);
    const gsid_nlopt_search how = {GSID_NLOPT_SLSQP, tolerance, EVALUATIONS_MAX, 0, 0};
    const gsid_status status = gsid_nlopt_minimise(&how, s->n, objective, s, lower, upper, x, least);
    for (uint32_t i = 0; i < s->n; i++)
        x[i] *= s->scale[i];
    return status;
}

gsid_status gsid_fit_stable(const gsid_frd *data, const gsid_fit_bounds *bounds, gsid_rational *model, double *cost) {
    search s = {.data = data, .model = *model, .bounds = bounds, .free_delay = bounds->free_delay};
    s.n = model->n_poles + model->n_zeros + 1 + (s.free_delay ? 1 : 0);
    double x[PARAMETERS_MAX], least;
    gsid_status status = start_from(&s, model, x);
    if (status != GSID_OK)
        return status;
    s.variable = malloc(data->n_lines * sizeof *s.variable);
    if (s.variable == NULL)
        return GSID_E_NO_MEMORY;
    for (uint32_t k = 0; k < data->n_lines; k++)
        s.variable[k] = gsid_rational_variable(model, GSID_TWO_PI * data->f_hz[k]);
    status = minimise(&s, TOLERANCE * fmin(1, *cost / data->n_lines), x, &least);
    free(s.variable);
    if (status < 0)
        return status;
    unpack(&s, x, &s.model);
    *model = s.model;
    *cost = least;
    return status;
}

#endif
