/* Columns of laws along a motion against closed forms: mean of a sign over a cell, Coulomb, Dahl between reversals, a hard
 * stop, maps of the command. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "gsid/catalogue.h"
#include "gsid/host/law_columns.h"

#define PI 3.14159265358979323846
enum { N = 1000, P = GSID_EFFECT_PARAMETERS_MAX };

static double angle[N], rate[N], acceleration[N], side[N], out[3 * N];
static const double swing = 1.5, step_s = 1e-3; /* one period of 1 s */
static gsid_law_motion motion = {N, 1e-3, PI / 180, angle, rate, side, NULL};

static void near(double got, double want, double tolerance) {
    if (!(fabs(got - want) <= tolerance)) {
        fail_msg("got %.12g, want %.12g +- %g", got, want, tolerance);
    }
}

/* angle = swing sin: it turns round at a quarter and three quarters of the period, between samples with a shift. */
static int swinging(void **state) {
    (void)state;
    for (int i = 0; i < N; i++) {
        const double t = (i + 0.3) * step_s, w = 2 * PI;
        angle[i] = swing * sin(w * t);
        rate[i] = swing * w * cos(w * t);
        acceleration[i] = -w * w * angle[i];
    }
    assert_int_equal(gsid_law_side(N, step_s, rate, acceleration, side), GSID_OK);
    return 0;
}

static void side_is_the_mean_of_the_sign_over_a_cell(void **state) {
    (void)state;
    const double v[] = {-1.0, -0.1, 0.0, 0.25, 1.0}, a[] = {1.0, 1.0, 1.0, -1.0, 0.0};
    double mean[5];
    assert_int_equal(gsid_law_side(5, 1.0, v, a, mean), GSID_OK);
    for (int i = 0; i < 5; i++) { /* the sign of v + a t over t = -1/2 .. 1/2, by many points */
        double sum = 0;
        for (int k = 0; k < 100000; k++) {
            const double x = v[i] + a[i] * ((k + 0.5) / 100000 - 0.5);
            sum += x > 0 ? 1 : x < 0 ? -1 : 0;
        }
        near(mean[i], sum / 100000, 1e-4);
    }
}

static void coulomb_has_the_mean_of_its_fourier_line(void **state) {
    (void)state;
    const double values[P] = {3.0};
    assert_int_equal(gsid_law_torques(gsid_catalogue_find("coulomb_friction"), NULL, &motion, 1, values, out), GSID_OK);
    double re = 0, im = 0; /* sign(cos): 4/pi cos - 4/(3 pi) cos(3 w t) + ...; here its 21st harmonic */
    for (int i = 0; i < N; i++) {
        const double phase = 2 * PI * 21 * (i + 0.3) * step_s;
        re += out[i] * cos(phase) * 2 / N;
        im += out[i] * sin(phase) * 2 / N;
    }
    near(re, 3.0 * 4 / (21 * PI), 2e-4); /* sampled without the mean over cells it is 2e-3 off */
    near(im, 0, 2e-4);
}

static void stribeck_is_the_mean_of_both_directions_at_a_reversal(void **state) {
    (void)state;
    const double values[P] = {2.0, 1.0, 0.5};
    assert_int_equal(gsid_law_torques(gsid_catalogue_find("stribeck_friction"), NULL, &motion, 1, values, out),
                     GSID_OK);
    for (int i = 0; i < N; i++) {
        const double x = rate[i] / 0.5;
        near(out[i], (2 + exp(-x * x)) * side[i], 1e-12);
    }
}

