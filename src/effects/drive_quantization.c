#include "effects.h"

/* The derivatives are those of the trend through the steps; almost everywhere it would be zero, and infinite at the rest. */
static gsid_real command(const gsid_plant_item *item, gsid_real u, gsid_real *by_u, gsid_real *by_value) {
    const gsid_real step = item->value[0];
    *by_u = 1;
    by_value[0] = 0;
    if (step == 0) {
        return u;
    }
    const gsid_real size = step * gsid_floor(gsid_fabs(u) / step + R(0.5));
    return u < 0 ? -size : size;
}

const gsid_effect EFFECT(drive_quantization) = {
    .id = "drive_quantization",
    .sentence = "The drive rounds the command to whole steps.",
    .confused_with = "drive_dead_zone",
    .stage = GSID_STAGE_ACTUATOR,
    .null_kind = GSID_NULL_THRESHOLD,
    .n_parameters = 1,
    .parameter = {{"step", "command", R(0.0874), R(1e-6), ANY, R(0.0)}},
    .command = command,
};

const gsid_effect_facts FACTS(drive_quantization) = {
    .effect = &EFFECT(drive_quantization),
    .law = "step round(u / step)",
    .as_c = "copysignf({step} * floorf(fabsf(u) / {step} + 0.5f), u)",
    .parameter = {{.grid = {GSID_SPACING_ROUNDING, GSID_SHARE_OF_COMMAND, R(3.0), R(1500.0), R(1.0) / 3, 0, NULL,
                            "at the largest command the rounding of neighbours differs by a third of a step; "
                            "the error of the finest has an rms of 0.02 % of it"}}},
};
