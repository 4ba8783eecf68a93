#include "effects.h"

static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    const gsid_real stiffness = item->value[0], angle = motion->angle;
    answer->torque = stiffness * angle * angle;
    answer->by_angle = 2 * stiffness * angle;
    answer->by_value[0] = angle * angle;
}

const gsid_effect EFFECT(quadratic_spring) = {
    .id = "quadratic_spring",
    .sentence = "A spring that is stiffer on one side of the middle than on the other (cable loop, preloaded flexure).",
    .confused_with = "mass_unbalance,torque_bias,cubic_spring",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_SMOOTH,
    .n_parameters = 1,
    .parameter = {{"stiffness", "1/(s^2 deg)", R(20.0), -ANY, ANY, R(0.0)}},
    .looks_at_angle = 1,
    .torque = torque,
};

const gsid_effect_facts FACTS(quadratic_spring) = {
    .effect = &EFFECT(quadratic_spring),
    .law = "stiffness theta^2",
    .as_c = "{stiffness} * angle * angle",
    .not_searched = "the rates of right and wrong names were measured without it; gsid add takes it",
    .parameter = {{0}},
};
