#include "gsid/host/axis.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PI 3.14159265358979323846
#define RADIANS (PI / 180.0)

/* Between two events (the delayed command switches, the rate passes zero, the gyro is refreshed) the axis is
 *   theta' = w,   w' = gain u + noise - viscous w - spring theta - level s - curved(theta, w),   s the sign of w
 *   p' = w0 r,    r' = residue gain u - w0 p - 2 zeta w0 r            (r = q', p = w0 q: rates both, well scaled)
 *   gyro' = (w + r - gyro) / lag
 * with constant inputs: but for the curved laws a step of any length is a matrix. While the axis sticks, theta and w
 * stand still, and no law is curved. */
enum { THETA, RATE, MODE_P, MODE_R, GYRO, N_STATES, IN_COMMAND = N_STATES, IN_FRICTION, IN_TORQUE, N_ALL };

typedef struct {
    double m[N_ALL][N_ALL];
} matrix;

typedef enum { SLIP, STICK, N_REGIMES } regime;

/* A tick is [0, frac) with the command of d + 1 ticks ago, then [frac, 1) with that of d ticks ago. */
typedef struct {
    double duration_s;
    matrix whole[N_REGIMES]; /* the step over the whole piece */
    double part_s;           /* steps through curved laws */
    matrix half;             /* half such a step, slipping */
} piece;

/* A gyro lag of 1 ms makes 2e-8 of the torque's effect wrong at a quarter of a tick of 3 kHz. */
#define PARTS_A_TICK 4.0
#define EVENTS_MAX 100 /* in one piece; then the axis rests until its end */

#define DELAY_MAX 64u
#define RING (DELAY_MAX + 1u)

struct gsid_axis {
    gsid_axis_cfg cfg;
    int is_curved;              /* some law is */
    matrix rates[N_REGIMES];
    piece pieces[2];
    uint32_t delay_ticks;
    double x[N_STATES];
    double side;                /* -1, 0 sticking or frictionless, +1: the side friction pushes against */
    double command[RING];       /* what the drive makes of the commands, by tick modulo RING */
    uint64_t tick;
    uint64_t n_refreshes;       /* of a gyro that is refreshed */
    double shown;               /* and what it shows since the last */
    uint64_t random[4];
    double spare;               /* second half of the last pair of normal numbers */
    int has_spare;
    double low_noise, low_pole; /* coloured noise and the pole of its filter */
    double torque, torque_pole; /* process noise of this tick, and the pole of its filter */
    double first_refresh;       /* time of the gyro's first refresh, in refreshes, 0 .. 1 */
};

/* ---- the step of a linear system ---- */

/* a b + factor c */
static matrix multiply_add(const matrix *a, const matrix *b, double factor, const matrix *c) {
    matrix sum;
    for (int i = 0; i < N_ALL; i++) {
        for (int j = 0; j < N_ALL; j++) {
            sum.m[i][j] = factor * c->m[i][j];
            for (int k = 0; k < N_ALL; k++) {
                sum.m[i][j] += a->m[i][k] * b->m[k][j];
            }
        }
    }
    return sum;
}

static matrix scaled(const matrix *a, double factor) {
    matrix c;
    for (int i = 0; i < N_ALL; i++) {
        for (int j = 0; j < N_ALL; j++) {
            c.m[i][j] = factor * a->m[i][j];
        }
    }
    return c;
}

static double norm(const matrix *a) {
    double largest = 0.0;
    for (int i = 0; i < N_ALL; i++) {
        double sum = 0.0;
        for (int j = 0; j < N_ALL; j++) {
            sum += fabs(a->m[i][j]);
        }
        largest = fmax(largest, sum);
    }
    return largest;
}

/* exp(a t) - 1 by its series at 1/2^n of the time, then n doublings: (1 + e)^2 - 1 = e^2 + 2 e. Carrying the difference
 * from 1 keeps the digits of short steps. */
