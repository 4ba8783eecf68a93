/* The simulated axis: its linear part against closed forms and the analytic response to a held input; what its drive and
 * its gyro do; what is refused. Its other laws are in test_host_axis_laws.c. */
#include <complex.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "axis_bench.h"

/* Rate of the rigid body and of the mode after a unit step, both of the form amplitude exp(-decay t) sin(wd t) / wd. */
static double ringing(double t, double amplitude, double decay, double w0_squared) {
    const double wd = sqrt(w0_squared - decay * decay);
    return t <= 0.0 ? 0.0 : amplitude * exp(-decay * t) * sin(wd * t) / wd;
}

static double step_response(const gsid_axis_cfg *cfg, double t) {
    const double w0 = 2.0 * PI * cfg->mode_f_hz;
    return ringing(t, cfg->gain, 0.5 * cfg->viscous_rate, cfg->spring_stiffness) +
           ringing(t, cfg->mode_residue * cfg->gain, cfg->mode_zeta * w0, w0 * w0);
}

static void step_and_free_decay_follow_the_closed_form(void **state) {
    (void)state;
    gsid_axis_cfg cfg = quiet();
    cfg.delay_s = cfg.gyro_lag_s = 0.0;
    step_of(10.0, 1500);
    memset(u + 1500, 0, 4500 * sizeof *u);
    run(&cfg, 6000);
    for (uint32_t i = 0; i < 6000; i++) {
        const double t = i / cfg.fs_hz, back = t - 0.5;
        /* rounding of 6000 steps of a state of size 6 */
        assert_near(y[i], 10.0 * (step_response(&cfg, t) - step_response(&cfg, back)), 1e-12);
    }
}

/* The same step, whatever the delay: any fraction of a tick, none, and fractions next to none. */
static void delay_is_any_fraction_of_a_tick(void **state) {
    (void)state;
    const double ticks[] = {0.0, 1e-9, 0.2, 0.5, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 16.2, 16.9999, 63.0, 63.999};
    step_of(10.0, 300);
    for (size_t k = 0; k < sizeof ticks / sizeof ticks[0]; k++) {
        gsid_axis_cfg cfg = quiet();
        cfg.gyro_lag_s = 0.0;
        cfg.delay_s = ticks[k] / cfg.fs_hz;
        run(&cfg, 300);
        for (uint32_t i = 0; i < 300; i++) {
            assert_near(y[i], 10.0 * step_response(&cfg, i / cfg.fs_hz - cfg.delay_s), 1e-12);
        }
    }
}

static void overdamped_and_springless_axes_follow_the_closed_form(void **state) {
    (void)state;
    gsid_axis_cfg cfg = rigid();
    cfg.spring_stiffness = 0.0;
    cfg.gyro_lag_s = 0.002;
    step_of(5.0, 3000);
    run(&cfg, 3000);
    const double v = cfg.viscous_rate, lag = cfg.gyro_lag_s, final = 5.0 * cfg.gain / v;
    for (uint32_t i = 0; i < 3000; i++) {
        const double t = i / cfg.fs_hz, slow = exp(-v * t), fast = exp(-t / lag);
        assert_near(y[i], final * (1.0 - (slow - v * lag * fast) / (1.0 - v * lag)), 1e-12);
        assert_near(angle[i], final * (t - (1.0 - slow) / v), 1e-12);
    }
    cfg.viscous_rate = cfg.gyro_lag_s = 0.0;
    run(&cfg, 3000);
    assert_near(y[2999], 5.0 * cfg.gain * 2999 / cfg.fs_hz, 1e-11);
}

/* One-sided spectrum of the last n samples at a line. */
static double complex line_of(const double *x, uint32_t n, uint32_t line) {
    double complex sum = 0.0;
    for (uint32_t i = 0; i < n; i++) {
        sum += x[i] * cexp(-2.0 * I * PI * (double)((uint64_t)i * line % n) / n);
    }
    return 2.0 * sum / n;
}

