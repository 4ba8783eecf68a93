#include "effects.h"

#define TWO_PI R(6.28318530717958647693)

/* A power of two near x. As a scale of the state it keeps the matrix balanced, and does not count as a parameter. */
static gsid_real round_to_octave(gsid_real x) {
    gsid_real octave = 1;
    for (int i = 0; i < 64 && octave * 2 <= x; i++) {
        octave *= 2;
    }
    return octave;
}

/* q'' + 2 zeta w q' + w^2 q = residue gain u, with the states q' and scale q. */
static void linear(const gsid_plant_item *item, gsid_linear *to) {
    const gsid_real zeta = item->value[1], residue = item->value[2];
    const gsid_real w = TWO_PI * item->value[0], scale = round_to_octave(w);
    const uint32_t bend = gsid_linear_state(to), rate = gsid_linear_state(to);
    gsid_linear_add(to, bend, rate, scale);
    gsid_linear_add(to, rate, bend, -w * w / scale);
    gsid_linear_add(to, rate, rate, -2 * zeta * w);
    gsid_linear_add(to, rate, to->command, residue * to->gain);
    gsid_linear_slope(to, to->item, 0, rate, bend, -2 * w * TWO_PI / scale);
    gsid_linear_slope(to, to->item, 0, rate, rate, -2 * zeta * TWO_PI);
    gsid_linear_slope(to, to->item, 1, rate, rate, -2 * w);
    gsid_linear_slope(to, to->item, 2, rate, to->command, to->gain);
    gsid_linear_slope(to, to->rigid_body, 0, rate, to->command, residue);
    to->signal[to->output_angle ? bend : rate] += to->output_angle ? 1 / scale : R(1.0);
}

const gsid_effect EFFECT(flexible_mode) = {
    .id = "flexible_mode",
    .sentence = "The structure between motor and sensor bends: a resonance.",
    .confused_with = "gear_backlash,sensor_lag,transport_delay",
    .stage = GSID_STAGE_STRUCTURE,
    .null_kind = GSID_NULL_SMOOTH,
    .n_parameters = 3,
    .parameter = {{"f_hz", "Hz", R(179.0), R(1e-3), R(1e6), NAN},
                  {"zeta", "1", R(0.015), R(0.0), R(10.0), NAN},
                  {"residue", "1", R(0.15), R(-1e6), R(1e6), R(0.0)}},
    .n_states = 2,
    .linear = linear,
};

static const gsid_real ZETAS[] = {R(0.005), R(0.02), R(0.08)};

const gsid_effect_facts FACTS(flexible_mode) = {
    .effect = &EFFECT(flexible_mode),
    .law = "adds q' to the rate; q'' + 2 zeta w0 q' + w0^2 q = residue gain u, w0 = 2 pi f_hz",
    .linear_part = GSID_LINEAR_MODE,
    .parameter = {{.in_response = 1,
                   .grid = {GSID_SPACING_GEOMETRIC, GSID_SHARE_OF_BAND, R(1.0) / 50, R(1.1), 0, 60, NULL,
                            "the excited band and a little above: a mode further up is a spring to the data"}},
                  {.in_response = 1,
                   .grid = {GSID_SPACING_LIST, GSID_SHARE_OF_ONE, 0, 0, 0, 3, ZETAS,
                            "metal structures; a fit moves it on from the nearest"}},
                  {.in_response = 1}},
};
