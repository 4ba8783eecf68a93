#include "effects.h"

static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    const gsid_real stiffness = item->value[0], angle = motion->angle;
    answer->torque = stiffness * angle * angle * angle;
    answer->by_angle = 3 * stiffness * angle * angle;
    answer->by_value[0] = angle * angle * angle;
}

const gsid_effect EFFECT(cubic_spring) = {
    .id = "cubic_spring",
    .sentence = "A spring that stiffens with the angle, or softens.",
    .confused_with = "hard_stop,motor_cogging,cable_spring",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_SMOOTH,
    .n_parameters = 1,
    .parameter = {{"stiffness", "1/(s^2 deg^2)", R(10.0), -ANY, ANY, R(0.0)}},
    .looks_at_angle = 1,
    .torque = torque,
};

const gsid_effect_facts FACTS(cubic_spring) = {
    .effect = &EFFECT(cubic_spring),
    .law = "stiffness theta^3",
    .as_c = "{stiffness} * angle * angle * angle",
    .enlarged = "c*theta*abs(theta); c*theta^5",
    .parameter = {{.axis_field = "cubic_stiffness"}},
};
