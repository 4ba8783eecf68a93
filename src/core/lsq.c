#include "gsid/lsq.h"

#include <string.h>

#include "real.h"

/* Row i of the triangle of (A | b). */
static gsid_real *triangle_row(const gsid_lsq *q, uint32_t i) {
    return q->r + (size_t)i * (q->n_columns + 1);
}

static gsid_real column_length(const gsid_lsq *q, uint32_t column) {
    gsid_real length = 0;
    for (uint32_t i = 0; i <= column; i++) {
        length = gsid_hypot(length, triangle_row(q, i)[column]);
    }
    return length;
}

/* A pivot below this part of its column is rounding. */
static gsid_real rank_tolerance(const gsid_lsq *q) {
    return 8 * (gsid_real)(q->n_columns + 1) * GSID_EPSILON;
}

size_t gsid_lsq_mem_size(uint32_t n_columns) {
    return n_columns == 0 || n_columns > GSID_LSQ_COLUMNS_MAX ? 0 : GSID_LSQ_MEM_SIZE(n_columns);
}

gsid_status gsid_lsq_init(gsid_lsq *q, uint32_t n_columns, void *mem, size_t mem_size) {
    if (q == NULL || mem == NULL) {
        return GSID_E_NULL;
    }
    if (n_columns == 0 || n_columns > GSID_LSQ_COLUMNS_MAX) {
        return GSID_E_CONFIG;
    }
    if (mem_size < GSID_LSQ_MEM_SIZE(n_columns) || (uintptr_t)mem % sizeof(gsid_real) != 0) {
        return GSID_E_MEMORY;
    }
    q->n_columns = n_columns;
    q->r = (gsid_real *)mem;
    q->row = q->r + ((size_t)n_columns + 1) * ((size_t)n_columns + 1);
    return gsid_lsq_reset(q);
}

gsid_status gsid_lsq_reset(gsid_lsq *q) {
    if (q == NULL) {
        return GSID_E_NULL;
    }
    if (q->r == NULL) {
        return GSID_E_STATE;
    }
    const size_t n = (size_t)q->n_columns + 1;
    for (size_t i = 0; i < n * n; i++) {
        q->r[i] = 0;
    }
    q->n_rows = q->n_pinned = 0;
    return GSID_OK;
}

/* Rotation that turns (r, a), a not 0, into (length, 0). Near the ends of the range only ratios are squared. */
static gsid_real rotation(gsid_real r, gsid_real a, gsid_real *c, gsid_real *s) {
    const gsid_real sum = r * r + a * a;
    if (sum > GSID_SMALLEST / GSID_EPSILON && sum <= GSID_LARGEST) {
        const gsid_real length = gsid_sqrt(sum), inverse = 1 / length;
        *c = r * inverse;
        *s = a * inverse;
        return length;
    }
    if (gsid_fabs(r) >= gsid_fabs(a)) {
        const gsid_real t = a / r, root = gsid_sqrt(1 + t * t);
        *c = 1 / root;
        *s = t / root;
        return r * root;
    }
    const gsid_real t = r / a, root = gsid_sqrt(1 + t * t);
    *c = t / root;
    *s = 1 / root;
    return a * root;
}

/* Rotate q->row, from its column `first` on, into the triangle. */
static void rotate_in(gsid_lsq *q, uint32_t first) {
    const uint32_t n = q->n_columns;
    gsid_real *a = q->row;
    for (uint32_t i = first; i <= n; i++) {
        if (a[i] == 0) {
            continue;
        }
        gsid_real *r = triangle_row(q, i), c, s;
        r[i] = rotation(r[i], a[i], &c, &s);
        for (uint32_t j = i + 1; j <= n; j++) {
            const gsid_real rj = r[j];
            r[j] = c * rj + s * a[j];
            a[j] = c * a[j] - s * rj;
        }
    }
}

gsid_status gsid_lsq_add(gsid_lsq *q, const gsid_real *row, gsid_real rhs) {
    if (q == NULL || row == NULL) {
        return GSID_E_NULL;
    }
    if (q->r == NULL) {
        return GSID_E_STATE;
    }
    for (uint32_t i = 0; i < q->n_columns; i++) {
        if (!gsid_is_finite(row[i])) {
            return GSID_E_NONFINITE;
        }
    }
    if (!gsid_is_finite(rhs)) {
        return GSID_E_NONFINITE;
    }
    memcpy(q->row, row, q->n_columns * sizeof(*row));
    q->row[q->n_columns] = rhs;
    rotate_in(q, 0);
    q->n_rows = gsid_count(q->n_rows, 1);
    return GSID_OK;
}

static void rotate_in_rows(gsid_lsq *q, uint32_t first, gsid_real *block) {
    for (uint32_t t = 0; t < GSID_LSQ_BLOCK; t++) {
        for (uint32_t j = first; j <= q->n_columns; j++) {
            q->row[j] = block[(size_t)j * GSID_LSQ_BLOCK + t];
        }
        rotate_in(q, first);
    }
}