static double complex continuous_response(const gsid_axis_cfg *cfg, double w) {
    const double complex s = I * w;
    const double w0 = 2.0 * PI * cfg->mode_f_hz;
    const double complex body = s / (s * s + cfg->viscous_rate * s + cfg->spring_stiffness);
    const double complex mode = cfg->mode_residue * s / (s * s + 2.0 * cfg->mode_zeta * w0 * s + w0 * w0);
    return cfg->gain * (body + mode) * cexp(-s * cfg->delay_s) / (1.0 + cfg->gyro_lag_s * s);
}

/* Held input: the line and all its aliases, each through the hold. They fall as 1/m^3 in the rigid body and the lag. */
static double complex held_response(const gsid_axis_cfg *cfg, double w) {
    double complex sum = 0.0;
    for (int m = 20000; m >= 0; m--) {
        for (int sign = m > 0 ? -1 : 1; sign <= 1; sign += 2) {
            const double wm = w + sign * m * 2.0 * PI * cfg->fs_hz, phase = wm / cfg->fs_hz;
            sum += continuous_response(cfg, wm) * (1.0 - cexp(-I * phase)) / (I * phase);
        }
    }
    return sum;
}

static void sine_steady_state_is_the_held_input_response(void **state) {
    (void)state;
    const gsid_axis_cfg cfg = quiet();
    const uint32_t n = 3000, n_settle = 21000; /* slowest decay 5.5 1/s: exp(-5.5 * 7) = 2e-17 */
    const uint32_t lines[] = {1, 2, 30, 178, 179, 180, 700, 1400};
    for (uint32_t i = 0; i < n_settle + n; i++) {
        u[i] = 0.0;
        for (size_t k = 0; k < 8; k++) {
            u[i] += cos(2.0 * PI * (double)(i * lines[k] % n) / n + (double)k);
        }
    }
    run(&cfg, n_settle + n);
    for (size_t k = 0; k < 8; k++) {
        const double complex g = line_of(y + n_settle, n, lines[k]) / line_of(u + n_settle, n, lines[k]);
        const double complex want = held_response(&cfg, 2.0 * PI * lines[k] * cfg.fs_hz / n);
        /* the aliases left out add less than 1e-5 / 20000^2; DFT rounding 1e-13 of the largest line, 2 */
        assert_near(cabs(g - want), 0.0, 1e-12);
    }
}

/* ---- command and sensor ---- */

static void command_is_clipped_and_rounded(void **state) {
    (void)state;
    gsid_axis_cfg cfg;
    gsid_axis_cfg_init(&cfg);
    const double step = 2.0 * 179.0 / 4096.0;
    for (uint32_t i = 0; i < 4000; i++) {
        u[i] = -250.0 + 0.125 * i;
    }
    run(&cfg, 4000);
    for (uint32_t i = 0; i < 4000; i++) {
        assert_true(fabs(u_applied[i]) <= 179.0);
        assert_near(u_applied[i] / step, round(u_applied[i] / step), 1e-9);
        if (fabs(u[i]) <= 179.0) {
            assert_near(u_applied[i], u[i], 0.5 * step * (1 + 1e-12));
        } else {
            assert_true(u_applied[i] == (u[i] > 0 ? 179.0 : -179.0));
        }
    }
}

/* The drive's laws are no dynamics: the same axis driven by what is left of the command. */
static void the_drive_has_a_dead_zone_and_a_limit(void **state) {
    (void)state;
    static double driven[6000];
    gsid_axis_cfg cfg = quiet();
    cfg.drive_dead_zone = 2.0;
    cfg.drive_limit = 5.0;
    for (uint32_t i = 0; i < 6000; i++) {
        u[i] = 12.0 * sin(2.0 * PI * 7.0 * i / cfg.fs_hz);
    }
    run(&cfg, 6000);
    memcpy(driven, y, sizeof driven);
    assert_memory_equal(u_applied, u, 6000 * sizeof *u); /* the drive keeps it to itself */
    for (uint32_t i = 0; i < 6000; i++) {
        u[i] = u[i] > 2.0 ? fmin(u[i] - 2.0, 5.0) : u[i] < -2.0 ? fmax(u[i] + 2.0, -5.0) : 0.0;
    }
    cfg.drive_dead_zone = cfg.drive_limit = 0.0;
    run(&cfg, 6000);
    assert_memory_equal(driven, y, sizeof driven);
}

