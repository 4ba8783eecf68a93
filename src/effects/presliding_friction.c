#include "effects.h"

/* Dahl's law does not know time: while the axis turns one way, dz/dangle = stiffness (1 - side z), and
 *   z = side + (z0 - side) exp(-stiffness |turned|). */
static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    const gsid_real level = item->value[0], stiffness = item->value[1];
    const gsid_real path = motion->side * motion->turned;
    const gsid_real fade = gsid_exp(-stiffness * path), from = motion->memory - motion->side;
    answer->memory = motion->side + from * fade;
    answer->memory_by_turned = -stiffness * motion->side * from * fade;
    answer->memory_by_memory = fade;
    answer->memory_by_value[1] = -path * from * fade;
    answer->torque = level * answer->memory;
    answer->by_turned = level * answer->memory_by_turned;
    answer->by_memory = level * fade;
    answer->by_value[0] = answer->memory;
    answer->by_value[1] = level * answer->memory_by_value[1];
}

const gsid_effect EFFECT(presliding_friction) = {
    .id = "presliding_friction",
    .sentence = "Dry friction that gives like a spring before it slides, and remembers reversals (Dahl).",
    .confused_with = "coulomb_friction,stribeck_friction,cable_spring",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 2,
    .parameter = {{"level", "deg/s^2", R(15.0), R(0.0), ANY, R(0.0)},
                  {"stiffness", "1/deg", R(50.0), R(1e-3), ANY, NAN}},
    .has_memory = 1,
    .torque = torque,
};

const gsid_effect_facts FACTS(presliding_friction) = {
    .effect = &EFFECT(presliding_friction),
    .law = "level z, dz/dt = stiffness (w - |w| z)",
    .simpler = "coulomb_friction",
    .parameter = {{0},
                  {.grid = {GSID_SPACING_INVERSE, GSID_SHARE_OF_TRAVEL, R(0.001), R(4.0), 0, 11, NULL,
                            "within a thousandth of the travel it is coulomb_friction, over four times the travel a "
                            "spring"}}},
};