static matrix exponential(const matrix *a, double t_s) {
    int n_doublings = 0;
    for (double size = norm(a) * t_s; size > 0.5; size *= 0.5) {
        n_doublings++;
    }
    const matrix step = scaled(a, ldexp(t_s, -n_doublings));
    matrix e = scaled(a, 0.0);
    for (int order = 16; order >= 1; order--) { /* the next term, 0.5^17 / 17!, is below 1e-19 */
        e = multiply_add(&step, &e, 1.0, &step);
        e = scaled(&e, 1.0 / order);
    }
    for (int n = 0; n < n_doublings; n++) {
        e = multiply_add(&e, &e, 2.0, &e);
    }
    return e;
}

static void fill_rates(const gsid_axis_cfg *cfg, regime how, matrix *rates) {
    const double w0 = 2.0 * PI * cfg->mode_f_hz;
    double (*a)[N_ALL] = rates->m;
    memset(rates, 0, sizeof *rates);
    if (how == SLIP) {
        a[THETA][RATE] = 1.0;
        a[RATE][RATE] = -cfg->viscous_rate;
        a[RATE][THETA] = -cfg->spring_stiffness;
        a[RATE][IN_COMMAND] = cfg->gain;
        a[RATE][IN_FRICTION] = -cfg->coulomb_level;
        a[RATE][IN_TORQUE] = 1.0;
    }
    if (w0 > 0.0) {
        a[MODE_P][MODE_R] = w0;
        a[MODE_R][MODE_P] = -w0;
        a[MODE_R][MODE_R] = -2.0 * cfg->mode_zeta * w0;
        a[MODE_R][IN_COMMAND] = cfg->mode_residue * cfg->gain;
    }
    if (cfg->gyro_lag_s > 0.0) {
        a[GYRO][GYRO] = -1.0 / cfg->gyro_lag_s;
        a[GYRO][RATE] = a[GYRO][MODE_R] = 1.0 / cfg->gyro_lag_s;
    }
}

static void advance(gsid_axis *axis, const matrix *e, double u) {
    double z[N_ALL];
    memcpy(z, axis->x, sizeof axis->x);
    z[IN_COMMAND] = u;
    z[IN_FRICTION] = axis->side;
    z[IN_TORQUE] = axis->torque;
    for (int i = 0; i < N_STATES; i++) {
        double change = 0.0;
        for (int j = 0; j < N_ALL; j++) {
            change += e->m[i][j] * z[j];
        }
        axis->x[i] += change;
    }
}

/* ---- stick and slip ---- */

/* Angle beyond a stop, deg; 0 between the stops. */
static double depth(const gsid_axis *axis) {
    const double low = axis->cfg.stop_low_deg, high = axis->cfg.stop_high_deg, theta = axis->x[THETA];
    if (high > 0.0 && theta > high) {
        return theta - high;
    }
    return low < 0.0 && theta < low ? theta - low : 0.0;
}

/* The laws of the angle alone. */
static double position_torque(const gsid_axis *axis) {
    const gsid_axis_cfg *cfg = &axis->cfg;
    const double theta = axis->x[THETA], turned = theta * RADIANS, rest = cfg->unbalance_angle_deg * RADIANS;
    double torque = cfg->cubic_stiffness * theta * theta * theta + cfg->stop_stiffness * depth(axis);
    if (cfg->unbalance_level > 0.0) {
        torque += cfg->unbalance_level * (sin(turned + rest) - sin(rest));
    }
    if (cfg->cogging_level > 0.0) {
        torque += cfg->cogging_level * sin(cfg->cogging_cycles * turned + cfg->cogging_phase_rad);
    }
    return torque;
}

/* What the matrix of a slipping axis leaves out of its torques. */
static double curved_torque(const gsid_axis *axis) {
    const gsid_axis_cfg *cfg = &axis->cfg;
    const double w = axis->x[RATE];
    double torque = position_torque(axis) + cfg->drag_rate * w * fabs(w);
    if (depth(axis) != 0.0) {
        torque += cfg->stop_damping * w;
    }
    if (cfg->stribeck_extra > 0.0) {
        const double ratio = w / cfg->stribeck_velocity;
        torque += axis->side * cfg->stribeck_extra * exp(-ratio * ratio);
    }
    return torque;
}

static double spring_and_motor(const gsid_axis *axis, double u) {
    return axis->cfg.gain * u + axis->torque - axis->cfg.spring_stiffness * axis->x[THETA] - position_torque(axis);
}

