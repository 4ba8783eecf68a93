#include "effects.h"

static void linear(const gsid_plant_item *item, gsid_linear *to) {
    gsid_linear_add(to, GSID_Z_RATE, GSID_Z_RATE, -item->value[0]);
    gsid_linear_slope(to, to->item, 0, GSID_Z_RATE, GSID_Z_RATE, -1);
}

const gsid_effect EFFECT(viscous_friction) = {
    .id = "viscous_friction",
    .sentence = "A torque against the motion, in proportion to the rate (bearing grease, back-EMF).",
    .confused_with = "coulomb_friction,stribeck_friction",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 1,
    .parameter = {{"rate", "1/s", R(11.0), R(0.0), R(1e6), R(0.0)}},
    .linear = linear,
};

const gsid_effect_facts FACTS(viscous_friction) = {
    .effect = &EFFECT(viscous_friction),
    .law = "rate w",
    .linear_part = GSID_LINEAR_DAMPING,
    .parameter = {{.in_response = 1}},
};
