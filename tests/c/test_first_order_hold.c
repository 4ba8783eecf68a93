/* Plants whose command runs linearly from one sample to the next: closed form, periodic state, sensitivities. */
#include "plant_bench.h"

#ifdef GSID_SINGLE
#define FINE 2e-5 /* rounding of a few hundred samples */
#define PERIODIC_TOL 1e-3
#else
#define FINE 1e-11
#define PERIODIC_TOL 1e-8
#define DIFFERENCE 1e-5 /* differences of a float simulation are rounding only */
#define SLOPE_TOL 1e-6
#endif

enum { N = 600 };
static bench b;
static gsid_real u[N], y[N], dy[FREE_MAX][N];

static void start(void) {
    bench_clear(&b);
    b.cfg.first_order_hold = 1;
}

/* A command that jumps to 10 rises over one sample, and turns a free axis by gain u (t - 1/2 sample) from then on. */
static void a_free_axis_follows_the_closed_form(void **state) {
    (void)state;
    const double samples[] = {0.0, 0.25, 1.0, 1.5, 16.2, 63.99, 255.9};
    for (size_t k = 0; k < sizeof samples / sizeof samples[0]; k++) {
        start();
        bench_add_with(&b, "rigid_body", 2.0, 0, 0);
        bench_add_with(&b, "transport_delay", samples[k] / FS, 0, 0);
        bench_init(&b);
        for (int n = 0; n < 300; n++) {
            const double t = fmax(0.0, n - samples[k]), rate = 20.0 * (t < 1 ? t * t / 2 : t - 0.5) / FS;
            gsid_real out;
            assert_int_equal(gsid_plant_step(&b.plant, GSID_R(10.0), &out, NULL), GSID_OK);
            assert_near((double)out, rate, FINE);
        }
    }
}

static void start_rich_stack(void) {
    start();
    bench_add_source(&b);
    bench_add_with(&b, "drive_saturation", 60, 0, 0);
    bench_add_with(&b, "coulomb_friction", 15, 0, 0);
    bench_add_with(&b, "cubic_spring", 10, 0, 0);
    bench_add_with(&b, "motor_lag", 1e-3, 0, 0);
    for (uint32_t n = 0; n < N; n++) {
        u[n] = (gsid_real)bench_command(N, n, 50);
    }
}

/* A step takes the command that is reached at its end. */
static void one_more_period_repeats_the_answer(void **state) {
    (void)state;
    gsid_real residual, out;
    const double delays[] = {0.0, 5.0, 16.2};
    for (size_t k = 0; k < sizeof delays / sizeof delays[0]; k++) {
        start_rich_stack();
        b.item[0].value[0] = (gsid_real)(delays[k] / FS);
        bench_init(&b);
        assert_int_equal(gsid_plant_periodic(&b.plant, N, u, 2, 10, y, NULL, NULL, NULL, &residual), GSID_OK);
        for (int n = 0; n < N; n++) {
            assert_int_equal(gsid_plant_step(&b.plant, u[(n + 1) % N], &out, NULL), GSID_OK);
            assert_near((double)out, (double)y[n], (double)residual + 10 * FINE);
        }
    }
}

/* The commands under way at the start are those of several periods. */
static void a_period_may_be_shorter_than_the_delay(void **state) {
    (void)state;
    enum { SHORT = 9 };
    gsid_real residual, out = 0;
    start();
    bench_add_source(&b);
    b.item[0].value[0] = (gsid_real)(50.3 / FS);
    for (uint32_t n = 0; n < SHORT; n++) {
        u[n] = (gsid_real)bench_command(SHORT, n, 50);
    }
    bench_init(&b);
    assert_int_equal(gsid_plant_periodic(&b.plant, SHORT, u, 2, 10, y, NULL, NULL, NULL, &residual), GSID_OK);
    assert_int_equal(gsid_plant_reset(&b.plant), GSID_OK);
    for (int n = 0; n < 2000 * SHORT; n++) {
        assert_int_equal(gsid_plant_step(&b.plant, u[(n + 1) % SHORT], &out, NULL), GSID_OK);
        if (n >= 1999 * SHORT) {
            assert_near((double)out, (double)y[n % SHORT], (double)residual + 100 * FINE);
        }
    }
}

/* With a joint, the motor follows the command; a sensor that is held is refreshed within the steps. */
static void play_and_a_held_sensor_see_the_line_between_commands(void **state) {
    (void)state;
    gsid_real residual, out;
    start();
    bench_add_with(&b, "rigid_body", 7.4, 0, 0);
    bench_add_with(&b, "viscous_friction", 11, 0, 0);
    bench_add_with(&b, "cable_spring", 170, 0, 0);
    bench_add(&b, "gear_backlash");
    bench_add_with(&b, "sensor_sample_hold", 375, 0, 0);
    for (uint32_t n = 0; n < N; n++) {
        u[n] = (gsid_real)bench_command(N, n, 50);
    }
    bench_init(&b);
    assert_true(gsid_plant_periodic(&b.plant, N, u, 2, 10, y, NULL, NULL, NULL, &residual) >= 0);
    for (int n = 0; n < N; n++) {
        assert_int_equal(gsid_plant_step(&b.plant, u[(n + 1) % N], &out, NULL), GSID_OK);
        assert_near((double)out, (double)y[n], (double)residual + 100 * FINE);
    }
}