/* At rest friction holds what it can; only a switch of the command can break it loose, since theta stands still. */
static regime choose_side(gsid_axis *axis, double u) {
    const double level = axis->cfg.coulomb_level + axis->cfg.stribeck_extra;
    double towards = axis->x[RATE];
    axis->side = 0.0;
    if (level == 0.0) {
        return SLIP;
    }
    if (towards == 0.0) {
        towards = spring_and_motor(axis, u);
        if (fabs(towards) <= level) {
            return STICK;
        }
    }
    axis->side = towards > 0.0 ? 1.0 : -1.0;
    return SLIP;
}

/* Time until the slipping axis comes to rest, in closed form: with constant torque the rate, counted in the direction
 * of motion, is
 *   exp(-half t) (w cos(mu t) + (b / mu) sin(mu t)),  b = dw/dt + half w,  mu^2 = spring - half^2,
 * with the hyperbolic functions when mu^2 < 0. */
static double time_to_rest(const gsid_axis *axis, double u) {
    const gsid_axis_cfg *cfg = &axis->cfg;
    const double half = 0.5 * cfg->viscous_rate, mu_squared = cfg->spring_stiffness - half * half;
    const double mu = sqrt(fabs(mu_squared));
    const double w = fabs(axis->x[RATE]); /* never -0: atan2 would turn the wrong way */
    const double b = axis->side * spring_and_motor(axis, u) - cfg->coulomb_level - half * w;
    if (mu_squared > 0.0) {
        return atan2(w * mu, -b) / mu;
    }
    if (-b <= w * mu) {
        return INFINITY;
    }
    return mu > 0.0 ? atanh(w * mu / -b) / mu : w / -b;
}

/* The classical Runge-Kutta method in coordinates that move with the exact linear flow (Lawson 1967): `half` is that
 * flow over half of t_s, applied before and after the torques of the middle. */
static void curved_step(gsid_axis *axis, const matrix *half, double t_s, double u) {
    double start[N_STATES], middle[N_STATES], slope[4];
    memcpy(start, axis->x, sizeof start);
    slope[0] = -curved_torque(axis);
    advance(axis, half, u);
    memcpy(middle, axis->x, sizeof middle);

    memcpy(axis->x, start, sizeof start);
    axis->x[RATE] += 0.5 * t_s * slope[0];
    advance(axis, half, u);
    slope[1] = -curved_torque(axis);

    memcpy(axis->x, middle, sizeof middle);
    axis->x[RATE] += 0.5 * t_s * slope[1];
    slope[2] = -curved_torque(axis);

    memcpy(axis->x, middle, sizeof middle);
    axis->x[RATE] += t_s * slope[2];
    advance(axis, half, u);
    slope[3] = -curved_torque(axis);

    memcpy(axis->x, start, sizeof start);
    axis->x[RATE] += t_s / 6.0 * slope[0];
    advance(axis, half, u);
    axis->x[RATE] += t_s / 3.0 * (slope[1] + slope[2]);
    advance(axis, half, u);
    axis->x[RATE] += t_s / 6.0 * slope[3];
}

static void curved_step_of(gsid_axis *axis, const double *from, double t_s, double u) {
    const matrix half = exponential(&axis->rates[SLIP], 0.5 * t_s);
    memcpy(axis->x, from, sizeof axis->x);
    curved_step(axis, &half, t_s, u);
}

/* The rate has changed its sign within a step from `from`: find the instant by secants and halving in turn. Returns the
 * time until then, and leaves the axis at rest. */
static double go_to_rest(gsid_axis *axis, const double *from, double t_s, double u) {
    double low = 0.0, high = t_s, w_low = axis->side * from[RATE], w_high = axis->side * axis->x[RATE];
    double t = high, w = w_high;
    const double nothing = 1e-13 * (w_low - w_high);
    for (int i = 0; i < 60 && fabs(w) > nothing; i++) {
        t = i % 2 == 0 && w_low > 0.0 ? low + (high - low) * w_low / (w_low - w_high) : 0.5 * (low + high);
        curved_step_of(axis, from, t, u);
        w = axis->side * axis->x[RATE];
        *(w > 0.0 ? &low : &high) = t;
        *(w > 0.0 ? &w_low : &w_high) = w;
    }
    axis->x[RATE] = 0.0;
    return t;
}

