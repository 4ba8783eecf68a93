/* Laws of the simulated axis that are not linear, against closed forms, energies and a slow integrator of our own. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "axis_bench.h"

/* ---- dry friction ---- */

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

/* A coasting axis meets one stop only: in contact its angle is half a sine of sqrt(stiffness), and it leaves as fast as it
 * came; on the other side, without a stop, it turns on forever. */
static void a_stop_on_one_side_is_a_spring_on_that_side(void **state) {
    (void)state;
    const double w0 = 40.0, pushed_s = 0.1, k = 1e4, root = sqrt(k);
    for (int side = -1; side <= 1; side += 2) {
        gsid_axis_cfg cfg = rigid();
        cfg.spring_stiffness = cfg.viscous_rate = 0.0;
        cfg.gain = 1.0;
        cfg.stop_high_deg = 10.0;
        cfg.stop_stiffness = k;
        cfg.stop_damping = 0.0;
        step_of(side * w0 / pushed_s, 6000);
        memset(u + 300, 0, 5700 * sizeof *u);
        run(&cfg, 6000);
        const double contact_s = pushed_s + (10.0 - 0.5 * w0 * pushed_s) / w0;
        for (uint32_t i = 300; i < 6000; i++) {
            const double t = i / 3000.0, in = t - contact_s,
                         free_angle = side * (0.5 * w0 * pushed_s + w0 * (t - pushed_s));
            if (side < 0 || in <= 0.0) {
                assert_near(angle[i], free_angle, 1e-9);
                assert_near(y[i], side * w0, 1e-9);
            } else if (in < PI / root) { /* the corner of the law costs the fourth-order steps some digits */
                assert_near(angle[i], 10.0 + w0 / root * sin(root * in), 2e-5);
                assert_near(y[i], w0 * cos(root * in), 2e-3);
            } else {
                assert_near(y[i], -w0, 2e-3);
            }
        }
    }
}

static void a_damped_stop_takes_energy_and_both_sides_hold(void **state) {
    (void)state;
    gsid_axis_cfg cfg = rigid();
    cfg.spring_stiffness = cfg.viscous_rate = 0.0;
    cfg.gain = 1.0;
    cfg.stop_low_deg = -135.0;
    cfg.stop_high_deg = 50.0;
    cfg.stop_stiffness = 1e4;
    cfg.stop_damping = 60.0;
    step_of(0.0, N_MAX);
    step_of(-2000.0, 300);
    run(&cfg, N_MAX);
    /* between the stops the rate is constant; each contact of w'' + damping w' + stiffness w = 0 leaves a fixed share */
    const double half = 30.0, wd = sqrt(1e4 - half * half), share = exp(-half * PI / wd);
    double lowest = 0.0, highest = 0.0, before = -200.0;
    uint32_t bounces = 0;
    for (uint32_t i = 301; i < N_MAX; i++) {
        lowest = fmin(lowest, angle[i]);
        highest = fmax(highest, angle[i]);
        const int is_free = angle[i] > -134.0 && angle[i] < 49.0;
        if (is_free && y[i] * before < 0.0) {
            assert_near(-y[i] / before, share, 2e-3 * share);
            before = y[i];
            bounces++;
        }
    }
    assert_true(bounces >= 3 && lowest > -138.0 && lowest < -135.0 && highest > 50.0 && highest < 52.0);
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
        for (int i = 0; i < 5; i++) {
            mid[i] = from[i] + part * (stage == 0 ? 0.0 : k[stage - 1][i]);
        }
        slopes(c, mid, side, command, k[stage]);
    }
    for (int i = 0; i < 5; i++) {
        to[i] = from[i] + h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
    }
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
        if (crossed) {
            axis->x[1] = 0.0;
        }
        h -= crossed ? hi : h;
    }
}

/* The delay is 16.1875 ticks, so that the switch falls on a sub-step of the reference. */
static void assert_like_the_slow_one(gsid_axis_cfg cfg, uint32_t n, double tolerance) {
    const uint32_t delay = 16 * SUB + 12;
    cfg.delay_s = 16.1875 / cfg.fs_hz;
    for (uint32_t i = 0; i < n; i++) {
        u[i] = 9.0 * sin(2.0 * PI * 3.0 * i / cfg.fs_hz) + 2.0 * sin(2.0 * PI * 41.0 * i / cfg.fs_hz + 1.0);
    }
    run(&cfg, n);
    slow_axis slow = {{0}, 0};
    uint32_t n_stuck = 0, n_moved = 0;
    for (uint32_t i = 0; i < n; i++) {
        assert_near(y[i], slow.x[4], tolerance);
        assert_near(angle[i], slow.x[0], tolerance);
        if (i > 0) {
            *(angle[i] == angle[i - 1] ? &n_stuck : &n_moved) += 1;
        }
        for (uint32_t k = 0; k < SUB; k++) {
            const int64_t at = (int64_t)i * SUB + k - delay;
            slow_step(&cfg, &slow, at < 0 ? 0.0 : u[at / SUB], 1.0 / (cfg.fs_hz * SUB));
        }
    }
    if (cfg.coulomb_level > 0.0) {
        assert_true(n_stuck > n / 20 && n_moved > n / 20); /* the record has both in plenty */
    }
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
        assert_like_the_slow_one(cfg, (uint32_t)repeats(6000, 1500), 1e-10);
    }
}

/* ---- curved laws ---- */

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
    if (c->cogging_level > 0.0) {
        energy -= c->cogging_level / (degree * c->cogging_cycles) *
                  cos(degree * c->cogging_cycles * theta + c->cogging_phase_rad);
    }
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(coulomb_alone_stops_where_it_must),
        cmocka_unit_test(a_stop_on_one_side_is_a_spring_on_that_side),
        cmocka_unit_test(a_damped_stop_takes_energy_and_both_sides_hold),
        cmocka_unit_test(it_sticks_up_to_the_level_and_not_beyond),
        cmocka_unit_test(energy_only_falls_once_the_command_is_zero),
        cmocka_unit_test(friction_agrees_with_a_slow_integrator),
        cmocka_unit_test(curved_laws_agree_with_a_slow_integrator),
        cmocka_unit_test(drag_follows_the_closed_form),
        cmocka_unit_test(position_laws_keep_the_energy),
        cmocka_unit_test(a_cubic_spring_keeps_its_period),
        cmocka_unit_test(stribeck_breaks_away_at_the_sum),
    };
    return cmocka_run_group_tests_name("axis laws", tests, NULL, NULL);
}
