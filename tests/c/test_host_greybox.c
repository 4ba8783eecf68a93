/* Block-arrow least squares against the normal equations in long double, and SPQR against Givens rotations. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "gsid/host/build_info.h"
#include "gsid/host/greybox.h"

enum { RECORDS = 3, LOCAL = 2, SHARED = 4, COLUMNS = LOCAL + SHARED + 1, ROWS_MAX = 60 };
enum { N = RECORDS * LOCAL + SHARED + 1 };

static const uint32_t n_rows[RECORDS] = {60, 12, 35};
static double rows[RECORDS][ROWS_MAX * COLUMNS];
static const double *const row[RECORDS] = {rows[0], rows[1], rows[2]};
static const gsid_arrow arrow = {RECORDS, LOCAL, SHARED, n_rows, row};

static int fill_rows(void **state) {
    (void)state;
    uint64_t seed = 20260307;
    for (int r = 0; r < RECORDS; r++) {
        for (int i = 0; i < ROWS_MAX * COLUMNS; i++) {
            seed = seed * 6364136223846793005u + 1442695040888963407u;
            rows[r][i] = (double)(seed >> 11) * 0x1p-53 - 0.5;
        }
        for (int i = 0; i < ROWS_MAX; i++) {
            rows[r][i * COLUMNS + 3] *= 1e-6; /* columns of unequal length */
        }
    }
    return 0;
}

static long double gram(int i, int j) {
    long double sum = 0;
    for (int r = 0; r < RECORDS; r++) {
        for (uint32_t k = 0; k < n_rows[r]; k++) {
            long double entry[2];
            const int column[2] = {i, j};
            for (int e = 0; e < 2; e++) {
                const int own = column[e] - r * LOCAL, shared = column[e] - RECORDS * LOCAL;
                const int at = shared >= 0 ? LOCAL + shared : own >= 0 && own < LOCAL ? own : -1;
                entry[e] = at < 0 ? 0 : (long double)rows[r][(int)k * COLUMNS + at];
            }
            sum += entry[0] * entry[1];
        }
    }
    return sum;
}

/* R'R = A'A to rounding of columns of these lengths; zero below the diagonal, which is not negative. */
static void assert_triangle(const double *t) {
    for (int i = 0; i < N; i++) {
        assert_true(t[i * N + i] >= 0);
        for (int j = 0; j < i; j++) {
            assert_true(t[i * N + j] == 0);
        }
        for (int j = 0; j < N; j++) {
            long double sum = 0;
            for (int k = 0; k < N; k++) {
                sum += (long double)t[k * N + i] * t[k * N + j];
            }
            const long double size = sqrtl(gram(i, i) * gram(j, j));
            assert_true(fabsl(sum - gram(i, j)) <= 200 * DBL_EPSILON * size);
        }
    }
}

static void triangles_are_those_of_the_whole_matrix(void **state) {
    (void)state;
    double by_build[N * N], dense[N * N];
    assert_int_equal(gsid_arrow_reduce(&arrow, by_build), GSID_OK);
    assert_int_equal(gsid_arrow_reduce_dense(&arrow, dense), GSID_OK);
    assert_triangle(by_build);
    assert_triangle(dense);
    for (int i = 0; i < N - 1; i++) { /* conditions of this matrix, columns scaled, are below 100 */
        for (int j = i; j < N; j++) {
            const double length = sqrt((double)gram(j, j));
            assert_true(fabs(by_build[i * N + j] - dense[i * N + j]) <= 1e-12 * length);
        }
    }
}

static void a_column_of_zeros_is_kept(void **state) {
    (void)state;
    double by_build[N * N], dense[N * N];
    for (int r = 0; r < RECORDS; r++) {
        for (int i = 0; i < ROWS_MAX; i++) {
            rows[r][i * COLUMNS + LOCAL + 2] = 0;
        }
    }
    assert_int_equal(gsid_arrow_reduce(&arrow, by_build), GSID_OK);
    assert_int_equal(gsid_arrow_reduce_dense(&arrow, dense), GSID_OK);
    assert_triangle(by_build);
    assert_triangle(dense);
    fill_rows(state);
}

