/* Response of structures against closed forms, and their refinement from values that are off. */
#include <complex.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "../../src/host/structure.h"

#define PI 3.14159265358979323846
enum { N = 120, COLUMNS = 3, THETA = 5 };

static const double sample_s = 1e-3;
static double w[N], weight[N];
static gsid_cplx hold[N], column[(COLUMNS + 1) * N], g[N], torque[N];
static gsid_structure_lines lines = {N, w, hold, 1e-3, 0, 0, NULL, NULL, NULL};

/* Viscous body, a mode, a lag, modes above the band; the output is the angle. */
static const gsid_structure rich = {1, 1, 1, 1, 1};
static const double truth[THETA] = {2.3, 5.9, -3.5, -6.5, 1.3e-3}, gains[COLUMNS + 1] = {7, -2, 0.01, 3};

static int on_lines(void **state) {
    (void)state;
    for (int l = 0; l < N; l++) {
        w[l] = 2 * PI * (1 + 2.5 * l);
        hold[l] = (gsid_cplx){1, 0};
        weight[l] = 1;
        torque[l] = (gsid_cplx){cos(3.0 * l), sin(5.0 * l)};
    }
    lines.has_images = 0;
    lines.torque = NULL;
    return 0;
}

static double complex at(const gsid_cplx *z) {
    return z->re + I * z->im;
}

static void near(double complex got, double complex want, double tolerance) {
    if (!(cabs(got - want) <= tolerance * cabs(want))) {
        fail_msg("got %.12g %+.12g j, want %.12g %+.12g j", creal(got), cimag(got), creal(want), cimag(want));
    }
}

static void columns_are_those_of_the_formula(void **state) {
    (void)state;
    assert_int_equal(gsid_structure_columns(&rich, &lines, truth, column), GSID_OK);
    for (int l = 0; l < N; l++) {
        const double complex s = I * w[l], w0 = exp(truth[1]);
        const double complex shared = cexp(-s * truth[4]) / s / (1 + exp(truth[3]) * s);
        near(at(&column[l]), shared / (s + exp(truth[0])), 1e-12);
        near(at(&column[N + l]), shared * s / (s * s + 2 * exp(truth[2]) * w0 * s + w0 * w0), 1e-12);
        near(at(&column[2 * N + l]), shared * s, 1e-12);
    }
}

/* A held first-order system, sampled: (1 - a) / c / (z - a), a = exp(-c h); two samples later with a delay. */
static void images_make_the_sampled_response(void **state) {
    (void)state;
    const gsid_structure body = {0, 1, 0, 0, 0};
    const double c = 10, a = exp(-c * sample_s), theta[2] = {log(c), 2 * sample_s};
    for (int l = 0; l < N; l++) {
        const double complex response = (1 - cexp(-I * w[l] * sample_s)) / (I * w[l] * sample_s);
        hold[l] = (gsid_cplx){creal(response), cimag(response)};
    }
    lines.has_images = 1;
    assert_int_equal(gsid_structure_columns(&body, &lines, theta, column), GSID_OK);
    for (int l = 0; l < N; l++) {
        const double complex z = cexp(I * w[l] * sample_s);
        near(at(&column[l]), (1 - a) / c / (z - a) / (z * z), 1e-9);
    }
}

static void respond(const gsid_structure *structure, const double *theta, double complex *response) {
    const int n_columns = (int)gsid_structure_n_columns(structure, &lines);
    assert_int_equal(gsid_structure_columns(structure, &lines, theta, column), GSID_OK);
    for (int l = 0; l < N; l++) {
        response[l] = 0;
        for (int c = 0; c < n_columns; c++) {
            response[l] += gains[c] * at(&column[c * N + l]);
        }
    }
}

static void check_slopes(const gsid_structure *structure, uint32_t n_theta, const double *theta) {
    static double complex up[N], down[N];
    static gsid_cplx slope[GSID_STRUCTURE_THETA_MAX * N];
    assert_int_equal(gsid_structure_n_theta(structure), n_theta);
    assert_int_equal(gsid_structure_columns(structure, &lines, theta, column), GSID_OK);
    assert_int_equal(gsid_structure_slopes(structure, &lines, theta, column, gains, slope), GSID_OK);
    for (uint32_t i = 0; i < n_theta; i++) {
        double moved[GSID_STRUCTURE_THETA_MAX];
        const double step = i == n_theta - 1 ? 1e-9 : 1e-6;
        memcpy(moved, theta, n_theta * sizeof *theta);
        moved[i] = theta[i] + step;
        respond(structure, moved, up);
        moved[i] = theta[i] - step;
        respond(structure, moved, down);
        for (int l = 0; l < N; l++) {
            const double complex want = (up[l] - down[l]) / (2 * step);
            assert_true(cabs(at(&slope[i * N + l]) - want) <= 1e-5 * cabs(want) + 1e-13 * cabs(up[l]) / step);
        }
    }
}

static void slopes_are_those_of_differences(void **state) {
    (void)state;
    for (int q = -1; q <= 1; q++) {
        const gsid_structure sprung = {q, 2, 1, 1, 0}, viscous = {q, 1, 1, 1, 1}, free_body = {q, 0, 1, 0, 0};
        const double of_sprung[6] = {3.0, 6.8, 5.9, -3.5, -6.5, 1.3e-3};
        check_slopes(&sprung, 6, of_sprung);
        check_slopes(&viscous, 5, truth);
        check_slopes(&free_body, 3, (const double[]){5.9, -3.5, 1.3e-3});
    }
}

