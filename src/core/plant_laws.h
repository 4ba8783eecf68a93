/* Torques that are not linear, and the regimes and zones that they are smooth in: see plant_laws.c. */
#ifndef GSID_PLANT_LAWS_H
#define GSID_PLANT_LAWS_H

#include "plant_parts.h"

#define gsid_plant_sum_torques GSID_NAME(gsid_plant_sum_torques)
#define gsid_plant_choose_regime GSID_NAME(gsid_plant_choose_regime)
#define gsid_plant_choose_zones GSID_NAME(gsid_plant_choose_zones)
#define gsid_plant_derivative GSID_NAME(gsid_plant_derivative)
#define gsid_plant_enter_zone GSID_NAME(gsid_plant_enter_zone)
#define gsid_plant_free_acceleration GSID_NAME(gsid_plant_free_acceleration)
#define gsid_plant_largest_hold GSID_NAME(gsid_plant_largest_hold)
#define gsid_plant_move_memories GSID_NAME(gsid_plant_move_memories)
#define gsid_plant_torques_at_end GSID_NAME(gsid_plant_torques_at_end)

/* Row of the angle that a law works with. */
static inline uint32_t gsid_plant_angle_row(const gsid_plant_layout *l, const plant_law *law) {
    return law->channel == BACKLASH ? l->linear.a.twist : (uint32_t)GSID_Z_ANGLE;
}

/* to = torques of all laws by channel, [CHANNELS_MAX][n_columns], at z in a step that began at z0; without those that hold
 * the axis, when `but_holding`. */
void gsid_plant_sum_torques(const gsid_plant_layout *l, int but_holding, uint32_t n_active, const gsid_real *z,
                            const gsid_real *z0, gsid_real *to);

/* Values of the torques that act at the end z of a step from l->z, by channel, [CHANNELS_MAX]; returns the sum of the laws'
 * magnitudes. */
gsid_real gsid_plant_torques_at_end(const gsid_plant_layout *l, const gsid_real *z, gsid_real *by_channel);

/* The laws' memories at the end z of a step from l->z. */
void gsid_plant_move_memories(const gsid_plant_layout *l, gsid_real *z);

/* Largest torque at which friction holds the axis. */
gsid_real gsid_plant_largest_hold(const gsid_plant_layout *l);

/* Acceleration at z without the friction that can hold the axis. */
gsid_real gsid_plant_free_acceleration(const gsid_plant_layout *l, const gsid_real *z);

/* Time derivative of the states, [linear.a.n]. */
void gsid_plant_derivative(const gsid_plant_layout *l, const gsid_real *z, gsid_real *rates);

/* Stick or slip, and which way, where the rate is zero. */
void gsid_plant_choose_regime(gsid_plant_layout *l);

/* The zone of every law, by the angle at l->z. */
void gsid_plant_choose_zones(gsid_plant_layout *l);
void gsid_plant_enter_zone(gsid_plant_layout *l, plant_law *law, int zone);

#endif
