/* Algebra of grey-box fits: block-arrow least squares, and the interface to the general minimiser. */
#include "gsid/host/greybox.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "backend/backend.h"
#include "gsid/lsq.h"

static size_t n_unknowns(const gsid_arrow *arrow) {
    return (size_t)arrow->n_records * arrow->n_local + arrow->n_shared;
}

static gsid_status check(const gsid_arrow *arrow) {
    if (arrow->n_rows == NULL || arrow->row == NULL) {
        return GSID_E_NULL;
    }
    const size_t n = (size_t)arrow->n_local + arrow->n_shared;
    if (arrow->n_records == 0 || arrow->n_shared == 0 || n >= GSID_LSQ_COLUMNS_MAX) {
        return GSID_E_CONFIG;
    }
    size_t n_rows = 0;
    for (uint32_t r = 0; r < arrow->n_records; r++) {
        if (arrow->row[r] == NULL) {
            return GSID_E_NULL;
        }
        n_rows += arrow->n_rows[r];
        for (size_t i = 0; i < arrow->n_rows[r] * (n + 1); i++) {
            if (!isfinite(arrow->row[r][i])) {
                return GSID_E_NONFINITE;
            }
        }
    }
    return n_rows < n_unknowns(arrow) + 1 ? GSID_E_TOO_FEW : GSID_OK;
}

static void make_diagonal_positive(size_t n, double *triangle) {
    for (size_t i = 0; i < n; i++) {
        if (triangle[i * n + i] < 0) {
            for (size_t j = i; j < n; j++) {
                triangle[i * n + j] = -triangle[i * n + j];
            }
        }
    }
}

static gsid_status add_rows(gsid_lsq *q, uint32_t n_rows, const double *row) {
    gsid_status status = GSID_OK;
    for (uint32_t i = 0; i < n_rows && status == GSID_OK; i++, row += q->n_columns + 1) {
        status = gsid_lsq_add(q, row, row[q->n_columns]);
    }
    return status;
}

/* Reduce the rows of one record to a triangle. Its last rows contain the shared unknowns only. */
static gsid_status reduce_record(const gsid_arrow *arrow, uint32_t r, gsid_lsq *record, gsid_lsq *shared,
                                 double *triangle) {
    const uint32_t n_local = arrow->n_local, n = n_local + arrow->n_shared;
    const size_t width = n_unknowns(arrow) + 1;
    gsid_status status = gsid_lsq_reset(record);
    if (status == GSID_OK) {
        status = add_rows(record, arrow->n_rows[r], arrow->row[r]);
    }
    for (uint32_t i = 0; i < n_local; i++) {
        const double *from = record->r + (size_t)i * (n + 1);
        double *to = triangle + ((size_t)r * n_local + i) * width;
        memcpy(to + (size_t)r * n_local, from, n_local * sizeof(*to));
        memcpy(to + width - arrow->n_shared - 1, from + n_local, ((size_t)arrow->n_shared + 1) * sizeof(*to));
    }
    for (uint32_t i = n_local; i <= n && status == GSID_OK; i++) {
        const double *left = record->r + (size_t)i * (n + 1) + n_local;
        status = gsid_lsq_add(shared, left, left[arrow->n_shared]);
    }
    return status;
}

static gsid_status reduce(const gsid_arrow *arrow, gsid_lsq *record, gsid_lsq *shared, double *triangle) {
    const uint32_t n_shared = arrow->n_shared;
    const size_t width = n_unknowns(arrow) + 1;
    gsid_status status = GSID_OK;
    memset(triangle, 0, width * width * sizeof(*triangle));
    for (uint32_t r = 0; r < arrow->n_records && status == GSID_OK; r++) {
        status = reduce_record(arrow, r, record, shared, triangle);
    }
    for (uint32_t i = 0; i <= n_shared; i++) {
        memcpy(triangle + (width - n_shared - 1 + i) * width + (width - n_shared - 1),
               shared->r + (size_t)i * (n_shared + 1), ((size_t)n_shared + 1) * sizeof(*triangle));
    }
    make_diagonal_positive(width, triangle);
    return status;
}

gsid_status gsid_arrow_reduce_dense(const gsid_arrow *arrow, double *triangle) {
    if (arrow == NULL || triangle == NULL) {
        return GSID_E_NULL;
    }
    gsid_status status = check(arrow);
    if (status != GSID_OK) {
        return status;
    }
    const uint32_t n_record = arrow->n_local + arrow->n_shared;
    const size_t record_size = gsid_lsq_mem_size(n_record), shared_size = gsid_lsq_mem_size(arrow->n_shared);
    void *record_mem = malloc(record_size), *shared_mem = malloc(shared_size);
    gsid_lsq record, shared;
    status = record_mem == NULL || shared_mem == NULL ? GSID_E_NO_MEMORY : GSID_OK;
    if (status == GSID_OK) {
        status = gsid_lsq_init(&record, n_record, record_mem, record_size);
    }
    if (status == GSID_OK) {
        status = gsid_lsq_init(&shared, arrow->n_shared, shared_mem, shared_size);
    }
    if (status == GSID_OK) {
        status = reduce(arrow, &record, &shared, triangle);
    }
    free(record_mem);
    free(shared_mem);
    return status;
}

gsid_status gsid_arrow_reduce(const gsid_arrow *arrow, double *triangle) {
#ifdef GSID_WITH_SUITESPARSE
    if (arrow == NULL || triangle == NULL) {
        return GSID_E_NULL;
    }
    gsid_status status = check(arrow);
    if (status == GSID_OK) {
        status = gsid_suitesparse_reduce(arrow, triangle);
    }
    if (status == GSID_OK) {
        make_diagonal_positive(n_unknowns(arrow) + 1, triangle);
    }
    return status;
#else
    return gsid_arrow_reduce_dense(arrow, triangle);
#endif
}

gsid_status gsid_minimise(uint32_t n, gsid_objective objective, void *user, const double *lower, const double *upper,
                          double tolerance, uint32_t n_max, double *x, double *least) {
    if (objective == NULL || lower == NULL || upper == NULL || x == NULL || least == NULL) {
        return GSID_E_NULL;
    }
    if (n == 0) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < n; i++) {
        if (!isfinite(x[i])) {
            return GSID_E_NONFINITE;
        }
        if (!(lower[i] <= x[i] && x[i] <= upper[i])) {
            return GSID_E_CONFIG;
        }
    }
#ifdef GSID_WITH_NLOPT
    const gsid_nlopt_search how = {.algorithm = GSID_NLOPT_SLSQP,
                                   .n = n,
                                   .lower = lower,
                                   .upper = upper,
                                   .tolerance = tolerance,
                                   .n_max = (int)n_max};
    double value, *at = malloc(n * sizeof *at);
    if (at == NULL) {
        return GSID_E_NO_MEMORY;
    }
    memcpy(at, x, n * sizeof *at);
    gsid_status status = gsid_nlopt_minimise(&how, objective, user, at, &value);
    if (status >= 0 && !isfinite(value)) {
        status = GSID_E_NONFINITE;
    }
    if (status >= 0) {
        memcpy(x, at, n * sizeof *at);
        *least = value;
    }
    free(at);
    return status;
#else
    (void)user;
    (void)tolerance;
    (void)n_max;
    return GSID_E_BACKEND;
#endif
}
