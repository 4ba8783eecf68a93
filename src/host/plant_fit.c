#include "gsid/host/plant_fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "gsid/host/greybox.h"
#include "gsid/lsq.h"
#include "plant_fit_problem.h"

gsid_status gsid_plant_fit_defaults(gsid_plant_fit_settings *settings) {
    if (settings == NULL) {
        return GSID_E_NULL;
    }
    *settings = (gsid_plant_fit_settings){
        .settled = 1e-2, .unsettled = 0.1, .noise_floor = 1e-7, .silent = 1e-3, .involved = 0.1};
    return gsid_squares_defaults(&settings->search);
}

uint32_t gsid_plant_fit_n(const gsid_plant_fit_cfg *cfg) {
    if (cfg == NULL || cfg->n_records == 0 || cfg->record == NULL) {
        return 0;
    }
    uint64_t n_own = cfg->has_drift ? 1 : 0, n_shared = 0;
    for (uint32_t i = 0; i < cfg->record[0].input.plant.n_free; i++) {
        *(cfg->is_own != NULL && cfg->is_own[i] ? &n_own : &n_shared) += 1;
    }
    const uint64_t n = cfg->n_records * n_own + n_shared;
    return n_shared == 0 || n > UINT32_MAX ? 0 : (uint32_t)n;
}

/* ---- arguments ---- */

static gsid_status check_lines(const gsid_plant_fit_record *record) {
    for (uint32_t k = 0; k < record->n_lines; k++) {
        if (2 * (uint64_t)record->line[k] >= record->input.n_period) {
            return GSID_E_CONFIG;
        }
        if (!isfinite(record->y[k].re) || !isfinite(record->y[k].im) || !isfinite(record->variance[k])) {
            return GSID_E_NONFINITE;
        }
        if (record->variance[k] < 0) {
            return GSID_E_CONFIG;
        }
    }
    return GSID_OK;
}

/* Each record has the same effects and free parameters. */
static int is_same_stack(const gsid_plant_cfg *a, const gsid_plant_cfg *b) {
    int is_same = a->n_items == b->n_items && a->n_free == b->n_free;
    for (uint32_t i = 0; i < a->n_items && is_same; i++) {
        is_same = a->item[i].effect == b->item[i].effect;
    }
    for (uint32_t i = 0; i < a->n_free && is_same; i++) {
        const gsid_plant_free *one = &a->free_parameter[i], *other = &b->free_parameter[i];
        is_same = one->item == other->item && one->parameter == other->parameter && one->item < a->n_items &&
                  one->parameter < a->item[one->item].effect->n_parameters;
    }
    return is_same;
}

static gsid_status check_record(const gsid_plant_fit_cfg *cfg, const gsid_plant_fit_record *record) {
    const gsid_plant_cfg *plant = &record->input.plant;
    if (record->line == NULL || record->y == NULL || record->variance == NULL || plant->item == NULL ||
        plant->free_parameter == NULL) {
        return GSID_E_NULL;
    }
    for (uint32_t i = 0; i < plant->n_items; i++) {
        if (plant->item[i].effect == NULL) {
            return GSID_E_NULL;
        }
    }
    if (record->n_lines == 0 || record->n_lines > record->input.n_period / 2 + 1 || !(record->n_periods >= 1) ||
        !(record->dof > 2) || !is_same_stack(&cfg->record[0].input.plant, plant)) {
        return GSID_E_CONFIG;
    }
    return check_lines(record);
}

/* Residuals: a real line has one, the others two. */
static double n_residuals(const gsid_plant_fit_cfg *cfg) {
    double n = 0;
    for (uint32_t r = 0; r < cfg->n_records; r++) {
        for (uint32_t k = 0; k < cfg->record[r].n_lines; k++) {
            n += cfg->record[r].line[k] == 0 ? 1 : 2;
        }
    }
    return n;
}

static gsid_status check(const gsid_plant_fit_cfg *cfg, const gsid_plant_fit_result *result) {
    if (cfg == NULL || result == NULL || cfg->record == NULL || result->x == NULL || result->cov == NULL ||
        result->is_open == NULL || result->is_at_bound == NULL) {
        return GSID_E_NULL;
    }
    for (uint32_t r = 0; r < cfg->n_records; r++) {
        const gsid_status status = check_record(cfg, &cfg->record[r]);
        if (status != GSID_OK) {
            return status;
        }
    }
    const uint32_t n = gsid_plant_fit_n(cfg);
    const uint32_t n_of_record = cfg->record[0].input.plant.n_free + (cfg->has_drift ? 1 : 0);
    const int is_known = (cfg->method == GSID_PLANT_FIT_ML || cfg->method == GSID_PLANT_FIT_NLS_OUTPUT) &&
                         (cfg->solver == GSID_SOLVER_GAUSS_NEWTON || cfg->solver == GSID_SOLVER_NLOPT);
    if (n == 0 || n > GSID_LSQ_COLUMNS_MAX || n_of_record >= GSID_LSQ_COLUMNS_MAX || cfg->n_max == 0 || !is_known) {
        return GSID_E_CONFIG;
    }
    return n_residuals(cfg) <= n ? GSID_E_TOO_FEW : GSID_OK;
}

/* ---- covariance ---- */

typedef struct {
    double *x, *r, *q, *cov, *open, *work; /* [n], [n][n], [n], [n][n], [n], [n][n] */
    uint8_t *blocked;                      /* [n] */
    uint32_t n_open;
    double cost;
    gsid_squares_result search;
} found;

