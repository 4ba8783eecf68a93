#include "gsid/host/law_columns.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PERIODS_MAX = 100 }; /* that a memory is given to repeat */
#define REPEATS 1e-10       /* largest change of a memory from period to period */

/* Where the motion turns round: between sample `after` and the next one. */
typedef struct {
    uint32_t after;
    double side, angle; /* direction from here on, and where the axis is */
} reversal;

static gsid_plant_item item_of(const gsid_effect *effect, const void *data, const double *values) {
    gsid_plant_item item = {effect, {0}, data};
    memcpy(item.value, values, sizeof item.value);
    return item;
}

gsid_status gsid_law_side(uint32_t n, double step_s, const double *rate, const double *acceleration, double *side) {
    if (rate == NULL || acceleration == NULL || side == NULL) {
        return GSID_E_NULL;
    }
    if (n < 1 || !(step_s > 0)) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < n; i++) {
        const double half = 0.5 * fabs(acceleration[i]) * step_s;
        side[i] = rate[i] >= half ? (rate[i] > 0 ? 1 : 0) : rate[i] <= -half ? -1 : rate[i] / half;
    }
    return GSID_OK;
}

/* ---- laws without memory ---- */

static gsid_motion motion_at(const gsid_law_motion *along, uint32_t i, double edge) {
    gsid_motion now = {0};
    now.angle = along->angle[i];
    now.rate = along->rate[i];
    now.command = along->command != NULL ? along->command[i] : 0;
    now.side = along->side[i] < 0 ? -1 : 1;
    now.zone = now.angle > edge ? 1 : now.angle < -edge ? -1 : 0;
    now.unit_rad = along->unit_rad;
    return now;
}

static gsid_torque law_at(const gsid_plant_item *item, const gsid_motion *now) {
    gsid_torque answer;
    memset(&answer, 0, sizeof answer);
    item->effect->torque(item, now, &answer);
    return answer;
}

/* `slope` may be NULL. */
static void without_memory(const gsid_plant_item *item, const gsid_law_motion *along, uint32_t by, double *torque,
                           double *slope) {
    const gsid_effect *effect = item->effect;
    const double edge = effect->edge != NULL ? effect->edge(item) : 0;
    for (uint32_t i = 0; i < along->n; i++) {
        gsid_motion now = motion_at(along, i, edge);
        gsid_torque answer = law_at(item, &now);
        const double share = 0.5 * (1 - fabs(along->side[i])); /* of the other direction */
        if (effect->holding != NULL && share > 0) {
            now.side = -now.side;
            const gsid_torque other = law_at(item, &now);
            answer.torque += share * (other.torque - answer.torque);
            answer.by_value[by] += share * (other.by_value[by] - answer.by_value[by]);
        }
        torque[i] = answer.torque;
        if (slope != NULL) {
            slope[i] = answer.by_value[by];
        }
    }
}

/* ---- laws with memory ---- */

static double direction(double rate, double before) {
    return rate > 0 ? 1 : rate < 0 ? -1 : before;
}

/* The rate is straight between two samples. */
static uint32_t find_reversals(const gsid_law_motion *along, reversal *found) {
    const uint32_t n = along->n;
    uint32_t n_found = 0;
    double side = 0;
    for (uint32_t i = 0; i < n; i++) { /* direction before the first sample */
        side = direction(along->rate[i], side);
    }
    for (uint32_t i = 0; i < n; i++) {
        const double next = direction(along->rate[i], side);
        if (side != 0 && next != side) {
            const uint32_t before = (i + n - 1) % n;
            const double from = along->rate[before], to = along->rate[i];
            const double at = from != to ? from / (from - to) : 0;
            found[n_found++] = (reversal){before, next, along->angle[before] + 0.5 * at * along->step_s * from};
        }
        side = next;
    }
    return n_found;
}

static gsid_motion moved(const gsid_law_motion *along, const reversal *from, double memory, double angle) {
    gsid_motion now = {0};
    now.angle = angle;
    now.side = from->side;
    now.turned = angle - from->angle;
    now.memory = memory;
    now.unit_rad = along->unit_rad;
    return now;
}

/* Memory at each reversal of a period that repeats. */
static void find_memories(const gsid_plant_item *item, const gsid_law_motion *along, uint32_t n_reversals,
                          const reversal *at, double *memory) {
    memory[0] = 0;
    for (int period = 0; period < PERIODS_MAX; period++) {
        const double first = memory[0];
        for (uint32_t k = 0; k < n_reversals; k++) {
            const uint32_t next = (k + 1) % n_reversals;
            const gsid_motion now = moved(along, &at[k], memory[k], at[next].angle);
            memory[next] = law_at(item, &now).memory;
        }
        if (fabs(memory[0] - first) <= REPEATS) {
            break;
        }
    }
}