/* Dahl on a swing between +-A: z = 1 - c exp(-k (theta + A)) on the way up, with the c that repeats. */
static void presliding_repeats_and_follows_its_closed_form_between_reversals(void **state) {
    (void)state;
    const double stiffness[] = {0.05, 0.8, 40.0};
    double values[3][P] = {{0}};
    for (int k = 0; k < 3; k++) {
        values[k][0] = 2.0;
        values[k][1] = stiffness[k];
    }
    assert_int_equal(gsid_law_torques(gsid_catalogue_find("presliding_friction"), NULL, &motion, 3, values[0], out),
                     GSID_OK);
    for (int k = 0; k < 3; k++) {
        const double c = 2 / (1 + exp(-2 * stiffness[k] * swing));
        for (int i = 0; i < N; i++) {
            const double s = rate[i] > 0 ? 1 : -1, path = swing + s * angle[i];
            near(out[k * N + i], 2.0 * s * (1 - c * exp(-stiffness[k] * path)), 2e-5 * (1 + stiffness[k]));
        }
    }
}

/* Bouc-Wen with equal rates is Dahl; with others it repeats, and dz = (1 - rate side z) dtheta holds from sample to sample. */
static void bouc_wen_contains_dahl_and_follows_its_equation(void **state) {
    (void)state;
    static double dahl[N];
    const double level[P] = {2.0, 0.8}, values[2][P] = {{1.6, 0.8, 0.8}, {1.0, 1.9, -0.3}};
    assert_int_equal(gsid_law_torques(gsid_catalogue_find("presliding_friction"), NULL, &motion, 1, level, dahl),
                     GSID_OK);
    assert_int_equal(gsid_law_torques(gsid_catalogue_find("bouc_wen"), NULL, &motion, 2, values[0], out), GSID_OK);
    double largest = 0;
    for (int i = 0; i < N; i++) {
        near(out[i], dahl[i], 1e-12);
        const double z = out[N + i], next = out[N + (i + 1) % N], path = angle[(i + 1) % N] - angle[i];
        const double side_here = path > 0 ? 1 : -1, mid = 0.5 * (z + next);
        const double by_angle = 1 - (side_here * mid < 0 ? 1.9 : -0.3) * side_here * mid;
        near(next - z, by_angle * path, rate[i] * rate[(i + 1) % N] < 0 || z * next < 0 ? 1e-4 : 1e-6);
        largest = fmax(largest, fabs(z));
    }
    assert_true(largest > swing);
}

static void hard_stop_acts_beyond_its_edges(void **state) {
    (void)state;
    const double values[P] = {1.2, 50.0};
    assert_int_equal(gsid_law_torques(gsid_catalogue_find("hard_stop"), NULL, &motion, 1, values, out), GSID_OK);
    for (int i = 0; i < N; i++) {
        near(out[i], 50 * (fmax(angle[i] - 1.2, 0) + fmin(angle[i] + 1.2, 0)), 1e-9);
    }
}

/* level sin(cycles angle + phase), whose derivative by the phase is the torque a quarter of a turn on; of friction, which is a
 * mean of two directions, the derivative by the level is the torque of level 1. */
static void a_slope_is_the_derivative_by_one_value(void **state) {
    (void)state;
    const double cogging[2][P] = {{3.0, 80.0, 0.4}, {1.0, 200.0, 0.0}}, friction[P] = {2.5};
    static double slope[2 * N];
    const gsid_effect *effect = gsid_catalogue_find("motor_cogging");
    assert_int_equal(gsid_law_torques_and_slopes(effect, NULL, &motion, 2, cogging[0], 2, out, slope), GSID_OK);
    for (int k = 0; k < 2; k++) {
        for (int i = 0; i < N; i++) {
            const double at = cogging[k][1] * PI / 180 * angle[i] + cogging[k][2];
            near(out[k * N + i], cogging[k][0] * sin(at), 1e-12);
            near(slope[k * N + i], cogging[k][0] * cos(at), 1e-12);
        }
    }
    effect = gsid_catalogue_find("coulomb_friction");
    assert_int_equal(gsid_law_torques_and_slopes(effect, NULL, &motion, 1, friction, 0, out, slope), GSID_OK);
    for (int i = 0; i < N; i++) {
        near(2.5 * slope[i], out[i], 1e-12);
    }
}

