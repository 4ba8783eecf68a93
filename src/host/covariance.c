/* Covariance of a fit from its triangle, by the singular values of one-sided Jacobi rotations. */
#include <math.h>
#include <stdlib.h>

#include "gsid/host/greybox.h"
#include "singular.h"

/* Columns of the triangle, scaled to length 1, as the rows of `a`; a column of zeros keeps the scale 1. */
static void take_columns(uint32_t n, uint32_t stride, const double *r, double *a, double *scale) {
    for (uint32_t j = 0; j < n; j++) {
        double length = 0;
        for (uint32_t i = 0; i < n; i++) {
            length = hypot(length, r[(size_t)i * stride + j]);
        }
        scale[j] = length > 0 ? length : 1;
        for (uint32_t i = 0; i < n; i++) {
            a[(size_t)j * n + i] = r[(size_t)i * stride + j] / scale[j];
        }
    }
}

/* Sums of the outer products of the singular vectors: those determined over their squared values, and of the others. */
static uint32_t add_up(uint32_t n, const double *a, const double *v, const double *scale, double singular, double *cov,
                       double *open) {
    double largest = 0;
    uint32_t n_open = 0;
    for (uint32_t k = 0; k < n; k++) {
        largest = fmax(largest, gsid_dot(n, a + (size_t)k * n, a + (size_t)k * n));
    }
    for (size_t i = 0; i < (size_t)n * n; i++) {
        cov[i] = 0;
    }
    for (uint32_t i = 0; i < n; i++) {
        open[i] = 0;
    }
    for (uint32_t k = 0; k < n; k++) {
        const double *along = v + (size_t)k * n, square = gsid_dot(n, a + (size_t)k * n, a + (size_t)k * n);
        const int is_known = sqrt(square) > singular * sqrt(largest);
        n_open += !is_known;
        for (uint32_t i = 0; i < n; i++) {
            if (!is_known) {
                open[i] = hypot(open[i], along[i]);
            }
            for (uint32_t j = 0; j < n && is_known; j++) {
                cov[(size_t)i * n + j] += along[i] / scale[i] * (along[j] / scale[j]) / square;
            }
        }
    }
    return n_open;
}

gsid_status gsid_arrow_covariance(uint32_t n, uint32_t stride, const double *r, double singular, double *cov,
                                  double *open, uint32_t *n_open) {
    if (r == NULL || cov == NULL || open == NULL || n_open == NULL) {
        return GSID_E_NULL;
    }
    if (n == 0 || n > GSID_LSQ_COLUMNS_MAX || stride < n || !(singular >= 0 && singular <= 1)) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++) {
            if (!isfinite(r[(size_t)i * stride + j])) {
                return GSID_E_NONFINITE;
            }
        }
    }
    double *a = malloc(2 * (size_t)n * (n + 1) * sizeof *a);
    if (a == NULL) {
        return GSID_E_NO_MEMORY;
    }
    double *v = a + (size_t)n * n, *scale = v + (size_t)n * n;
    take_columns(n, stride, r, a, scale);
    const int is_done = gsid_singular_values(n, n, a, v);
    *n_open = add_up(n, a, v, scale, singular, cov, open);
    free(a);
    return is_done ? GSID_OK : GSID_MAX_ITER;
}
