/* A simulated gimbal axis for trials: the inner azimuth axis of the thesis. It shares no code with the fitted models: it is
 * integrated exactly between events, and the instants of stick and slip are computed. Laws that are not linear are
 * integrated by a Runge-Kutta method of order 4 around the exact linear part. */
#ifndef GSID_HOST_AXIS_H
#define GSID_HOST_AXIS_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

/* No decay or oscillation of the axis may be faster than this many times the ticks [rad/s over ticks per second]. */
#define GSID_AXIS_RATE_MAX 1000.0

/* Values divided by the inertia, as in the design's table of effects. A zero switches an effect off. Everything but the
 * gain, the residue, the fan, the lower stop, angles and phases is >= 0. */
typedef struct {
    double fs_hz;                    /* ticks per second, > 0 */
    double gain;                     /* deg/s^2 per command */
    double viscous_rate;             /* 1/s */
    double spring_stiffness;         /* 1/s^2 */
    double coulomb_level;            /* deg/s^2 */
    double stribeck_extra;           /* deg/s^2: friction is level + extra exp(-(w / velocity)^2) */
    double stribeck_velocity;        /* deg/s, >= extra / fs_hz */
    double drag_rate;                /* 1/deg: torque rate w |w| */
    double cubic_stiffness;          /* 1/(s^2 deg^2): torque stiffness theta^3 */
    double unbalance_level;          /* deg/s^2: torque level (sin(theta + angle) - sin(angle)) */
    double unbalance_angle_deg;
    double cogging_level;            /* deg/s^2: torque level sin(cycles theta + phase) */
    double cogging_cycles;           /* in a turn; the law's oscillation is slower than fs_hz [rad/s] */
    double cogging_phase_rad;
    double stop_low_deg;             /* <= 0: a spring below this angle; 0: no stop on this side */
    double stop_high_deg;            /* >= 0: a spring above this angle; 0: no stop on this side */
    double stop_stiffness;           /* 1/s^2, <= fs_hz^2 */
    double stop_damping;             /* 1/s, <= fs_hz, within a stop only */
    double torque_noise_rms;         /* deg/s^2, process noise: of the torque, filtered at torque_noise_hz */
    double torque_noise_hz;          /* Hz */
    double delay_s;                  /* of the command, >= 0, any fraction of a tick, < 64 ticks */
    double mode_f_hz, mode_zeta, mode_residue; /* adds q' to the rate: q'' + 2 zeta w q' + w^2 q = residue gain u */
    double gyro_lag_s;               /* first order */
    double gyro_refresh_hz;          /* the gyro, with its noise, is held between refreshes, <= fs_hz; 0: no hold */
    uint32_t gyro_free_running;      /* 1: the seed sets the time of the first refresh; 0: it is at tick 0 */
    double command_limit;            /* clipped at +- this, then rounded; 0: neither */
    uint32_t command_bits;           /* steps of 2 command_limit / 2^bits, <= 31; 0: not rounded */
    double drive_dead_zone;          /* subtracted from the size of each command; smaller commands become 0 */
    double drive_limit;              /* limit of the result; 0: none */
    double noise_rms;                /* deg/s, white part of the gyro's noise */
    double noise_low_rms;            /* deg/s, part filtered by a first-order low-pass at noise_low_hz */
    double noise_low_hz;             /* Hz */
    double fan_f_hz, fan_amplitude, fan_phase_rad; /* deg/s, added to the gyro; not locked to the excitation */
    uint64_t seed;                   /* of the noise */
} gsid_axis_cfg;

typedef struct gsid_axis gsid_axis;

/** The inner azimuth axis of the thesis at 3 kHz, linear but for the limit and steps of the command.
 *  @return GSID_OK; GSID_E_NULL */
gsid_status gsid_axis_cfg_init(gsid_axis_cfg *cfg);

/** Create a simulated axis.
 *  @param[out] axis  the new axis, to be freed with gsid_axis_destroy
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE; GSID_E_NO_MEMORY */
gsid_status gsid_axis_create(gsid_axis **axis, const gsid_axis_cfg *cfg);

/** Free a simulated axis; NULL is allowed. */
void gsid_axis_destroy(gsid_axis *axis);

/** Reset to rest at tick 0, and restart the noise from the seed. */
gsid_status gsid_axis_reset(gsid_axis *axis);

/** Advance n ticks: y[i] is sampled at the instant from which u[i] is applied.
 *  @param[in]  u          [n] command, finite
 *  @param[out] u_applied  [n] clipped and rounded command, before the drive; may be NULL
 *  @param[out] y          [n] gyro, deg/s
 *  @param[out] angle_deg  [n] true angle, deg; may be NULL
 *  @return GSID_OK; GSID_E_NULL; GSID_E_NONFINITE nothing was advanced */
gsid_status gsid_axis_step(gsid_axis *axis, uint32_t n, const double *u, double *u_applied, double *y,
                           double *angle_deg);

#ifdef __cplusplus
}
#endif

#endif
