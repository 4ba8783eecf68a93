#include "effects.h"

static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    const gsid_real edge = item->value[0], stiffness = item->value[1];
    const gsid_real side = (gsid_real)motion->zone;
    if (motion->zone == 0) {
        return;
    }
    answer->torque = stiffness * (motion->angle - side * edge);
    answer->by_angle = stiffness;
    answer->by_value[0] = -stiffness * side;
    answer->by_value[1] = motion->angle - side * edge;
}

static gsid_real edge_of(const gsid_plant_item *item) {
    return item->value[0];
}

const gsid_effect EFFECT(hard_stop) = {
    .id = "hard_stop",
    .sentence = "Stiff springs that the axis runs into at both ends of its travel.",
    .confused_with = "cubic_spring,drive_saturation",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_THRESHOLD,
    .n_parameters = 2,
    .parameter = {{"angle_deg", "deg", R(1.8), R(1e-6), ANY, NAN},
                  {"stiffness", "1/s^2", R(1e5), R(0.0), R(1e9), R(0.0)}},
    .looks_at_angle = 1,
    .torque = torque,
    .edge = edge_of,
};

const gsid_effect_facts FACTS(hard_stop) = {
    .effect = &EFFECT(hard_stop),
    .law = "stiffness (|theta| - angle_deg) sign(theta) for |theta| > angle_deg, else 0",
    .parameter = {{.grid = {GSID_SPACING_FROM_END, GSID_SHARE_OF_ANGLE, R(0.5), R(0.002), 0, 14, NULL,
                            "dense towards the largest angle: most stops are only just touched, and often on one "
                            "side"}}},
};
