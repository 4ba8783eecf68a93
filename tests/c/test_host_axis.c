/* The simulated axis against closed forms, the analytic response to a held input, and a slow integrator of our own. */
#include <complex.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "gsid/host/axis.h"

#define PI 3.14159265358979323846
#define N_MAX 40000

static double u[N_MAX], y[N_MAX], angle[N_MAX], u_applied[N_MAX];

/* The axis of the source with everything off but what moves it: no noise, no fan, no command limit. */
static gsid_axis_cfg quiet(void) {
    gsid_axis_cfg cfg;
    assert_int_equal(gsid_axis_cfg_init(&cfg), GSID_OK);
    cfg.command_limit = cfg.noise_rms = cfg.noise_low_rms = cfg.fan_amplitude = 0.0;
    return cfg;
}

/* Rigid body only: what the gyro shows is the rate at this very instant. */
static gsid_axis_cfg rigid(void) {
    gsid_axis_cfg cfg = quiet();
    cfg.mode_f_hz = cfg.mode_residue = cfg.gyro_lag_s = cfg.delay_s = 0.0;
    return cfg;
}

static void run(const gsid_axis_cfg *cfg, uint32_t n) {
    gsid_axis *axis;
    assert_int_equal(gsid_axis_create(&axis, cfg), GSID_OK);
    assert_int_equal(gsid_axis_step(axis, n, u, u_applied, y, angle), GSID_OK);
    gsid_axis_destroy(axis);
}

static void step_of(double size, uint32_t n) {
    for (uint32_t i = 0; i < n; i++)
        u[i] = size;
}

static void assert_near(double got, double want, double tolerance) {
    if (!(fabs(got - want) <= tolerance))
        fail_msg("got %.17g, want %.17g, off by %.3g, allowed %.3g", got, want, fabs(got - want), tolerance);
}

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
        for (uint32_t i = 0; i < 300; i++)
            assert_near(y[i], 10.0 * step_response(&cfg, i / cfg.fs_hz - cfg.delay_s), 1e-12);
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
    for (uint32_t i = 0; i < n; i++)
        sum += x[i] * cexp(-2.0 * I * PI * (double)((uint64_t)i * line % n) / n);
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
        for (size_t k = 0; k < 8; k++)
            u[i] += cos(2.0 * PI * (double)(i * lines[k] % n) / n + (double)k);
    }
    run(&cfg, n_settle + n);
    for (size_t k = 0; k < 8; k++) {
        const double complex g = line_of(y + n_settle, n, lines[k]) / line_of(u + n_settle, n, lines[k]);
        const double complex want = held_response(&cfg, 2.0 * PI * lines[k] * cfg.fs_hz / n);
        /* the aliases left out add less than 1e-5 / 20000^2; DFT rounding 1e-13 of the largest line, 2 */
        assert_near(cabs(g - want), 0.0, 1e-12);
    }
}

/* ---- friction ---- */

static void coulomb_alone_stops_where_it_must(void **state) {
    (void)state;
    gsid_axis_cfg cfg = rigid();
    cfg.spring_stiffness = cfg.viscous_rate = 0.0;
    cfg.coulomb_level = 3.7;
    cfg.gain = 7.4;
    memset(u, 0, 3000 * sizeof *u);
    step_of(-1.0, 600); /* net -3.7 for 0.2 s, then +3.7 until it stands, 0.2 s later */
    run(&cfg, 3000);
    assert_near(y[600], -0.74, 1e-13);
    assert_near(y[900], -0.37, 1e-13);
    for (uint32_t i = 1201; i < 3000; i++) {
        assert_true(y[i] == 0.0);
        assert_near(angle[i], -0.148, 1e-13);
    }
}

static void it_sticks_up_to_the_level_and_not_beyond(void **state) {
    (void)state;
    gsid_axis_cfg cfg = rigid();
    cfg.gain = 2.0;
    cfg.coulomb_level = 4.0;
    step_of(2.0, 100);
    run(&cfg, 100);
    assert_true(y[99] == 0.0 && angle[99] == 0.0);
    step_of(-2.0001, 100);
    run(&cfg, 100);
    assert_true(y[99] < 0.0);
}

