#include "effects.h"

#define TWO_PI R(6.28318530717958647693)

static gsid_real disturbance(const gsid_plant_item *item, gsid_real t_s, gsid_real *by_value) {
    const gsid_real f_hz = item->value[0], amplitude = item->value[1], turns = f_hz * t_s;
    const gsid_real at = TWO_PI * (turns - gsid_floor(turns)) + item->value[2];
    by_value[0] = amplitude * gsid_cos(at) * TWO_PI * t_s;
    by_value[1] = gsid_sin(at);
    by_value[2] = amplitude * gsid_cos(at);
    return amplitude * gsid_sin(at);
}

const gsid_effect EFFECT(periodic_disturbance) = {
    .id = "periodic_disturbance",
    .sentence = "A sine in the sensor that keeps its own time (a fan): it adds to the variance, and is nothing in the "
                "periodic answer.",
    .confused_with = "",
    .stage = GSID_STAGE_SENSOR,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 3,
    .parameter = {{"f_hz", "Hz", R(30.9), R(1e-6), R(1e6), NAN},
                  {"amplitude", "deg/s", R(0.005), R(0.0), ANY, R(0.0)},
                  {"phase_rad", "rad", R(0.0), R(-10.0), R(10.0), NAN}},
    .disturbance = disturbance,
};

const gsid_effect_facts FACTS(periodic_disturbance) = {
    .effect = &EFFECT(periodic_disturbance),
    .law = "adds amplitude sin(2 pi f_hz t + phase_rad) to the output",
    .not_searched = "it is not locked to the excitation and adds to the variance only",
    .parameter = {{0}},
};