static void commands_of_several_sizes_are_mapped_at_once(void **state) {
    (void)state;
    const double u[] = {-3.0, -0.4, 0.0, 0.6, 2.0};
    const double values[2][P] = {{0.5}, {1.0}};
    const double want[] = {-2.5, 0, 0, 0.1, 1.5, -2, 0, 0, 0, 1};
    double mapped[10];
    assert_int_equal(gsid_law_commands(gsid_catalogue_find("drive_dead_zone"), NULL, 5, u, 2, values[0], mapped),
                     GSID_OK);
    for (int i = 0; i < 10; i++) {
        near(mapped[i], want[i], 1e-12);
    }
}

static void what_has_no_column_is_refused(void **state) {
    (void)state;
    const double values[P] = {1.0, 1.0, 1.0, 1.0};
    const gsid_effect *backlash = gsid_catalogue_find("gear_backlash"), *spring = gsid_catalogue_find("cable_spring");
    assert_int_equal(gsid_law_torques(backlash, NULL, &motion, 1, values, out), GSID_E_CONFIG);
    assert_int_equal(gsid_law_torques(spring, NULL, &motion, 1, values, out), GSID_E_CONFIG);
    assert_int_equal(gsid_law_torques(NULL, NULL, &motion, 1, values, out), GSID_E_NULL);
    const gsid_effect *memory = gsid_catalogue_find("bouc_wen"), *cogging = gsid_catalogue_find("motor_cogging");
    assert_int_equal(gsid_law_torques_and_slopes(memory, NULL, &motion, 1, values, 0, out, out + N), GSID_E_CONFIG);
    assert_int_equal(gsid_law_torques_and_slopes(cogging, NULL, &motion, 1, values, 3, out, out + N), GSID_E_CONFIG);
    assert_int_equal(gsid_law_torques_and_slopes(cogging, NULL, &motion, 1, values, 0, out, NULL), GSID_E_NULL);
    assert_int_equal(gsid_law_commands(spring, NULL, N, rate, 1, values, out), GSID_E_CONFIG);
    assert_int_equal(gsid_law_commands(spring, NULL, N, NULL, 1, values, out), GSID_E_NULL);
    assert_int_equal(gsid_law_side(0, step_s, rate, acceleration, side), GSID_E_CONFIG);
    assert_int_equal(gsid_law_side(N, step_s, NULL, acceleration, side), GSID_E_NULL);
}

static void an_axis_at_rest_has_no_presliding_torque(void **state) {
    (void)state;
    const double rest[4] = {0}, values[P] = {2.0, 10.0};
    const gsid_law_motion still = {4, 1e-3, 1, rest, rest, rest, NULL};
    assert_int_equal(gsid_law_torques(gsid_catalogue_find("presliding_friction"), NULL, &still, 1, values, out),
                     GSID_OK);
    for (int i = 0; i < 4; i++) {
        near(out[i], 0, 1e-15);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(side_is_the_mean_of_the_sign_over_a_cell),
        cmocka_unit_test_setup(coulomb_has_the_mean_of_its_fourier_line, swinging),
        cmocka_unit_test_setup(stribeck_is_the_mean_of_both_directions_at_a_reversal, swinging),
        cmocka_unit_test_setup(presliding_repeats_and_follows_its_closed_form_between_reversals, swinging),
        cmocka_unit_test_setup(bouc_wen_contains_dahl_and_follows_its_equation, swinging),
        cmocka_unit_test_setup(hard_stop_acts_beyond_its_edges, swinging),
        cmocka_unit_test_setup(a_slope_is_the_derivative_by_one_value, swinging),
        cmocka_unit_test(commands_of_several_sizes_are_mapped_at_once),
        cmocka_unit_test_setup(what_has_no_column_is_refused, swinging),
        cmocka_unit_test(an_axis_at_rest_has_no_presliding_torque),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
