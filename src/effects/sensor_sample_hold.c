#include "effects.h"

static gsid_real refresh_hz(const gsid_plant_item *item) {
    return item->value[0];
}

const gsid_effect EFFECT(sensor_sample_hold) = {
    .id = "sensor_sample_hold",
    .sentence = "The sensor is refreshed more slowly than it is read, and holds its value between.",
    .confused_with = "transport_delay,sensor_lag",
    .stage = GSID_STAGE_SENSOR,
    .null_kind = GSID_NULL_THRESHOLD,
    .n_parameters = 1,
    .parameter = {{"rate_hz", "Hz", R(400.0), R(1e-3), R(1e6), R(0.0)}},
    .refresh_hz = refresh_hz,
};