/* Periods of the same command through _step: the sensitivities settle to those of the periodic answer. */
static void periodic_sensitivities_are_those_reached_by_stepping(void **state) {
    (void)state;
    start_rich_stack();
    bench_free_all(&b);
    bench_init(&b);
    assert_int_equal(gsid_plant_periodic(&b.plant, N, u, 2, 10, y, dy[0], NULL, NULL, NULL), GSID_OK);
    bench_compare_stepped(&b, N, u, 1, repeats(30, 3), dy[0], PERIODIC_TOL);
}

#ifndef GSID_SINGLE
static void periodic_answer(uint32_t p, double factor, gsid_real *answer) {
    start_rich_stack();
    bench_free_all(&b);
    const gsid_plant_free one = b.free_parameter[p];
    b.item[one.item].value[one.parameter] *= (gsid_real)factor;
    b.cfg.n_free = 0;
    bench_init(&b);
    assert_int_equal(gsid_plant_periodic(&b.plant, N, u, 2, 10, answer, NULL, NULL, NULL, NULL), GSID_OK);
}

/* The delay moves the line between two commands, the limit of the drive its ends. */
static void periodic_sensitivities_are_those_by_differences(void **state) {
    (void)state;
    static double below[N], above[N];
    start_rich_stack();
    bench_free_all(&b);
    bench_init(&b);
    const uint32_t n_free = b.cfg.n_free;
    assert_int_equal(gsid_plant_periodic(&b.plant, N, u, 2, 10, y, dy[0], NULL, NULL, NULL), GSID_OK);
    for (uint32_t p = 0; p < n_free; p++) {
        const gsid_plant_free one = b.free_parameter[p];
        const double value = (double)b.item[one.item].value[one.parameter];
        periodic_answer(p, 1 - DIFFERENCE, below);
        periodic_answer(p, 1 + DIFFERENCE, above);
        double largest = 0, worst = 0;
        for (int n = 0; n < N; n++) {
            const double slope = (double)(above[n] - below[n]) / (2 * DIFFERENCE * value);
            largest = fmax(largest, fabs(slope));
            worst = fmax(worst, fabs(slope - (double)dy[p][n]));
        }
        assert_true(largest > 0);
        if (!(worst <= SLOPE_TOL * largest)) {
            fail_msg("free parameter %u: off by %.3g of %.3g", p, worst / largest, largest);
        }
        start_rich_stack();
        bench_free_all(&b);
    }
}
#endif

/* Moves of one period of a body with friction, whose command has the torque of a gain of 1000. */
static uint64_t moves_of(double gain, int first_order_hold, double lag_s) {
    uint64_t left = UINT64_MAX;
    bench_clear(&b);
    b.cfg.first_order_hold = first_order_hold;
    b.cfg.moves_left = &left;
    bench_add_with(&b, "rigid_body", gain, 0, 0);
    bench_add_with(&b, "viscous_friction", 11, 0, 0);
    bench_add_with(&b, "coulomb_friction", 15, 0, 0);
    if (lag_s > 0) {
        bench_add_with(&b, "motor_lag", lag_s, 0, 0);
    }
    for (uint32_t n = 0; n < N; n++) {
        u[n] = (gsid_real)(bench_command(N, n, 50) / gain * 1000);
    }
    bench_init(&b);
    assert_int_equal(gsid_plant_periodic(&b.plant, N, u, 2, 10, y, NULL, NULL, NULL, NULL), GSID_OK);
    return UINT64_MAX - left;
}

/* The unit of the command has no influence: a gain of a million took 200 times the moves, one of ten million was too steep. */
static void bug_the_gain_of_a_body_counted_as_a_rate(void **state) {
    (void)state;
    const double lag_s[] = {0, 1e-3, 1e-3};
    for (int k = 0; k < 3; k++) { /* rounding moves an event */
        const double small = (double)moves_of(1e2, k != 1, lag_s[k]);
        assert_near((double)moves_of(1e7, k != 1, lag_s[k]), small, 0.01 * small);
    }
}

/* A controller's clock holds its command. */
static void a_controller_is_refused(void **state) {
    (void)state;
    start();
    bench_add_with(&b, "position_velocity_loop", 4, 2, 0);
    bench_add_source(&b);
    assert_int_equal(gsid_plant_init(&b.plant, &b.cfg, b.memory.bytes, sizeof b.memory), GSID_E_CONFIG);
    b.cfg.first_order_hold = 0;
    bench_init(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_free_axis_follows_the_closed_form),
        cmocka_unit_test(one_more_period_repeats_the_answer),
        cmocka_unit_test(a_period_may_be_shorter_than_the_delay),
        cmocka_unit_test(play_and_a_held_sensor_see_the_line_between_commands),
        cmocka_unit_test(periodic_sensitivities_are_those_reached_by_stepping),
#ifndef GSID_SINGLE
        cmocka_unit_test(periodic_sensitivities_are_those_by_differences),
#endif
        cmocka_unit_test(bug_the_gain_of_a_body_counted_as_a_rate),
        cmocka_unit_test(a_controller_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
