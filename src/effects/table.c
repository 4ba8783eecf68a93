/* Torque laws of the user's own, as tables: a cubic between points, once continuously differentiable. */
#include "gsid/table.h"

#include "effects.h"

static gsid_real secant(const gsid_real *at, const gsid_real *torque, uint32_t i) {
    return (torque[i + 1] - torque[i]) / (at[i + 1] - at[i]);
}

/* Slope inside, from the secants on both sides: 0 at an extremum, else their harmonic mean, which keeps the cubic
 * monotone (Fritsch and Butland 1984, with the weights for points that are not evenly spaced). */
static gsid_real slope_between(gsid_real left, gsid_real right, gsid_real d_left, gsid_real d_right) {
    if (!(d_left * d_right > 0)) {
        return 0;
    }
    const gsid_real w_left = 2 * right + left, w_right = right + 2 * left;
    return (w_left + w_right) / (w_left / d_left + w_right / d_right);
}

/* Slope at an end: that of a parabola through three points, held back where it would bend the wrong way. */
static gsid_real slope_at_end(gsid_real near, gsid_real far, gsid_real d_near, gsid_real d_far) {
    const gsid_real slope = ((2 * near + far) * d_near - near * d_far) / (near + far);
    if (!(slope * d_near > 0)) {
        return 0;
    }
    return d_near * d_far <= 0 && gsid_fabs(slope) > 3 * gsid_fabs(d_near) ? 3 * d_near : slope;
}

static gsid_status check_points(uint32_t n_points, const gsid_real *at, const gsid_real *torque) {
    if (at == NULL || torque == NULL) {
        return GSID_E_NULL;
    }
    if (n_points < GSID_TABLE_POINTS_MIN || n_points > GSID_TABLE_POINTS_MAX) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < n_points; i++) {
        if (!gsid_is_finite(at[i]) || !gsid_is_finite(torque[i])) {
            return GSID_E_NONFINITE;
        }
        if (i > 0 && !(at[i] > at[i - 1])) {
            return GSID_E_CONFIG;
        }
    }
    return GSID_OK;
}

/* TAB-1 */
gsid_status gsid_table_slopes(uint32_t n_points, const gsid_real *at, const gsid_real *torque, gsid_real *slope) {
    if (slope == NULL) {
        return GSID_E_NULL;
    }
    const gsid_status status = check_points(n_points, at, torque);
    if (status != GSID_OK) {
        return status;
    }
    const uint32_t last = n_points - 1;
    for (uint32_t i = 1; i < last; i++) {
        slope[i] =
            slope_between(at[i] - at[i - 1], at[i + 1] - at[i], secant(at, torque, i - 1), secant(at, torque, i));
    }
    slope[0] = slope_at_end(at[1] - at[0], at[2] - at[1], secant(at, torque, 0), secant(at, torque, 1));
    slope[last] = slope_at_end(at[last] - at[last - 1], at[last - 1] - at[last - 2], secant(at, torque, last - 1),
                               secant(at, torque, last - 2));
    return GSID_OK;
}

/* First point of the interval that holds x, by bisection. */
static uint32_t interval(const gsid_table *t, gsid_real x) {
    uint32_t low = 0, high = t->n_points - 1;
    while (high - low > 1) {
        const uint32_t middle = low + (high - low) / 2;
        if (x < t->at[middle]) {
            high = middle;
        } else {
            low = middle;
        }
    }
    return low;
}

static void look_up(const gsid_table *t, gsid_real x, gsid_real *value, gsid_real *slope) {
    const uint32_t last = t->n_points - 1;
    if (x <= t->at[0] || x >= t->at[last]) {
        const uint32_t end = x <= t->at[0] ? 0 : last;
        *slope = t->slope[end];
        *value = t->torque[end] + t->slope[end] * (x - t->at[end]);
        return;
    }
    const uint32_t i = interval(t, x);
    const gsid_real h = t->at[i + 1] - t->at[i], s = (x - t->at[i]) / h, d = secant(t->at, t->torque, i);
    const gsid_real c2 = 3 * d - 2 * t->slope[i] - t->slope[i + 1], c3 = t->slope[i] + t->slope[i + 1] - 2 * d;
    *value = t->torque[i] + h * s * (t->slope[i] + s * (c2 + s * c3));
    *slope = t->slope[i] + s * (2 * c2 + 3 * s * c3);
}

static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    const gsid_table *t = (const gsid_table *)item->data;
    const gsid_real scale = item->value[0];
    gsid_real value, slope;
    switch (t->variable) {
    case GSID_TABLE_ANGLE:
        look_up(t, motion->angle, &value, &slope);
        answer->by_angle = scale * slope;
        break;
    case GSID_TABLE_COMMAND:
        look_up(t, motion->command, &value, &slope);
        answer->by_command = scale * slope;
        break;
    case GSID_TABLE_RATE:
    default:
        look_up(t, motion->rate, &value, &slope);
        answer->by_rate = scale * slope;
    }
    answer->torque = scale * value;
    answer->by_value[0] = value;
}

static gsid_status check(const gsid_table *t) {
    if (t == NULL || t->slope == NULL) {
        return GSID_E_NULL;
    }
    if ((uint32_t)t->variable > GSID_TABLE_COMMAND) {
        return GSID_E_CONFIG;
    }
    const gsid_status status = check_points(t->n_points, t->at, t->torque);
    for (uint32_t i = 0; status == GSID_OK && i < t->n_points; i++) {
        if (!gsid_is_finite(t->slope[i])) {
            return GSID_E_NONFINITE;
        }
    }
    return status;
}

gsid_status gsid_table_effect(const gsid_table *table, gsid_effect *effect) {
    if (effect == NULL) {
        return GSID_E_NULL;
    }
    const gsid_status status = check(table);
    if (status != GSID_OK) {
        return status;
    }
    const gsid_effect_parameter scale = {"scale", "", R(1.0), -ANY, ANY, R(0.0)};
    effect->stage = GSID_STAGE_TORQUE;
    effect->null_kind = GSID_NULL_SMOOTH;
    effect->n_parameters = 1;
    effect->parameter[0] = scale;
    effect->looks_at_angle = table->variable == GSID_TABLE_ANGLE;
    effect->looks_at_command = table->variable == GSID_TABLE_COMMAND;
    effect->may_be_steep = 1;
    effect->torque = torque;
    return GSID_OK;
}
