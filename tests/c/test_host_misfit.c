/* Misfit and comparison against closed forms, and what they refuse. Tail functions: tests/python/test_tail.py. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "gsid/host/compare.h"

#define N 6

static const gsid_cplx error[N] = {{2, 0}, {0.5, -1}, {0, 0.25}, {3, 4}, {-1, 1}, {0.1, 0}};
static const double variance[N] = {1, 0.5, 2, 4, 1, 0.25}, dof[N] = {3, 3, 3, INFINITY, 7, 1};
static const double f_hz[N] = {0, 1, 2, 3, 8, 40};
static const gsid_cplx y[N] = {{1, 0}, {1, 0}, {1, 0}, {1, 0}, {1, 0}, {1, 0}};

static void assert_near(double found, double want, double rel) {
    if (!(fabs(found - want) <= rel * fabs(want))) {
        fail_msg("%.17g, not %.17g", found, want);
    }
}

static void tails_have_closed_forms(void **state) {
    (void)state;
    gsid_tail t;
    assert_int_equal(gsid_tail_gamma(1, 3, &t), GSID_OK);
    assert_near(t.upper, exp(-3), 1e-14);
    assert_int_equal(gsid_tail_gamma(2, 1e5, &t), GSID_OK);
    assert_true(t.upper == 0 && t.lower == 1);
    assert_near(t.log_upper, -1e5 + log1p(1e5), 1e-15);
    assert_int_equal(gsid_tail_beta(1, 4, 0.25, 0.75, &t), GSID_OK);
    assert_near(t.upper, pow(0.75, 4), 1e-14);
    assert_near(t.lower + t.upper, 1, 1e-15);
    assert_int_equal(gsid_tail_f(2, 6, 5, &t), GSID_OK);
    assert_near(t.upper, pow(1 + 5.0 / 3, -3), 1e-14);
    assert_int_equal(gsid_tail_chi2(1, 4, &t), GSID_OK);
    assert_near(t.upper, erfc(sqrt(2)), 1e-13);
}

static void a_known_model_leaves_the_scores_of_its_errors(void **state) {
    (void)state;
    const uint8_t real[N] = {1};
    const gsid_misfit_lines lines = {N, error, variance, dof, NULL, real, 0, NULL};
    gsid_misfit found;
    gsid_tail tail;
    gsid_cplx left[N];
    double ratio[N], score[N];
    assert_int_equal(gsid_misfit_test(&lines, left, ratio, &found), GSID_OK);
    assert_memory_equal(left, error, sizeof left);
    double sum = 0;
    for (int k = 0; k < N; k++) {
        assert_near(ratio[k], (error[k].re * error[k].re + error[k].im * error[k].im) / variance[k], 1e-14);
        score[k] = isinf(dof[k]) ? ratio[k] : dof[k] * log(1 + ratio[k] / dof[k]);
    }
    /* Student's t with 3 degrees of freedom, both sides */
    const double t = sqrt(ratio[0] / 3);
    score[0] = -log(1 - 2 / acos(-1) * (atan(t) + t / (1 + t * t)));
    for (int k = 0; k < N; k++) {
        sum += 2 * score[k];
    }
    assert_near(found.chi2, sum, 1e-13);
    assert_true(found.n_dof == 2 * N && found.moved == 0);
    assert_int_equal(gsid_misfit_tail(&found, 1e3, &tail), GSID_OK); /* at least one degree of freedom is left */
    assert_near(tail.upper, erfc(sqrt(sum / 2)), 1e-12);
}

static void a_fitted_parameter_takes_less_where_variances_are_estimated(void **state) {
    (void)state;
    const double two_periods[2] = {1, 1}, mixed[3] = {1, 3, INFINITY};
    assert_near(gsid_misfit_taken(2, two_periods), 0.5, 1e-15);
    assert_near(gsid_misfit_taken(3, mixed), (0.5 + 0.75 + 1) / 3, 1e-15);
    assert_true(gsid_misfit_taken(0, NULL) == 1);
}

