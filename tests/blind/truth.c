/* Runge-Kutta of order 4 between events. Everything that is not smooth (stick and slip, stops, backlash, reversals of a
 * bristle) is a mode that is held during a step; a step in which a mode's condition breaks is cut there and repeated. */
#include "truth.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PI 3.14159265358979323846
#define RADIANS (PI / 180.0)
#define P(name) (axis->p[TRUTH_##name])
#define EVENTS_MAX 200 /* in one step; a truth that needs more is not one to hand out */

typedef struct {
    const double *p;
    double command; /* held: the command after maps and delay */
    int slip; /* of set-valued friction: -1, +1, 0 sticks */
    int stop; /* side in contact, 0 free */
    int gear; /* flank in contact, 0 in the play */
    int direction; /* of the bristle's motion */
} truth_axis;

static int sign_of(double value) {
    return (value > 0.0) - (value < 0.0);
}

static int has_dry_friction(const truth_axis *axis) {
    return P(coulomb_level) > 0.0 || P(stribeck_extra) > 0.0;
}

static double actuator(const truth_axis *axis, const double *x) {
    return P(motor_lag_s) > 0.0 ? x[TRUTH_ACTUATOR] : axis->command;
}

static double motor_torque(const truth_axis *axis, const double *x) {
    const double ripple = P(gain_ripple) * sin(P(gain_ripple_cycles) * x[TRUTH_THETA] * RADIANS);
    return P(gain) * (1.0 + ripple) * actuator(axis, x);
}

static double dry_friction(const truth_axis *axis, double theta, double rate) {
    const double ratio = P(stribeck_velocity) > 0.0 ? rate / P(stribeck_velocity) : 0.0;
    const double ripple =
        P(friction_ripple) * sin(P(friction_ripple_cycles) * theta * RADIANS + P(friction_ripple_phase_rad));
    return P(coulomb_level) * (1.0 + ripple) + P(stribeck_extra) * exp(-ratio * ratio);
}

static double bristle_rate(const truth_axis *axis, double rate, double bristle) {
    double bend = bristle;
    if (P(lugre_extra) > 0.0) {
        const double ratio = rate / P(lugre_velocity);
        bend /= 1.0 + P(lugre_extra) * exp(-ratio * ratio);
    }
    return P(presliding_stiffness) * rate * (1.0 - axis->direction * bend);
}

static double dissipative_torque(const truth_axis *axis, const double *x) {
    const double w = x[TRUTH_RATE];
    double torque = w * (P(viscous_rate) + P(quadratic_drag_rate) * fabs(w) + P(eddy_rate) * fabs(actuator(axis, x)));
    torque += axis->slip * dry_friction(axis, x[TRUTH_THETA], w);
    if (P(presliding_level) > 0.0) {
        torque += P(presliding_level) * x[TRUTH_BRISTLE] +
                  P(lugre_damping) * bristle_rate(axis, w, x[TRUTH_BRISTLE]) / P(presliding_stiffness);
    }
    return torque;
}

static double position_torque(const truth_axis *axis, const double *x) {
    const double theta = x[TRUTH_THETA];
    double torque = P(spring_stiffness) * theta + P(cubic_stiffness) * theta * theta * theta + P(bias_level);
    if (P(unbalance_level) != 0.0) {
        torque += P(unbalance_level) *
                  (sin((theta + P(unbalance_angle_deg)) * RADIANS) - sin(P(unbalance_angle_deg) * RADIANS));
    }
    if (P(cogging_level) != 0.0) {
        torque += P(cogging_level) * sin(P(cogging_cycles) * theta * RADIANS + P(cogging_phase_rad));
    }
    if (P(snap_level) != 0.0) {
        const double bend = (theta - P(snap_angle_deg)) / P(snap_width_deg);
        torque += P(snap_level) * bend * exp(0.5 - 0.5 * bend * bend);
    }
    torque += P(creep_stiffness) * (theta - x[TRUTH_CREEP]);
    return torque + P(stop_stiffness) * (axis->stop != 0 ? theta - axis->stop * P(stop_angle_deg) : 0.0);
}

static double gear_torque(const truth_axis *axis, const double *x) {
    const double twist = x[TRUTH_MOTOR_THETA] - x[TRUTH_THETA];
    const double spring = axis->gear != 0 ? P(gear_stiffness) * (twist - axis->gear * 0.5 * P(gear_gap_deg)) : 0.0;
    return spring + P(gear_damping) * (x[TRUTH_MOTOR_RATE] - x[TRUTH_RATE]);
}