static void energy_only_falls_once_the_command_is_zero(void **state) {
    (void)state;
    gsid_axis_cfg cfg = rigid();
    cfg.viscous_rate = 1.0;
    cfg.coulomb_level = 20.0;
    memset(u, 0, 9000 * sizeof *u);
    step_of(30.0, 700);
    run(&cfg, 9000);
    double last = INFINITY;
    for (uint32_t i = 700; i < 9000; i++) {
        const double energy = 0.5 * y[i] * y[i] + 0.5 * cfg.spring_stiffness * angle[i] * angle[i];
        assert_true(energy <= last * (1.0 + 1e-14));
        last = energy;
    }
    assert_true(y[8999] == 0.0 && cfg.spring_stiffness * fabs(angle[8999]) <= cfg.coulomb_level);
}

/* Slow reference: Runge-Kutta at 1/64 of a tick. The states are angle, rate, q, q', gyro; a step in which the rate
 * would change sign is cut at the zero by bisection on the step's length. */
#define SUB 64
typedef struct {
    double x[5];
    double side;
} slow_axis;

/* Torques of the angle alone, and of the motion: the laws as the header states them. */
static double spring_torque(const gsid_axis_cfg *c, double theta) {
    const double degree = PI / 180.0;
    return c->spring_stiffness * theta + c->cubic_stiffness * theta * theta * theta +
           c->unbalance_level *
               (sin(degree * (theta + c->unbalance_angle_deg)) - sin(degree * c->unbalance_angle_deg)) +
           c->cogging_level * sin(c->cogging_cycles * degree * theta + c->cogging_phase_rad);
}

static double dry_friction(const gsid_axis_cfg *c, double w) {
    const double ratio = c->stribeck_extra > 0.0 ? w / c->stribeck_velocity : 0.0;
    return c->coulomb_level + c->stribeck_extra * exp(-ratio * ratio);
}

static void slopes(const gsid_axis_cfg *c, const double *x, double side, double command, double *dx) {
    const double w0 = 2.0 * PI * c->mode_f_hz;
    const double drag = (c->viscous_rate + c->drag_rate * fabs(x[1])) * x[1];
    const double torque = c->gain * command - drag - spring_torque(c, x[0]);
    dx[0] = x[1];
    dx[1] = side == 0.0 && x[1] == 0.0 ? 0.0 : torque - dry_friction(c, x[1]) * side;
    dx[2] = x[3];
    dx[3] = c->mode_residue * c->gain * command - 2.0 * c->mode_zeta * w0 * x[3] - w0 * w0 * x[2];
    dx[4] = (x[1] + x[3] - x[4]) / c->gyro_lag_s;
}

static void runge_kutta(const gsid_axis_cfg *c, const double *from, double side, double command, double h, double *to) {
    double k[4][5], mid[5];
    for (int stage = 0; stage < 4; stage++) {
        const double part = stage == 0 ? 0.0 : stage == 3 ? h : 0.5 * h;
        for (int i = 0; i < 5; i++)
            mid[i] = from[i] + part * (stage == 0 ? 0.0 : k[stage - 1][i]);
        slopes(c, mid, side, command, k[stage]);
    }
    for (int i = 0; i < 5; i++)
        to[i] = from[i] + h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
}

static void slow_step(const gsid_axis_cfg *c, slow_axis *axis, double command, double h) {
    double to[5];
    while (h > 0.0) {
        axis->side = axis->x[1] > 0.0 ? 1.0 : -1.0;
        if (axis->x[1] == 0.0) {
            const double torque = c->gain * command - spring_torque(c, axis->x[0]);
            axis->side = fabs(torque) <= dry_friction(c, 0.0) ? 0.0 : torque > 0.0 ? 1.0 : -1.0;
        }
        runge_kutta(c, axis->x, axis->side, command, h, to);
        double lo = 0.0, hi = h;
        const int crossed = to[1] * axis->side < 0.0;
        for (int i = 0; crossed && i < 50; i++) {
            const double half = 0.5 * (lo + hi);
            runge_kutta(c, axis->x, axis->side, command, half, to);
            *(to[1] * axis->side < 0.0 ? &hi : &lo) = half;
        }
        memcpy(axis->x, to, sizeof to);
        if (crossed)
            axis->x[1] = 0.0;
        h -= crossed ? hi : h;
    }
}

