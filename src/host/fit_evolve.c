#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/residual.h"
#include "backend/backend.h"
#include "fit_run.h"

#ifndef GSID_WITH_NLOPT

gsid_status gsid_fit_evolve(fit_run *r, uint32_t n_kept, fit_candidate *kept) {
    (void)r;
    (void)n_kept;
    (void)kept;
    return GSID_E_BACKEND;
}

#else

/* The settings of the thesis, where the genes were the coefficients. One population finds a lightly damped resonance in half of
 * the cases, so several are used, each with its own seed. */
#define POPULATION 80
#define GENERATIONS 100
#define BEYOND 2 /* poles are searched from the lowest line / BEYOND to the highest line * BEYOND */
#define DAMPING_LEAST 3e-3
#define DAMPING_MOST 2.0

typedef struct {
    const fit_run *r;
    gsid_lsq num; /* equations of the numerator */
    gsid_rational model;
    double cost;
} herd;

/* Genes: for each pair of poles log of the natural frequency and of the damping, which is above 1 for two real ones; log of the
 * frequency of a pole alone; the delay. */
static void poles_of(const herd *h, const double *gene, gsid_cplx *pole) {
    const uint32_t n = h->model.n_poles;
    for (uint32_t i = 0; i + 1 < n; i += 2) {
        const double w = exp(gene[i]), z = exp(gene[i + 1]), root = w * sqrt(fabs(z * z - 1));
        pole[i] = z < 1 ? gsid_cplx_make(-w * z, root) : gsid_cplx_make(-w * z + root, 0);
        pole[i + 1] = z < 1 ? gsid_cplx_make(-w * z, -root) : gsid_cplx_make(-w * z - root, 0);
    }
    if (n % 2 == 1) {
        pole[n - 1] = gsid_cplx_make(-exp(gene[n - 1]), 0);
    }
}

/* den <- product of (v - p / scale) in domain s, of (1 - exp(p T) v) in domain z. */
static void set_denominator(const gsid_cplx *pole, gsid_rational *model) {
    gsid_cplx den[GSID_ORDER_MAX + 1] = {{1, 0}};
    for (uint32_t i = 0; i < model->n_poles; i++) {
        gsid_cplx one = {1, 0}, root;
        if (model->domain == GSID_DOMAIN_S) {
            root = gsid_cplx_scale(-1 / model->scale_rad_s, pole[i]);
        } else {
            root = one;
            one = gsid_cplx_scale(-exp(pole[i].re * model->sample_s), gsid_cplx_cis(pole[i].im * model->sample_s));
        }
        for (uint32_t j = i + 2; j-- > 0;) {
            const gsid_cplx low = j <= i ? gsid_cplx_mul(root, den[j]) : gsid_cplx_make(0, 0);
            den[j] = j > 0 ? gsid_cplx_add(low, gsid_cplx_mul(one, den[j - 1])) : low;
        }
    }
    for (uint32_t i = 0; i <= model->n_poles; i++) {
        model->den[i] = den[i].re;
    }
}

/* Eq: EST-10. Weights between absolute and relative errors: with absolute errors a resonance at a small response would be lost
 * beside small errors at a large one. */
static void weigh(fit_run *r) {
    for (uint32_t k = 0; k < r->thin.n_lines; k++) {
        const double size = hypot(r->thin_g[k].re, r->thin_g[k].im);
        r->thin_sigma[k] = size > 0 ? sqrt(size) : HUGE_VAL;
    }
}

static double fitness(unsigned n, const double *gene, double *gradient, void *user) {
    herd *h = user;
    gsid_cplx pole[GSID_ORDER_MAX];
    (void)gradient;
    poles_of(h, gene, pole);
    set_denominator(pole, &h->model);
    if (h->r->cfg.delay == GSID_DELAY_FREE) {
        h->model.delay_s = gene[n - 1];
    }
    const gsid_status status = gsid_fit_numerator(&h->r->thin, 1, &h->num, &h->model, &h->cost);
    return status >= 0 && isfinite(h->cost) ? h->cost : HUGE_VAL;
}

static void set_ranges(const fit_run *r, double *lower, double *upper) {
    const uint32_t n = r->cfg.n_poles;
    double f_min = HUGE_VAL;
    for (uint32_t k = 0; k < r->data->n_lines; k++) {
        if (r->data->f_hz[k] > 0) {
            f_min = fmin(f_min, r->data->f_hz[k]);
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        const int is_damping = i % 2 == 1;
        lower[i] = log(is_damping ? DAMPING_LEAST : GSID_TWO_PI * f_min / BEYOND);
        upper[i] = log(is_damping ? DAMPING_MOST : GSID_TWO_PI * gsid_fit_highest_frequency(r->data) * BEYOND);
    }
    lower[n] = 0;
    upper[n] = r->delay_limit_s;
}

/* One population from a seed to its last generation. */
static gsid_status evolve(herd *h, uint32_t n, const double *lower, const double *upper, uint32_t seed,
                          fit_candidate *c) {
    double gene[GSID_ORDER_MAX + 1];
    for (uint32_t i = 0; i < n; i++) {
        gene[i] = (lower[i] + upper[i]) / 2;
    }
    const gsid_nlopt_search how = {.algorithm = GSID_NLOPT_ESCH,
                                   .n = n,
                                   .lower = lower,
                                   .upper = upper,
                                   .n_max = POPULATION * GENERATIONS,
                                   .population = POPULATION,
                                   .seed = seed};
    c->cost = HUGE_VAL;
    if (n > 0) {
        const gsid_status status = gsid_nlopt_minimise(&how, fitness, h, gene, &c->cost);
        if (status < 0) {
            return status;
        }
    }
    if (!(fitness(n, gene, NULL, h) < HUGE_VAL)) {
        return GSID_E_SINGULAR;
    }
    c->model = h->model;
    return gsid_estimate_cost(&h->r->work, &c->model, &c->cost);
}

gsid_status gsid_fit_evolve(fit_run *r, uint32_t n_kept, fit_candidate *kept) {
    herd h = {.r = r};
    gsid_status status = gsid_rational_init(&h.model, r->cfg.domain, r->cfg.n_poles, r->cfg.n_zeros, gsid_fit_rate(r));
    if (status == GSID_OK) {
        status = gsid_lsq_init(&h.num, r->cfg.n_zeros + 1, r->mem, r->mem_size);
    }
    if (status != GSID_OK) {
        return status;
    }
    double lower[GSID_ORDER_MAX + 1], upper[GSID_ORDER_MAX + 1];
    r->stride = (r->stride + 1) / 2;
    gsid_fit_thin_out(r);
    weigh(r);
    h.model.delay_s = r->cfg.delay == GSID_DELAY_FIXED ? r->cfg.delay_s : 0;
    set_ranges(r, lower, upper);
    const uint32_t n = r->cfg.n_poles + (r->cfg.delay == GSID_DELAY_FREE ? 1 : 0);
    gsid_fit_forget(n_kept, kept);
    for (uint32_t i = 0; i < n_kept; i++) {
        fit_candidate c;
        status = evolve(&h, n, lower, upper, n_kept * r->cfg.seed + i + 1, &c);
        gsid_fit_keep_best(&c, n_kept, kept);
    }
    return kept[0].cost < HUGE_VAL ? GSID_OK : status;
}

#endif