static double load_share(const truth_axis *axis) {
    return P(gear_stiffness) > 0.0 ? 1.0 / (1.0 + P(gear_inertia_ratio)) : 1.0;
}

/* Torque on the load but for dry friction: what has to overcome it. */
static double load_torque(const truth_axis *axis, const double *x) {
    truth_axis free_axis = *axis;
    free_axis.slip = 0;
    const double drive = P(gear_stiffness) > 0.0 ? gear_torque(axis, x) : motor_torque(axis, x);
    return drive - position_torque(axis, x) - dissipative_torque(&free_axis, x);
}

static void derivative(const truth_axis *axis, const double *x, double *dx) {
    const int geared = P(gear_stiffness) > 0.0, sticks = has_dry_friction(axis) && axis->slip == 0;
    const double motor = motor_torque(axis, x), brake = dissipative_torque(axis, x);
    const double gear = geared ? gear_torque(axis, x) : 0.0;

    memset(dx, 0, TRUTH_N_STATES * sizeof *dx);
    if (!sticks) {
        dx[TRUTH_THETA] = x[TRUTH_RATE];
        dx[TRUTH_RATE] = ((geared ? gear : motor) - brake - position_torque(axis, x)) / load_share(axis);
    }
    if (geared) {
        dx[TRUTH_MOTOR_THETA] = x[TRUTH_MOTOR_RATE];
        dx[TRUTH_MOTOR_RATE] = (motor - gear) / (1.0 - load_share(axis));
    }
    if (P(motor_lag_s) > 0.0) {
        dx[TRUTH_ACTUATOR] = (axis->command - x[TRUTH_ACTUATOR]) / P(motor_lag_s);
    }
    if (P(mode_hz) > 0.0) {
        const double w0 = 2.0 * PI * P(mode_hz);
        dx[TRUTH_MODE] = x[TRUTH_MODE_RATE];
        dx[TRUTH_MODE_RATE] = P(mode_residue) * P(gain) * actuator(axis, x) - w0 * w0 * x[TRUTH_MODE] -
                              2.0 * P(mode_zeta) * w0 * x[TRUTH_MODE_RATE];
    }
    if (P(sensor_lag_s) > 0.0) {
        dx[TRUTH_SENSOR] = (x[TRUTH_RATE] + x[TRUTH_MODE_RATE] - x[TRUTH_SENSOR]) / P(sensor_lag_s);
    }
    if (P(presliding_level) > 0.0) {
        dx[TRUTH_BRISTLE] = bristle_rate(axis, x[TRUTH_RATE], x[TRUTH_BRISTLE]);
    }
    const double creep = x[TRUTH_THETA] - x[TRUTH_CREEP];
    if (P(creep_time_s) > 0.0) {
        dx[TRUTH_CREEP] = creep / P(creep_time_s);
    }

    dx[TRUTH_WORK] = motor * (geared ? x[TRUTH_MOTOR_RATE] : x[TRUTH_RATE]);
    dx[TRUTH_DISSIPATED] = brake * x[TRUTH_RATE] + P(creep_stiffness) * creep * dx[TRUTH_CREEP];
    if (geared) {
        truth_axis open = *axis;
        open.gear = 0;
        dx[TRUTH_DISSIPATED] += gear_torque(&open, x) * (x[TRUTH_MOTOR_RATE] - x[TRUTH_RATE]);
    }
}

