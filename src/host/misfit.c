/* Errors of a model against noise and the model's uncertainty. */
#include "gsid/host/misfit.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "gsid/lsq.h"

/* With negligible noise, the change of the model would be lost to rounding. */
#define LEAST_SHARE 1e-20

static int is_real(const uint8_t *real, uint32_t k) {
    return real != NULL && real[k];
}

gsid_status gsid_misfit_scores(uint32_t n_lines, const double *ratio, const double *dof, const uint8_t *real,
                               double *score) {
    if (n_lines > 0 && (ratio == NULL || dof == NULL || score == NULL)) {
        return GSID_E_NULL;
    }
    for (uint32_t k = 0; k < n_lines; k++) {
        const double t = fmin(ratio[k], DBL_MAX);
        if (!(ratio[k] >= 0 && dof[k] > 0)) {
            return GSID_E_CONFIG;
        }
        if (is_real(real, k)) {
            gsid_tail tail;
            const gsid_status status = gsid_tail_f(1, dof[k] < GSID_TAIL_SHAPE_MAX ? dof[k] : INFINITY, t, &tail);
            if (status != GSID_OK) {
                return status;
            }
            score[k] = -tail.log_upper;
        } else {
            score[k] = isinf(dof[k]) ? t : dof[k] * log1p(t / dof[k]);
        }
    }
    return GSID_OK;
}

static gsid_status check(const gsid_misfit_lines *lines, const gsid_misfit *result) {
    const uint32_t n = lines == NULL ? 0 : lines->n_lines, p = lines == NULL ? 0 : lines->n_directions;
    if (lines == NULL || result == NULL) {
        return GSID_E_NULL;
    }
    if (n > 0 &&
        (lines->error == NULL || lines->variance == NULL || lines->dof == NULL || (p > 0 && lines->by_model == NULL))) {
        return GSID_E_NULL;
    }
    if (p > GSID_LSQ_COLUMNS_MAX) {
        return GSID_E_CONFIG;
    }
    const double *weight = lines->var_weight != NULL ? lines->var_weight : lines->variance;
    for (uint32_t k = 0; k < n; k++) {
        if (!isfinite(lines->error[k].re) || !isfinite(lines->error[k].im) || !isfinite(lines->variance[k]) ||
            !isfinite(weight[k])) {
            return GSID_E_NONFINITE;
        }
        if (!(lines->variance[k] >= 0 && weight[k] >= 0 && lines->dof[k] > 0)) {
            return GSID_E_CONFIG;
        }
    }
    for (size_t i = 0; i < (size_t)n * p; i++) {
        if (!isfinite(lines->by_model[i].re) || !isfinite(lines->by_model[i].im)) {
            return GSID_E_NONFINITE;
        }
    }
    return GSID_OK;
}

/* Square roots of the weights of a line's parts. */
static void weigh(const gsid_misfit_lines *lines, double *weight) {
    double largest = 0;
    for (size_t i = 0; i < (size_t)lines->n_lines * lines->n_directions; i++) {
        largest = fmax(largest, hypot(lines->by_model[i].re, lines->by_model[i].im));
    }
    const double least = fmax(LEAST_SHARE * largest * largest, DBL_MIN);
    const double *variance = lines->var_weight != NULL ? lines->var_weight : lines->variance;
    for (uint32_t k = 0; k < lines->n_lines; k++) {
        weight[k] = sqrt((is_real(lines->is_real, k) ? 1 : 2) / fmax(variance[k], least));
    }
}

/* One part of a line's row of A, whitened. */
static void fill_row(const gsid_misfit_lines *lines, uint32_t k, int imaginary, double weight, double *row) {
    const gsid_cplx *a = lines->by_model + (size_t)k * lines->n_directions;
    for (uint32_t j = 0; j < lines->n_directions; j++) {
        row[j] = weight * (imaginary ? a[j].im : a[j].re);
    }
}

/* Least squares of (A; 1) z = (error; 0), both whitened. */
static gsid_status solve(const gsid_misfit_lines *lines, const double *weight, gsid_lsq *q, double *row, double *z) {
    const uint32_t p = lines->n_directions;
    gsid_status status = GSID_OK;
    for (uint32_t k = 0; k < lines->n_lines && status == GSID_OK; k++) {
        const int n_parts = is_real(lines->is_real, k) ? 1 : 2;
        for (int part = 0; part < n_parts && status == GSID_OK; part++) {
            fill_row(lines, k, part, weight[k], row);
            status = gsid_lsq_add(q, row, weight[k] * (part ? lines->error[k].im : lines->error[k].re));
        }
    }
    for (uint32_t j = 0; j < p && status == GSID_OK; j++) {
        memset(row, 0, p * sizeof *row);
        row[j] = 1;
        status = gsid_lsq_add(q, row, 0);
    }
    if (status == GSID_OK) {
        status = gsid_lsq_solve(q, 0, z, NULL);
    }
    return status == GSID_RANK ? GSID_OK : status; /* a direction beyond rounding of the others: not used */
}

