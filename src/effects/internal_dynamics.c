#include "effects.h"

/* A power of two near the square root of |x|: a scale of the state that balances the matrix. */
static gsid_real octave_of_root(gsid_real x) {
    const gsid_real size = x < 0 ? -x : x;
    gsid_real octave = 1;
    for (int i = 0; i < 64 && octave * octave * 4 <= size; i++) {
        octave *= 2;
    }
    return octave;
}

/* torque = v, v'' + a1 v' + a0 v = b1 w' + b0 w, with the states v and (v' + a1 v - b1 w) / scale.
 * With a0 = b0 = 0 it is of first order: v' + a1 v = b1 w. */
static void linear(const gsid_plant_item *item, gsid_linear *to) {
    const gsid_real b1 = item->value[0], b0 = item->value[1], a1 = item->value[2], a0 = item->value[3];
    const gsid_real scale = octave_of_root(a0);
    const uint32_t torque = gsid_linear_state(to), inner = gsid_linear_state(to);
    gsid_linear_add(to, GSID_Z_RATE, torque, -1);
    gsid_linear_add(to, torque, GSID_Z_RATE, b1);
    gsid_linear_add(to, torque, torque, -a1);
    gsid_linear_slope(to, to->item, 0, torque, GSID_Z_RATE, 1);
    gsid_linear_slope(to, to->item, 2, torque, torque, -1);
    if (a0 == 0 && b0 == 0) {
        gsid_linear_add(to, inner, inner, -1); /* unused */
        return;
    }
    gsid_linear_add(to, torque, inner, scale);
    gsid_linear_add(to, inner, torque, -a0 / scale);
    gsid_linear_add(to, inner, GSID_Z_RATE, b0 / scale);
    gsid_linear_slope(to, to->item, 1, inner, GSID_Z_RATE, 1 / scale);
    gsid_linear_slope(to, to->item, 3, inner, torque, -1 / scale);
}

const gsid_effect EFFECT(internal_dynamics) = {
    .id = "internal_dynamics",
    .sentence = "A linear torque that depends on the past of the rate: two zeros of a rational response of the axis.",
    .confused_with = "flexible_mode",
    .stage = GSID_STAGE_STRUCTURE,
    .null_kind = GSID_NULL_NEVER,
    .n_parameters = 4,
    .parameter = {{"b1", "1/s^2", R(50.0), -R(1e30), R(1e30), NAN},
                  {"b0", "1/s^3", R(1e4), -R(1e30), R(1e30), NAN},
                  {"a1", "1/s", R(10.0), -R(1e30), R(1e30), NAN},
                  {"a0", "1/s^2", R(1e5), -R(1e30), R(1e30), NAN}},
    .n_states = 2,
    .linear = linear,
};

const gsid_effect_facts FACTS(internal_dynamics) = {
    .effect = &EFFECT(internal_dynamics),
    .law = "v; v'' + a1 v' + a0 v = b1 w' + b0 w",
    .linear_part = GSID_LINEAR_DYNAMICS,
    .not_searched = "a part of a rational response, not a cause",
    .parameter = {{.in_response = 1}, {.in_response = 1}, {.in_response = 1}, {.in_response = 1}},
};