static void runge_kutta(const truth_axis *axis, const double *x, double h, double *next) {
    double k1[TRUTH_N_STATES], k2[TRUTH_N_STATES], k3[TRUTH_N_STATES], k4[TRUTH_N_STATES], mid[TRUTH_N_STATES];
    derivative(axis, x, k1);
    for (int i = 0; i < TRUTH_N_STATES; ++i) {
        mid[i] = x[i] + 0.5 * h * k1[i];
    }
    derivative(axis, mid, k2);
    for (int i = 0; i < TRUTH_N_STATES; ++i) {
        mid[i] = x[i] + 0.5 * h * k2[i];
    }
    derivative(axis, mid, k3);
    for (int i = 0; i < TRUTH_N_STATES; ++i) {
        mid[i] = x[i] + h * k3[i];
    }
    derivative(axis, mid, k4);
    for (int i = 0; i < TRUTH_N_STATES; ++i) {
        next[i] = x[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
    }
}

/* ---- modes -------------------------------------------------------------------------------------------------------- */

/* Distance into a spring with play: > 0 while the side that is held in `side` stays the right one. */
static double play_margin(int side, double deflection, double half_play) {
    return side != 0 ? side * deflection - half_play : half_play - fabs(deflection);
}

enum { EVENT_FRICTION, EVENT_STOP, EVENT_GEAR, EVENT_DIRECTION, N_EVENTS };

/* Each margin is positive while its mode holds; effects that are absent never break. */
static void margins(const truth_axis *axis, const double *x, double *margin) {
    for (int i = 0; i < N_EVENTS; ++i) {
        margin[i] = 1.0;
    }
    if (has_dry_friction(axis)) {
        margin[EVENT_FRICTION] = axis->slip != 0 ? axis->slip * x[TRUTH_RATE]
                                                 : dry_friction(axis, x[TRUTH_THETA], 0.0) - fabs(load_torque(axis, x));
    }
    if (P(stop_stiffness) > 0.0) {
        margin[EVENT_STOP] = play_margin(axis->stop, x[TRUTH_THETA], P(stop_angle_deg));
    }
    if (P(gear_stiffness) > 0.0) {
        margin[EVENT_GEAR] = play_margin(axis->gear, x[TRUTH_MOTOR_THETA] - x[TRUTH_THETA], 0.5 * P(gear_gap_deg));
    }
    if (P(presliding_level) > 0.0) {
        margin[EVENT_DIRECTION] = axis->direction * x[TRUTH_RATE];
    }
}

static double least_margin(const truth_axis *axis, const double *x, int *event) {
    double margin[N_EVENTS];
    margins(axis, x, margin);
    *event = 0;
    for (int i = 1; i < N_EVENTS; ++i) {
        if (margin[i] < margin[*event]) {
            *event = i;
        }
    }
    return margin[*event];
}

static int play_side(double deflection, double half_play) {
    return fabs(deflection) > half_play ? sign_of(deflection) : 0;
}

/* At rest: stick while the torque does not overcome friction, else slip the way it pushes. */
static void settle_friction(truth_axis *axis, double *x) {
    x[TRUTH_RATE] = 0.0;
    const double torque = load_torque(axis, x);
    axis->slip = fabs(torque) <= dry_friction(axis, x[TRUTH_THETA], 0.0) ? 0 : sign_of(torque);
    if (axis->slip != 0) {
        axis->direction = axis->slip;
    }
}

static void start_modes(truth_axis *axis, double *x) {
    axis->stop = play_side(x[TRUTH_THETA], P(stop_angle_deg));
    axis->gear = play_side(x[TRUTH_MOTOR_THETA] - x[TRUTH_THETA], 0.5 * P(gear_gap_deg));
    axis->slip = 0;
    axis->direction = x[TRUTH_RATE] != 0.0 ? sign_of(x[TRUTH_RATE]) : (load_torque(axis, x) < 0.0 ? -1 : 1);
    if (!has_dry_friction(axis)) {
        return;
    }
    axis->slip = sign_of(x[TRUTH_RATE]);
    if (axis->slip == 0) {
        settle_friction(axis, x);
    }
}

static void change_mode(truth_axis *axis, int event, double *x) {
    switch (event) {
    case EVENT_FRICTION:
        if (axis->slip != 0) {
            settle_friction(axis, x);
        } else {
            axis->slip = axis->direction = load_torque(axis, x) < 0.0 ? -1 : 1;
        }
        break;
    case EVENT_STOP:
        axis->stop = axis->stop != 0 ? 0 : sign_of(x[TRUTH_THETA]);
        break;
    case EVENT_GEAR:
        axis->gear = axis->gear != 0 ? 0 : sign_of(x[TRUTH_MOTOR_THETA] - x[TRUTH_THETA]);
        break;
    default:
        axis->direction = -axis->direction;
        break;
    }
}

/* The part of the step h at whose end the first mode has just broken: false position (Illinois) on the least margin,
 * the step repeated for each try. The bracket is left on its broken side, so that the event cannot come twice. */
static double cut_step(const truth_axis *axis, const double *x, double h, double *next, int *event) {
    double low = 0.0, high = h, f_low, f_high, tried[TRUTH_N_STATES];
    int which;
    f_low = fmax(least_margin(axis, x, &which), 0.0);
    f_high = least_margin(axis, next, event);
    int side = 0;
    for (int i = 0; i < 60 && high - low > 1e-13 * h; ++i) {
        double t = (low * f_high - high * f_low) / (f_high - f_low);
        if (!(t > low && t < high) || i % 4 == 3) {
            t = 0.5 * (low + high);
        }
        runge_kutta(axis, x, t, tried);
        const double f = least_margin(axis, tried, &which);
        if (f < 0.0) {
            high = t;
            f_high = f;
            *event = which;
            memcpy(next, tried, sizeof tried);
            if (side == 1) {
                f_low *= 0.5;
            }
            side = 1;
            if (f > -1e-13) {
                break;
            }
        } else {
            low = t;
            f_low = f;
            if (side == -1) {
                f_high *= 0.5;
            }
            side = -1;
        }
    }
    return high;
}

static int advance(truth_axis *axis, double *x, double h) {
    double next[TRUTH_N_STATES];
    int event;
    for (int i = 0; i < EVENTS_MAX; ++i) {
        runge_kutta(axis, x, h, next);
        if (least_margin(axis, next, &event) >= 0.0) {
            memcpy(x, next, sizeof next);
            return isfinite(x[TRUTH_THETA]) && isfinite(x[TRUTH_RATE]) ? 0 : -2;
        }
        const double done = cut_step(axis, x, h, next, &event);
        memcpy(x, next, sizeof next);
        change_mode(axis, event, x);
        h -= done;
        if (h <= 0.0) {
            return 0;
        }
    }
    return -3;
}

/* ---- commands and samples ------------------------------------------------------------------------------------------ */

static double command_map(const double *p, double u) {
    u *= 1.0 + p[TRUTH_command_even] * u + p[TRUTH_command_cubic] * u * u;
    if (p[TRUTH_quantization_step] > 0.0) {
        u = p[TRUTH_quantization_step] * rint(u / p[TRUTH_quantization_step]);
    }
    if (p[TRUTH_dead_zone_half_width] > 0.0) {
        u = sign_of(u) * fmax(fabs(u) - p[TRUTH_dead_zone_half_width], 0.0);
    }
    if (p[TRUTH_saturation_limit] > 0.0) {
        u = fmin(fmax(u, -p[TRUTH_saturation_limit]), p[TRUTH_saturation_limit]);
    }
    return u;
}

void truth_command(const double *parameter, size_t n, const double *u, double *v) {
    const double limit = parameter[TRUTH_command_rate_limit];
    double held = u[n - 1];
    for (size_t pass = 0; pass < (limit > 0.0 ? 3 : 1); ++pass) { /* the limiter's own settling */
        for (size_t i = 0; i < n; ++i) {
            held = limit > 0.0 ? held + fmin(fmax(u[i] - held, -limit), limit) : u[i];
            v[i] = command_map(parameter, held);
        }
    }
}

double truth_torque(const double *parameter, double theta, double rate, double act) {
    truth_axis axis = {parameter, act, sign_of(rate), 0, 0, sign_of(rate)};
    double x[TRUTH_N_STATES] = {0};
    x[TRUTH_THETA] = theta;
    x[TRUTH_RATE] = rate;
    x[TRUTH_ACTUATOR] = act;
    axis.stop = play_side(theta, parameter[TRUTH_stop_angle_deg]);
    return position_torque(&axis, x) + dissipative_torque(&axis, x);
}

static double gyro(const truth_axis *axis, const double *x) {
    const double rate = P(sensor_lag_s) > 0.0 ? x[TRUTH_SENSOR] : x[TRUTH_RATE] + x[TRUTH_MODE_RATE];
    return rate * (1.0 + P(gyro_even) * rate + P(gyro_cubic) * rate * rate);
}

static int advance_to(truth_axis *axis, double *x, double from, double to, int n_steps) {
    const int steps = (int)ceil((to - from) * n_steps - 1e-9);
    for (int i = 0; i < steps; ++i) {
        const int status = advance(axis, x, (to - from) / (steps * P(fs_hz)));
        if (status != 0) {
            return status;
        }
    }
    return 0;
}

static void new_command(truth_axis *axis, double *x, double command) {
    axis->command = command;
    int event;
    /* A held torque may jump past the friction at once. */
    if (has_dry_friction(axis) && axis->slip == 0 && least_margin(axis, x, &event) < 0.0) {
        change_mode(axis, EVENT_FRICTION, x);
    }
}

/* One sample: the old command up to the delay's fraction, then the new one; cut again where the gyro is refreshed. */
static int sample(truth_axis *axis, double *x, size_t i, const double *command, int n_steps, size_t *refresh,
                  double *held) {
    const double per_refresh = P(sample_hold_hz) > 0.0 ? P(fs_hz) / P(sample_hold_hz) : 0.0;
    const double fraction = P(delay_s) * P(fs_hz) - floor(P(delay_s) * P(fs_hz));
    double at = 0.0;
    for (int piece = 0; piece < 2; ++piece) {
        const double end = piece == 0 ? fraction : 1.0;
        if (end <= at) {
            continue;
        }
        new_command(axis, x, command[piece]);
        while (per_refresh > 0.0 && (double)*refresh * per_refresh < (double)i + end - 1e-9) {
            const double instant = (double)*refresh * per_refresh - (double)i;
            const int status = advance_to(axis, x, at, instant, n_steps);
            if (status != 0) {
                return status;
            }
            at = fmax(instant, at);
            *held = gyro(axis, x);
            ++*refresh;
        }
        const int status = advance_to(axis, x, at, end, n_steps);
        if (status != 0) {
            return status;
        }
        at = end;
    }
    return 0;
}

/* [n] each; theta and rate may be NULL. */
typedef struct {
    double *y, *theta, *rate;
} signals;

static int period(truth_axis *axis, size_t n, const double *v, int n_steps, double *x, const signals *to) {
    const size_t delay = (size_t)floor(P(delay_s) * P(fs_hz)) % n;
    const double per_refresh = P(sample_hold_hz) > 0.0 ? P(fs_hz) / P(sample_hold_hz) : 0.0;
    size_t refresh = 0;
    double held = gyro(axis, x);
    for (size_t i = 0; i < n; ++i) {
        if (per_refresh > 0.0 && fabs((double)refresh * per_refresh - (double)i) < 1e-9) {
            held = gyro(axis, x);
            ++refresh;
        }
        to->y[i] = per_refresh > 0.0 ? held : gyro(axis, x);
        if (to->theta) {
            to->theta[i] = x[TRUTH_THETA];
        }
        if (to->rate) {
            to->rate[i] = x[TRUTH_RATE];
        }
        const double command[2] = {v[(i + 2 * n - delay - 1) % n], v[(i + 2 * n - delay) % n]};
        const int status = sample(axis, x, i, command, n_steps, &refresh, &held);
        if (status != 0) {
            return status;
        }
    }
    return 0;
}

int truth_run(const double *parameter, size_t n, const double *u, size_t n_periods, int n_steps, double *x, double *y,
              double *theta, double *rate) {
    if (n == 0 || n_steps < 1 || !(parameter[TRUTH_fs_hz] > 0.0)) {
        return -1;
    }
    double *v = malloc(n * sizeof *v);
    if (!v) {
        return -1;
    }
    truth_command(parameter, n, u, v);
    const size_t delay = (size_t)floor(parameter[TRUTH_delay_s] * parameter[TRUTH_fs_hz]) % n;
    truth_axis axis = {parameter, v[(2 * n - delay - 1) % n], 0, 0, 0, 0};
    start_modes(&axis, x);
    const signals to = {y, theta, rate};
    int status = 0;
    for (size_t i = 0; i < n_periods && status == 0; ++i) {
        status = period(&axis, n, v, n_steps, x, &to);
    }
    free(v);
    return status;
}

/* ---- names --------------------------------------------------------------------------------------------------------- */

#define TRUTH_NAME(name) #name,
static const char *const names[] = {TRUTH_PARAMETERS(TRUTH_NAME)};

int truth_n_parameters(void) {
    return TRUTH_N_PARAMETERS;
}

int truth_n_states(void) {
    return TRUTH_N_STATES;
}

const char *truth_parameter_name(int index) {
    return index >= 0 && index < TRUTH_N_PARAMETERS ? names[index] : NULL;
}