/* The delay is 16.1875 ticks, so that the switch falls on a sub-step of the reference. */
static void assert_like_the_slow_one(gsid_axis_cfg cfg, uint32_t n, double tolerance) {
    const uint32_t delay = 16 * SUB + 12;
    cfg.delay_s = 16.1875 / cfg.fs_hz;
    for (uint32_t i = 0; i < n; i++)
        u[i] = 9.0 * sin(2.0 * PI * 3.0 * i / cfg.fs_hz) + 2.0 * sin(2.0 * PI * 41.0 * i / cfg.fs_hz + 1.0);
    run(&cfg, n);
    slow_axis slow = {{0}, 0};
    uint32_t n_stuck = 0, n_moved = 0;
    for (uint32_t i = 0; i < n; i++) {
        assert_near(y[i], slow.x[4], tolerance);
        assert_near(angle[i], slow.x[0], tolerance);
        if (i > 0)
            *(angle[i] == angle[i - 1] ? &n_stuck : &n_moved) += 1;
        for (uint32_t k = 0; k < SUB; k++) {
            const int64_t at = (int64_t)i * SUB + k - delay;
            slow_step(&cfg, &slow, at < 0 ? 0.0 : u[at / SUB], 1.0 / (cfg.fs_hz * SUB));
        }
    }
    if (cfg.coulomb_level > 0.0)
        assert_true(n_stuck > n / 20 && n_moved > n / 20); /* the record has both in plenty */
}

static void friction_agrees_with_a_slow_integrator(void **state) {
    (void)state;
    const double cases[][3] = {
        {11.0, 170.0, 40.0}, /* the spring rings */
        {60.0, 170.0, 30.0}, /* overdamped */
        {60.0, 900.0, 30.0}, /* critically damped */
        {11.0, 0.0, 50.0},   /* no spring */
        {0.0, 0.0, 60.0},    /* friction alone */
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        gsid_axis_cfg cfg = quiet();
        cfg.viscous_rate = cases[i][0];
        cfg.spring_stiffness = cases[i][1];
        cfg.coulomb_level = cases[i][2];
        /* Runge-Kutta: (w0 h)^4 / 120 a radian of the mode's 0.02 deg/s, 1e-13 */
        assert_like_the_slow_one(cfg, 6000, 1e-10);
    }
}

/* ---- laws that are not linear ---- */

static void curved_laws_agree_with_a_slow_integrator(void **state) {
    (void)state;
    gsid_axis_cfg cfg = quiet();
    cfg.drag_rate = 0.2;
    cfg.cubic_stiffness = 500.0; /* the axis moves by 0.5 deg: two thirds of the linear spring */
    cfg.unbalance_level = 2000.0;
    cfg.unbalance_angle_deg = -40.0;
    cfg.cogging_level = 10.0;
    cfg.cogging_cycles = 1500.0;
    cfg.cogging_phase_rad = 0.7;
    /* Torques change by 200 rad/s times themselves: (200 h)^4 / 120 a step of a quarter of a tick, 6e-10 of 5 deg/s. */
    assert_like_the_slow_one(cfg, 2000, 1e-9);
    cfg.coulomb_level = 30.0;
    cfg.stribeck_extra = 20.0;
    cfg.stribeck_velocity = 0.8;
    assert_like_the_slow_one(cfg, 2000, 1e-9);
}

static void drag_follows_the_closed_form(void **state) {
    (void)state;
    gsid_axis_cfg cfg = rigid();
    cfg.viscous_rate = cfg.spring_stiffness = 0.0;
    cfg.drag_rate = 0.3;
    const double push = 10.0 * cfg.gain, c = cfg.drag_rate, rate = sqrt(push * c);
    const double w0 = -sqrt(push / c) * tanh(rate * 0.2), theta0 = -log(cosh(rate * 0.2)) / c;
    memset(u, 0, 3000 * sizeof *u);
    step_of(-10.0, 600);
    run(&cfg, 3000);
    for (uint32_t i = 0; i < 3000; i++) {
        const double t = i / cfg.fs_hz, coasting = 1.0 - c * w0 * (t - 0.2);
        /* four steps a tick of the classical method: (c w h)^4 / 120 a step, 1e-14 of the rate each */
        assert_near(y[i], i <= 600 ? -sqrt(push / c) * tanh(rate * t) : w0 / coasting, 1e-11);
        assert_near(angle[i], i <= 600 ? -log(cosh(rate * t)) / c : theta0 - log(coasting) / c, 1e-11);
    }
}

static double potential(const gsid_axis_cfg *c, double theta) {
    const double degree = PI / 180.0, rest = degree * c->unbalance_angle_deg;
    double energy = 0.5 * c->spring_stiffness * theta * theta + 0.25 * c->cubic_stiffness * pow(theta, 4);
    energy -= c->unbalance_level * (cos(degree * theta + rest) / degree + theta * sin(rest));
    if (c->cogging_level > 0.0)
        energy -= c->cogging_level / (degree * c->cogging_cycles) *
                  cos(degree * c->cogging_cycles * theta + c->cogging_phase_rad);
    return energy;
}

