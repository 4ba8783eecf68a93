#include "effects.h"

#define RAD_PER_DEG R(0.0174532925199432958)

static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    const gsid_real level = item->value[0], unit = motion->unit_rad;
    const gsid_real rest = RAD_PER_DEG * item->value[1], now = unit * motion->angle + rest;
    const gsid_real change = gsid_sin(now) - gsid_sin(rest);
    answer->torque = level * change;
    answer->by_angle = level * unit * gsid_cos(now);
    answer->by_value[0] = change;
    answer->by_value[1] = level * RAD_PER_DEG * (gsid_cos(now) - gsid_cos(rest));
}

const gsid_effect EFFECT(mass_unbalance) = {
    .id = "mass_unbalance",
    .sentence = "Gravity on a centre of mass off the axis; its torque at angle 0 is left to torque_bias.",
    .confused_with = "cable_spring,cubic_spring,motor_cogging",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 2,
    .parameter = {{"level", "deg/s^2", R(500.0), R(0.0), ANY, R(0.0)},
                  {"angle_deg", "deg (whatever the unit of angles)", R(45.0), R(-360.0), R(360.0), NAN}},
    .looks_at_angle = 1,
    .torque = torque,
};

const gsid_effect_facts FACTS(mass_unbalance) = {
    .effect = &EFFECT(mass_unbalance),
    .law = "level (sin(theta + angle_deg) - sin(angle_deg))",
    .as_c = "{level} * (sinf(angle * {unit_rad} + {angle_deg} * RAD_PER_DEG) - sinf({angle_deg} * RAD_PER_DEG))",
    .linear_part = GSID_LINEAR_PENDULUM,
    .turns_only = 1,
    .parameter = {{.axis_field = "unbalance_level"}, {.axis_field = "unbalance_angle_deg"}},
};
