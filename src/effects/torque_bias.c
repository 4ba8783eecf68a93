#include "effects.h"

static void linear(const gsid_plant_item *item, gsid_linear *to) {
    gsid_linear_add(to, GSID_Z_RATE, GSID_Z_ONE, -item->value[0]);
    gsid_linear_slope(to, to->item, 0, GSID_Z_RATE, GSID_Z_ONE, -1);
}

const gsid_effect EFFECT(torque_bias) = {
    .id = "torque_bias",
    .sentence = "A constant torque against the positive direction (a tilted base, an offset of the drive).",
    .confused_with = "mass_unbalance,cubic_spring",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_SMOOTH,
    .n_parameters = 1,
    .parameter = {{"level", "deg/s^2", R(5.0), -ANY, ANY, R(0.0)}},
    .linear = linear,
};

const gsid_effect_facts FACTS(torque_bias) = {
    .effect = &EFFECT(torque_bias),
    .law = "level",
    .as_c = "{level}",
    .parameter = {{0}},
};
