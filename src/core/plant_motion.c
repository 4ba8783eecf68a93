/* Motion through one piece of a sample: steps between events.
 *
 * Side (the direction of motion) and zones are fixed between events, so that every law is smooth there; a step integrates
 * the linear part exactly and the torques as a parabola in time through their values at its start, middle and end
 * (exponential Runge-Kutta, order 3). Where the rate passes zero, friction breaks loose or a law enters another zone, the
 * step is cut at that instant. */
#include <float.h>
#include <string.h>

#include "plant_laws.h"
#include "plant_linear.h"
#include "plant_motion.h"
#include "plant_sensor.h"

#ifdef GSID_SINGLE
#define ROUNDING_UNIT FLT_EPSILON
#define NEARLY 1e-5f /* samples: instants closer than this, by rounding, count as one */
#else
#define ROUNDING_UNIT DBL_EPSILON
#define NEARLY 1e-9
#endif

/* After this many events in one step, the rest of the step is run without a search for more, to bound the time. */
#define EVENTS_MAX 16
#define SEARCH_MAX 50

/* Tolerances of a step with steep laws, relative to the largest torque so far. SURPRISE: torque at the end of the step against
 * its prediction. CURVED: torque in the middle against the mean of both ends. */
#ifdef GSID_SINGLE
#define SURPRISE 1e-4f
#else
#define SURPRISE 1e-5
#endif
#define CURVED GSID_R(1e-2)
#define HALVINGS_MAX 20
#define PARTS_MAX 256

/* ---- guards: below zero, the regime has ended ---- */

enum { RATE_GUARD = 0, HOLD_GUARD = 1, ZONE_GUARD = 2 }; /* and the law's number */

typedef struct {
    gsid_real margin;
    uint32_t which;
} guard;

static void consider(guard *worst, gsid_real margin, uint32_t which) {
    if (margin < worst->margin) {
        worst->margin = margin;
        worst->which = which;
    }
}

static guard look(const gsid_plant_layout *l, const gsid_real *z) {
    guard worst = {INFINITY, NONE};
    if (l->regime.sticks) {
        consider(&worst, gsid_plant_largest_hold(l) - gsid_fabs(gsid_plant_free_acceleration(l, z)), HOLD_GUARD);
    } else if (l->laws.have_side) {
        consider(&worst, l->regime.side * z[GSID_Z_RATE * l->shape.n_columns], RATE_GUARD);
    }
    for (uint32_t i = 0; i < l->laws.n; i++) {
        const plant_law *law = &l->laws.law[i];
        if (law->item->effect->edge == NULL) {
            continue;
        }
        const gsid_real angle = z[gsid_plant_angle_row(l, law) * l->shape.n_columns],
                        edge = law->item->effect->edge(law->item);
        const gsid_real margin = law->zone == 0 ? edge - gsid_fabs(angle) : (gsid_real)law->zone * angle - edge;
        consider(&worst, margin, ZONE_GUARD + i);
    }
    return worst;
}

/* ---- one step ---- */

/* Forcing of the step that starts at l->z: c0 + c1 t + c2 t^2, t from 0 to 1. */
static void force(gsid_plant_layout *l, gsid_real start[3], gsid_real middle[3], gsid_real end[3]) {
    const size_t n = l->shape.n_columns;
    for (uint32_t channel = 0; channel < l->laws.n_channels; channel++) {
        gsid_real *c = l->z + (l->linear.a.n + FORCING * channel) * n;
        const gsid_real *t0 = l->laws.torque[0] + channel * n, *t1 = l->laws.torque[1] + channel * n,
                        *t2 = l->laws.torque[2] + channel * n;
        for (int k = 0; k < FORCING; k++) {
            for (uint32_t i = 0; i < l->shape.n_active; i++) {
                c[(size_t)k * n + i] = start[k] * t0[i] + middle[k] * t1[i] + end[k] * t2[i];
            }
        }
    }
}

/* The sample has taken so many moves that it is given up: this bounds the time, whatever the values. */
static int is_spent(const gsid_plant_layout *l) {
    return l->motion.n_moves > GSID_PLANT_MOVES_MAX;
}

static void move(gsid_plant_layout *l, const plant_flow *flow, int part, gsid_real length_s, uint32_t n_rows,
                 gsid_real *to) {
    l->motion.n_moves += flow != NULL ? 1 : gsid_plant_series_parts(l, part == HALF ? length_s / 2 : length_s);
    if (flow != NULL) {
        gsid_plant_flow_move(l, flow->map[gsid_plant_regime(l)][part], n_rows, l->z, to);
    } else {
        gsid_plant_series_move(l, part == HALF ? length_s / 2 : length_s, n_rows, l->z, to);
    }
}

