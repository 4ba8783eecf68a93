/* One sample of a plant, without its output: see plant_sample.c. */
#ifndef GSID_PLANT_SAMPLE_H
#define GSID_PLANT_SAMPLE_H

#include "plant_parts.h"

#define gsid_plant_clear_ring GSID_NAME(gsid_plant_clear_ring)
#define gsid_plant_give GSID_NAME(gsid_plant_give)
#define gsid_plant_health GSID_NAME(gsid_plant_health)
#define gsid_plant_sample GSID_NAME(gsid_plant_sample)
#define gsid_plant_take_command GSID_NAME(gsid_plant_take_command)
#define gsid_plant_take_ramp GSID_NAME(gsid_plant_take_ramp)

/* Pass a command through controller and static maps into the delay. */
void gsid_plant_give(gsid_plant *plant, gsid_real u);

/* A command that is under way, [ring_columns]. */
static inline gsid_real *gsid_plant_command_given(const gsid_plant_layout *l, uint32_t samples_ago) {
    const uint32_t at = (l->command.newest + GSID_PLANT_DELAY_MAX + 1 - samples_ago) % (GSID_PLANT_DELAY_MAX + 1);
    return l->command.under_way + (size_t)at * l->command.ring_columns;
}

/* The motor gets the command given a delay ago, since_s before now. */
void gsid_plant_take_command(gsid_plant_layout *l, gsid_real since_s);

/* The same for a first-order hold: the motor's command runs to the one given a delay ago. */
void gsid_plant_take_ramp(gsid_plant_layout *l, gsid_real since_s);

/* Set the derivatives of the delayed commands and of the controller's angles to 0, from this column on. */
void gsid_plant_clear_ring(gsid_plant_layout *l, uint32_t first_column);

/* Take a command, and move to the end of the sample. */
void gsid_plant_sample(gsid_plant *plant, gsid_real u);

/* GSID_OK, or why the state is no longer valid. */
gsid_status gsid_plant_health(const gsid_plant_layout *l);

#endif