/* cov = factor (R cov)' (R cov) */
static void propagate(uint32_t n, const double *r, double factor, double *work, double *cov) {
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++) {
            double sum = 0;
            for (uint32_t k = i; k < n; k++) { /* R is a triangle */
                sum += r[(size_t)i * n + k] * cov[(size_t)k * n + j];
            }
            work[(size_t)i * n + j] = sum;
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++) {
            double sum = 0;
            for (uint32_t k = 0; k < n; k++) {
                sum += work[(size_t)k * n + i] * work[(size_t)k * n + j];
            }
            cov[(size_t)i * n + j] = factor * sum;
        }
    }
}

/* The weights are estimates themselves, which increases the variance of the parameters. */
static void scale_by_dof(gsid_fit_problem *p, found *f) {
    const double dof = gsid_fit_problem_dof(p), factor = isinf(dof) ? 1 : (dof - 1) / (dof - 2);
    for (size_t i = 0; i < (size_t)p->n * p->n; i++) {
        f->cov[i] *= factor;
    }
}

/* Covariance that the noise causes where the weights are equal. Those of the noise contain the mean of 1/s^2. */
static gsid_status by_noise(gsid_fit_problem *p, found *f) {
    const double dof = gsid_fit_problem_dof(p);
    gsid_fit_problem_weigh(p, 2);
    const gsid_status status = gsid_fit_problem_kept(p, f->x, &f->cost, f->r, f->q);
    if (status == GSID_OK) {
        propagate(p->n, f->r, isinf(dof) ? 1 : (dof - 1) / dof, f->work, f->cov);
    }
    return status;
}

static gsid_status answer(gsid_fit_problem *p, found *f) {
    gsid_status status = gsid_fit_problem_kept(p, f->x, &f->cost, f->r, f->q);
    if (status == GSID_OK) {
        status = gsid_arrow_covariance(p->n, p->n, f->r, p->cfg->settings.search.singular, f->cov, f->open, &f->n_open);
    }
    if (status < 0) {
        return status;
    }
    if (p->cfg->method == GSID_PLANT_FIT_ML) {
        scale_by_dof(p, f);
        return GSID_OK;
    }
    status = by_noise(p, f);
    gsid_fit_problem_weigh(p, 0);
    return status == GSID_OK ? gsid_fit_problem_kept(p, f->x, &f->cost, f->r, f->q) : status;
}

/* ---- the call ---- */

static gsid_status fit(gsid_fit_problem *p, found *f) {
    const gsid_squares squares = {p->n, p->lower, p->upper, gsid_fit_problem_at, gsid_fit_problem_keep, p};
    memcpy(f->x, p->start, p->n * sizeof *f->x);
    if (p->cfg->method == GSID_PLANT_FIT_NLS_OUTPUT) {
        gsid_fit_problem_weigh(p, 1);
    }
    const gsid_status status = gsid_squares_search(&squares, &p->cfg->settings.search, p->cfg->solver, p->cfg->n_max,
                                                   f->x, f->blocked, &f->search);
    return status == GSID_OK ? answer(p, f) : status;
}

static void copy(double *to, const double *from, size_t n) {
    if (to != NULL) {
        memcpy(to, from, n * sizeof *to);
    }
}

static void give_record(const gsid_fit_problem *p, uint32_t record, gsid_plant_fit_at *to) {
    const gsid_fit_part *one = &p->part[record];
    const gsid_fit_state *kept = &one->state[p->kept];
    const size_t n_lines = one->cfg->n_lines, n = one->cfg->input.n_period;
    copy(to->weight, one->weight, n_lines);
    copy(to->row, kept->row, 2 * n_lines * ((size_t)p->n_own + p->n_shared + 1));
    copy(to->answer.y, kept->answer.y, n);
    copy(to->answer.angle, kept->answer.angle, n);
    copy(to->answer.rate, kept->answer.rate, n);
    copy(to->answer.dy, kept->answer.dy, n * p->n_free);
    to->answer.residual = kept->answer.residual;
    to->answer.is_settled = kept->answer.is_settled;
    to->is_unsettled = kept->answer.residual > p->cfg->settings.unsettled * one->noise_rms;
}

static void give(const gsid_fit_problem *p, const found *f, gsid_plant_fit_result *result) {
    const uint32_t n = p->n;
    copy(result->x, f->x, n);
    copy(result->cov, f->cov, (size_t)n * n);
    memcpy(result->is_at_bound, f->blocked, n);
    for (uint32_t j = 0; j < n; j++) {
        result->is_open[j] = f->open[j] > p->cfg->settings.involved;
    }
    for (uint32_t r = 0; r < p->cfg->n_records && result->at != NULL; r++) {
        give_record(p, r, &result->at[r]);
    }
    result->cost = f->cost;
    result->n_dof = n_residuals(p->cfg) - n + f->n_open;
    result->converged = f->search.converged;
    result->n_iterations = f->search.n_iterations;
}

gsid_status gsid_plant_fit(const gsid_plant_fit_cfg *cfg, gsid_plant_fit_result *result) {
    gsid_status status = check(cfg, result);
    if (status != GSID_OK) {
        return status;
    }
    const size_t n = gsid_plant_fit_n(cfg);
    found f = {.blocked = malloc(n)};
    double *memory = malloc((3 * n * n + 3 * n) * sizeof *memory);
    gsid_fit_problem problem = {.cfg = cfg};
    status = memory == NULL || f.blocked == NULL ? GSID_E_NO_MEMORY : gsid_fit_problem_make(cfg, &problem);
    if (status == GSID_OK) {
        f.r = memory, f.cov = f.r + n * n, f.work = f.cov + n * n;
        f.x = f.work + n * n, f.q = f.x + n, f.open = f.q + n;
        status = fit(&problem, &f);
    }
    if (status == GSID_OK) {
        give(&problem, &f, result);
    }
    gsid_fit_problem_free(&problem);
    free(memory);
    free(f.blocked);
    return status;
}
