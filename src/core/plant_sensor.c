/* The sensor of a plant: its output, refreshed at its own rate, and its disturbances. */
#include <string.h>

#include "plant_laws.h"
#include "plant_sensor.h"

static void add_signal(const gsid_plant_layout *l, const gsid_real *z, gsid_real *y) {
    memset(y, 0, l->shape.n_active * sizeof *y);
    for (uint32_t row = GSID_Z_STATES; row < l->linear.a.n; row++) {
        const gsid_real factor = l->linear.a.signal[row], *from = z + row * l->shape.n_columns;
        for (uint32_t c = 0; factor != 0 && c < l->shape.n_active; c++) {
            y[c] += factor * from[c];
        }
    }
}

/* The k-th refresh at t = k / rate moves with the rate by -t / rate, and so does the sampled signal. */
void gsid_plant_refresh(gsid_plant_layout *l, const gsid_real *z) {
    add_signal(l, z, l->sensor.held);
    const uint32_t by = l->sensor.column[0];
    if (l->shape.n_free > 0 && by != 0) {
        gsid_real rates[GSID_Z_MAX], slope = 0;
        gsid_plant_derivative(l, z, rates);
        for (uint32_t row = GSID_Z_STATES; row < l->linear.a.n; row++) {
            slope += l->linear.a.signal[row] * rates[row];
        }
        l->sensor.held[by] -= slope * l->sensor.since_start_s * l->sensor.refresh_s;
    }
    l->sensor.since_start_s += l->sensor.refresh_s;
}

void gsid_plant_start_refresh(gsid_plant_layout *l) {
    l->sensor.since_start_s = 0;
    l->sensor.to_refresh = l->sensor.refresh_samples;
    if (l->sensor.refresh_s > 0) {
        gsid_plant_refresh(l, l->z);
    }
}

void gsid_plant_output(const gsid_plant_layout *l, gsid_real *y) {
    if (l->sensor.refresh_s > 0) {
        memcpy(y, l->sensor.held, l->shape.n_active * sizeof *y);
    } else {
        add_signal(l, l->z, y);
    }
}

void gsid_plant_add_disturbances(const gsid_plant *plant, gsid_real *y) {
    const gsid_plant_layout *l = plant->layout;
    for (uint32_t i = 0; i < plant->cfg.n_items; i++) {
        const gsid_plant_item *item = &l->stack.item[i];
        const uint32_t *column = l->stack.column + (size_t)i * GSID_EFFECT_PARAMETERS_MAX;
        gsid_real by_value[GSID_EFFECT_PARAMETERS_MAX] = {0};
        if (item->effect->disturbance == NULL) {
            continue;
        }
        y[VALUE] += item->effect->disturbance(item, l->sensor.time_s, by_value);
        for (uint32_t k = 0; l->shape.n_free > 0 && k < item->effect->n_parameters; k++) {
            if (column[k] != 0) {
                y[column[k]] += by_value[k];
            }
        }
    }
}