/* One step of at most t_s of a slipping axis with curved laws; returns the time it took. */
static double slip_curved(gsid_axis *axis, const piece *p, double t_s, double u) {
    double from[N_STATES];
    memcpy(from, axis->x, sizeof from);
    const int is_usual = t_s > p->part_s * (1.0 - 1e-9);
    if (is_usual) {
        t_s = p->part_s;
        curved_step(axis, &p->half, t_s, u);
    } else {
        curved_step_of(axis, from, t_s, u);
    }
    return axis->side * axis->x[RATE] < 0.0 ? go_to_rest(axis, from, t_s, u) : t_s;
}

/* One step of at most t_s through linear laws; returns the time it took. */
static double go_straight(gsid_axis *axis, const piece *p, regime how, double t_s, double u) {
    const double rest_s = axis->side != 0.0 ? time_to_rest(axis, u) : INFINITY;
    const double done_s = fmin(rest_s, t_s);
    if (done_s == p->duration_s) {
        advance(axis, &p->whole[how], u);
    } else {
        const matrix e = exponential(&axis->rates[how], done_s);
        advance(axis, &e, u);
    }
    if (rest_s <= t_s) {
        axis->x[RATE] = 0.0;
    }
    return done_s;
}

/* Through linear laws the next event is at least half a period of the spring away; curved ones may, by rounding, find
 * one after the other. */
static void run_for(gsid_axis *axis, const piece *p, double left_s, double u) {
    for (int n_events = 0; left_s > 1e-12 * p->duration_s; n_events++) {
        regime how = choose_side(axis, u);
        if (n_events > EVENTS_MAX) {
            axis->x[RATE] = axis->side = 0.0;
            how = STICK;
        }
        const int curved = how == SLIP && axis->is_curved;
        left_s -= curved ? slip_curved(axis, p, left_s, u) : go_straight(axis, p, how, left_s, u);
    }
}

/* ---- the gyro's refreshes ---- */

#define SAME_INSTANT 1e-6 /* ticks */

/* Ticks from now to the next refresh. The instant comes from the refresh's number: it cannot drift. */
static double until_refresh(const gsid_axis *axis) {
    if (axis->cfg.gyro_refresh_hz == 0.0) {
        return INFINITY;
    }
    const double n = (double)axis->n_refreshes + axis->first_refresh;
    return n * axis->cfg.fs_hz / axis->cfg.gyro_refresh_hz - (double)axis->tick;
}

static double gyro(const gsid_axis *axis) {
    return axis->cfg.gyro_lag_s > 0.0 ? axis->x[GYRO] : axis->x[RATE] + axis->x[MODE_R];
}

static void refresh(gsid_axis *axis, double disturbance) {
    axis->shown = gyro(axis) + disturbance;
    axis->n_refreshes++;
}

static double gyro_sample(gsid_axis *axis, double disturbance) {
    if (axis->cfg.gyro_refresh_hz == 0.0) {
        return gyro(axis) + disturbance;
    }
    if (until_refresh(axis) < SAME_INSTANT) {
        refresh(axis, disturbance);
    }
    return axis->shown;
}

/* Run through a piece that begins `start` ticks after the tick, with the gyro refreshed where that is due. */
static void run_piece(gsid_axis *axis, const piece *p, double start, double u, double disturbance) {
    const double fs_hz = axis->cfg.fs_hz, end = start + p->duration_s * fs_hz;
    double left_s = p->duration_s;
    for (double next = until_refresh(axis); next < end - SAME_INSTANT; next = until_refresh(axis)) {
        const double before_s = fmax(0.0, left_s - (end - next) / fs_hz);
        run_for(axis, p, before_s, u);
        left_s -= before_s;
        refresh(axis, disturbance);
    }
    run_for(axis, p, left_s, u);
}

/* ---- noise: xoshiro256** (Blackman and Vigna), seeded by splitmix64, made normal by Box and Muller ---- */

static uint64_t rotate(uint64_t x, int k) {
    return (x << k) | (x >> (64 - k));
}