/* Springs, gravity and magnets take what they give; a potential has been integrated by hand. */
static void position_laws_keep_the_energy(void **state) {
    (void)state;
    for (int law = 0; law < 3; law++) {
        gsid_axis_cfg cfg = rigid();
        cfg.viscous_rate = 0.0;
        cfg.cubic_stiffness = law == 0 ? 30.0 : 0.0;
        cfg.unbalance_level = law == 1 ? 3000.0 : 0.0;
        cfg.unbalance_angle_deg = 60.0;
        cfg.cogging_level = law == 2 ? 20.0 : 0.0;
        cfg.cogging_cycles = 252.0;
        cfg.cogging_phase_rad = 1.0;
        memset(u, 0, 9000 * sizeof *u);
        step_of(60.0, 500);
        run(&cfg, 9000);
        const double start = 0.5 * y[500] * y[500] + potential(&cfg, angle[500]);
        double least = 0.0, most = 0.0;
        for (uint32_t i = 500; i < 9000; i++) {
            assert_near(0.5 * y[i] * y[i] + potential(&cfg, angle[i]), start, 1e-8 * y[500] * y[500]);
            least = fmin(least, angle[i]);
            most = fmax(most, angle[i]);
        }
        assert_true(most - least > 2.0); /* degrees: every law is out of its linear part */
    }
}

/* A pure cubic spring swings with the period 4 sqrt(2) L / (A sqrt(k)), L = 1.31102877714605991 half the length of the
 * lemniscate: ten periods hit the rate's zero again. */
static void a_cubic_spring_keeps_its_period(void **state) {
    (void)state;
    gsid_axis_cfg cfg = rigid();
    cfg.viscous_rate = cfg.spring_stiffness = 0.0;
    cfg.cubic_stiffness = 40.0;
    memset(u, 0, 30000 * sizeof *u);
    step_of(30.0, 300);
    run(&cfg, 30000);
    const double energy = 0.5 * y[300] * y[300] + 10.0 * pow(angle[300], 4);
    const double amplitude = pow(energy / 10.0, 0.25);
    const double period = 4.0 * sqrt(2.0) * 1.31102877714605991 / (amplitude * sqrt(cfg.cubic_stiffness));
    double first = 0.0, last = 0.0;
    int n_turns = -1;
    for (uint32_t i = 301; i < 30000 && n_turns < 10; i++) {
        if (y[i - 1] > 0.0 && y[i] <= 0.0) { /* at the turn the torque is all but constant: straight between samples */
            last = (i - 1 + y[i - 1] / (y[i - 1] - y[i])) / cfg.fs_hz;
            first = n_turns++ < 0 ? last : first;
        }
    }
    assert_int_equal(n_turns, 10);
    assert_near((last - first) / 10.0, period, 1e-6 * period); /* the straight line: (w h)^2 / 12 of a tick */
}

/* Dry friction that falls with the rate lets the axis stick up to level + extra, and stop only below the level's own. */
static void stribeck_breaks_away_at_the_sum(void **state) {
    (void)state;
    gsid_axis_cfg cfg = rigid();
    cfg.gain = 2.0;
    cfg.coulomb_level = 3.0;
    cfg.stribeck_extra = 1.0;
    cfg.stribeck_velocity = 0.05;
    step_of(2.0, 300);
    run(&cfg, 300);
    assert_true(y[299] == 0.0 && angle[299] == 0.0);
    step_of(-2.0001, 300);
    run(&cfg, 300);
    assert_true(y[299] < 0.0);
    cfg.spring_stiffness = cfg.viscous_rate = 0.0;
    step_of(-2.5, 3000);
    run(&cfg, 3000);
    /* far above the velocity only the level brakes */
    assert_near((y[2999] - y[1499]) / 0.5, 3.0 - 2.5 * cfg.gain, 1e-9);
}

/* ---- command and sensor ---- */

