/* The blind trials' own plant: a gimbal axis with every effect of the catalogue, and some that are not in it.
 *
 * It shares no code with the product. Laws are those of the catalogue's table (torques divided by the inertia,
 * subtracted from gain u; angles in degrees). What the table leaves open is decided here:
 *   command    even and cubic gain, rate limit, quantization, dead zone, saturation, then delay, then motor lag
 *   mode       driven by gain times the actuator's output, its rate added to the axis rate before the sensor lag
 *   refresh    the held gyro is refreshed at k / rate; a refresh at the instant of sample n is seen by sample n
 *   backlash   motor and load of inertias r/(1+r) and 1/(1+r), r the inertia ratio; gap_deg is the whole play; torque
 *              stiffness (twist beyond gap/2) plus gear_damping times the twist rate, in the play too; the gyro,
 *              friction and springs are on the load
 *   friction   set-valued: at rest it takes any value up to level + extra
 */
#ifndef GSID_BLIND_TRUTH_H
#define GSID_BLIND_TRUTH_H

#include <stddef.h>

/* Zero takes an effect out. */
#define TRUTH_PARAMETERS(X)                                                                                            \
    X(fs_hz)                                                                                                           \
    X(gain)                                                                                                            \
    X(delay_s)                                                                                                         \
    X(motor_lag_s)                                                                                                     \
    X(quantization_step)                                                                                               \
    X(dead_zone_half_width)                                                                                            \
    X(saturation_limit)                                                                                                \
    X(viscous_rate)                                                                                                    \
    X(coulomb_level)                                                                                                   \
    X(stribeck_extra)                                                                                                  \
    X(stribeck_velocity)                                                                                               \
    X(presliding_level)                                                                                                \
    X(presliding_stiffness)                                                                                            \
    X(lugre_extra)    /* share of presliding_level: makes the Dahl law a LuGre law */                                  \
    X(lugre_velocity) /* deg/s */                                                                                      \
    X(lugre_damping)  /* torque per rate of the bristle [1/s] */                                                       \
    X(quadratic_drag_rate)                                                                                             \
    X(spring_stiffness)                                                                                                \
    X(cubic_stiffness)                                                                                                 \
    X(unbalance_level)                                                                                                 \
    X(unbalance_angle_deg)                                                                                             \
    X(cogging_level)                                                                                                   \
    X(cogging_cycles)                                                                                                  \
    X(cogging_phase_rad)                                                                                               \
    X(stop_angle_deg)                                                                                                  \
    X(stop_stiffness)                                                                                                  \
    X(gear_gap_deg)                                                                                                    \
    X(gear_stiffness)                                                                                                  \
    X(gear_inertia_ratio)                                                                                              \
    X(gear_damping)                                                                                                    \
    X(bias_level)                                                                                                      \
    X(mode_hz)                                                                                                         \
    X(mode_zeta)                                                                                                       \
    X(mode_residue)                                                                                                    \
    X(sensor_lag_s)                                                                                                    \
    X(sample_hold_hz)                                                                                                  \
    /* Not in the catalogue. */                                                                                        \
    X(snap_level)                                                                                                      \
    X(snap_angle_deg)                                                                                                  \
    X(snap_width_deg)                                                                                                  \
    X(eddy_rate) /* torque eddy_rate |u| w */                                                                          \
    X(creep_stiffness)                                                                                                 \
    X(creep_time_s)                                                                                                    \
    X(command_rate_limit)     /* command per sample */                                                                 \
    X(friction_ripple)        /* Coulomb level times 1 + ripple sin(cycles theta + phase), ripple < 1 */               \
    X(friction_ripple_cycles) /* per revolution */                                                                     \
    X(friction_ripple_phase_rad)                                                                                       \
    X(command_even)                                                                                                    \
    X(command_cubic)                                                                                                   \
    X(gyro_even)                                                                                                       \
    X(gyro_cubic)                                                                                                      \
    X(gain_ripple)                                                                                                     \
    X(gain_ripple_cycles)

#define TRUTH_INDEX(name) TRUTH_##name,
enum { TRUTH_PARAMETERS(TRUTH_INDEX) TRUTH_N_PARAMETERS };
#undef TRUTH_INDEX

/* State: load angle and rate, motor angle and rate (backlash only), actuator output, mode position and rate, sensor
 * output, bristle, creep; then two integrals, the motor's work and the energy dissipated (per inertia). */
enum {
    TRUTH_THETA,
    TRUTH_RATE,
    TRUTH_MOTOR_THETA,
    TRUTH_MOTOR_RATE,
    TRUTH_ACTUATOR,
    TRUTH_MODE,
    TRUTH_MODE_RATE,
    TRUTH_SENSOR,
    TRUTH_BRISTLE,
    TRUTH_CREEP,
    TRUTH_WORK,
    TRUTH_DISSIPATED,
    TRUTH_N_STATES
};

int truth_n_parameters(void);
int truth_n_states(void);
const char *truth_parameter_name(int index);

/* Runs n_periods periods of the periodic command u [n] from state x, with n_steps Runge-Kutta steps per sample.
 * x [TRUTH_N_STATES] in/out; y, theta, rate [n] of the last period, out (theta and rate may be NULL).
 * Returns 0; -1 out of memory or bad argument; -2 not finite; -3 too many events in a step. */
int truth_run(const double *parameter, size_t n, const double *u, size_t n_periods, int n_steps, double *x, double *y,
              double *theta, double *rate);

/* The load's torque that is subtracted (without friction at rest, stops included) and the command maps, for tests. */
double truth_torque(const double *parameter, double theta, double rate, double actuator);
void truth_command(const double *parameter, size_t n, const double *u, double *v);

#endif
