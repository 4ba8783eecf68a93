#include "effects.h"

static void linear(const gsid_plant_item *item, gsid_linear *to) {
    const gsid_real lag = item->value[0];
    if (lag < to->instant_s) {
        gsid_linear_delay(to, 0, lag);
        return;
    }
    const gsid_real pole = 1 / lag;
    const uint32_t out = gsid_linear_state(to);
    for (uint32_t from = GSID_Z_STATES; from < out; from++) {
        if (to->signal[from] == 0) {
            continue;
        }
        gsid_linear_add(to, out, from, pole * to->signal[from]);
        gsid_linear_slope(to, to->item, 0, out, from, -pole * pole * to->signal[from]);
        to->signal[from] = 0;
    }
    gsid_linear_add(to, out, out, -pole);
    gsid_linear_slope(to, to->item, 0, out, out, pole * pole);
    to->signal[out] = 1;
}

const gsid_effect EFFECT(sensor_lag) = {
    .id = "sensor_lag",
    .sentence = "The sensor follows as a first-order lag.",
    .confused_with = "transport_delay,motor_lag,sensor_sample_hold",
    .stage = GSID_STAGE_SENSOR,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 1,
    .parameter = {{"time_constant_s", "s", R(0.001), R(0.0), R(10.0), R(0.0)}},
    .n_states = 1,
    .linear = linear,
};

static const gsid_real SAMPLES[] = {R(0.6), R(1.5), 3, 6, 15};

const gsid_effect_facts FACTS(sensor_lag) = {
    .effect = &EFFECT(sensor_lag),
    .law = "dv/dt = (y - v) / time_constant_s",
    .linear_part = GSID_LINEAR_LAG,
    .parameter = {{.in_response = 1,
                   .grid = {GSID_SPACING_LIST, GSID_SHARE_OF_SAMPLE, 0, 0, 0, 5, SAMPLES,
                            "below half a sample a lag is a delay, above 15 samples nearly a friction"}}},
};
