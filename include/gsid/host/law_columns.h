/* Torques of an effect's law along a measured motion, and its command for a measured command: the columns with which a
 * missing effect is searched for without simulation. The laws are those of the descriptors (effect.h), written once. */
#ifndef GSID_HOST_LAW_COLUMNS_H
#define GSID_HOST_LAW_COLUMNS_H

#include "gsid/effect.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One period of a motion, sampled in equal steps; the first sample follows the last one. */
typedef struct {
    uint32_t n;            /* samples, at least 2 */
    double step_s;         /* between two samples, > 0 */
    double unit_rad;       /* radians in a unit of angle */
    const double *angle;   /* [n] */
    const double *rate;    /* [n] */
    const double *side;    /* [n] mean direction around each sample, -1 .. 1, as gsid_law_side gives it */
    const double *command; /* [n] as it drives the motor; may be NULL for laws that do not look at it */
} gsid_law_motion;

/** Mean of sign(rate) over the cell of one step around each sample, the rate taken as straight in it.
 *  A jump that is only sampled folds its high harmonics back into the lines; its mean over the cell hardly does.
 *  @param[in]  acceleration  [n] derivative of the rate
 *  @param[out] side          [n] clip(rate / (|acceleration| step_s / 2), -1, 1)
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG n or step_s is not positive */
gsid_status gsid_law_side(uint32_t n, double step_s, const double *rate, const double *acceleration, double *side);

/** Torque of a law along a motion for one or several sets of its values.
 *  Laws with a direction (descriptor: holding) are the mean of both directions, weighted by `side`. Laws with a memory run
 *  from reversal to reversal, where the rate crosses zero between two samples, over the period until they repeat.
 *  @param[in]  effect  with a torque, without states of its own
 *  @param[in]  data    what the effect's functions need besides the values (gsid_plant_item); may be NULL
 *  @param[in]  values  [n_sets][GSID_EFFECT_PARAMETERS_MAX]
 *  @param[out] torque  [n_sets][n] against the motion, divided by the inertia
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG sizes, or the effect has no such torque; GSID_E_NO_MEMORY */
gsid_status gsid_law_torques(const gsid_effect *effect, const void *data, const gsid_law_motion *motion,
                             uint32_t n_sets, const double *values, double *torque);

/** The same with the derivative by one of the values, of a law without memory: both cost little more than one.
 *  @param[in]  by     number of the value
 *  @param[out] slope  [n_sets][n] derivative of the torque by it
 *  @return as gsid_law_torques; GSID_E_CONFIG also for a law with memory, or without such a value */
gsid_status gsid_law_torques_and_slopes(const gsid_effect *effect, const void *data, const gsid_law_motion *motion,
                                        uint32_t n_sets, const double *values, uint32_t by, double *torque,
                                        double *slope);

/** Static map of a command for one or several sets of values.
 *  @param[in]  effect  with a command map
 *  @param[in]  u       [n]
 *  @param[in]  values  [n_sets][GSID_EFFECT_PARAMETERS_MAX]
 *  @param[out] mapped  [n_sets][n]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG sizes, or the effect has no command map */
gsid_status gsid_law_commands(const gsid_effect *effect, const void *data, uint32_t n, const double *u, uint32_t n_sets,
                              const double *values, double *mapped);

#ifdef __cplusplus
}
#endif

#endif
