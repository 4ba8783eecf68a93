#include "gsid/host/axis.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PI 3.14159265358979323846

/* Between two events (the delayed command switches, the rate passes zero) the axis is linear with constant inputs:
 *   theta' = w,   w' = gain u - viscous w - spring theta - level s,   s the sign of w
 *   p' = w0 r,    r' = residue gain u - w0 p - 2 zeta w0 r            (r = q', p = w0 q: rates both, well scaled)
 *   gyro' = (w + r - gyro) / lag
 * and a step of any length is a matrix. While the axis sticks, theta and w stand still. */
enum { THETA, RATE, MODE_P, MODE_R, GYRO, N_STATES, IN_COMMAND = N_STATES, IN_FRICTION, N_ALL };

typedef struct {
    double m[N_ALL][N_ALL];
} matrix;

typedef enum { SLIP, STICK, N_REGIMES } regime;

/* A tick is [0, frac) with the command of d + 1 ticks ago, then [frac, 1) with that of d ticks ago. */
typedef struct {
    double duration_s;
    matrix whole[N_REGIMES]; /* the step over the whole piece */
} piece;

#define DELAY_MAX 64u
#define RING (DELAY_MAX + 1u)

struct gsid_axis {
    gsid_axis_cfg cfg;
    matrix rates[N_REGIMES];
    piece pieces[2];
    uint32_t delay_ticks;
    double x[N_STATES];
    double side;                /* -1, 0 sticking or frictionless, +1: the side friction pushes against */
    double command[RING];       /* applied commands, by tick modulo RING */
    uint64_t tick;
    uint64_t random[4];
    double spare;               /* second half of the last pair of normal numbers */
    int has_spare;
    double low_noise, low_pole; /* coloured noise and the pole of its filter */
};

/* ---- the step of a linear system ---- */

/* a b + factor c */
static matrix multiply_add(const matrix *a, const matrix *b, double factor, const matrix *c) {
    matrix sum;
    for (int i = 0; i < N_ALL; i++) {
        for (int j = 0; j < N_ALL; j++) {
            sum.m[i][j] = factor * c->m[i][j];
            for (int k = 0; k < N_ALL; k++)
                sum.m[i][j] += a->m[i][k] * b->m[k][j];
        }
    }
    return sum;
}

static matrix scaled(const matrix *a, double factor) {
    matrix c;
    for (int i = 0; i < N_ALL; i++) {
        for (int j = 0; j < N_ALL; j++)
            c.m[i][j] = factor * a->m[i][j];
    }
    return c;
}

static double norm(const matrix *a) {
    double largest = 0.0;
    for (int i = 0; i < N_ALL; i++) {
        double sum = 0.0;
        for (int j = 0; j < N_ALL; j++)
            sum += fabs(a->m[i][j]);
        largest = fmax(largest, sum);
    }
    return largest;
}

/* exp(a t) - 1 by its series at 1/2^n of the time, then n doublings: (1 + e)^2 - 1 = e^2 + 2 e. Carrying the difference
 * from 1 keeps the digits of short steps. */
static matrix exponential(const matrix *a, double t_s) {
    int n_doublings = 0;
    for (double size = norm(a) * t_s; size > 0.5; size *= 0.5)
        n_doublings++;
    const matrix step = scaled(a, ldexp(t_s, -n_doublings));
    matrix e = scaled(a, 0.0);
    for (int order = 16; order >= 1; order--) { /* the next term, 0.5^17 / 17!, is below 1e-19 */
        e = multiply_add(&step, &e, 1.0, &step);
        e = scaled(&e, 1.0 / order);
    }
    for (int n = 0; n < n_doublings; n++)
        e = multiply_add(&e, &e, 2.0, &e);
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
    for (int i = 0; i < N_STATES; i++) {
        double change = 0.0;
        for (int j = 0; j < N_ALL; j++)
            change += e->m[i][j] * z[j];
        axis->x[i] += change;
    }
}

/* ---- stick and slip ---- */

static double spring_and_motor(const gsid_axis *axis, double u) {
    return axis->cfg.gain * u - axis->cfg.spring_stiffness * axis->x[THETA];
}

