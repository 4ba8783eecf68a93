#include "effects.h"

static void linear(const gsid_plant_item *item, gsid_linear *to) {
    to->n_bodies++;
    to->rigid_body = to->item;
    to->gain = item->value[0];
    gsid_linear_add(to, to->drive, to->command, item->value[0]);
    gsid_linear_slope(to, to->item, 0, to->drive, to->command, 1);
}

const gsid_effect EFFECT(rigid_body) = {
    .id = "rigid_body",
    .sentence = "The motor's torque turns the inertia.",
    .confused_with = "",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_NEVER,
    .n_parameters = 1,
    .parameter = {{"gain", "deg/s^2 per command", R(7.4), -ANY, ANY, NAN}},
    .linear = linear,
};

const gsid_effect_facts FACTS(rigid_body) = {
    .effect = &EFFECT(rigid_body),
    .law = "dw/dt = gain u - torques, dtheta/dt = w",
    .linear_part = GSID_LINEAR_GAIN,
    .parameter = {{.in_response = 1}},
};
