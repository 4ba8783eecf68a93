/* One sample of a plant: the command's way to the motor, the pieces of the motion, and the sensor. */
#include <string.h>

#include "plant_private.h"

gsid_status gsid_plant_reset(gsid_plant *plant) {
    if (plant == NULL)
        return GSID_E_NULL;
    if (plant->layout == NULL)
        return GSID_E_STATE;
    gsid_plant_layout *l = plant->layout;
    memset(l->z, 0, (size_t)l->n_rows * l->n_columns * sizeof *l->z);
    memset(l->under_way, 0, (GSID_PLANT_DELAY_MAX + 1) * (size_t)l->ring_columns * sizeof *l->under_way);
    for (int i = 0; i < 3; i++) /* a number that is not finite would outlive a factor of 0 */
        memset(l->torque[i], 0, (size_t)CHANNELS_MAX * l->n_columns * sizeof *l->torque[i]);
    l->z[GSID_Z_ONE * l->n_columns] = 1;
    l->newest = 0;
    if (l->has_controller)
        memset(l->angle_seen, 0, (GSID_RATE_SAMPLES_MAX + 1) * (size_t)l->n_columns * sizeof *l->angle_seen);
    l->angle_newest = 0;
    l->n_active = 1;
    l->n_free = 0;
    l->side = 1;
    l->time_s = 0;
    l->stride_s = l->sample_s;
    l->largest_torque = 0;
    l->is_too_steep = 0;
    gsid_plant_choose_zones(l);
    gsid_plant_choose_regime(l);
    gsid_plant_start_refresh(l);
    return GSID_OK;
}

/* ---- sensor ---- */

static void add_signal(const gsid_plant_layout *l, const gsid_real *z, gsid_real *y) {
    memset(y, 0, l->n_active * sizeof *y);
    for (uint32_t row = GSID_Z_STATES; row < l->linear.n; row++) {
        const gsid_real factor = l->linear.signal[row], *from = z + row * l->n_columns;
        for (uint32_t c = 0; factor != 0 && c < l->n_active; c++)
            y[c] += factor * from[c];
    }
}

/* The k-th refresh at t = k / rate moves with the rate by -t / rate, and the signal seen with it. */
void gsid_plant_refresh(gsid_plant_layout *l, const gsid_real *z) {
    add_signal(l, z, l->held);
    const uint32_t by = l->sampler_column[0];
    if (l->n_free > 0 && by != 0) {
        gsid_real rates[GSID_Z_MAX], slope = 0;
        gsid_plant_derivative(l, z, rates);
        for (uint32_t row = GSID_Z_STATES; row < l->linear.n; row++)
            slope += l->linear.signal[row] * rates[row];
        l->held[by] -= slope * l->since_start_s * l->refresh_s;
    }
    l->since_start_s += l->refresh_s;
}

void gsid_plant_start_refresh(gsid_plant_layout *l) {
    l->since_start_s = 0;
    l->to_refresh = l->refresh;
    if (l->refresh_s > 0)
        gsid_plant_refresh(l, l->z);
}

/* [n_active] */
void gsid_plant_output(const gsid_plant_layout *l, gsid_real *y) {
    if (l->refresh_s > 0)
        memcpy(y, l->held, l->n_active * sizeof *y);
    else
        add_signal(l, l->z, y);
}

static void add_disturbances(const gsid_plant *plant, gsid_real *y) {
    const gsid_plant_layout *l = plant->layout;
    for (uint32_t i = 0; i < plant->cfg.n_items; i++) {
        const gsid_plant_item *item = &l->item[i];
        const uint32_t *column = l->column + (size_t)i * GSID_EFFECT_PARAMETERS_MAX;
        gsid_real by_value[GSID_EFFECT_PARAMETERS_MAX] = {0};
        if (item->effect->disturbance == NULL)
            continue;
        y[VALUE] += item->effect->disturbance(item, l->time_s, by_value);
        for (uint32_t k = 0; l->n_free > 0 && k < item->effect->n_parameters; k++)
            if (column[k] != 0)
                y[column[k]] += by_value[k];
    }
}

/* ---- command ---- */

