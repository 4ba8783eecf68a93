/* One sample of a plant: the command's way to the motor, and the pieces of the motion. */
#include <string.h>

#include "plant_laws.h"
#include "plant_motion.h"
#include "plant_sample.h"

/* ---- command ---- */

static void scale_command(const gsid_plant_layout *l, gsid_real *u, gsid_real by_u, const uint32_t *column,
                          uint32_t n_parameters, const gsid_real *by_value) {
    for (uint32_t c = 1; c < l->shape.n_active; c++) {
        u[c] *= by_u;
    }
    for (uint32_t k = 0; l->shape.n_free > 0 && k < n_parameters; k++) {
        if (column[k] != 0) {
            u[column[k]] += by_value[k];
        }
    }
}

static gsid_real *angle_seen(const gsid_plant_layout *l, uint32_t samples_ago) {
    const uint32_t at = (l->controller.newest + GSID_RATE_SAMPLES_MAX + 1 - samples_ago) % (GSID_RATE_SAMPLES_MAX + 1);
    return l->controller.angle + (size_t)at * l->shape.n_columns;
}

/* The rate that a controller works with: the axis's, or the change of the angle over n samples. */
static void controlled_rate(const gsid_plant_layout *l, const gsid_plant_item *item, const gsid_real *angle,
                            gsid_real *rate) {
    const uint32_t n = item->effect->rate_samples != NULL ? item->effect->rate_samples(item) : 0;
    if (n == 0) {
        memcpy(rate, l->z + GSID_Z_RATE * l->shape.n_columns, l->shape.n_active * sizeof *rate);
        return;
    }
    const gsid_real *past = angle_seen(l, n);
    for (uint32_t c = 0; c < l->shape.n_active; c++) {
        rate[c] = (angle[c] - past[c]) / ((gsid_real)n * l->motion.sample_s);
    }
}

/* The command from the reference in u[VALUE] and the sampled motion. */
static void control(gsid_plant_layout *l, const gsid_plant_item *item, const uint32_t *column, gsid_real *u) {
    const gsid_real *angle = l->z + GSID_Z_ANGLE * l->shape.n_columns;
    gsid_real *rate = l->controller.rate;
    l->controller.newest = (l->controller.newest + 1) % (GSID_RATE_SAMPLES_MAX + 1);
    memcpy(angle_seen(l, 0), angle, l->shape.n_active * sizeof *angle);
    controlled_rate(l, item, angle, rate);
    const gsid_real signal[3] = {u[VALUE], angle[VALUE], rate[VALUE]};
    gsid_real by_signal[3] = {0}, by_value[GSID_EFFECT_PARAMETERS_MAX] = {0};
    u[VALUE] = item->effect->control(item, signal, by_signal, by_value);
    for (uint32_t c = 1; c < l->shape.n_active; c++) {
        u[c] = by_signal[1] * angle[c] + by_signal[2] * rate[c];
    }
    scale_command(l, u, 1, column, item->effect->n_parameters, by_value);
}

void gsid_plant_give(gsid_plant *plant, gsid_real u) {
    gsid_plant_layout *l = plant->layout;
    memset(l->command.u, 0, l->shape.n_active * sizeof *l->command.u);
    l->command.u[VALUE] = u;
    for (int stage = GSID_STAGE_CONTROLLER; stage <= GSID_STAGE_ACTUATOR; stage++) {
        for (uint32_t i = 0; i < plant->cfg.n_items; i++) {
            const gsid_plant_item *item = &l->stack.item[i];
            const uint32_t *column = l->stack.column + (size_t)i * GSID_EFFECT_PARAMETERS_MAX;
            gsid_real by_u = 0, by_value[GSID_EFFECT_PARAMETERS_MAX] = {0};
            if (stage == GSID_STAGE_CONTROLLER && item->effect->control != NULL) {
                control(l, item, column, l->command.u);
            } else if (stage == GSID_STAGE_ACTUATOR && item->effect->command != NULL) {
                l->command.u[VALUE] = item->effect->command(item, l->command.u[VALUE], &by_u, by_value);
                scale_command(l, l->command.u, by_u, column, item->effect->n_parameters, by_value);
            }
        }
    }
    l->command.newest = (l->command.newest + 1) % (GSID_PLANT_DELAY_MAX + 1);
    const uint32_t n = l->command.ring_columns < l->shape.n_active ? l->command.ring_columns : l->shape.n_active;
    memcpy(gsid_plant_command_given(l, 0), l->command.u, n * sizeof *l->command.u);
}

