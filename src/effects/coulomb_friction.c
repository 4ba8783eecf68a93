#include "effects.h"

static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    answer->torque = item->value[0] * motion->side;
    answer->by_value[0] = motion->side;
}

static gsid_real holding(const gsid_plant_item *item) {
    return item->value[0];
}

const gsid_effect EFFECT(coulomb_friction) = {
    .id = "coulomb_friction",
    .sentence = "A constant torque against the motion, which also holds the axis at rest (dry friction).",
    .confused_with = "viscous_friction,stribeck_friction,presliding_friction,drive_dead_zone",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 1,
    .parameter = {{"level", "deg/s^2", R(15.0), R(0.0), ANY, R(0.0)}},
    .is_constant = 1,
    .torque = torque,
    .holding = holding,
};

const gsid_effect_facts FACTS(coulomb_friction) = {
    .effect = &EFFECT(coulomb_friction),
    .law = "level sign(w)",
    .as_c = "{level} * (rate > 0 ? 1.0f : rate < 0 ? -1.0f : 0.0f)",
    .enlarged = "c*w/sqrt(abs(w)+1e-9)",
    .parameter = {{.axis_field = "coulomb_level"}},
};