/* No hold, delay or image: the torque is that of the measured motion. */
static void a_torque_has_the_response_of_body_and_lags(void **state) {
    (void)state;
    for (int has_images = 0; has_images <= 1; has_images++) {
        lines.has_images = has_images;
        lines.torque = torque;
        assert_int_equal(gsid_structure_n_columns(&rich, &lines), COLUMNS + 1);
        assert_int_equal(gsid_structure_columns(&rich, &lines, truth, column), GSID_OK);
        for (int l = 0; l < N; l++) {
            const double complex s = I * w[l];
            near(at(&column[COLUMNS * N + l]), -at(&torque[l]) / s / (1 + exp(truth[3]) * s) / (s + exp(truth[0])),
                 1e-12);
        }
    }
    lines.has_images = 0;
    check_slopes(&rich, THETA, truth);
    check_slopes(&(gsid_structure){1, 2, 1, 1, 0}, 6, (const double[]){3.0, 6.8, 5.9, -3.5, -6.5, 1.3e-3});
}

static void a_refinement_finds_the_values(void **state) {
    static double complex response[N];
    double theta[THETA], gain[COLUMNS + 1], cost;
    lines.torque = *state;
    respond(&rich, truth, response);
    for (int l = 0; l < N; l++) {
        g[l] = (gsid_cplx){creal(response[l]), cimag(response[l])};
        weight[l] = 1e3 / cabs(response[l]);
    }
    memcpy(theta, truth, sizeof theta);
    assert_int_equal(gsid_structure_refine(&rich, &lines, g, weight, 0, theta, gain, &cost), GSID_OK);
    assert_memory_equal(theta, truth, sizeof theta); /* the gains alone */
    assert_true(cost < 1e-12);
    theta[1] += 0.02;
    theta[2] += 0.3;
    theta[4] += 1e-4;
    assert_int_equal(gsid_structure_refine(&rich, &lines, g, weight, 30, theta, gain, &cost), GSID_OK);
    assert_true(cost < 1e-3);
    for (int i = 0; i < THETA; i++) {
        assert_true(fabs(theta[i] - truth[i]) < 1e-4);
    }
    for (uint32_t c = 0; c < gsid_structure_n_columns(&rich, &lines); c++) {
        assert_true(fabs(gain[c] / gains[c] - 1) < 1e-3);
    }
}

static void a_refinement_finds_the_values_beside_a_torque(void **state) {
    (void)state;
    void *with = torque;
    a_refinement_finds_the_values(&with);
}

/* Two modes at one frequency are one: the second gets no gain. */
static void columns_that_are_alike_do_not_end_a_refinement(void **state) {
    (void)state;
    const gsid_structure twins = {0, 0, 2, 0, 0};
    double theta[5] = {5.9, -3.5, 5.9, -3.5, 0}, gain[3], cost;
    for (int l = 0; l < N; l++) {
        g[l] = (gsid_cplx){1, 0.1 * l};
        weight[l] = 1;
    }
    assert_int_equal(gsid_structure_refine(&twins, &lines, g, weight, 30, theta, gain, &cost), GSID_OK);
    assert_true(isfinite(cost) && isfinite(gain[1]) && isfinite(gain[2]));
}

static void a_start_without_a_response_has_an_infinite_cost(void **state) {
    (void)state;
    double theta[THETA] = {1000, 5.9, -3.5, -6.5, 1.3e-3}, gain[COLUMNS], cost;
    theta[4] = INFINITY;
    assert_int_equal(gsid_structure_refine(&rich, &lines, g, weight, 5, theta, gain, &cost), GSID_OK);
    assert_true(cost == INFINITY);
}

static void wrong_arguments_are_refused(void **state) {
    (void)state;
    gsid_structure many = rich;
    gsid_structure_lines none = lines;
    double theta[THETA] = {0}, gain[COLUMNS], cost;
    many.n_modes = GSID_STRUCTURE_MODES_MAX + 1;
    none.n = 0;
    assert_int_equal(gsid_structure_columns(&many, &lines, truth, column), GSID_E_CONFIG);
    assert_int_equal(gsid_structure_columns(&rich, &none, truth, column), GSID_E_CONFIG);
    assert_int_equal(gsid_structure_columns(&rich, &lines, NULL, column), GSID_E_NULL);
    assert_int_equal(gsid_structure_slopes(&rich, &lines, truth, column, NULL, column), GSID_E_NULL);
    assert_int_equal(gsid_structure_refine(&rich, NULL, g, weight, 1, theta, gain, &cost), GSID_E_NULL);
    none = lines;
    none.n_fractions = 1;
    assert_int_equal(gsid_structure_columns(&rich, &none, truth, column), GSID_E_NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(columns_are_those_of_the_formula, on_lines),
        cmocka_unit_test_setup(images_make_the_sampled_response, on_lines),
        cmocka_unit_test_setup(slopes_are_those_of_differences, on_lines),
        cmocka_unit_test_setup(a_torque_has_the_response_of_body_and_lags, on_lines),
        cmocka_unit_test_setup(a_refinement_finds_the_values, on_lines),
        cmocka_unit_test_setup(a_refinement_finds_the_values_beside_a_torque, on_lines),
        cmocka_unit_test_setup(columns_that_are_alike_do_not_end_a_refinement, on_lines),
        cmocka_unit_test_setup(a_start_without_a_response_has_an_infinite_cost, on_lines),
        cmocka_unit_test_setup(wrong_arguments_are_refused, on_lines),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