void gsid_plant_clear_ring(gsid_plant_layout *l, uint32_t first_column) {
    for (uint32_t at = 0; at <= GSID_PLANT_DELAY_MAX; at++) {
        for (uint32_t c = first_column; c < l->command.ring_columns; c++) {
            l->command.under_way[(size_t)at * l->command.ring_columns + c] = 0;
        }
    }
    for (uint32_t ago = 0; l->stack.has_controller && ago <= GSID_RATE_SAMPLES_MAX; ago++) {
        for (uint32_t c = first_column; c < l->shape.n_columns; c++) {
            angle_seen(l, ago)[c] = 0;
        }
    }
    for (uint32_t c = first_column; c < l->shape.n_columns; c++) {
        l->z[GSID_Z_COMMAND * l->shape.n_columns + c] = 0;
    }
}

void gsid_plant_take_command(gsid_plant_layout *l, gsid_real since_s) {
    if (l->command.ramp != 0) {
        gsid_plant_take_ramp(l, since_s);
        return;
    }
    const uint32_t n = l->command.ring_columns < l->shape.n_active ? l->command.ring_columns : l->shape.n_active;
    memcpy(l->z + GSID_Z_COMMAND * l->shape.n_columns, gsid_plant_command_given(l, l->command.delay_samples),
           n * sizeof *l->z);
}

/* The motor's command switches at an instant that moves with the delay, dt* = d delay: S jumps by f before - f after. With
 * this jump the output is a smooth function of the delay. */
static void switch_command(gsid_plant_layout *l) {
    const int moves = l->shape.n_free > 0 && l->linear.a.n_delays > 0 && l->command.ramp == 0;
    gsid_real before[GSID_Z_MAX], after[GSID_Z_MAX];
    if (moves) {
        gsid_plant_derivative(l, l->z, before);
    }
    gsid_plant_take_command(l, 0);
    gsid_plant_choose_regime(l);
    if (!moves) {
        return;
    }
    gsid_plant_derivative(l, l->z, after);
    for (uint32_t row = GSID_Z_STATES; row < l->linear.a.n; row++) {
        for (uint32_t k = 0; k < l->linear.a.n_delays; k++) {
            l->z[row * l->shape.n_columns + l->linear.a.delay[k].by] += before[row] - after[row];
        }
    }
}

/* ---- one sample ---- */

void gsid_plant_sample(gsid_plant *plant, gsid_real u) {
    gsid_plant_layout *l = plant->layout;
    gsid_plant_give(plant, u);
    l->motion.at_s = 0;
    l->motion.n_moves = 0;
    gsid_plant_run_piece(l, &l->motion.piece[0]);
    switch_command(l);
    gsid_plant_run_piece(l, &l->motion.piece[1]);
    l->sensor.to_refresh -= 1;
    l->sensor.time_s += l->motion.sample_s;
}

/* 0 times a number is 0, unless it is not finite. */
static gsid_real zero_times_rows(const gsid_plant_layout *l, uint32_t first, uint32_t end) {
    gsid_real sum = 0;
    for (uint32_t row = first; row < end; row++) {
        for (uint32_t c = 0; c < l->shape.n_active; c++) {
            sum += 0 * l->z[row * l->shape.n_columns + c];
        }
    }
    return sum;
}

gsid_status gsid_plant_health(const gsid_plant_layout *l) {
    if (zero_times_rows(l, 0, l->linear.a.n) != 0 ||
        zero_times_rows(l, l->shape.n_rows - l->laws.n_memories, l->shape.n_rows) != 0) {
        return GSID_E_NONFINITE;
    }
    return l->steep.is_given_up ? GSID_E_STEEP : GSID_OK;
}