static void without_own_unknowns(void **state) {
    (void)state;
    const gsid_arrow shared_only = {RECORDS, 0, COLUMNS - 1, n_rows, row};
    double by_build[COLUMNS * COLUMNS], dense[COLUMNS * COLUMNS];
    assert_int_equal(gsid_arrow_reduce(&shared_only, by_build), GSID_OK);
    assert_int_equal(gsid_arrow_reduce_dense(&shared_only, dense), GSID_OK);
    for (int i = 0; i < COLUMNS * COLUMNS; i++) {
        assert_true(fabs(by_build[i] - dense[i]) <= 1e-12);
    }
}

static void refusals(void **state) {
    (void)state;
    double t[N * N], untouched[N * N];
    memset(t, 0x5A, sizeof t);
    memcpy(untouched, t, sizeof t);
    const uint32_t few[RECORDS] = {4, 3, 3};
    gsid_status (*const reduce[2])(const gsid_arrow *, double *) = {gsid_arrow_reduce, gsid_arrow_reduce_dense};
    for (int i = 0; i < 2; i++) {
        gsid_arrow wrong = arrow;
        assert_int_equal(reduce[i](NULL, t), GSID_E_NULL);
        assert_int_equal(reduce[i](&arrow, NULL), GSID_E_NULL);
        wrong.n_rows = NULL;
        assert_int_equal(reduce[i](&wrong, t), GSID_E_NULL);
        wrong = arrow;
        wrong.n_shared = 0;
        assert_int_equal(reduce[i](&wrong, t), GSID_E_CONFIG);
        wrong.n_shared = UINT32_MAX;
        assert_int_equal(reduce[i](&wrong, t), GSID_E_CONFIG);
        wrong = arrow;
        wrong.n_rows = few;
        assert_int_equal(reduce[i](&wrong, t), GSID_E_TOO_FEW);
        const double kept = rows[2][7];
        rows[2][7] = NAN;
        assert_int_equal(reduce[i](&arrow, t), GSID_E_NONFINITE);
        rows[2][7] = kept;
    }
    assert_memory_equal(t, untouched, sizeof t);
}

/* Rosenbrock's valley; least in x <= 0.5 is at (0.5, 0.25). */
static double valley(unsigned n, const double *x, double *gradient, void *user) {
    (void)n;
    (*(int *)user)++;
    const double a = 1 - x[0], b = x[1] - x[0] * x[0];
    if (gradient != NULL) {
        gradient[0] = -2 * a - 400 * x[0] * b;
        gradient[1] = 200 * b;
    }
    return a * a + 100 * b * b;
}

static void minimum_on_a_bound(void **state) {
    (void)state;
    const double lower[2] = {-2, -2}, upper[2] = {0.5, 2};
    double x[2] = {-1.2, 1}, least = -1;
    int calls = 0;
    const gsid_status status = gsid_minimise(2, valley, &calls, lower, upper, 1e-14, 500, x, &least);
    if (gsid_build_library_version("nlopt")[0] == '\0') {
        assert_int_equal(status, GSID_E_BACKEND);
        return;
    }
    assert_int_equal(status, GSID_OK);
    assert_true(calls > 2 && fabs(least - 0.25) < 1e-9);
    assert_true(fabs(x[0] - 0.5) < 1e-6 && fabs(x[1] - 0.25) < 1e-5);
    assert_int_equal(gsid_minimise(2, NULL, &calls, lower, upper, 1e-14, 500, x, &least), GSID_E_NULL);
}

static double no_number(unsigned n, const double *x, double *gradient, void *user) {
    (void)x;
    (void)user;
    for (unsigned i = 0; gradient != NULL && i < n; i++) {
        gradient[i] = NAN;
    }
    return NAN;
}