/* Leverage of a row: |R^-T row|^2. The row is overwritten. */
static double leverage(const gsid_lsq *q, double *row) {
    const uint32_t p = q->n_columns;
    double sum = 0;
    for (uint32_t i = 0; i < p; i++) {
        const double *r = q->r + (size_t)i * (p + 1);
        row[i] /= r[i];
        sum += row[i] * row[i];
        for (uint32_t j = i + 1; j < p; j++) {
            row[j] -= r[j] * row[i];
        }
    }
    return sum;
}

/* Change of the model: what it leaves, its size, and the degrees of freedom that it adds. The change takes a share h of the
 * variance of a line, which lowers the mean of twice its score by h nu/(nu + 1); the mean of z'z is the sum of h. */
static gsid_status change_model(const gsid_misfit_lines *lines, gsid_cplx *left, gsid_misfit *result) {
    const uint32_t n = lines->n_lines, p = lines->n_directions;
    const size_t size = gsid_lsq_mem_size(p);
    gsid_lsq q;
    void *mem = malloc(size);
    double *weight = malloc(((size_t)n + 2 * p) * sizeof *weight), *row = weight + n, *z = row + p;
    gsid_status status = mem == NULL || weight == NULL ? GSID_E_NO_MEMORY : gsid_lsq_init(&q, p, mem, size);
    if (status == GSID_OK) {
        weigh(lines, weight);
        status = solve(lines, weight, &q, row, z);
    }
    for (uint32_t k = 0; k < n && status == GSID_OK; k++) {
        const gsid_cplx *a = lines->by_model + (size_t)k * p;
        double h = 0;
        for (int part = 0; part < (is_real(lines->is_real, k) ? 1 : 2); part++) {
            fill_row(lines, k, part, weight[k], row);
            h += leverage(&q, row);
        }
        result->n_dof += h / (lines->dof[k] + 1);
        for (uint32_t j = 0; j < p; j++) {
            left[k].re -= a[j].re * z[j];
            left[k].im -= a[j].im * z[j];
        }
    }
    for (uint32_t j = 0; j < p && status == GSID_OK; j++) {
        result->moved += z[j] * z[j];
    }
    free(mem);
    free(weight);
    return status;
}

gsid_status gsid_misfit_test(const gsid_misfit_lines *lines, gsid_cplx *left, double *ratio, gsid_misfit *result) {
    gsid_status status = check(lines, result);
    if (status != GSID_OK) {
        return status;
    }
    const uint32_t n = lines->n_lines;
    gsid_misfit found = {0, 2.0 * n, 0};
    gsid_cplx *rest = malloc(((size_t)n + 1) * sizeof *rest);
    double *t = calloc(2 * (size_t)n + 1, sizeof *t), *score = t + n;
    status = rest == NULL || t == NULL ? GSID_E_NO_MEMORY : GSID_OK;
    if (status == GSID_OK && n > 0) {
        memcpy(rest, lines->error, n * sizeof *rest);
        status = lines->n_directions > 0 ? change_model(lines, rest, &found) : GSID_OK;
    }
    for (uint32_t k = 0; k < n && status == GSID_OK; k++) {
        const double size = hypot(rest[k].re, rest[k].im) / sqrt(fmax(lines->variance[k], DBL_MIN));
        t[k] = fmin(size * size, DBL_MAX);
    }
    if (status == GSID_OK) {
        status = gsid_misfit_scores(n, t, lines->dof, lines->is_real, score);
    }
    if (status == GSID_OK) {
        for (uint32_t k = 0; k < n; k++) {
            found.chi2 += 2 * score[k];
        }
        found.chi2 = fmin(found.chi2 + found.moved, DBL_MAX);
        *result = found;
        if (left != NULL && n > 0) {
            memcpy(left, rest, n * sizeof *rest);
        }
        if (ratio != NULL && n > 0) {
            memcpy(ratio, t, n * sizeof *t);
        }
    }
    free(rest);
    free(t);
    return status;
}

double gsid_misfit_taken(uint32_t n_lines, const double *dof) {
    double sum = 0;
    for (uint32_t k = 0; k < n_lines; k++) {
        sum += isinf(dof[k]) ? 1 : dof[k] / (dof[k] + 1);
    }
    return n_lines > 0 ? sum / n_lines : 1;
}

gsid_status gsid_misfit_tail(const gsid_misfit *misfit, double n_fitted, gsid_tail *tail) {
    if (misfit == NULL || tail == NULL) {
        return GSID_E_NULL;
    }
    return n_fitted >= 0 ? gsid_tail_chi2(fmax(misfit->n_dof - n_fitted, 1), misfit->chi2, tail) : GSID_E_CONFIG;
}