/* From l->z over a length: by the flow's maps, or by series where there are none. */
static void advance(gsid_plant_layout *l, const plant_flow *flow, gsid_real length_s, gsid_real *to) {
    const uint32_t n_states = l->linear.a.n - GSID_Z_STATES;
    for (uint32_t row = 0; row < GSID_Z_STATES; row++) {
        memcpy(to + row * l->shape.n_columns, l->z + row * l->shape.n_columns, l->shape.n_active * sizeof *to);
    }
    if (l->laws.n == 0) {
        move(l, flow, WHOLE, length_s, n_states, to);
        return;
    }
    gsid_real *t0 = l->laws.torque[0], *t1 = l->laws.torque[1], *t2 = l->laws.torque[2];
    gsid_real none[3] = {0, 0, 0}, constant[3] = {1, 0, 0}, slope0[3] = {1, -2, 0}, slope1[3] = {0, 2, 0};
    gsid_real parabola0[3] = {1, -3, 2}, parabola1[3] = {0, 4, -4}, parabola2[3] = {0, -1, 2};
    gsid_plant_sum_torques(l, l->regime.sticks, l->shape.n_active, l->z, l->z, t0);
    force(l, constant, none, none);
    if (l->laws.are_constant) {
        move(l, flow, WHOLE, length_s, n_states, to);
        return;
    }
    move(l, flow, HALF, length_s, l->shape.n_look, l->motion.stage);
    gsid_plant_sum_torques(l, l->regime.sticks, l->shape.n_active, l->motion.stage, l->z, t1);
    force(l, slope0, slope1, none);
    move(l, flow, WHOLE, length_s, l->shape.n_look, l->motion.stage);
    gsid_plant_sum_torques(l, l->regime.sticks, l->shape.n_active, l->motion.stage, l->z, t2);
    force(l, parabola0, parabola1, parabola2);
    move(l, flow, WHOLE, length_s, n_states, to);
    gsid_plant_move_memories(l, to);
}

/* ---- events ---- */

/* Instant at which the first guard is broken, known to be before length_s: false position (Illinois), with an occasional
 * bisection. Values only, no sensitivities. */
static gsid_real locate(gsid_plant_layout *l, gsid_real length_s, gsid_real margin_at_end) {
    const uint32_t n_active = l->shape.n_active, n_free = l->shape.n_free;
    gsid_real low = 0, high = length_s, at_low = look(l, l->z).margin, at_high = margin_at_end;
    const gsid_real margin_tol = ROUNDING_UNIT * (gsid_fabs(at_low) + gsid_fabs(at_high));
    int last = 0;
    l->shape.n_active = 1;
    l->shape.n_free = 0;
    for (int i = 0; i < SEARCH_MAX && high - low > ROUNDING_UNIT * length_s && !is_spent(l); i++) {
        gsid_real at = low + (high - low) / 2;
        if (at_low > 0 && i % 4 != 3) {
            at = low + (high - low) * (at_low / (at_low - at_high));
        }
        advance(l, NULL, at, l->motion.next);
        const gsid_real margin = look(l, l->motion.next).margin;
        if (margin < 0) {
            high = at;
            at_high = margin;
            at_low = last < 0 ? at_low / 2 : at_low;
            last = -1;
        } else {
            low = at;
            at_low = margin;
            at_high = last > 0 ? at_high / 2 : at_high;
            last = 1;
        }
        if (gsid_fabs(margin) <= margin_tol) {
            high = at;
            break;
        }
    }
    l->shape.n_active = n_active;
    l->shape.n_free = n_free;
    return high;
}

/* The instant t* at which the rate passes zero moves with the parameters by dt* = -S_w / w', and with it the switch of the
 * acceleration from before to after: S+ = S- + (before - after) dt* = S- after / before (the saltation matrix). */
static void pass_zero(gsid_plant_layout *l) {
    gsid_real rates[GSID_Z_MAX];
    gsid_real *rate = l->z + GSID_Z_RATE * l->shape.n_columns;
    gsid_plant_derivative(l, l->z, rates);
    const gsid_real before = rates[GSID_Z_RATE];
    rate[VALUE] = 0;
    l->regime.side = -l->regime.side;
    gsid_plant_choose_regime(l);
    gsid_plant_derivative(l, l->z, rates);
    const gsid_real after = rates[GSID_Z_RATE];
    const gsid_real ratio = l->regime.sticks ? 0 : before != 0 ? after / before : GSID_R(1.0);
    for (uint32_t c = 1; c < l->shape.n_active; c++) {
        rate[c] *= ratio;
    }
}

static void change_zone(gsid_plant_layout *l, plant_law *law) {
    const gsid_real angle = l->z[gsid_plant_angle_row(l, law) * l->shape.n_columns];
    gsid_plant_enter_zone(l, law, law->zone != 0 ? 0 : angle > 0 ? 1 : -1);
}

/* Torques are continuous where friction breaks loose and at the edge of a zone: no jump of the sensitivities there. */
static void handle(gsid_plant_layout *l, uint32_t which) {
    if (which == RATE_GUARD) {
        pass_zero(l);
    } else if (which == HOLD_GUARD) {
        l->regime.side = gsid_plant_free_acceleration(l, l->z) > 0 ? GSID_R(1.0) : GSID_R(-1.0);
        l->regime.sticks = 0;
    } else if (which != NONE) {
        change_zone(l, &l->laws.law[which - ZONE_GUARD]);
    }
}