static void command_is_clipped_and_rounded(void **state) {
    (void)state;
    gsid_axis_cfg cfg;
    gsid_axis_cfg_init(&cfg);
    const double step = 2.0 * 179.0 / 4096.0;
    for (uint32_t i = 0; i < 4000; i++)
        u[i] = -250.0 + 0.125 * i;
    run(&cfg, 4000);
    for (uint32_t i = 0; i < 4000; i++) {
        assert_true(fabs(u_applied[i]) <= 179.0);
        assert_near(u_applied[i] / step, round(u_applied[i] / step), 1e-9);
        if (fabs(u[i]) <= 179.0)
            assert_near(u_applied[i], u[i], 0.5 * step * (1 + 1e-12));
        else
            assert_true(u_applied[i] == (u[i] > 0 ? 179.0 : -179.0));
    }
}

/* The drive's laws are no dynamics: the same axis driven by what is left of the command. */
static void the_drive_has_a_dead_zone_and_a_limit(void **state) {
    (void)state;
    static double driven[6000];
    gsid_axis_cfg cfg = quiet();
    cfg.drive_dead_zone = 2.0;
    cfg.drive_limit = 5.0;
    for (uint32_t i = 0; i < 6000; i++)
        u[i] = 12.0 * sin(2.0 * PI * 7.0 * i / cfg.fs_hz);
    run(&cfg, 6000);
    memcpy(driven, y, sizeof driven);
    assert_memory_equal(u_applied, u, 6000 * sizeof *u); /* the drive keeps it to itself */
    for (uint32_t i = 0; i < 6000; i++)
        u[i] = u[i] > 2.0 ? fmin(u[i] - 2.0, 5.0) : u[i] < -2.0 ? fmax(u[i] + 2.0, -5.0) : 0.0;
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
    for (uint32_t i = 1; i < 3000; i++)
        n_changes += y[i] != y[i - 1];
    assert_int_equal(n_changes, 399); /* 400 refreshes, the first at tick 0 */
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
    for (uint32_t i = 0; i < 2000; i++)
        assert_true(again[i] != y[i]);
}

static void noise_has_its_rms_and_its_colour(void **state) {
    (void)state;
    gsid_axis_cfg cfg = quiet();
    gsid_axis *axis;
    const uint32_t n_blocks = 10;
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
                if (i > 0)
                    innovation += (y[i] - pole * y[i - 1]) * (y[i] - pole * y[i - 1]);
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
    for (int block = 0; block < 11; block++) /* 11 * 40000 / 40 Hz = 3.06 h */
        gsid_axis_step(axis, N_MAX, u, NULL, y, NULL);
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
    double *const not_negative[] = {&c.viscous_rate,  &c.coulomb_level,  &c.spring_stiffness,  &c.delay_s,
                                    &c.mode_f_hz,     &c.mode_zeta,      &c.gyro_lag_s,        &c.command_limit,
                                    &c.noise_rms,     &c.noise_low_rms,  &c.noise_low_hz,      &c.fs_hz,
                                    &c.drag_rate,     &c.stribeck_extra, &c.stribeck_velocity, &c.cubic_stiffness,
                                    &c.cogging_level, &c.cogging_cycles, &c.unbalance_level,   &c.gyro_refresh_hz,
                                    &c.drive_limit,   &c.drive_dead_zone};
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

static void a_command_that_is_no_number_advances_nothing(void **state) {
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
        cmocka_unit_test(coulomb_alone_stops_where_it_must),
        cmocka_unit_test(it_sticks_up_to_the_level_and_not_beyond),
        cmocka_unit_test(energy_only_falls_once_the_command_is_zero),
        cmocka_unit_test(friction_agrees_with_a_slow_integrator),
        cmocka_unit_test(curved_laws_agree_with_a_slow_integrator),
        cmocka_unit_test(drag_follows_the_closed_form),
        cmocka_unit_test(position_laws_keep_the_energy),
        cmocka_unit_test(a_cubic_spring_keeps_its_period),
        cmocka_unit_test(stribeck_breaks_away_at_the_sum),
        cmocka_unit_test(command_is_clipped_and_rounded),
        cmocka_unit_test(the_drive_has_a_dead_zone_and_a_limit),
        cmocka_unit_test(a_slow_gyro_shows_its_last_refresh),
        cmocka_unit_test(a_slow_gyro_holds_its_noise),
        cmocka_unit_test(the_command_of_a_tick_shows_in_the_next_sample),
        cmocka_unit_test(the_seed_decides_the_noise),
        cmocka_unit_test(noise_has_its_rms_and_its_colour),
        cmocka_unit_test(the_fan_keeps_its_phase_for_three_hours),
        cmocka_unit_test(bad_configurations_are_refused),
        cmocka_unit_test(a_command_that_is_no_number_advances_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
