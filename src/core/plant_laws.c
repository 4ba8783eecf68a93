/* Torques that are not linear. Side (the direction of motion) and zones are fixed between events, so that every law is
 * smooth there. */
#include <string.h>

#include "plant_laws.h"
#include "plant_linear.h"

/* ---- torques ---- */

/* Row of the command at z: one that is held stays as it was at the step's start. */
static const gsid_real *command_row(const gsid_plant_layout *l, const gsid_real *z) {
    const uint32_t row = l->linear.a.command;
    return (row < GSID_Z_STATES ? l->z : z) + (size_t)row * l->shape.n_columns;
}

/* One law at z, in a step that began at z0. */
static gsid_torque torque_at(const gsid_plant_layout *l, const plant_law *law, const gsid_real *z,
                             const gsid_real *z0) {
    const size_t n = l->shape.n_columns;
    const gsid_motion motion = {
        .angle = z[gsid_plant_angle_row(l, law) * n],
        .rate = z[GSID_Z_RATE * n],
        .command = l->stack.looks_at_command ? command_row(l, z)[VALUE] : 0,
        .side = l->regime.side,
        .zone = law->zone,
        .turned = z[GSID_Z_ANGLE * n] - z0[GSID_Z_ANGLE * n],
        .memory = law->memory == NONE ? 0 : z0[law->memory * n],
        .unit_rad = l->laws.unit_rad,
    };
    gsid_torque answer;
    memset(&answer, 0, sizeof answer);
    law->item->effect->torque(law->item, &motion, &answer);
    return answer;
}

static void add_torque(const gsid_plant_layout *l, const plant_law *law, uint32_t n_active, const gsid_real *z,
                       const gsid_real *z0, gsid_real *to) {
    const size_t n = l->shape.n_columns;
    const gsid_torque t = torque_at(l, law, z, z0);
    const gsid_real *angle = z + gsid_plant_angle_row(l, law) * n, *rate = z + GSID_Z_RATE * n;
    to[VALUE] += t.torque;
    if (n_active == 1) {
        return;
    }
    for (uint32_t c = 1; c < n_active; c++) {
        to[c] += t.by_angle * angle[c] + t.by_rate * rate[c];
    }
    if (law->item->effect->looks_at_command) {
        const gsid_real *command = command_row(l, z);
        for (uint32_t c = 1; c < n_active; c++) {
            to[c] += t.by_command * command[c];
        }
    }
    if (law->memory != NONE) {
        const gsid_real *end = z + GSID_Z_ANGLE * n, *begin = z0 + GSID_Z_ANGLE * n, *memory = z0 + law->memory * n;
        for (uint32_t c = 1; c < n_active; c++) {
            to[c] += t.by_turned * (end[c] - begin[c]) + t.by_memory * memory[c];
        }
    }
    for (uint32_t k = 0; l->shape.n_free > 0 && k < law->item->effect->n_parameters; k++) {
        if (law->column[k] != 0) {
            to[law->column[k]] += t.by_value[k];
        }
    }
}

void gsid_plant_sum_torques(const gsid_plant_layout *l, int but_holding, uint32_t n_active, const gsid_real *z,
                            const gsid_real *z0, gsid_real *to) {
    for (uint32_t channel = 0; channel < l->laws.n_channels; channel++) {
        memset(to + channel * l->shape.n_columns, 0, n_active * sizeof *to);
    }
    for (uint32_t i = 0; i < l->laws.n; i++) {
        const plant_law *law = &l->laws.law[i];
        if (!(but_holding && law->item->effect->holding != NULL)) {
            add_torque(l, law, n_active, z, z0, to + law->channel * l->shape.n_columns);
        }
    }
}

gsid_real gsid_plant_torques_at_end(const gsid_plant_layout *l, const gsid_real *z, gsid_real *by_channel) {
    gsid_real size = 0;
    for (uint32_t channel = 0; channel < CHANNELS_MAX; channel++) {
        by_channel[channel] = 0;
    }
    for (uint32_t i = 0; i < l->laws.n; i++) {
        const plant_law *law = &l->laws.law[i];
        if (l->regime.sticks && law->item->effect->holding != NULL) {
            continue;
        }
        const gsid_real torque = torque_at(l, law, z, l->z).torque;
        by_channel[law->channel] += torque;
        size += gsid_fabs(torque);
    }
    return size;
}

