#include "effects.h"

static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    const gsid_real rate = item->value[0], speed = gsid_fabs(motion->rate);
    answer->torque = rate * motion->rate * speed;
    answer->by_rate = 2 * rate * speed;
    answer->by_value[0] = motion->rate * speed;
}

const gsid_effect EFFECT(quadratic_drag) = {
    .id = "quadratic_drag",
    .sentence = "A torque against the motion that grows with the square of the rate (air).",
    .confused_with = "viscous_friction,coulomb_friction",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 1,
    .parameter = {{"rate", "1/deg", R(0.05), R(0.0), R(1e6), R(0.0)}},
    .torque = torque,
};

const gsid_effect_facts FACTS(quadratic_drag) = {
    .effect = &EFFECT(quadratic_drag),
    .law = "rate w |w|",
    .as_c = "{rate} * rate * fabsf(rate)",
    .enlarged = "c*w*sqrt(abs(w)); c*w^3",
    .parameter = {{.axis_field = "drag_rate"}},
};