static uint64_t random_bits(uint64_t s[4]) {
    const uint64_t result = rotate(s[1] * 5u, 7) * 9u, t = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = rotate(s[3], 45);
    return result;
}

static void random_seed(uint64_t s[4], uint64_t seed) {
    for (int i = 0; i < 4; i++) {
        seed += 0x9E3779B97F4A7C15u;
        uint64_t z = seed;
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
        s[i] = z ^ (z >> 31);
    }
}

static double random_normal(gsid_axis *axis) {
    if (axis->has_spare) {
        axis->has_spare = 0;
        return axis->spare;
    }
    const double first = ldexp((double)(random_bits(axis->random) >> 11) + 1.0, -53); /* (0, 1]: log is finite */
    const double second = ldexp((double)(random_bits(axis->random) >> 11), -53);
    const double radius = sqrt(-2.0 * log(first));
    axis->spare = radius * sin(2.0 * PI * second);
    axis->has_spare = 1;
    return radius * cos(2.0 * PI * second);
}

static double noise(gsid_axis *axis) {
    const gsid_axis_cfg *cfg = &axis->cfg;
    double sum = 0.0;
    if (cfg->noise_rms > 0.0) {
        sum += cfg->noise_rms * random_normal(axis);
    }
    if (cfg->noise_low_rms > 0.0) {
        sum += axis->low_noise;
        const double pole = axis->low_pole, drive = cfg->noise_low_rms * sqrt(1.0 - pole * pole);
        axis->low_noise = pole * axis->low_noise + drive * random_normal(axis);
    }
    return sum;
}

static double process_noise(gsid_axis *axis) {
    const double pole = axis->torque_pole, drive = axis->cfg.torque_noise_rms * sqrt(1.0 - pole * pole);
    return pole * axis->torque + drive * random_normal(axis);
}

/* The phase comes from the tick's number, not from a running sum: it cannot drift. */
static double fan(const gsid_axis *axis) {
    const gsid_axis_cfg *cfg = &axis->cfg;
    if (cfg->fan_amplitude == 0.0) {
        return 0.0;
    }
    const double turns = fmod((double)axis->tick * cfg->fan_f_hz / cfg->fs_hz, 1.0);
    return cfg->fan_amplitude * sin(2.0 * PI * turns + cfg->fan_phase_rad);
}

/* ---- the axis ---- */

gsid_status gsid_axis_cfg_init(gsid_axis_cfg *cfg) {
    if (!cfg) {
        return GSID_E_NULL;
    }
    const gsid_axis_cfg inner_azimuth = {
        .fs_hz = 3000.0,
        .gain = 7.4,
        .viscous_rate = 11.0,
        .coulomb_level = 0.0,
        .spring_stiffness = 170.0,
        .delay_s = 5.4e-3,
        .mode_f_hz = 179.0,
        .mode_zeta = 0.015,
        .mode_residue = 0.15, /* the resonance stands 14 dB above the rigid body's slope */
        .gyro_lag_s = 1e-3,
        .command_limit = 179.0,
        .command_bits = 12,
        .stop_stiffness = 1e5, /* with damping that leaves 91 % of the rate after a contact */
        .stop_damping = 20.0,
        .torque_noise_hz = 10.0,
        .noise_rms = 0.010,
        .noise_low_rms = 0.010,
        .noise_low_hz = 5.0,
        .fan_f_hz = 30.9,
        .fan_amplitude = 0.005,
        .fan_phase_rad = 0.0,
        .seed = 1,
    };
    *cfg = inner_azimuth;
    return GSID_OK;
}

