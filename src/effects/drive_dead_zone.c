#include "effects.h"

static gsid_real command(const gsid_plant_item *item, gsid_real u, gsid_real *by_u, gsid_real *by_value) {
    const gsid_real half_width = item->value[0];
    const int is_inside = gsid_fabs(u) <= half_width;
    const gsid_real side = u < 0 ? R(-1.0) : R(1.0);
    *by_u = is_inside ? R(0.0) : R(1.0);
    by_value[0] = is_inside ? R(0.0) : -side;
    return is_inside ? R(0.0) : u - side * half_width;
}

const gsid_effect EFFECT(drive_dead_zone) = {
    .id = "drive_dead_zone",
    .sentence = "The drive does not answer to small commands, and takes as much off the large ones.",
    .confused_with = "coulomb_friction,drive_quantization",
    .stage = GSID_STAGE_ACTUATOR,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 1,
    .parameter = {{"half_width", "command", R(1.0), R(0.0), ANY, R(0.0)}},
    .command = command,
};

const gsid_effect_facts FACTS(drive_dead_zone) = {
    .effect = &EFFECT(drive_dead_zone),
    .law = "0 for |u| <= half_width, else u - half_width sign(u)",
    .as_c = "u > {half_width} ? u - {half_width} : u < -{half_width} ? u + {half_width} : 0.0f",
    .parameter = {{.axis_field = "drive_dead_zone",
                   .grid = {GSID_SPACING_GEOMETRIC, GSID_SHARE_OF_COMMAND, R(1e-4), R(0.3), 0, 14, NULL,
                            "the smallest is below most noise, the largest swallows a third of the command"}}},
};