/* r <- r - s, x <- x - s v with s = tau (r + v'x): one column under the reflection 1 - tau (1, v)(1, v)'. */
static void reflect(gsid_real tau, const gsid_real *v, gsid_real *r, gsid_real *x) {
    gsid_real sum = *r;
    for (uint32_t t = 0; t < GSID_LSQ_BLOCK; t++) {
        sum += v[t] * x[t];
    }
    sum *= tau;
    *r -= sum;
    for (uint32_t t = 0; t < GSID_LSQ_BLOCK; t++) {
        x[t] -= sum * v[t];
    }
}

static int is_zero(const gsid_real *x) {
    for (uint32_t t = 0; t < GSID_LSQ_BLOCK; t++) {
        if (x[t] != 0) {
            return 0;
        }
    }
    return 1;
}

/* Householder's reflections, column by column; rotations where squares would leave the range. */
static void reflect_in(gsid_lsq *q, gsid_real *block) {
    const uint32_t n = q->n_columns;
    for (uint32_t i = 0; i <= n; i++) {
        gsid_real *r = triangle_row(q, i), *x = block + (size_t)i * GSID_LSQ_BLOCK, v[GSID_LSQ_BLOCK], sum = 0;
        for (uint32_t t = 0; t < GSID_LSQ_BLOCK; t++) {
            sum += x[t] * x[t];
        }
        if (sum == 0 && is_zero(x)) {
            continue;
        }
        const gsid_real length2 = r[i] * r[i] + sum;
        if (!(sum > GSID_SMALLEST / GSID_EPSILON && length2 <= GSID_LARGEST)) {
            rotate_in_rows(q, i, block);
            return;
        }
        const gsid_real length = gsid_sqrt(length2), pivot = gsid_fabs(r[i]) + length;
        const gsid_real scale = (r[i] < 0 ? GSID_R(-1.0) : GSID_R(1.0)) / pivot;
        for (uint32_t t = 0; t < GSID_LSQ_BLOCK; t++) {
            v[t] = x[t] * scale;
        }
        const gsid_real tau = pivot / length;
        for (uint32_t j = i + 1; j <= n; j++) {
            reflect(tau, v, &r[j], block + (size_t)j * GSID_LSQ_BLOCK);
        }
        r[i] = r[i] < 0 ? length : -length;
    }
}

gsid_status gsid_lsq_add_block(gsid_lsq *q, uint32_t n_rows, gsid_real *block) {
    if (q == NULL || block == NULL) {
        return GSID_E_NULL;
    }
    if (q->r == NULL) {
        return GSID_E_STATE;
    }
    if (n_rows > GSID_LSQ_BLOCK) {
        return GSID_E_CONFIG;
    }
    for (uint32_t j = 0; j <= q->n_columns; j++) {
        for (uint32_t t = 0; t < n_rows; t++) {
            if (!gsid_is_finite(block[(size_t)j * GSID_LSQ_BLOCK + t])) {
                return GSID_E_NONFINITE;
            }
        }
    }
    for (uint32_t j = 0; j <= q->n_columns; j++) {
        for (uint32_t t = n_rows; t < GSID_LSQ_BLOCK; t++) {
            block[(size_t)j * GSID_LSQ_BLOCK + t] = 0;
        }
    }
    reflect_in(q, block);
    q->n_rows = gsid_count(q->n_rows, n_rows);
    return GSID_OK;
}

/* Replace the equation whose pivot is only rounding by "unknown = 0"; its information on later unknowns is kept. */
static void pin(gsid_lsq *q, uint32_t column) {
    gsid_real *r = triangle_row(q, column);
    const gsid_real length = column_length(q, column);
    memcpy(q->row, r, ((size_t)q->n_columns + 1) * sizeof(*r));
    for (uint32_t j = column; j <= q->n_columns; j++) {
        r[j] = 0;
    }
    r[column] = length > 0 ? length : 1;
    rotate_in(q, column + 1);
    q->n_pinned++;
}

static void pin_undetermined(gsid_lsq *q, gsid_real rank_tol) {
    for (uint32_t j = 0; j < q->n_columns; j++) {
        if (gsid_fabs(triangle_row(q, j)[j]) <= rank_tol * column_length(q, j)) {
            pin(q, j);
        }
    }
}

gsid_status gsid_lsq_solve(gsid_lsq *q, gsid_real rank_tol, gsid_real *x, gsid_real *cost) {
    if (q == NULL || x == NULL) {
        return GSID_E_NULL;
    }
    if (q->r == NULL) {
        return GSID_E_STATE;
    }
    if (!(rank_tol >= 0)) {
        return GSID_E_CONFIG;
    }
    const uint32_t n = q->n_columns;
    if (q->n_rows < n) {
        return GSID_E_TOO_FEW;
    }
    const gsid_real tol = rank_tol > 0 ? rank_tol : rank_tolerance(q);
    pin_undetermined(q, tol);

    gsid_real *y = q->row; /* so that x is untouched when the solution overflows */
    for (uint32_t i = n; i-- > 0;) {
        const gsid_real *r = triangle_row(q, i);
        gsid_real sum = r[n];
        for (uint32_t j = i + 1; j < n; j++) {
            sum -= r[j] * y[j];
        }
        y[i] = sum / r[i];
        if (!gsid_is_finite(y[i])) {
            return GSID_E_NONFINITE;
        }
    }
    memcpy(x, y, n * sizeof(*x));
    if (cost != NULL) {
        const gsid_real residual = triangle_row(q, n)[n];
        *cost = residual * residual;
    }
    return q->n_pinned > 0 ? GSID_RANK : GSID_OK;
}

