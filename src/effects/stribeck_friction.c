#include "effects.h"

static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    const gsid_real level = item->value[0], extra = item->value[1], velocity = item->value[2];
    const gsid_real ratio = motion->rate / velocity, peak = gsid_exp(-ratio * ratio);
    answer->torque = (level + extra * peak) * motion->side;
    answer->by_rate = -2 * extra * peak * ratio / velocity * motion->side;
    answer->by_value[0] = motion->side;
    answer->by_value[1] = peak * motion->side;
    answer->by_value[2] = 2 * extra * peak * ratio * ratio / velocity * motion->side;
}

static gsid_real holding(const gsid_plant_item *item) {
    return item->value[0] + item->value[1];
}

const gsid_effect EFFECT(stribeck_friction) = {
    .id = "stribeck_friction",
    .sentence = "Dry friction that is larger at low rates, before the lubricant carries.",
    .confused_with = "coulomb_friction,presliding_friction,viscous_friction",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 3,
    .parameter = {{"level", "deg/s^2", R(15.0), R(0.0), ANY, R(0.0)},
                  {"extra", "deg/s^2", R(5.0), R(0.0), ANY, R(0.0)},
                  {"velocity", "deg/s", R(1.0), R(1e-3), ANY, NAN}},
    .torque = torque,
    .holding = holding,
};

const gsid_effect_facts FACTS(stribeck_friction) = {
    .effect = &EFFECT(stribeck_friction),
    .law = "(level + extra exp(-(w / velocity)^2)) sign(w)",
    .as_c = "({level} + {extra} * expf(-(rate / {velocity}) * (rate / {velocity}))) * "
            "(rate > 0 ? 1.0f : rate < 0 ? -1.0f : 0.0f)",
    .simpler = "coulomb_friction",
    .parameter = {{.axis_field = "coulomb_level"},
                  {.axis_field = "stribeck_extra"},
                  {.axis_field = "stribeck_velocity",
                   .grid = {GSID_SPACING_GEOMETRIC, GSID_SHARE_OF_RATE, R(0.003), R(0.5), 0, 8, NULL,
                            "a narrower peak is crossed within a few samples, a wider one is a friction that falls "
                            "everywhere"}}},
};
