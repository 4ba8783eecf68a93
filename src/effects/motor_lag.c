#include "effects.h"

static void linear(const gsid_plant_item *item, gsid_linear *to) {
    const gsid_real lag = item->value[0];
    if (lag < to->instant_s) {
        gsid_linear_delay(to, 0, lag);
        return;
    }
    const gsid_real pole = 1 / lag;
    const uint32_t out = gsid_linear_state(to);
    gsid_linear_add(to, out, to->command, pole);
    gsid_linear_add(to, out, out, -pole);
    gsid_linear_slope(to, to->item, 0, out, to->command, -pole * pole);
    gsid_linear_slope(to, to->item, 0, out, out, pole * pole);
    to->command = out;
}

const gsid_effect EFFECT(motor_lag) = {
    .id = "motor_lag",
    .sentence = "The motor's torque follows the command as a first-order lag (current loop, winding).",
    .confused_with = "transport_delay,sensor_lag",
    .stage = GSID_STAGE_ACTUATOR,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 1,
    .parameter = {{"time_constant_s", "s", R(0.001), R(0.0), R(10.0), R(0.0)}},
    .n_states = 1,
    .linear = linear,
};

static const gsid_real SAMPLES[] = {R(0.6), R(1.5), 3, 6, 15};

const gsid_effect_facts FACTS(motor_lag) = {
    .effect = &EFFECT(motor_lag),
    .law = "dv/dt = (u - v) / time_constant_s",
    .linear_part = GSID_LINEAR_LAG,
    .parameter = {{.in_response = 1,
                   .grid = {GSID_SPACING_LIST, GSID_SHARE_OF_SAMPLE, 0, 0, 0, 5, SAMPLES,
                            "below half a sample a lag is a delay, above 15 samples nearly a friction"}}},
};