/* Between refreshes the last one is shown, also when it fell inside a tick (400 Hz: every 7.5 ticks). */
static void a_slow_gyro_shows_its_last_refresh(void **state) {
    (void)state;
    const double rates_hz[] = {400.0, 750.0, 3000.0};
    step_of(10.0, 3000);
    for (size_t k = 0; k < 3; k++) {
        gsid_axis_cfg cfg = quiet();
        cfg.gyro_lag_s = 0.0;
        cfg.gyro_refresh_hz = rates_hz[k];
        run(&cfg, 3000);
        for (uint32_t i = 0; i < 3000; i++) {
            const double refreshed_s = floor(i * rates_hz[k] / 3000.0 + 1e-9) / rates_hz[k];
            assert_near(y[i], 10.0 * step_response(&cfg, refreshed_s - cfg.delay_s), 1e-12);
        }
    }
}

static void a_slow_gyro_holds_its_noise(void **state) {
    (void)state;
    gsid_axis_cfg cfg = quiet();
    cfg.noise_rms = 0.1;
    cfg.gyro_refresh_hz = 400.0;
    memset(u, 0, 3000 * sizeof *u);
    run(&cfg, 3000);
    uint32_t n_changes = 0;
    for (uint32_t i = 1; i < 3000; i++) {
        n_changes += y[i] != y[i - 1];
    }
    assert_int_equal(n_changes, 399); /* 400 refreshes, the first at tick 0 */
}

/* 400.02 Hz: the instants drift through the tick by 0.005 %, from a first one that the seed sets. The response is that of
 * the closed form at the last instant of n / 400.02 Hz + start. */
static void a_free_running_gyro_drifts_through_the_ticks(void **state) {
    (void)state;
    step_of(10.0, 3000);
    double starts[20];
    for (uint32_t seed = 0; seed < 20; seed++) {
        gsid_axis_cfg cfg = quiet();
        cfg.gyro_lag_s = 0.0;
        cfg.gyro_refresh_hz = 400.02;
        cfg.gyro_free_running = 1;
        cfg.seed = seed;
        run(&cfg, 3000);
        uint32_t changes = 0, last = 0, first = 0;
        for (uint32_t i = 17; i < 3000; i++) {
            if (y[i] != y[i - 1]) {
                first = changes++ == 0 ? i : first;
                last = i;
            }
        }
        const double period = 3000.0 / 400.02, n = round((last - first) / period);
        assert_true(changes - 1 == n);
        /* the start that agrees with the closed form at one refresh agrees at all */
        double low = (first - 1) / 3000.0, high = first / 3000.0;
        for (int k = 0; k < 60; k++) {
            const double middle = 0.5 * (low + high);
            *(fabs(10.0 * step_response(&cfg, middle - cfg.delay_s)) < fabs(y[first]) ? &low : &high) = middle;
        }
        for (uint32_t i = first; i < 3000; i++) {
            const double since = floor((i / 3000.0 - low) * 400.02 + 1e-9) / 400.02;
            assert_near(y[i], 10.0 * step_response(&cfg, low + since - cfg.delay_s), 1e-9);
        }
        starts[seed] = fmod(low * 400.02, 1.0);
    }
    double lowest = 1.0, highest = 0.0;
    for (uint32_t seed = 0; seed < 20; seed++) {
        lowest = fmin(lowest, starts[seed]);
        highest = fmax(highest, starts[seed]);
    }
    assert_true(lowest < 0.2 && highest > 0.8);
}

/* Variance of the rate of w' = torque - viscous w, with the torque of an AR(1) sequence held over each tick:
 * the stationary solution of the two-state difference equation. */
