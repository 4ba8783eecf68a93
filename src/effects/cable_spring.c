#include "effects.h"

static void linear(const gsid_plant_item *item, gsid_linear *to) {
    gsid_linear_add(to, GSID_Z_RATE, GSID_Z_ANGLE, -item->value[0]);
    gsid_linear_slope(to, to->item, 0, GSID_Z_RATE, GSID_Z_ANGLE, -1);
}

const gsid_effect EFFECT(cable_spring) = {
    .id = "cable_spring",
    .sentence = "A torque back to the middle in proportion to the angle (cable wrap, flexure).",
    .confused_with = "mass_unbalance,presliding_friction,motor_cogging",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 1,
    .parameter = {{"stiffness", "1/s^2", R(170.0), R(0.0), ANY, R(0.0)}},
    .looks_at_angle = 1,
    .linear = linear,
};

const gsid_effect_facts FACTS(cable_spring) = {
    .effect = &EFFECT(cable_spring),
    .law = "stiffness theta",
    .linear_part = GSID_LINEAR_SPRING,
    .parameter = {{.in_response = 1}},
};