/* A bug: a function without a number gave GSID_MAX_ITER, and NaN for x. */
static void a_search_that_fails_leaves_the_outputs(void **state) {
    (void)state;
    const double lower[2] = {-2, -2}, upper[2] = {0.5, 2}, nan[2] = {NAN, 0};
    double x[2] = {-1.2, 1}, least = -1;
    int calls = 0;
    const int has_nlopt = gsid_build_library_version("nlopt")[0] != '\0';
    assert_int_equal(gsid_minimise(2, no_number, NULL, lower, upper, 1e-9, 50, x, &least),
                     has_nlopt ? GSID_E_NONFINITE : GSID_E_BACKEND);
    assert_true(x[0] == -1.2 && x[1] == 1 && least == -1);
    assert_int_equal(gsid_minimise(0, valley, &calls, lower, upper, 1e-9, 50, x, &least), GSID_E_CONFIG);
    x[0] = 0.6;
    assert_int_equal(gsid_minimise(2, valley, &calls, lower, upper, 1e-9, 50, x, &least), GSID_E_CONFIG);
    assert_int_equal(gsid_minimise(2, valley, &calls, nan, upper, 1e-9, 50, x, &least), GSID_E_CONFIG);
    x[0] = INFINITY;
    assert_int_equal(gsid_minimise(2, valley, &calls, lower, upper, 1e-9, 50, x, &least), GSID_E_NONFINITE);
    assert_true(calls == 0 && least == -1);
}

static void a_covariance_is_the_inverse_of_the_normal_equations(void **state) {
    (void)state;
    /* R'R = ((4, 2), (2, 10)), whose determinant is 36; the row of the triangle is longer than the unknowns. */
    const double r[6] = {2, 1, 99, 0, 3, 99};
    double cov[4], open[2];
    uint32_t n_open;
    assert_int_equal(gsid_arrow_covariance(2, 3, r, 1e-6, cov, open, &n_open), GSID_OK);
    const double want[4] = {10.0 / 36, -2.0 / 36, -2.0 / 36, 4.0 / 36};
    for (int i = 0; i < 4; i++) {
        assert_true(fabs(cov[i] - want[i]) < 1e-15);
    }
    assert_true(n_open == 0 && open[0] == 0 && open[1] == 0);
}

static void a_direction_that_is_not_determined_is_left_out(void **state) {
    (void)state;
    /* The second column is three times the first, the third is 0: only x0 + 3 x1 is known, with variance 1/4. */
    const double r[9] = {2, 6, 0, 0, 0, 0, 0, 0, 0};
    double cov[9], open[3];
    uint32_t n_open;
    assert_int_equal(gsid_arrow_covariance(3, 3, r, 1e-6, cov, open, &n_open), GSID_OK);
    assert_int_equal(n_open, 2);
    assert_true(fabs(cov[0] + 6 * cov[1] + 9 * cov[4] - 0.25) < 1e-15 && cov[8] == 0);
    assert_true(fabs(open[0] - sqrt(0.5)) < 1e-15 && fabs(open[1] - sqrt(0.5)) < 1e-15 && open[2] == 1);
}

static void a_covariance_of_no_numbers_is_refused(void **state) {
    (void)state;
    const double r[1] = {2}, nan_[1] = {NAN};
    double cov[1] = {-7}, open[1];
    uint32_t n_open;
    assert_int_equal(gsid_arrow_covariance(1, 1, NULL, 0, cov, open, &n_open), GSID_E_NULL);
    assert_int_equal(gsid_arrow_covariance(1, 1, r, 0, cov, open, NULL), GSID_E_NULL);
    assert_int_equal(gsid_arrow_covariance(0, 1, r, 0, cov, open, &n_open), GSID_E_CONFIG);
    assert_int_equal(gsid_arrow_covariance(1, 0, r, 0, cov, open, &n_open), GSID_E_CONFIG);
    assert_int_equal(gsid_arrow_covariance(1, 1, r, NAN, cov, open, &n_open), GSID_E_CONFIG);
    assert_int_equal(gsid_arrow_covariance(1, 1, nan_, 0, cov, open, &n_open), GSID_E_NONFINITE);
    assert_true(cov[0] == -7);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_covariance_is_the_inverse_of_the_normal_equations),
        cmocka_unit_test(a_direction_that_is_not_determined_is_left_out),
        cmocka_unit_test(a_covariance_of_no_numbers_is_refused),
        cmocka_unit_test(triangles_are_those_of_the_whole_matrix),
        cmocka_unit_test(a_column_of_zeros_is_kept),
        cmocka_unit_test(without_own_unknowns),
        cmocka_unit_test(refusals),
        cmocka_unit_test(minimum_on_a_bound),
        cmocka_unit_test(a_search_that_fails_leaves_the_outputs),
    };
    printf("suitesparse: %s\n", gsid_build_library_version("suitesparse"));
    return cmocka_run_group_tests(tests, fill_rows, NULL);
}
