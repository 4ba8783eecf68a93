/* The command of a first-order hold. Apart from plant_sample.c: a held command shall not pay for its registers. */
#include <string.h>

#include "plant_sample.h"

/* The line from the command before to this one, with its slope. A longer delay shifts it by its slope.  Eq: PLT-3 */
void gsid_plant_take_ramp(gsid_plant_layout *l, gsid_real since_s) {
    const uint32_t n = l->command.ring_columns < l->shape.n_active ? l->command.ring_columns : l->shape.n_active;
    const gsid_real *to = gsid_plant_command_given(l, l->command.delay_samples),
                    *from = gsid_plant_command_given(l, l->command.delay_samples + 1);
    gsid_real *slope = l->z + GSID_Z_COMMAND * l->shape.n_columns, *ramp = l->z + l->command.ramp * l->shape.n_columns;
    memset(ramp, 0, l->shape.n_active * sizeof *ramp);
    for (uint32_t c = 0; c < n; c++) {
        slope[c] = (to[c] - from[c]) / l->motion.sample_s;
        ramp[c] = from[c] + slope[c] * since_s;
    }
    for (uint32_t k = 0; l->shape.n_free > 0 && k < l->linear.a.n_delays; k++) {
        ramp[l->linear.a.delay[k].by] -= slope[VALUE];
    }
}