static void process_noise_moves_the_axis_as_much_as_its_theory_says(void **state) {
    (void)state;
    gsid_axis_cfg cfg = rigid();
    cfg.spring_stiffness = 0.0;
    cfg.viscous_rate = 200.0;
    cfg.torque_noise_rms = 50.0;
    cfg.torque_noise_hz = 100.0;
    memset(u, 0, N_MAX * sizeof *u);
    const double a = exp(-200.0 / 3000.0), b = (1.0 - a) / 200.0, p = exp(-2.0 * PI * 100.0 / 3000.0), s2 = 2500.0;
    const double cross = b * p * s2 / (1.0 - a * p); /* E w torque */
    const double want = (b * b * s2 + 2.0 * a * b * cross) / (1.0 - a * a);
    double sum = 0.0;
    uint32_t n = 0;
    for (uint64_t seed = 0; seed < 5; seed++) {
        cfg.seed = seed;
        run(&cfg, N_MAX);
        for (uint32_t i = 1000; i < N_MAX; i++, n++) {
            sum += y[i] * y[i];
        }
    }
    assert_near(sum / n / want, 1.0, 0.05); /* about 10 000 independent values: sigma 1.5 % */
}

static void the_command_of_a_tick_shows_in_the_next_sample(void **state) {
    (void)state;
    const gsid_axis_cfg cfg = rigid();
    memset(u, 0, 10 * sizeof *u);
    u[3] = 1.0;
    run(&cfg, 10);
    assert_true(y[3] == 0.0);
    assert_true(y[4] > 0.0);
}

static void the_seed_decides_the_noise(void **state) {
    (void)state;
    static double again[2000];
    gsid_axis_cfg cfg;
    gsid_axis *axis;
    gsid_axis_cfg_init(&cfg);
    step_of(1.0, 2000);
    run(&cfg, 2000);
    assert_int_equal(gsid_axis_create(&axis, &cfg), GSID_OK);
    for (int pass = 0; pass < 2; pass++) { /* in blocks of odd size, and again after a reset */
        for (uint32_t at = 0, n; at < 2000; at += n) {
            n = at + 37 <= 2000 ? 37 : 2000 - at;
            assert_int_equal(gsid_axis_step(axis, n, u + at, NULL, again + at, NULL), GSID_OK);
        }
        assert_memory_equal(again, y, sizeof again);
        gsid_axis_reset(axis);
    }
    gsid_axis_destroy(axis);
    cfg.seed++;
    run(&cfg, 2000);
    for (uint32_t i = 0; i < 2000; i++) {
        assert_true(again[i] != y[i]);
    }
}

static void noise_has_its_rms_and_its_colour(void **state) {
    (void)state;
    gsid_axis_cfg cfg = quiet();
    gsid_axis *axis;
    const uint32_t n_blocks = (uint32_t)repeats(10, 1);
    memset(u, 0, sizeof u);
    for (int low = 0; low < 2; low++) {
        cfg.noise_rms = low ? 0.0 : 0.02;
        cfg.noise_low_rms = low ? 0.03 : 0.0;
        cfg.noise_low_hz = 5.0;
        const double pole = low ? exp(-2.0 * PI * 5.0 / cfg.fs_hz) : 0.0, rms = low ? 0.03 : 0.02;
        double square = 0.0, sum = 0.0, innovation = 0.0, inside = 0.0;
        assert_int_equal(gsid_axis_create(&axis, &cfg), GSID_OK);
        for (uint32_t block = 0; block < n_blocks; block++) {
            gsid_axis_step(axis, N_MAX, u, NULL, y, NULL);
            for (uint32_t i = 0; i < N_MAX; i++) {
                sum += y[i];
                square += y[i] * y[i];
                if (i > 0) {
                    innovation += (y[i] - pole * y[i - 1]) * (y[i] - pole * y[i - 1]);
                }
                inside += fabs(y[i]) < rms;
            }
        }
        gsid_axis_destroy(axis);
        /* independent values: all 4e5 when white, one per 2 / (1 - pole) = 190 samples when coloured; 4 sigma */
        const double n = (double)n_blocks * N_MAX, n_free = low ? n * (1.0 - pole) / 2.0 : n;
        assert_near(sum / n, 0.0, 4.0 * rms / sqrt(n_free));
        assert_near(square / n, rms * rms, 4.0 * rms * rms * sqrt(2.0 / n_free));
        assert_near(inside / n, 0.6827, 4.0 * 0.47 / sqrt(n_free));
        /* the part that is new each tick is white: its size gives the pole to 1e-3 */
        const double fresh = rms * rms * (1.0 - pole * pole);
        assert_near(innovation / n, fresh, 4.0 * fresh * sqrt(2.0 / n));
    }
}