static void an_uncertain_model_moves_by_ridge_regression(void **state) {
    (void)state;
    /* One direction, known variances: z = w a'e / (1 + w a'a), and e'(S + A A')^-1 e by Sherman and Morrison. */
    const gsid_cplx a[N] = {{1, 2}, {0, 1}, {-1, 0}, {2, 2}, {0.5, 0}, {1, -1}};
    double known[N], ae = 0, aa = 0, ee = 0;
    for (int k = 0; k < N; k++) {
        const double w = 2 / variance[k];
        known[k] = INFINITY;
        ae += w * (a[k].re * error[k].re + a[k].im * error[k].im);
        aa += w * (a[k].re * a[k].re + a[k].im * a[k].im);
        ee += w * (error[k].re * error[k].re + error[k].im * error[k].im);
    }
    const gsid_misfit_lines lines = {N, error, variance, known, NULL, NULL, 1, a};
    gsid_misfit found;
    gsid_cplx left[N];
    assert_int_equal(gsid_misfit_test(&lines, left, NULL, &found), GSID_OK);
    const double z = ae / (1 + aa);
    assert_near(found.moved, z * z, 1e-13);
    assert_near(found.chi2, ee - ae * z, 1e-13);
    assert_near(left[3].re, 3 - 2 * z, 1e-13);
    assert_true(found.n_dof == 2 * N);
    const gsid_misfit_lines estimated = {N, error, variance, dof, variance, NULL, 1, a};
    double n_dof = 2 * N;
    for (int k = 0; k < N; k++) {
        const double h = 2 / variance[k] * (a[k].re * a[k].re + a[k].im * a[k].im) / (1 + aa);
        n_dof += h / (dof[k] + 1);
    }
    assert_int_equal(gsid_misfit_test(&estimated, left, NULL, &found), GSID_OK);
    assert_near(found.n_dof, n_dof, 1e-13);
}

static void no_noise_gives_a_finite_misfit(void **state) {
    (void)state;
    const double none[N] = {0}, known[N] = {INFINITY, INFINITY, INFINITY, INFINITY, INFINITY, INFINITY};
    const gsid_misfit_lines lines = {N, error, none, known, NULL, NULL, 0, NULL};
    gsid_misfit found;
    gsid_tail tail;
    assert_int_equal(gsid_misfit_test(&lines, NULL, NULL, &found), GSID_OK);
    assert_true(isfinite(found.chi2));
    assert_int_equal(gsid_misfit_tail(&found, 0, &tail), GSID_OK);
    assert_true(tail.upper == 0 && isfinite(tail.log_upper) && tail.log_upper < -1e300);
}

static gsid_compare_data data_of(const gsid_misfit_lines *lines, const uint8_t *kind) {
    const gsid_compare_data data = {*lines, 1, NULL, f_hz, kind, y, 0};
    return data;
}

static void one_band_is_named(void **state) {
    (void)state;
    const gsid_cplx e[N] = {{0.5, 0}, {0.5, 0}, {0.5, 0}, {1000, 0}, {0.5, 0}, {0.5, 0}};
    const double one[N] = {1, 1, 1, 1, 1, 1}, known[N] = {INFINITY, INFINITY, INFINITY, INFINITY, INFINITY, INFINITY};
    const uint8_t kind[N] = {0, 0, 1, 1, 0, 2}, real[N] = {1};
    const gsid_misfit_lines lines = {N, e, one, known, NULL, real, 0, NULL};
    const gsid_compare_data data = data_of(&lines, kind);
    gsid_compare_band band[2];
    gsid_comparison found;
    double ratio[N];
    assert_int_equal(gsid_compare(&data, 0.05, 2, band, ratio, &found), GSID_OK);
    assert_int_equal(found.n_bands, 1);
    assert_true(band[0].kind == GSID_LINE_ODD && band[0].f_lo_hz == 3 && band[0].f_hi_hz == 3 && band[0].n_lines == 1);
    assert_near(band[0].share, 1, 1e-15);
    assert_near(band[0].db, 60, 1e-14);
    assert_near(band[0].log_p_value, -1e6 + log(6), 1e-12); /* one of 6 cells: Holm */
    assert_true(found.p_value == 0 && found.log_p_value < -9e5 && isfinite(found.log_p_value));
    assert_near(found.rms_error, sqrt(0.25 + 0.5 * (4 * 0.25 + 1e6)), 1e-14);
    assert_near(found.noise_floor_rms, sqrt(1 + 0.5 * 5), 1e-15);
    assert_near(found.cost_per_dof, (5 * 0.25 + 1e6) / N, 1e-14);
    assert_int_equal(gsid_compare(&data, 0.05, 0, NULL, NULL, &found), GSID_OK);
    assert_int_equal(found.n_bands, 1);
}

