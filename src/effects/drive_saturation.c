#include "effects.h"

/* A limit of 0 is none. */
static gsid_real command(const gsid_plant_item *item, gsid_real u, gsid_real *by_u, gsid_real *by_value) {
    const gsid_real limit = item->value[0];
    const int is_clipped = limit > 0 && gsid_fabs(u) > limit;
    const gsid_real side = u < 0 ? R(-1.0) : R(1.0);
    *by_u = is_clipped ? R(0.0) : R(1.0);
    by_value[0] = is_clipped ? side : R(0.0);
    return is_clipped ? side * limit : u;
}

const gsid_effect EFFECT(drive_saturation) = {
    .id = "drive_saturation",
    .sentence = "The drive clips the command.",
    .confused_with = "drive_dead_zone,hard_stop",
    .stage = GSID_STAGE_ACTUATOR,
    .null_kind = GSID_NULL_THRESHOLD,
    .n_parameters = 1,
    .parameter = {{"limit", "command", R(150.0), R(1e-6), ANY, R(0.0)}},
    .command = command,
};

static const gsid_real SHARES[] = {R(0.3), R(0.4), R(0.5), R(0.6), R(0.7), R(0.8), R(0.86), R(0.92), R(0.96), R(0.985)};

const gsid_effect_facts FACTS(drive_saturation) = {
    .effect = &EFFECT(drive_saturation),
    .law = "u clipped to +-limit",
    .as_c = "u > {limit} ? {limit} : u < -{limit} ? -{limit} : u",
    .parameter = {{.axis_field = "drive_limit",
                   .grid = {GSID_SPACING_LIST, GSID_SHARE_OF_COMMAND, 0, 0, 0, 10, SHARES,
                            "dense towards the peak: most limits clip the highest peaks only"}}},
};