static void the_fan_keeps_its_phase_for_three_hours(void **state) {
    (void)state;
    gsid_axis_cfg cfg = quiet();
    gsid_axis *axis;
    cfg.fs_hz = 40.0; /* as many turns as at 3 kHz, in fewer ticks */
    cfg.fan_f_hz = 30.9;
    cfg.fan_amplitude = 1.0;
    cfg.fan_phase_rad = 0.3;
    memset(u, 0, sizeof u);
    assert_int_equal(gsid_axis_create(&axis, &cfg), GSID_OK);
    for (int block = 0; block < 11; block++) { /* 11 * 40000 / 40 Hz = 3.06 h */
        gsid_axis_step(axis, N_MAX, u, NULL, y, NULL);
    }
    gsid_axis_destroy(axis);
    for (uint64_t i = 0; i < N_MAX; i++) {
        const uint64_t tick = 10u * (uint64_t)N_MAX + i;
        const double turns = (double)(309u * tick % 400u) / 400.0; /* 30.9 / 40 = 309 / 400, in integers */
        /* 3.4e5 turns to 53 bits: 6e-11 of a turn */
        assert_near(y[i], sin(2.0 * PI * turns + 0.3), 5e-10);
    }
}

/* ---- misuse ---- */

static void assert_refused(gsid_axis_cfg cfg, double *field, gsid_axis_cfg *base, double value, gsid_status want) {
    gsid_axis *axis = NULL;
    *(double *)((char *)&cfg + ((char *)field - (char *)base)) = value;
    assert_int_equal(gsid_axis_create(&axis, &cfg), want);
    assert_null(axis);
}

static void bad_configurations_are_refused(void **state) {
    (void)state;
    gsid_axis_cfg c;
    gsid_axis_cfg_init(&c);
    double *const not_negative[] = {&c.viscous_rate,  &c.coulomb_level,    &c.spring_stiffness,  &c.delay_s,
                                    &c.mode_f_hz,     &c.mode_zeta,        &c.gyro_lag_s,        &c.command_limit,
                                    &c.noise_rms,     &c.noise_low_rms,    &c.noise_low_hz,      &c.fs_hz,
                                    &c.drag_rate,     &c.stribeck_extra,   &c.stribeck_velocity, &c.cubic_stiffness,
                                    &c.cogging_level, &c.cogging_cycles,   &c.unbalance_level,   &c.gyro_refresh_hz,
                                    &c.drive_limit,   &c.drive_dead_zone,  &c.stop_high_deg,     &c.stop_stiffness,
                                    &c.stop_damping,  &c.torque_noise_rms, &c.torque_noise_hz};
    for (size_t i = 0; i < sizeof not_negative / sizeof not_negative[0]; i++) {
        assert_refused(c, not_negative[i], &c, -1.0, GSID_E_CONFIG);
        assert_refused(c, not_negative[i], &c, (double)NAN, GSID_E_NONFINITE);
    }
    assert_refused(c, &c.gain, &c, (double)INFINITY, GSID_E_NONFINITE);
    assert_refused(c, &c.fs_hz, &c, 0.0, GSID_E_CONFIG);
    assert_refused(c, &c.delay_s, &c, 64.0 / 3000.0, GSID_E_CONFIG);
    assert_refused(c, &c.noise_low_hz, &c, 0.0, GSID_E_CONFIG);
    assert_refused(c, &c.gyro_lag_s, &c, 1e-9, GSID_E_CONFIG);
    assert_refused(c, &c.mode_f_hz, &c, 1e6, GSID_E_CONFIG);
    assert_refused(c, &c.spring_stiffness, &c, 1e14, GSID_E_CONFIG);
    assert_refused(c, &c.viscous_rate, &c, 1e7, GSID_E_CONFIG);
    assert_refused(c, &c.unbalance_angle_deg, &c, (double)NAN, GSID_E_NONFINITE);
    assert_refused(c, &c.cogging_phase_rad, &c, (double)NAN, GSID_E_NONFINITE);
    assert_refused(c, &c.gyro_refresh_hz, &c, 3001.0, GSID_E_CONFIG);
    assert_refused(c, &c.stribeck_extra, &c, 1.0, GSID_E_CONFIG); /* at a velocity of 0 */
    assert_refused(c, &c.unbalance_level, &c, 1e9, GSID_E_CONFIG);
    assert_refused(c, &c.stop_low_deg, &c, 1.0, GSID_E_CONFIG);
    assert_refused(c, &c.stop_low_deg, &c, (double)NAN, GSID_E_NONFINITE);
    c.torque_noise_rms = c.stop_high_deg = 1.0;
    assert_refused(c, &c.torque_noise_hz, &c, 0.0, GSID_E_CONFIG);
    assert_refused(c, &c.stop_stiffness, &c, 1e7, GSID_E_CONFIG);
    c.cogging_cycles = 1000.0;
    assert_refused(c, &c.cogging_level, &c, 1e6, GSID_E_CONFIG);
    c.command_bits = 32;
    gsid_axis *axis = NULL;
    assert_int_equal(gsid_axis_create(&axis, &c), GSID_E_CONFIG);
    assert_int_equal(gsid_axis_create(NULL, &c), GSID_E_NULL);
    assert_int_equal(gsid_axis_create(&axis, NULL), GSID_E_NULL);
    assert_int_equal(gsid_axis_cfg_init(NULL), GSID_E_NULL);
    assert_int_equal(gsid_axis_reset(NULL), GSID_E_NULL);
    gsid_axis_destroy(NULL);
}

