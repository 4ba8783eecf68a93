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

/* Usual rates of sensors, in each decade. */
static const gsid_real NOMINAL[] = {1,      R(1.2), R(1.25), R(1.5), R(1.75), 2,      R(2.5), 3,
                                    R(3.5), 4,      R(4.5),  5,      6,       R(7.5), 8};

const gsid_effect_facts FACTS(sensor_sample_hold) = {
    .effect = &EFFECT(sensor_sample_hold),
    .law = "the output of the last refresh, rate_hz times a second; 0: always refreshed",
    .linear_part = GSID_LINEAR_HOLD,
    .parameter = {{.axis_field = "gyro_refresh_hz",
                   .grid = {GSID_SPACING_DECADES, GSID_SHARE_OF_FS, R(1.0) / 30, R(0.5), 0, 15, NOMINAL,
                            "usual rates of sensors; slower ones than a thirtieth of the loop are not built"}}},
};