void gsid_plant_move_memories(const gsid_plant_layout *l, gsid_real *z) {
    const size_t n = l->shape.n_columns;
    for (uint32_t i = 0; i < l->laws.n; i++) {
        const plant_law *law = &l->laws.law[i];
        if (law->memory == NONE) {
            continue;
        }
        const gsid_torque t = torque_at(l, law, z, l->z);
        const gsid_real *end = z + GSID_Z_ANGLE * n, *begin = l->z + GSID_Z_ANGLE * n, *old = l->z + law->memory * n;
        gsid_real *memory = z + law->memory * n;
        memory[VALUE] = t.memory;
        for (uint32_t c = 1; c < l->shape.n_active; c++) {
            memory[c] = t.memory_by_turned * (end[c] - begin[c]) + t.memory_by_memory * old[c];
        }
        for (uint32_t k = 0; l->shape.n_free > 0 && k < law->item->effect->n_parameters; k++) {
            if (law->column[k] != 0) {
                memory[law->column[k]] += t.memory_by_value[k];
            }
        }
    }
}

gsid_real gsid_plant_largest_hold(const gsid_plant_layout *l) {
    gsid_real sum = 0;
    for (uint32_t i = 0; i < l->laws.n; i++) {
        if (l->laws.law[i].item->effect->holding != NULL) {
            sum += l->laws.law[i].item->effect->holding(l->laws.law[i].item);
        }
    }
    return sum;
}

/* Row of A z at an instant, with these torques. */
static gsid_real row_rate(const gsid_plant_layout *l, uint32_t row, const gsid_real *z, const gsid_real *torque) {
    const gsid_linear *a = &l->linear.a;
    gsid_real sum = 0;
    for (uint32_t k = 0; k < a->n_entries; k++) {
        if (a->entry[k].row == row && a->entry[k].column < a->n &&
            gsid_plant_acts(a, l->regime.is_loose ? LOOSE : 0, a->entry[k])) {
            sum += a->entry[k].value * z[a->entry[k].column * l->shape.n_columns];
        }
    }
    for (uint32_t channel = 0; channel < l->laws.n_channels; channel++) {
        if (row == GSID_Z_RATE) {
            sum -= torque[channel * l->shape.n_columns];
        } else if (channel == BACKLASH && row == a->reaction) {
            sum += torque[channel * l->shape.n_columns];
        }
    }
    return sum;
}

void gsid_plant_derivative(const gsid_plant_layout *l, const gsid_real *z, gsid_real *rates) {
    gsid_plant_sum_torques(l, l->regime.sticks, 1, z, z, l->laws.torque[0]);
    for (uint32_t row = 0; row < l->linear.a.n; row++) {
        rates[row] = row < GSID_Z_STATES ? 0 : row_rate(l, row, z, l->laws.torque[0]);
    }
    if (l->regime.sticks) {
        rates[GSID_Z_RATE] = 0;
    }
}

gsid_real gsid_plant_free_acceleration(const gsid_plant_layout *l, const gsid_real *z) {
    gsid_plant_sum_torques(l, 1, 1, z, z, l->laws.torque[0]);
    return row_rate(l, GSID_Z_RATE, z, l->laws.torque[0]);
}

/* ---- regimes ---- */

void gsid_plant_choose_regime(gsid_plant_layout *l) {
    const gsid_real rate = l->z[GSID_Z_RATE * l->shape.n_columns];
    if (!l->laws.have_side) {
        return;
    }
    if (rate != 0) {
        l->regime.sticks = 0;
        l->regime.side = rate > 0 ? GSID_R(1.0) : GSID_R(-1.0);
        return;
    }
    const gsid_real towards = gsid_plant_free_acceleration(l, l->z);
    l->regime.sticks = l->laws.can_hold && gsid_fabs(towards) <= gsid_plant_largest_hold(l);
    if (!l->regime.sticks && towards != 0) {
        l->regime.side = towards > 0 ? GSID_R(1.0) : GSID_R(-1.0);
    }
}

static int zone_of(gsid_real angle, gsid_real edge) {
    return angle > edge ? 1 : angle < -edge ? -1 : 0;
}

void gsid_plant_enter_zone(gsid_plant_layout *l, plant_law *law, int zone) {
    law->zone = zone;
    if (law->channel == BACKLASH) {
        l->regime.is_loose = zone == 0;
    }
}

void gsid_plant_choose_zones(gsid_plant_layout *l) {
    for (uint32_t i = 0; i < l->laws.n; i++) {
        plant_law *law = &l->laws.law[i];
        if (law->item->effect->edge != NULL) {
            gsid_plant_enter_zone(
                l, law,
                zone_of(l->z[gsid_plant_angle_row(l, law) * l->shape.n_columns], law->item->effect->edge(law->item)));
        }
    }
}