static void a_command_that_is_not_finite_advances_nothing(void **state) {
    (void)state;
    const gsid_axis_cfg cfg = rigid();
    gsid_axis *axis;
    assert_int_equal(gsid_axis_create(&axis, &cfg), GSID_OK);
    step_of(1.0, 10);
    u[7] = (double)NAN;
    y[0] = 123.0;
    assert_int_equal(gsid_axis_step(axis, 10, u, NULL, y, NULL), GSID_E_NONFINITE);
    assert_true(y[0] == 123.0);
    u[7] = 1.0;
    assert_int_equal(gsid_axis_step(axis, 10, NULL, NULL, y, NULL), GSID_E_NULL);
    assert_int_equal(gsid_axis_step(axis, 10, u, NULL, NULL, NULL), GSID_E_NULL);
    assert_int_equal(gsid_axis_step(NULL, 10, u, NULL, y, NULL), GSID_E_NULL);
    assert_int_equal(gsid_axis_step(axis, 10, u, NULL, y, angle), GSID_OK);
    assert_true(y[0] == 0.0 && angle[0] == 0.0);
    gsid_axis_destroy(axis);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(step_and_free_decay_follow_the_closed_form),
        cmocka_unit_test(delay_is_any_fraction_of_a_tick),
        cmocka_unit_test(overdamped_and_springless_axes_follow_the_closed_form),
        cmocka_unit_test(sine_steady_state_is_the_held_input_response),
        cmocka_unit_test(command_is_clipped_and_rounded),
        cmocka_unit_test(the_drive_has_a_dead_zone_and_a_limit),
        cmocka_unit_test(a_slow_gyro_shows_its_last_refresh),
        cmocka_unit_test(a_free_running_gyro_drifts_through_the_ticks),
        cmocka_unit_test(process_noise_moves_the_axis_as_much_as_its_theory_says),
        cmocka_unit_test(a_slow_gyro_holds_its_noise),
        cmocka_unit_test(the_command_of_a_tick_shows_in_the_next_sample),
        cmocka_unit_test(the_seed_decides_the_noise),
        cmocka_unit_test(noise_has_its_rms_and_its_colour),
        cmocka_unit_test(the_fan_keeps_its_phase_for_three_hours),
        cmocka_unit_test(bad_configurations_are_refused),
        cmocka_unit_test(a_command_that_is_not_finite_advances_nothing),
    };
    return cmocka_run_group_tests_name("axis", tests, NULL, NULL);
}
