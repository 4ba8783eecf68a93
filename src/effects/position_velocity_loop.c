#include "effects.h"

/* u = kv (kp (reference - angle) - rate), clipped at +-limit; a limit of 0 is none. The rate is the axis's own, as a
 * tachometer shows it, or with rate_samples = n the encoder's (angle[k] - angle[k-n]) / n samples. */
static gsid_real control(const gsid_plant_item *item, const gsid_real signal[3], gsid_real *by_signal,
                         gsid_real *by_value) {
    const gsid_real kp = item->value[0], kv = item->value[1], limit = item->value[2];
    const gsid_real error = signal[0] - signal[1], u = kv * (kp * error - signal[2]);
    if (limit > 0 && gsid_fabs(u) > limit) {
        by_value[2] = u < 0 ? R(-1.0) : R(1.0);
        return by_value[2] * limit;
    }
    by_signal[0] = kv * kp;
    by_signal[1] = -kv * kp;
    by_signal[2] = -kv;
    by_value[0] = kv * error;
    by_value[1] = kp * error - signal[2];
    return u;
}

static uint32_t rate_samples(const gsid_plant_item *item) {
    return (uint32_t)(item->value[3] + R(0.5));
}

const gsid_effect EFFECT(position_velocity_loop) = {
    .id = "position_velocity_loop",
    .sentence = "A controller: position loop around a velocity loop, computed once a sample from angle and rate.",
    .confused_with = "",
    .stage = GSID_STAGE_CONTROLLER,
    .null_kind = GSID_NULL_NEVER,
    .n_parameters = 4,
    .parameter = {{"kp", "1/s", R(20.0), R(0.0), ANY, NAN},
                  {"kv", "command per deg/s", R(5.0), -ANY, ANY, NAN},
                  {"limit", "command", R(179.0), R(1e-6), ANY, R(0.0)},
                  {"rate_samples", "samples", R(0.0), R(0.0), (gsid_real)GSID_RATE_SAMPLES_MAX, R(0.0)}},
    .looks_at_angle = 1,
    .control = control,
    .rate_samples = rate_samples,
};

const gsid_effect_facts FACTS(position_velocity_loop) = {
    .effect = &EFFECT(position_velocity_loop),
    .law = "u = kv (kp (reference - theta) - w), clipped to +-limit; w as the change of theta over rate_samples, 0: w "
           "itself",
    .linear_part = GSID_LINEAR_LOOP,
    .not_searched = "a controller is given, or found from reference, output and command by --r",
    .parameter = {{0}},
};