/* At rest friction holds what it can; only a switch of the command can break it loose, since theta stands still. */
static regime choose_side(gsid_axis *axis, double u) {
    const double level = axis->cfg.coulomb_level;
    double towards = axis->x[RATE];
    axis->side = 0.0;
    if (level == 0.0)
        return SLIP;
    if (towards == 0.0) {
        towards = spring_and_motor(axis, u);
        if (fabs(towards) <= level)
            return STICK;
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
    if (mu_squared > 0.0)
        return atan2(w * mu, -b) / mu;
    if (-b <= w * mu)
        return INFINITY;
    return mu > 0.0 ? atanh(w * mu / -b) / mu : w / -b;
}

/* Ends: after an event the rate is zero, and the next is at least half a period of the spring away. */
static void run_piece(gsid_axis *axis, const piece *p, double u) {
    double left_s = p->duration_s;
    while (left_s > 0.0) {
        const regime how = choose_side(axis, u);
        const double rest_s = axis->side != 0.0 ? time_to_rest(axis, u) : INFINITY;
        const double t_s = fmin(rest_s, left_s);
        if (t_s == p->duration_s) {
            advance(axis, &p->whole[how], u);
        } else {
            const matrix e = exponential(&axis->rates[how], t_s);
            advance(axis, &e, u);
        }
        if (rest_s <= left_s)
            axis->x[RATE] = 0.0;
        left_s -= t_s;
    }
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
    if (cfg->noise_rms > 0.0)
        sum += cfg->noise_rms * random_normal(axis);
    if (cfg->noise_low_rms > 0.0) {
        sum += axis->low_noise;
        const double pole = axis->low_pole, drive = cfg->noise_low_rms * sqrt(1.0 - pole * pole);
        axis->low_noise = pole * axis->low_noise + drive * random_normal(axis);
    }
    return sum;
}

/* The phase comes from the tick's number, not from a running sum: it cannot drift. */
static double fan(const gsid_axis *axis) {
    const gsid_axis_cfg *cfg = &axis->cfg;
    if (cfg->fan_amplitude == 0.0)
        return 0.0;
    const double turns = fmod((double)axis->tick * cfg->fan_f_hz / cfg->fs_hz, 1.0);
    return cfg->fan_amplitude * sin(2.0 * PI * turns + cfg->fan_phase_rad);
}

/* ---- the axis ---- */

gsid_status gsid_axis_cfg_init(gsid_axis_cfg *cfg) {
    if (!cfg)
        return GSID_E_NULL;
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

static gsid_status check_finite(const gsid_axis_cfg *c) {
    const double all[] = {c->fs_hz,         c->gain,         c->viscous_rate,  c->coulomb_level, c->spring_stiffness,
                          c->delay_s,       c->mode_f_hz,    c->mode_zeta,     c->mode_residue,  c->gyro_lag_s,
                          c->command_limit, c->noise_rms,    c->noise_low_rms, c->noise_low_hz,  c->fan_f_hz,
                          c->fan_amplitude, c->fan_phase_rad};
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++) {
        if (!isfinite(all[i]))
            return GSID_E_NONFINITE;
    }
    return GSID_OK;
}

static gsid_status check(const gsid_axis_cfg *c) {
    if (check_finite(c) != GSID_OK)
        return GSID_E_NONFINITE;
    const double magnitudes[] = {c->viscous_rate, c->coulomb_level, c->spring_stiffness, c->delay_s,
                                 c->mode_f_hz,    c->mode_zeta,     c->gyro_lag_s,       c->command_limit,
                                 c->noise_rms,    c->noise_low_rms, c->noise_low_hz};
    for (size_t i = 0; i < sizeof magnitudes / sizeof magnitudes[0]; i++) {
        if (magnitudes[i] < 0.0)
            return GSID_E_CONFIG;
    }
    if (c->fs_hz <= 0.0 || c->delay_s * c->fs_hz >= DELAY_MAX || c->command_bits > 31)
        return GSID_E_CONFIG;
    if (c->noise_low_rms > 0.0 && c->noise_low_hz == 0.0)
        return GSID_E_CONFIG;
    const double fastest = GSID_AXIS_RATE_MAX * c->fs_hz; /* keeps the step matrices accurate and their doublings few */
    if (c->viscous_rate > fastest || sqrt(c->spring_stiffness) > fastest || 2.0 * PI * c->mode_f_hz > fastest ||
        c->mode_zeta > GSID_AXIS_RATE_MAX || (c->gyro_lag_s > 0.0 && c->gyro_lag_s * fastest < 1.0))
        return GSID_E_CONFIG;
    return GSID_OK;
}

gsid_status gsid_axis_create(gsid_axis **axis, const gsid_axis_cfg *cfg) {
    if (!axis || !cfg)
        return GSID_E_NULL;
    const gsid_status status = check(cfg);
    if (status != GSID_OK)
        return status;
    gsid_axis *made = calloc(1, sizeof *made);
    if (!made)
        return GSID_E_NO_MEMORY;
    made->cfg = *cfg;
    const double delay = cfg->delay_s * cfg->fs_hz;
    made->delay_ticks = (uint32_t)delay;
    made->pieces[0].duration_s = (delay - (double)made->delay_ticks) / cfg->fs_hz;
    made->pieces[1].duration_s = 1.0 / cfg->fs_hz - made->pieces[0].duration_s;
    for (int how = 0; how < N_REGIMES; how++) {
        fill_rates(cfg, (regime)how, &made->rates[how]);
        for (int i = 0; i < 2; i++)
            made->pieces[i].whole[how] = exponential(&made->rates[how], made->pieces[i].duration_s);
    }
    made->low_pole = exp(-2.0 * PI * cfg->noise_low_hz / cfg->fs_hz);
    gsid_axis_reset(made);
    *axis = made;
    return GSID_OK;
}

void gsid_axis_destroy(gsid_axis *axis) {
    free(axis);
}

gsid_status gsid_axis_reset(gsid_axis *axis) {
    if (!axis)
        return GSID_E_NULL;
    memset(axis->x, 0, sizeof axis->x);
    memset(axis->command, 0, sizeof axis->command);
    axis->tick = 0;
    axis->has_spare = 0;
    random_seed(axis->random, axis->cfg.seed);
    axis->low_noise = axis->cfg.noise_low_rms > 0.0 ? axis->cfg.noise_low_rms * random_normal(axis) : 0.0;
    return GSID_OK;
}

static double applied(const gsid_axis_cfg *cfg, double u) {
    if (cfg->command_limit == 0.0)
        return u;
    u = fmax(-cfg->command_limit, fmin(cfg->command_limit, u));
    if (cfg->command_bits == 0)
        return u;
    const double step = ldexp(cfg->command_limit, 1 - (int)cfg->command_bits);
    return step * round(u / step);
}

static double command_before(const gsid_axis *axis, uint32_t n_ticks) {
    return axis->command[(axis->tick + RING - n_ticks) % RING];
}

gsid_status gsid_axis_step(gsid_axis *axis, uint32_t n, const double *u, double *u_applied, double *y,
                           double *angle_deg) {
    if (!axis || (n > 0 && (!u || !y)))
        return GSID_E_NULL;
    for (uint32_t i = 0; i < n; i++) {
        if (!isfinite(u[i]))
            return GSID_E_NONFINITE;
    }
    for (uint32_t i = 0; i < n; i++) {
        const double now = applied(&axis->cfg, u[i]);
        axis->command[axis->tick % RING] = now;
        if (u_applied)
            u_applied[i] = now;
        if (angle_deg)
            angle_deg[i] = axis->x[THETA];
        const double gyro = axis->cfg.gyro_lag_s > 0.0 ? axis->x[GYRO] : axis->x[RATE] + axis->x[MODE_R];
        y[i] = gyro + noise(axis) + fan(axis);
        run_piece(axis, &axis->pieces[0], command_before(axis, axis->delay_ticks + 1));
        run_piece(axis, &axis->pieces[1], command_before(axis, axis->delay_ticks));
        axis->tick++;
    }
    return GSID_OK;
}
