#include "effects.h"

static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    const gsid_real level = item->value[0], cycles = item->value[1], turned = motion->unit_rad * motion->angle;
    const gsid_real at = cycles * turned + item->value[2], slope = level * gsid_cos(at);
    answer->torque = level * gsid_sin(at);
    answer->by_angle = slope * cycles * motion->unit_rad;
    answer->by_value[0] = gsid_sin(at);
    answer->by_value[1] = slope * turned;
    answer->by_value[2] = slope;
}

const gsid_effect EFFECT(motor_cogging) = {
    .id = "motor_cogging",
    .sentence = "The motor's magnets prefer some angles: a torque that is a sine of the angle.",
    .confused_with = "cubic_spring,cable_spring,mass_unbalance",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 3,
    .parameter = {{"level", "deg/s^2", R(10.0), R(0.0), ANY, R(0.0)},
                  {"cycles_per_rev", "1/rev", R(252.0), R(1.0), R(1e5), NAN},
                  {"phase_rad", "rad", R(0.0), R(-10.0), R(10.0), NAN}},
    .looks_at_angle = 1,
    .torque = torque,
};

#define PI R(3.14159265358979323846)

const gsid_effect_facts FACTS(motor_cogging) = {
    .effect = &EFFECT(motor_cogging),
    .law = "level sin(cycles_per_rev theta + phase_rad)",
    .as_c = "{level} * sinf({cycles_per_rev} * angle * {unit_rad} + {phase_rad})",
    .turns_only = 1,
    .parameter = {{.axis_field = "cogging_level"},
                  {.axis_field = "cogging_cycles",
                   .grid = {GSID_SPACING_TURNS, GSID_SHARE_OF_TRAVEL, PI / 2, 40 * PI, 2 * PI / 3, 0, NULL,
                            "from a quarter of a pitch in the travel to twenty; a step turns the phase at the far end "
                            "by a third of a turn"}},
                  {.axis_field = "cogging_phase_rad"}},
};