static void swap(gsid_real **a, gsid_real **b) {
    gsid_real *const c = *a;
    *a = *b;
    *b = c;
}

/* Take the step to l->motion.next, with the refreshes of the sensor that fall in it. */
static void accept(gsid_plant_layout *l, gsid_real length_s) {
    const gsid_real end_s = l->motion.at_s + length_s;
    for (; l->sensor.refresh_s > 0 &&
           l->sensor.to_refresh * l->motion.sample_s <= end_s + NEARLY * l->motion.sample_s && !is_spent(l);
         l->sensor.to_refresh += l->sensor.refresh_samples) {
        const gsid_real at_s = l->sensor.to_refresh * l->motion.sample_s - l->motion.at_s;
        const int is_at_end = at_s >= length_s - NEARLY * l->motion.sample_s;
        if (!is_at_end) {
            advance(l, NULL, at_s > 0 ? at_s : 0, l->motion.peek);
        }
        gsid_plant_refresh(l, is_at_end ? l->motion.next : l->motion.peek);
    }
    l->motion.at_s = end_s;
    swap(&l->z, &l->motion.next);
}

/* Whether the torques of the step to l->motion.next differ from those that the step was computed with. The parabola's last point
 * is a prediction, and three points far from a straight line may hide a jump (PLT-4). */
static int is_surprised(gsid_plant_layout *l) {
    gsid_real found[CHANNELS_MAX], off = 0, curved = 0;
    const gsid_real size = gsid_plant_torques_at_end(l, l->motion.next, found);
    for (size_t channel = 0, at = 0; channel < l->laws.n_channels; channel++, at += l->shape.n_columns) {
        const gsid_real t0 = l->laws.torque[0][at], t1 = l->laws.torque[1][at], t2 = l->laws.torque[2][at];
        off += gsid_fabs(found[channel] - t2);
        curved += gsid_fabs(t1 - (t0 + t2) / 2);
    }
    if (size > l->steep.largest_torque) {
        l->steep.largest_torque = size;
    }
    return off > SURPRISE * l->steep.largest_torque || curved > CURVED * l->steep.largest_torque;
}

/* Length of a step, at most left_s, over which the torques agree with those that the step is computed with. Values only, no
 * sensitivities. With a law that jumps they never agree, however short the step is. */
static gsid_real foreseeable(gsid_plant_layout *l, const plant_flow *maps, gsid_real left_s) {
    const uint32_t n_active = l->shape.n_active, n_free = l->shape.n_free;
    gsid_real length_s = l->steep.stride_s < left_s ? l->steep.stride_s : left_s;
    int n = 0;
    if (!l->laws.may_be_steep || l->steep.is_given_up) {
        return left_s;
    }
    l->shape.n_active = 1;
    l->shape.n_free = 0;
    for (; n <= HALVINGS_MAX && !is_spent(l); n++) {
        advance(l, length_s < left_s ? NULL : maps, length_s, l->motion.next);
        if (!is_surprised(l)) {
            break;
        }
        length_s /= 2;
    }
    l->shape.n_active = n_active;
    l->shape.n_free = n_free;
    l->steep.is_given_up |= n > HALVINGS_MAX || ++l->steep.n_parts > PARTS_MAX;
    l->steep.stride_s = 2 * length_s;
    return l->steep.is_given_up ? left_s : length_s;
}

static void run_step(gsid_plant_layout *l, const plant_flow *flow) {
    const plant_flow *maps = flow;
    gsid_real left_s = flow->length_s;
    l->steep.n_parts = 0;
    for (int n_events = 0; left_s > 0 && !is_spent(l);) {
        const gsid_real length_s = foreseeable(l, maps, left_s);
        maps = length_s < left_s ? NULL : maps;
        advance(l, maps, length_s, l->motion.next);
        guard end = look(l, l->motion.next);
        if (end.margin >= 0 || n_events == EVENTS_MAX) {
            accept(l, length_s);
            left_s -= length_s;
            if (end.margin < 0) {
                gsid_plant_choose_regime(l);
                gsid_plant_choose_zones(l);
            }
            continue;
        }
        const gsid_real at_s = locate(l, length_s, end.margin);
        advance(l, NULL, at_s, l->motion.next);
        end = look(l, l->motion.next);
        accept(l, at_s);
        handle(l, end.which);
        left_s -= at_s;
        maps = NULL;
        n_events++;
    }
}

void gsid_plant_run_piece(gsid_plant_layout *l, const plant_piece *piece) {
    for (uint32_t i = 0; i < piece->n_steps; i++) {
        run_step(l, &piece->step);
    }
    l->steep.is_given_up |= is_spent(l);
}