static gsid_status check_numbers(const gsid_axis_cfg *c) {
    const double any[] = {c->gain,     c->mode_residue,  c->unbalance_angle_deg, c->cogging_phase_rad,
                          c->fan_f_hz, c->fan_amplitude, c->fan_phase_rad,       c->stop_low_deg};
    const double magnitudes[] = {c->fs_hz,          c->viscous_rate,      c->coulomb_level,   c->stribeck_extra,
                                 c->drag_rate,      c->stribeck_velocity, c->cubic_stiffness, c->spring_stiffness,
                                 c->cogging_cycles, c->unbalance_level,   c->cogging_level,   c->delay_s,
                                 c->mode_f_hz,      c->mode_zeta,         c->gyro_lag_s,      c->command_limit,
                                 c->drive_limit,    c->drive_dead_zone,   c->gyro_refresh_hz, c->noise_rms,
                                 c->noise_low_rms,  c->noise_low_hz,      c->stop_stiffness,  c->stop_damping,
                                 c->stop_high_deg,  c->torque_noise_rms,  c->torque_noise_hz};
    gsid_status status = GSID_OK;
    for (size_t i = 0; i < sizeof any / sizeof any[0]; i++) {
        if (!isfinite(any[i])) {
            return GSID_E_NONFINITE;
        }
    }
    for (size_t i = 0; i < sizeof magnitudes / sizeof magnitudes[0]; i++) {
        if (!isfinite(magnitudes[i])) {
            return GSID_E_NONFINITE;
        }
        if (magnitudes[i] < 0.0) {
            status = GSID_E_CONFIG;
        }
    }
    return status;
}

static int has_stop(const gsid_axis_cfg *c) {
    return c->stop_low_deg < 0.0 || c->stop_high_deg > 0.0;
}

/* Those of curved laws are as fast as the ticks at most, since their steps are fractions of one. */
static int has_slow_laws(const gsid_axis_cfg *c) {
    const double fastest = c->fs_hz, cogging = c->cogging_level * c->cogging_cycles * RADIANS;
    const int slow_stops = c->stop_stiffness <= fastest * fastest && c->stop_damping <= fastest;
    return (slow_stops || !has_stop(c)) && c->stribeck_extra <= fastest * c->stribeck_velocity &&
           c->unbalance_level * RADIANS <= fastest * fastest && cogging <= fastest * fastest;
}

static gsid_status check(const gsid_axis_cfg *c) {
    const gsid_status status = check_numbers(c);
    if (status != GSID_OK) {
        return status;
    }
    if (c->fs_hz == 0.0 || c->delay_s * c->fs_hz >= DELAY_MAX || c->command_bits > 31 ||
        c->gyro_refresh_hz > c->fs_hz) {
        return GSID_E_CONFIG;
    }
    if (c->stop_low_deg > 0.0 || c->gyro_free_running > 1 || (c->torque_noise_rms > 0.0 && c->torque_noise_hz == 0.0)) {
        return GSID_E_CONFIG;
    }
    if (c->noise_low_rms > 0.0 && c->noise_low_hz == 0.0) {
        return GSID_E_CONFIG;
    }
    const double fastest = GSID_AXIS_RATE_MAX * c->fs_hz; /* keeps the step matrices accurate and their doublings few */
    if (c->viscous_rate > fastest || sqrt(c->spring_stiffness) > fastest || 2.0 * PI * c->mode_f_hz > fastest ||
        c->mode_zeta > GSID_AXIS_RATE_MAX || (c->gyro_lag_s > 0.0 && c->gyro_lag_s * fastest < 1.0)) {
        return GSID_E_CONFIG;
    }
    return has_slow_laws(c) ? GSID_OK : GSID_E_CONFIG;
}

static int has_curved_law(const gsid_axis_cfg *c) {
    return c->stribeck_extra > 0.0 || c->drag_rate > 0.0 || c->cubic_stiffness > 0.0 || c->unbalance_level > 0.0 ||
           c->cogging_level > 0.0 || has_stop(c);
}

static void make_steps(gsid_axis *axis, piece *p) {
    for (int how = 0; how < N_REGIMES; how++) {
        p->whole[how] = exponential(&axis->rates[how], p->duration_s);
    }
    p->part_s = p->duration_s / fmax(1.0, ceil(p->duration_s * axis->cfg.fs_hz * PARTS_A_TICK - 1e-9));
    p->half = exponential(&axis->rates[SLIP], 0.5 * p->part_s);
}