/* Without a reversal the axis stands still. */
static void with_memory(const gsid_plant_item *item, const gsid_law_motion *along, uint32_t n_reversals,
                        const reversal *at, double *memory, double *torque) {
    const reversal rest = {0, 1, along->angle[0]};
    memory[0] = 0;
    if (n_reversals > 0) {
        find_memories(item, along, n_reversals, at, memory);
    }
    uint32_t next = 0; /* reversal; before the first one of the period the last one holds */
    for (uint32_t i = 0; i < along->n; i++) {
        while (next < n_reversals && (at[next].after + 1) % along->n == i) {
            next++;
        }
        const uint32_t last = n_reversals > 0 ? (next + n_reversals - 1) % n_reversals : 0;
        gsid_motion now = moved(along, n_reversals > 0 ? &at[last] : &rest, memory[last], along->angle[i]);
        now.rate = along->rate[i];
        now.command = along->command != NULL ? along->command[i] : 0;
        torque[i] = law_at(item, &now).torque;
    }
}

static gsid_status remembered(const gsid_effect *effect, const void *data, const gsid_law_motion *motion,
                              uint32_t n_sets, const double *values, double *torque) {
    reversal *at = malloc(motion->n * sizeof *at);
    double *memory = malloc((motion->n + 1) * sizeof *memory);
    if (at == NULL || memory == NULL) {
        free(at);
        free(memory);
        return GSID_E_NO_MEMORY;
    }
    const uint32_t n_reversals = find_reversals(motion, at);
    for (uint32_t k = 0; k < n_sets; k++) {
        const gsid_plant_item item = item_of(effect, data, values + (size_t)k * GSID_EFFECT_PARAMETERS_MAX);
        with_memory(&item, motion, n_reversals, at, memory, torque + (size_t)k * motion->n);
    }
    free(at);
    free(memory);
    return GSID_OK;
}

/* ---- the calls ---- */

static gsid_status check(const gsid_effect *effect, const gsid_law_motion *motion, uint32_t n_sets,
                         const double *values, const double *torque) {
    if (effect == NULL || motion == NULL || values == NULL || torque == NULL || motion->angle == NULL ||
        motion->rate == NULL || motion->side == NULL) {
        return GSID_E_NULL;
    }
    if (motion->n < 2 || !(motion->step_s > 0) || n_sets < 1 || effect->torque == NULL || effect->n_states > 0) {
        return GSID_E_CONFIG;
    }
    return GSID_OK;
}

gsid_status gsid_law_torques(const gsid_effect *effect, const void *data, const gsid_law_motion *motion,
                             uint32_t n_sets, const double *values, double *torque) {
    const gsid_status status = check(effect, motion, n_sets, values, torque);
    if (status != GSID_OK) {
        return status;
    }
    if (effect->has_memory) {
        return remembered(effect, data, motion, n_sets, values, torque);
    }
    for (uint32_t k = 0; k < n_sets; k++) {
        const gsid_plant_item item = item_of(effect, data, values + (size_t)k * GSID_EFFECT_PARAMETERS_MAX);
        without_memory(&item, motion, 0, torque + (size_t)k * motion->n, NULL);
    }
    return GSID_OK;
}

gsid_status gsid_law_torques_and_slopes(const gsid_effect *effect, const void *data, const gsid_law_motion *motion,
                                        uint32_t n_sets, const double *values, uint32_t by, double *torque,
                                        double *slope) {
    const gsid_status status = check(effect, motion, n_sets, values, torque);
    if (status != GSID_OK) {
        return status;
    }
    if (slope == NULL) {
        return GSID_E_NULL;
    }
    if (effect->has_memory || by >= effect->n_parameters) {
        return GSID_E_CONFIG;
    }
    for (uint32_t k = 0; k < n_sets; k++) {
        const gsid_plant_item item = item_of(effect, data, values + (size_t)k * GSID_EFFECT_PARAMETERS_MAX);
        without_memory(&item, motion, by, torque + (size_t)k * motion->n, slope + (size_t)k * motion->n);
    }
    return GSID_OK;
}

gsid_status gsid_law_commands(const gsid_effect *effect, const void *data, uint32_t n, const double *u, uint32_t n_sets,
                              const double *values, double *mapped) {
    if (effect == NULL || u == NULL || values == NULL || mapped == NULL) {
        return GSID_E_NULL;
    }
    if (n < 1 || n_sets < 1 || effect->command == NULL) {
        return GSID_E_CONFIG;
    }
    for (uint32_t k = 0; k < n_sets; k++) {
        const gsid_plant_item item = item_of(effect, data, values + (size_t)k * GSID_EFFECT_PARAMETERS_MAX);
        for (uint32_t i = 0; i < n; i++) {
            gsid_real by_u, by_value[GSID_EFFECT_PARAMETERS_MAX];
            mapped[(size_t)k * n + i] = effect->command(&item, u[i], &by_u, by_value);
        }
    }
    return GSID_OK;
}
