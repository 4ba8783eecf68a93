/* A plant's configuration and its memory: see plant_layout.c. */
#ifndef GSID_PLANT_LAYOUT_H
#define GSID_PLANT_LAYOUT_H

#include "plant_parts.h"

#define gsid_plant_lay_out GSID_NAME(gsid_plant_lay_out)
#define gsid_plant_size_within GSID_NAME(gsid_plant_size_within)
#define gsid_plant_take_values GSID_NAME(gsid_plant_take_values)

/* gsid_plant_mem_size where `most` is the largest size. */
size_t gsid_plant_size_within(const gsid_plant_cfg *cfg, size_t most);

/* Check a configuration and lay its plant out in the caller's memory, still without the values of the items.
 * @return as gsid_plant_init */
gsid_status gsid_plant_lay_out(const gsid_plant_cfg *cfg, void *mem, size_t mem_size, gsid_plant_layout **layout);

/* Check the values of the items and take them over; after a refusal the plant is as it was.
 * @param[out] has_same_states  0: the states are other ones now, so the plant must be reset
 * @return as gsid_plant_update */
gsid_status gsid_plant_take_values(const gsid_plant_cfg *cfg, gsid_plant_layout *l, int *has_same_states);

#endif
