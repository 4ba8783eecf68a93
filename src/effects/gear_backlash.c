#include "effects.h"

/* Everything is divided by the load's inertia. With the twist x = motor angle - load angle, the motor's momentum p (its rate
 * times the inertia ratio r), and the spring's torque T = stiffness (x - x clipped to the play) + damping dx/dt:
 *   dx/dt = p / r - rate,   dp/dt = gain u - T,   d rate/dt = T - the other torques.
 * The linear spring stands in the matrix, which the plant takes out within the play; beyond it, the torque below shifts where
 * the spring is at rest. */
static void linear(const gsid_plant_item *item, gsid_linear *to) {
    const gsid_real stiffness = item->value[1], ratio = item->value[2], damping = item->value[3];
    const uint32_t twist = gsid_linear_state(to), momentum = gsid_linear_state(to), rate = GSID_Z_RATE;
    const uint32_t rows[2] = {rate, momentum};
    to->twist = twist;
    to->reaction = to->drive = momentum;
    gsid_linear_add(to, twist, momentum, 1 / ratio);
    gsid_linear_add(to, twist, rate, -1);
    gsid_linear_slope(to, to->item, 2, twist, momentum, -1 / (ratio * ratio));
    for (int i = 0; i < 2; i++) {
        const gsid_real sign = i == 0 ? R(1.0) : R(-1.0);
        gsid_linear_add(to, rows[i], twist, sign * stiffness);
        gsid_linear_add(to, rows[i], momentum, sign * damping / ratio);
        gsid_linear_add(to, rows[i], rate, -sign * damping);
        gsid_linear_slope(to, to->item, 1, rows[i], twist, sign);
        gsid_linear_slope(to, to->item, 2, rows[i], momentum, -sign * damping / (ratio * ratio));
        gsid_linear_slope(to, to->item, 3, rows[i], momentum, sign / ratio);
        gsid_linear_slope(to, to->item, 3, rows[i], rate, -sign);
    }
}

static gsid_real edge_of(const gsid_plant_item *item) {
    return item->value[0] / 2;
}

static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    const gsid_real edge = edge_of(item), stiffness = item->value[1], side = (gsid_real)motion->zone;
    answer->torque = stiffness * side * edge;
    answer->by_value[0] = stiffness * side / 2;
    answer->by_value[1] = side * edge;
}

const gsid_effect EFFECT(gear_backlash) = {
    .id = "gear_backlash",
    .sentence = "Motor and load are joined by a spring with play; sensor, springs and friction are on the load.",
    .confused_with = "flexible_mode,coulomb_friction",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_THRESHOLD,
    .n_parameters = 4,
    .parameter = {{"gap_deg", "deg", R(0.02), R(0.0), ANY, R(0.0)},
                  {"stiffness", "1/s^2", R(1e5), R(1.0), R(1e9), NAN},
                  {"inertia_ratio", "motor over load", R(0.1), R(1e-3), R(1e3), NAN},
                  {"damping", "1/s", R(20.0), R(0.0), R(1e5), NAN}},
    .n_states = 2,
    .is_constant = 1,
    .linear = linear,
    .torque = torque,
    .edge = edge_of,
};

const gsid_effect_facts FACTS(gear_backlash) = {
    .effect = &EFFECT(gear_backlash),
    .law =
        "between motor (inertia inertia_ratio) and load: stiffness times the twist beyond +-gap_deg / 2, damping times "
        "its rate",
    .linear_part = GSID_LINEAR_BACKLASH,
    .parameter = {{0}, {.in_response = 1}, {0}, {.in_response = 1}},
};