gsid_status gsid_axis_create(gsid_axis **axis, const gsid_axis_cfg *cfg) {
    if (!axis || !cfg) {
        return GSID_E_NULL;
    }
    const gsid_status status = check(cfg);
    if (status != GSID_OK) {
        return status;
    }
    gsid_axis *made = calloc(1, sizeof *made);
    if (!made) {
        return GSID_E_NO_MEMORY;
    }
    made->cfg = *cfg;
    const double delay = cfg->delay_s * cfg->fs_hz;
    made->delay_ticks = (uint32_t)delay;
    made->pieces[0].duration_s = (delay - (double)made->delay_ticks) / cfg->fs_hz;
    made->pieces[1].duration_s = 1.0 / cfg->fs_hz - made->pieces[0].duration_s;
    made->is_curved = has_curved_law(cfg);
    for (int how = 0; how < N_REGIMES; how++) {
        fill_rates(cfg, (regime)how, &made->rates[how]);
    }
    for (int i = 0; i < 2; i++) {
        make_steps(made, &made->pieces[i]);
    }
    made->low_pole = exp(-2.0 * PI * cfg->noise_low_hz / cfg->fs_hz);
    made->torque_pole = exp(-2.0 * PI * cfg->torque_noise_hz / cfg->fs_hz);
    gsid_axis_reset(made);
    *axis = made;
    return GSID_OK;
}

void gsid_axis_destroy(gsid_axis *axis) {
    free(axis);
}

gsid_status gsid_axis_reset(gsid_axis *axis) {
    if (!axis) {
        return GSID_E_NULL;
    }
    memset(axis->x, 0, sizeof axis->x);
    memset(axis->command, 0, sizeof axis->command);
    axis->tick = axis->n_refreshes = 0;
    axis->has_spare = 0;
    random_seed(axis->random, axis->cfg.seed);
    axis->low_noise = axis->cfg.noise_low_rms > 0.0 ? axis->cfg.noise_low_rms * random_normal(axis) : 0.0;
    axis->torque = axis->cfg.torque_noise_rms > 0.0 ? axis->cfg.torque_noise_rms * random_normal(axis) : 0.0;
    axis->first_refresh = axis->cfg.gyro_free_running ? ldexp((double)(random_bits(axis->random) >> 11), -53) : 0.0;
    axis->shown = 0.0; /* until the first refresh */
    return GSID_OK;
}

static double applied(const gsid_axis_cfg *cfg, double u) {
    if (cfg->command_limit == 0.0) {
        return u;
    }
    u = fmax(-cfg->command_limit, fmin(cfg->command_limit, u));
    if (cfg->command_bits == 0) {
        return u;
    }
    const double step = ldexp(cfg->command_limit, 1 - (int)cfg->command_bits);
    return step * round(u / step);
}

static double driven(const gsid_axis_cfg *cfg, double u) {
    u = copysign(fmax(fabs(u) - cfg->drive_dead_zone, 0.0), u);
    return cfg->drive_limit > 0.0 ? fmax(-cfg->drive_limit, fmin(cfg->drive_limit, u)) : u;
}

static double command_before(const gsid_axis *axis, uint32_t n_ticks) {
    return axis->command[(axis->tick + RING - n_ticks) % RING];
}

gsid_status gsid_axis_step(gsid_axis *axis, uint32_t n, const double *u, double *u_applied, double *y,
                           double *angle_deg) {
    if (!axis || (n > 0 && (!u || !y))) {
        return GSID_E_NULL;
    }
    for (uint32_t i = 0; i < n; i++) {
        if (!isfinite(u[i])) {
            return GSID_E_NONFINITE;
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        const double now = applied(&axis->cfg, u[i]);
        axis->command[axis->tick % RING] = driven(&axis->cfg, now);
        if (u_applied) {
            u_applied[i] = now;
        }
        if (angle_deg) {
            angle_deg[i] = axis->x[THETA];
        }
        const double disturbance = noise(axis) + fan(axis);
        y[i] = gyro_sample(axis, disturbance);
        run_piece(axis, &axis->pieces[0], 0.0, command_before(axis, axis->delay_ticks + 1), disturbance);
        run_piece(axis, &axis->pieces[1], axis->pieces[0].duration_s * axis->cfg.fs_hz,
                  command_before(axis, axis->delay_ticks), disturbance);
        if (axis->cfg.torque_noise_rms > 0.0) {
            axis->torque = process_noise(axis);
        }
        axis->tick++;
    }
    return GSID_OK;
}
