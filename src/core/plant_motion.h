/* Motion of a plant through one piece of a sample: see plant_motion.c. */
#ifndef GSID_PLANT_MOTION_H
#define GSID_PLANT_MOTION_H

#include "plant_parts.h"

#define gsid_plant_run_piece GSID_NAME(gsid_plant_run_piece)

void gsid_plant_run_piece(gsid_plant_layout *l, const plant_piece *piece);

#endif
