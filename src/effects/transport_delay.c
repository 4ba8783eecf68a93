#include "effects.h"

static void linear(const gsid_plant_item *item, gsid_linear *to) {
    gsid_linear_delay(to, 0, item->value[0]);
}

const gsid_effect EFFECT(transport_delay) = {
    .id = "transport_delay",
    .sentence = "The command takes effect a fixed time later.",
    .confused_with = "motor_lag,sensor_lag",
    .stage = GSID_STAGE_ACTUATOR,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 1,
    .parameter = {{"delay_s", "s", R(0.0054), R(0.0), R(10.0), R(0.0)}},
    .linear = linear,
};

const gsid_effect_facts FACTS(transport_delay) = {
    .effect = &EFFECT(transport_delay),
    .law = "u(t - delay_s)",
    .linear_part = GSID_LINEAR_DELAY,
    .parameter = {{.in_response = 1}},
};