static void what_cannot_be_is_refused(void **state) {
    (void)state;
    const gsid_misfit_lines good = {N, error, variance, dof, NULL, NULL, 0, NULL};
    gsid_misfit_lines bad = good;
    const double negative[N] = {-1, 1, 1, 1, 1, 1}, nan_[N] = {NAN, 1, 1, 1, 1, 1}, zero[N] = {0};
    gsid_misfit found = {-7, -7, -7};
    assert_int_equal(gsid_misfit_test(NULL, NULL, NULL, &found), GSID_E_NULL);
    assert_int_equal(gsid_misfit_test(&good, NULL, NULL, NULL), GSID_E_NULL);
    bad.variance = negative;
    assert_int_equal(gsid_misfit_test(&bad, NULL, NULL, &found), GSID_E_CONFIG);
    bad.variance = nan_;
    assert_int_equal(gsid_misfit_test(&bad, NULL, NULL, &found), GSID_E_NONFINITE);
    bad = good;
    bad.dof = zero;
    assert_int_equal(gsid_misfit_test(&bad, NULL, NULL, &found), GSID_E_CONFIG);
    bad = good;
    bad.n_directions = 1;
    assert_int_equal(gsid_misfit_test(&bad, NULL, NULL, &found), GSID_E_NULL);
    assert_true(found.moved == -7);
    gsid_compare_data data = data_of(&good, NULL);
    gsid_comparison result;
    memset(&result, 0, sizeof result);
    assert_int_equal(gsid_compare(&data, 0.05, 0, NULL, NULL, NULL), GSID_E_NULL);
    assert_int_equal(gsid_compare(&data, 0.05, 1, NULL, NULL, &result), GSID_E_NULL);
    assert_int_equal(gsid_compare(&data, 1, 0, NULL, NULL, &result), GSID_E_CONFIG);
    data.n_fitted = -1;
    assert_int_equal(gsid_compare(&data, 0.05, 0, NULL, NULL, &result), GSID_E_CONFIG);
    const uint32_t too_many[2] = {N, 1};
    data = data_of(&good, NULL);
    data.n_records = 2;
    data.n_of = too_many;
    assert_int_equal(gsid_compare(&data, 0.05, 0, NULL, NULL, &result), GSID_E_CONFIG);
    data.n_of = NULL;
    assert_int_equal(gsid_compare(&data, 0.05, 0, NULL, NULL, &result), GSID_E_NULL);
    data = data_of(&good, NULL);
    data.f_hz = nan_;
    assert_int_equal(gsid_compare(&data, 0.05, 0, NULL, NULL, &result), GSID_E_NONFINITE);
    assert_int_equal(result.n_bands, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tails_have_closed_forms),
        cmocka_unit_test(a_known_model_leaves_the_scores_of_its_errors),
        cmocka_unit_test(a_fitted_parameter_takes_less_where_variances_are_estimated),
        cmocka_unit_test(an_uncertain_model_moves_by_ridge_regression),
        cmocka_unit_test(no_noise_gives_a_finite_misfit),
        cmocka_unit_test(one_band_is_named),
        cmocka_unit_test(what_cannot_be_is_refused),
    };
    return cmocka_run_group_tests_name("host misfit", tests, NULL, NULL);
}