static gsid_real *command_given(const gsid_plant_layout *l, uint32_t samples_ago) {
    const uint32_t at = (l->newest + GSID_PLANT_DELAY_MAX + 1 - samples_ago) % (GSID_PLANT_DELAY_MAX + 1);
    return l->under_way + (size_t)at * l->ring_columns;
}

static void scale_command(const gsid_plant_layout *l, gsid_real *u, gsid_real by_u, const uint32_t *column,
                          uint32_t n_parameters, const gsid_real *by_value) {
    for (uint32_t c = 1; c < l->n_active; c++)
        u[c] *= by_u;
    for (uint32_t k = 0; l->n_free > 0 && k < n_parameters; k++)
        if (column[k] != 0)
            u[column[k]] += by_value[k];
}

static gsid_real *angle_seen(const gsid_plant_layout *l, uint32_t samples_ago) {
    const uint32_t at = (l->angle_newest + GSID_RATE_SAMPLES_MAX + 1 - samples_ago) % (GSID_RATE_SAMPLES_MAX + 1);
    return l->angle_seen + (size_t)at * l->n_columns;
}

/* The rate that a controller works with: the axis's, or the change of the angle over n samples. */
static void controlled_rate(const gsid_plant_layout *l, const gsid_plant_item *item, const gsid_real *angle,
                            gsid_real *rate) {
    const uint32_t n = item->effect->rate_samples != NULL ? item->effect->rate_samples(item) : 0;
    if (n == 0) {
        memcpy(rate, l->z + GSID_Z_RATE * l->n_columns, l->n_active * sizeof *rate);
        return;
    }
    const gsid_real *past = angle_seen(l, n);
    for (uint32_t c = 0; c < l->n_active; c++)
        rate[c] = (angle[c] - past[c]) / ((gsid_real)n * l->sample_s);
}

/* The command from the reference in u[VALUE] and the sampled motion. */
static void control(gsid_plant_layout *l, const gsid_plant_item *item, const uint32_t *column, gsid_real *u) {
    const gsid_real *angle = l->z + GSID_Z_ANGLE * l->n_columns;
    gsid_real *rate = l->rate_seen;
    l->angle_newest = (l->angle_newest + 1) % (GSID_RATE_SAMPLES_MAX + 1);
    memcpy(angle_seen(l, 0), angle, l->n_active * sizeof *angle);
    controlled_rate(l, item, angle, rate);
    const gsid_real signal[3] = {u[VALUE], angle[VALUE], rate[VALUE]};
    gsid_real by_signal[3] = {0}, by_value[GSID_EFFECT_PARAMETERS_MAX] = {0};
    u[VALUE] = item->effect->control(item, signal, by_signal, by_value);
    for (uint32_t c = 1; c < l->n_active; c++)
        u[c] = by_signal[1] * angle[c] + by_signal[2] * rate[c];
    scale_command(l, u, 1, column, item->effect->n_parameters, by_value);
}

/* A command on its way: through controller and static maps into the delay. */
void gsid_plant_give(gsid_plant *plant, gsid_real u) {
    gsid_plant_layout *l = plant->layout;
    memset(l->command, 0, l->n_active * sizeof *l->command);
    l->command[VALUE] = u;
    for (int stage = GSID_STAGE_CONTROLLER; stage <= GSID_STAGE_ACTUATOR; stage++) {
        for (uint32_t i = 0; i < plant->cfg.n_items; i++) {
            const gsid_plant_item *item = &l->item[i];
            const uint32_t *column = l->column + (size_t)i * GSID_EFFECT_PARAMETERS_MAX;
            gsid_real by_u = 0, by_value[GSID_EFFECT_PARAMETERS_MAX] = {0};
            if (stage == GSID_STAGE_CONTROLLER && item->effect->control != NULL) {
                control(l, item, column, l->command);
            } else if (stage == GSID_STAGE_ACTUATOR && item->effect->command != NULL) {
                l->command[VALUE] = item->effect->command(item, l->command[VALUE], &by_u, by_value);
                scale_command(l, l->command, by_u, column, item->effect->n_parameters, by_value);
            }
        }
    }
    l->newest = (l->newest + 1) % (GSID_PLANT_DELAY_MAX + 1);
    const uint32_t n = l->ring_columns < l->n_active ? l->ring_columns : l->n_active;
    memcpy(command_given(l, 0), l->command, n * sizeof *l->command);
}

