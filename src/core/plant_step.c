/* A plant: laid out in the caller's memory, with new values, at rest, one sample further. */
#include <string.h>

#include "plant_laws.h"
#include "plant_layout.h"
#include "plant_sample.h"
#include "plant_sensor.h"

size_t gsid_plant_mem_size(const gsid_plant_cfg *cfg) {
    return gsid_plant_size_within(cfg, SIZE_MAX);
}

gsid_status gsid_plant_init(gsid_plant *plant, const gsid_plant_cfg *cfg, void *mem, size_t mem_size) {
    if (plant == NULL) {
        return GSID_E_NULL;
    }
    gsid_plant_layout *l = NULL;
    gsid_status status = gsid_plant_lay_out(cfg, mem, mem_size, &l);
    if (status != GSID_OK) {
        return status;
    }
    gsid_plant made = {*cfg, l};
    status = gsid_plant_update(&made);
    if (status == GSID_OK) {
        *plant = made;
    }
    return status;
}

gsid_status gsid_plant_update(gsid_plant *plant) {
    if (plant == NULL) {
        return GSID_E_NULL;
    }
    if (plant->layout == NULL) {
        return GSID_E_STATE;
    }
    int has_same_states = 0;
    const gsid_status status = gsid_plant_take_values(&plant->cfg, plant->layout, &has_same_states);
    return status != GSID_OK || has_same_states ? status : gsid_plant_reset(plant);
}

gsid_status gsid_plant_reset(gsid_plant *plant) {
    if (plant == NULL) {
        return GSID_E_NULL;
    }
    if (plant->layout == NULL) {
        return GSID_E_STATE;
    }
    gsid_plant_layout *l = plant->layout;
    memset(l->z, 0, (size_t)l->shape.n_rows * l->shape.n_columns * sizeof *l->z);
    memset(l->command.under_way, 0,
           (GSID_PLANT_DELAY_MAX + 1) * (size_t)l->command.ring_columns * sizeof *l->command.under_way);
    for (int i = 0; i < 3; i++) { /* a number that is not finite would outlive a factor of 0 */
        memset(l->laws.torque[i], 0, (size_t)CHANNELS_MAX * l->shape.n_columns * sizeof *l->laws.torque[i]);
    }
    l->z[GSID_Z_ONE * l->shape.n_columns] = 1;
    l->command.newest = 0;
    if (l->stack.has_controller) {
        memset(l->controller.angle, 0,
               (GSID_RATE_SAMPLES_MAX + 1) * (size_t)l->shape.n_columns * sizeof *l->controller.angle);
    }
    l->controller.newest = 0;
    l->shape.n_active = 1;
    l->shape.n_free = 0;
    l->regime.side = 1;
    l->sensor.time_s = 0;
    l->steep.stride_s = l->motion.sample_s;
    l->steep.largest_torque = 0;
    l->steep.is_given_up = 0;
    gsid_plant_choose_zones(l);
    gsid_plant_choose_regime(l);
    gsid_plant_start_refresh(l);
    return GSID_OK;
}

gsid_status gsid_plant_place(gsid_plant *plant, gsid_real angle, gsid_real rate) {
    if (plant == NULL) {
        return GSID_E_NULL;
    }
    if (plant->layout == NULL) {
        return GSID_E_STATE;
    }
    if (!gsid_is_finite(angle) || !gsid_is_finite(rate)) {
        return GSID_E_NONFINITE;
    }
    gsid_plant_layout *l = plant->layout;
    l->z[GSID_Z_ANGLE * l->shape.n_columns] = angle;
    l->z[GSID_Z_RATE * l->shape.n_columns] = rate;
    gsid_plant_choose_zones(l);
    gsid_plant_choose_regime(l);
    return GSID_OK;
}

gsid_status gsid_plant_step(gsid_plant *plant, gsid_real u, gsid_real *y, gsid_real *dy) {
    if (plant == NULL || y == NULL) {
        return GSID_E_NULL;
    }
    if (plant->layout == NULL) {
        return GSID_E_STATE;
    }
    if (!gsid_is_finite(u)) {
        return GSID_E_NONFINITE;
    }
    gsid_plant_layout *l = plant->layout;
    l->shape.n_free = dy != NULL ? plant->cfg.n_free : 0;
    l->shape.n_active = 1 + l->shape.n_free;
    gsid_plant_output(l, l->sensor.y);
    gsid_plant_add_disturbances(plant, l->sensor.y);
    gsid_plant_sample(plant, u);
    const gsid_status status = gsid_plant_health(l);
    if (status != GSID_OK) {
        gsid_plant_reset(plant);
        return status;
    }
    *y = l->sensor.y[VALUE];
    if (dy != NULL) {
        memcpy(dy, l->sensor.y + FIRST_FREE, l->shape.n_free * sizeof *dy);
    }
    return GSID_OK;
}