static gsid_status check_regular(const gsid_lsq *q) {
    if (q->r == NULL) {
        return GSID_E_STATE;
    }
    if (q->n_rows < q->n_columns) {
        return GSID_E_TOO_FEW;
    }
    if (q->n_pinned > 0) {
        return GSID_E_SINGULAR;
    }
    for (uint32_t j = 0; j < q->n_columns; j++) {
        if (!(gsid_fabs(triangle_row(q, j)[j]) > rank_tolerance(q) * column_length(q, j))) {
            return GSID_E_SINGULAR;
        }
    }
    return GSID_OK;
}

gsid_status gsid_lsq_solve_normal(const gsid_lsq *q, const gsid_real *c, gsid_real *x) {
    if (q == NULL || c == NULL || x == NULL) {
        return GSID_E_NULL;
    }
    const gsid_status status = check_regular(q);
    if (status != GSID_OK) {
        return status;
    }
    const uint32_t n = q->n_columns;
    gsid_real *y = q->row; /* so that x is untouched when the solution overflows */
    for (uint32_t i = 0; i < n; i++) { /* R' y = c */
        gsid_real sum = c[i];
        for (uint32_t j = 0; j < i; j++) {
            sum -= triangle_row(q, j)[i] * y[j];
        }
        y[i] = sum / triangle_row(q, i)[i];
    }
    for (uint32_t i = n; i-- > 0;) { /* R x = y */
        gsid_real sum = y[i];
        for (uint32_t j = i + 1; j < n; j++) {
            sum -= triangle_row(q, i)[j] * y[j];
        }
        y[i] = sum / triangle_row(q, i)[i];
        if (!gsid_is_finite(y[i])) {
            return GSID_E_NONFINITE;
        }
    }
    memcpy(x, y, n * sizeof(*x));
    return GSID_OK;
}

/* Variance of one unknown: the square of its row of R^-1, which q->row takes. */
static gsid_real variance_of(const gsid_lsq *q, uint32_t i) {
    gsid_real *row = q->row, sum2 = 0;
    for (uint32_t j = i; j < q->n_columns; j++) {
        gsid_real sum = i == j ? GSID_R(1.0) : GSID_R(0.0);
        for (uint32_t k = i; k < j; k++) {
            sum -= row[k] * triangle_row(q, k)[j];
        }
        row[j] = sum / triangle_row(q, j)[j];
        sum2 += row[j] * row[j];
    }
    return sum2;
}

/* No covariance is larger than the variances. */
static int is_covariance_in_range(const gsid_lsq *q) {
    for (uint32_t i = 0; i < q->n_columns; i++) {
        const gsid_real variance = variance_of(q, i);
        if (!(variance >= GSID_SMALLEST && variance <= GSID_LARGEST)) {
            return 0;
        }
    }
    return 1;
}

/* cov <- R^-1, upper triangular. */
static void invert_triangle(const gsid_lsq *q, gsid_real *cov) {
    const uint32_t n = q->n_columns;
    for (uint32_t j = 0; j < n; j++) {
        for (uint32_t i = j + 1; i-- > 0;) {
            gsid_real sum = i == j ? GSID_R(1.0) : GSID_R(0.0);
            for (uint32_t k = i + 1; k <= j; k++) {
                sum -= triangle_row(q, i)[k] * cov[k * n + j];
            }
            cov[i * n + j] = sum / triangle_row(q, i)[i];
        }
    }
}

gsid_status gsid_lsq_covariance(const gsid_lsq *q, gsid_real *cov) {
    if (q == NULL || cov == NULL) {
        return GSID_E_NULL;
    }
    const gsid_status status = check_regular(q);
    if (status != GSID_OK) {
        return status;
    }
    if (!is_covariance_in_range(q)) {
        return GSID_E_NONFINITE;
    }
    const uint32_t n = q->n_columns;
    invert_triangle(q, cov);
    /* R^-1 R^-T in place: entry (i, j) needs rows i and j from column j on, which later entries of row i do not touch. */
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = i; j < n; j++) {
            gsid_real sum = 0;
            for (uint32_t k = j; k < n; k++) {
                sum += cov[i * n + k] * cov[j * n + k];
            }
            cov[i * n + j] = sum;
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < i; j++) {
            cov[i * n + j] = cov[j * n + i];
        }
    }
    return GSID_OK;
}