void gsid_plant_clear_ring(gsid_plant_layout *l, uint32_t first_column) {
    for (uint32_t at = 0; at <= GSID_PLANT_DELAY_MAX; at++)
        for (uint32_t c = first_column; c < l->ring_columns; c++)
            l->under_way[(size_t)at * l->ring_columns + c] = 0;
    for (uint32_t ago = 0; l->has_controller && ago <= GSID_RATE_SAMPLES_MAX; ago++)
        for (uint32_t c = first_column; c < l->n_columns; c++)
            angle_seen(l, ago)[c] = 0;
    for (uint32_t c = first_column; c < l->n_columns; c++)
        l->z[GSID_Z_COMMAND * l->n_columns + c] = 0;
}

/* The motor sees the command given a delay ago. */
void gsid_plant_take_command(gsid_plant_layout *l) {
    const uint32_t n = l->ring_columns < l->n_active ? l->ring_columns : l->n_active;
    memcpy(l->z + GSID_Z_COMMAND * l->n_columns, command_given(l, l->delay_samples), n * sizeof *l->z);
}

/* The command that the motor sees changes at an instant that moves with the delay, dt*= d delay: S jumps by f before - f
 * after. This is what makes the delay a smooth parameter. */
static void switch_command(gsid_plant_layout *l) {
    const int moves = l->n_free > 0 && l->linear.n_delays > 0;
    gsid_real before[GSID_Z_MAX], after[GSID_Z_MAX];
    if (moves)
        gsid_plant_derivative(l, l->z, before);
    gsid_plant_take_command(l);
    gsid_plant_choose_regime(l);
    if (!moves)
        return;
    gsid_plant_derivative(l, l->z, after);
    for (uint32_t row = GSID_Z_STATES; row < l->linear.n; row++)
        for (uint32_t k = 0; k < l->linear.n_delays; k++)
            l->z[row * l->n_columns + l->linear.delay[k].by] += before[row] - after[row];
}

/* ---- one sample ---- */

void gsid_plant_sample(gsid_plant *plant, gsid_real u) {
    gsid_plant_layout *l = plant->layout;
    gsid_plant_give(plant, u);
    l->at_s = 0;
    l->n_moves = 0;
    gsid_plant_run_piece(l, &l->piece[0]);
    switch_command(l);
    gsid_plant_run_piece(l, &l->piece[1]);
    l->to_refresh -= 1;
    l->time_s += l->sample_s;
}

/* 0 times a number is 0, unless it is not finite. */
static gsid_real zero_times_rows(const gsid_plant_layout *l, uint32_t first, uint32_t end) {
    gsid_real sum = 0;
    for (uint32_t row = first; row < end; row++)
        for (uint32_t c = 0; c < l->n_active; c++)
            sum += 0 * l->z[row * l->n_columns + c];
    return sum;
}

/* GSID_OK, or why the state is no longer to be believed. */
gsid_status gsid_plant_health(const gsid_plant_layout *l) {
    if (zero_times_rows(l, 0, l->linear.n) != 0 || zero_times_rows(l, l->n_rows - l->n_memories, l->n_rows) != 0)
        return GSID_E_NONFINITE;
    return l->is_too_steep ? GSID_E_STEEP : GSID_OK;
}

gsid_status gsid_plant_step(gsid_plant *plant, gsid_real u, gsid_real *y, gsid_real *dy) {
    if (plant == NULL || y == NULL)
        return GSID_E_NULL;
    if (plant->layout == NULL)
        return GSID_E_STATE;
    if (!gsid_is_finite(u))
        return GSID_E_NONFINITE;
    gsid_plant_layout *l = plant->layout;
    l->n_free = dy != NULL ? plant->cfg.n_free : 0;
    l->n_active = 1 + l->n_free;
    gsid_plant_output(l, l->y);
    add_disturbances(plant, l->y);
    gsid_plant_sample(plant, u);
    const gsid_status status = gsid_plant_health(l);
    if (status != GSID_OK) {
        gsid_plant_reset(plant);
        return status;
    }
    *y = l->y[VALUE];
    if (dy != NULL)
        memcpy(dy, l->y + FIRST_FREE, l->n_free * sizeof *dy);
    return GSID_OK;
}
