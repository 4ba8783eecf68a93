/* The sensor of a plant: see plant_sensor.c. */
#ifndef GSID_PLANT_SENSOR_H
#define GSID_PLANT_SENSOR_H

#include "plant_parts.h"

#define gsid_plant_add_disturbances GSID_NAME(gsid_plant_add_disturbances)
#define gsid_plant_output GSID_NAME(gsid_plant_output)
#define gsid_plant_refresh GSID_NAME(gsid_plant_refresh)
#define gsid_plant_start_refresh GSID_NAME(gsid_plant_start_refresh)

/* Output of the sensor, [n_active]. */
void gsid_plant_output(const gsid_plant_layout *l, gsid_real *y);

/* y += effects that are not locked to the excitation. */
void gsid_plant_add_disturbances(const gsid_plant *plant, gsid_real *y);

/* A sampler's refreshes: the first one, at l->z; the next, with the plant at z. */
void gsid_plant_start_refresh(gsid_plant_layout *l);
void gsid_plant_refresh(gsid_plant_layout *l, const gsid_real *z);

#endif
