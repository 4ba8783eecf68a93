/* A plant's configuration, its memory, and the values it works with. */
#include <string.h>

#include "gsid/lsq.h"

#include "block.h"
#include "plant_layout.h"
#include "plant_linear.h"

/* A step of the Runge-Kutta method is at most this many radians of the stiffest law. The derivative by the delay at a hard stop
 * requires such short steps. Backlash is linear between events: its steps only have to be short enough to detect a short
 * contact. */
#define STEP_RAD GSID_R(0.025)
#define GEAR_STEP_RAD GSID_R(0.5)
#define STEPS_MAX 256
/* Limit of the rates of the linear part times the sample time. It bounds the doublings and parts of the exponentials. */
#define RATE_SAMPLES_MAX GSID_R(4000.0)
#define UNIT_DEGREE GSID_R(0.0174532925199432958)

/* ---- configuration ---- */

static gsid_status check_item(const gsid_plant_item *item) {
    if (item->effect == NULL) {
        return GSID_E_NULL;
    }
    if (item->effect->n_parameters > GSID_EFFECT_PARAMETERS_MAX || item->effect->n_states > GSID_Z_MAX) {
        return GSID_E_CONFIG;
    }
    for (uint32_t k = 0; k < item->effect->n_parameters; k++) {
        const gsid_effect_parameter *p = &item->effect->parameter[k];
        const gsid_real value = item->value[k];
        if (!gsid_is_finite(value)) {
            return GSID_E_NONFINITE;
        }
        if (value != p->null_value && !(value >= p->lower && value <= p->upper)) {
            return GSID_E_CONFIG;
        }
    }
    return GSID_OK;
}

static gsid_status check_free(const gsid_plant_cfg *cfg) {
    for (uint32_t i = 0; i < cfg->n_free; i++) {
        const gsid_plant_free f = cfg->free_parameter[i];
        if (f.item >= cfg->n_items || f.parameter >= cfg->item[f.item].effect->n_parameters) {
            return GSID_E_CONFIG;
        }
        for (uint32_t j = 0; j < i; j++) {
            if (cfg->free_parameter[j].item == f.item && cfg->free_parameter[j].parameter == f.parameter) {
                return GSID_E_CONFIG;
            }
        }
    }
    return GSID_OK;
}

static int is_backlash(const gsid_effect *effect) {
    return effect->stage == GSID_STAGE_TORQUE && effect->n_states > 0;
}

/* What a configuration needs. */
typedef struct {
    gsid_linear linear; /* counted only */
    uint32_t n_laws, n_memories, n_backlash, n_controllers, n_samplers, n_states;
    int holds, looks_at_angle, looks_at_command, is_constant, may_be_steep,
        maps_command; /* maps_command: has a static map of the command, or a controller */
} needs;

static void count(const gsid_plant_cfg *cfg, needs *n) {
    memset(n, 0, sizeof *n);
    n->is_constant = 1;
    n->n_states = cfg->first_order_hold ? 1 : 0;
    for (uint32_t i = 0; i < cfg->n_items; i++) {
        const gsid_effect *effect = cfg->item[i].effect;
        n->n_laws += effect->torque != NULL;
        n->n_memories += effect->has_memory != 0;
        n->n_backlash += is_backlash(effect) ? 1u : 0u;
        n->n_controllers += effect->control != NULL;
        n->n_samplers += effect->refresh_hz != NULL;
        n->n_states += effect->n_states;
        n->holds |= effect->holding != NULL;
        n->is_constant &= effect->torque == NULL || effect->is_constant;
        n->may_be_steep |= effect->may_be_steep;
        n->looks_at_command |= effect->looks_at_command;
        n->looks_at_angle |= effect->looks_at_angle || effect->control != NULL;
        n->maps_command |= effect->command != NULL || effect->control != NULL;
    }
}

static gsid_status check(const gsid_plant_cfg *cfg, needs *n) {
    if (cfg == NULL || cfg->item == NULL || (cfg->n_free > 0 && cfg->free_parameter == NULL)) {
        return GSID_E_NULL;
    }
    if (!gsid_is_finite(cfg->fs_hz) || !gsid_is_finite(cfg->unit_rad)) {
        return GSID_E_NONFINITE;
    }
    if (!(cfg->fs_hz > 0) || cfg->n_items == 0 || cfg->n_items > UINT16_MAX || cfg->n_free > UINT16_MAX) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < cfg->n_items; i++) {
        const gsid_status status = check_item(&cfg->item[i]);
        if (status != GSID_OK) {
            return status;
        }
    }
    count(cfg, n);
    if (n->n_backlash > 1 || n->n_controllers > 1 || n->n_samplers > 1 ||
        (n->n_controllers > 0 && cfg->first_order_hold) || GSID_Z_RATE + 1 + n->n_states > GSID_Z_MAX) {
        return GSID_E_CONFIG;
    }
    const gsid_status status = check_free(cfg);
    return status == GSID_OK ? gsid_check_build() : status;
}

/* ---- layout ---- */

static gsid_real *take_reals(gsid_block *b, size_t n) {
    return gsid_block_of(gsid_real, b, n, 1);
}

/* [n_rows][n_columns] */
static gsid_real *take_table(gsid_block *b, size_t n_rows, size_t n_columns) {
    return gsid_block_of(gsid_real, b, n_rows, n_columns);
}

static void lay_out_maps(const gsid_plant_cfg *cfg, const needs *n, gsid_plant_layout *l, gsid_block *b) {
    const size_t n_maps = 1 + (size_t)cfg->n_free, n_square = (size_t)l->shape.width * l->shape.width;
    for (int piece = 0; piece < 2; piece++) {
        for (int regime = 0; regime < REGIMES; regime++) {
            if (((regime & HELD) && !n->holds) || ((regime & LOOSE) && n->n_backlash == 0)) {
                continue;
            }
            for (int part = WHOLE; part <= (n->n_laws > 0 ? HALF : WHOLE); part++) {
                l->motion.piece[piece].step.map[regime][part] = take_table(b, n_maps, n_square);
            }
        }
    }
    l->linear.square = take_table(b, n_maps, 2 * n_square);
}

static void take_lists(const needs *n, gsid_linear *linear, gsid_block *b) {
    linear->entry = gsid_block_of(gsid_linear_entry, b, n->linear.n_entries, 1);
    linear->slope = gsid_block_of(gsid_linear_entry, b, n->linear.n_slopes, 1);
    linear->delay = gsid_block_of(gsid_linear_entry, b, n->linear.n_delays, 1);
}

static void take_blocks(const gsid_plant_cfg *cfg, const needs *n, gsid_plant_layout *l, gsid_block *b) {
    l->laws.n_channels = n->n_laws > 0 ? 1 + n->n_backlash : 0;
    l->shape.width = n->linear.n + FORCING * l->laws.n_channels;
    l->laws.n = n->n_laws;
    l->laws.n_memories = n->n_memories;
    l->shape.n_rows = l->shape.width + n->n_memories;
    l->shooting.n_max = n->linear.n - GSID_Z_STATES + n->n_memories;
    l->shape.n_columns = 1 + cfg->n_free + l->shooting.n_max;
    l->command.ring_columns = n->maps_command ? l->shape.n_columns : 1;

    const size_t n_columns = l->shape.n_columns, n_rows = l->shape.n_rows, n_shoot = l->shooting.n_max;
    take_lists(n, &l->linear.a, b);
    take_lists(n, &l->linear.draft, b);
    l->stack.item = gsid_block_of(gsid_plant_item, b, cfg->n_items, 1);
    l->laws.law = gsid_block_of(plant_law, b, n->n_laws, 1);
    l->stack.column = gsid_block_of(uint32_t, b, cfg->n_items, GSID_EFFECT_PARAMETERS_MAX);
    l->linear.slope_column = gsid_block_of(uint32_t, b, cfg->n_free, 1);
    l->shape.row = gsid_block_of(uint32_t, b, n->linear.n, 1);
    l->shooting.row = gsid_block_of(uint32_t, b, n_shoot, 1);
    lay_out_maps(cfg, n, l, b);
    l->z = take_table(b, n_rows, n_columns);
    l->motion.next = take_table(b, n_rows, n_columns);
    l->motion.stage = take_table(b, n_rows, n_columns);
    l->motion.peek = take_table(b, n->n_samplers > 0 ? n_rows : 0, n_columns);
    for (int i = 0; i < 3; i++) {
        l->linear.term[i] = take_table(b, n_rows, n_columns);
        l->laws.torque[i] = take_table(b, CHANNELS_MAX, n_columns);
    }
    l->command.u = take_reals(b, n_columns);
    l->sensor.y = take_reals(b, n_columns);
    l->sensor.held = take_reals(b, n_columns);
    l->command.under_way = take_table(b, GSID_PLANT_DELAY_MAX + 1, l->command.ring_columns);
    l->controller.angle = take_table(b, n->n_controllers > 0 ? GSID_RATE_SAMPLES_MAX + 1 : 0, n_columns);
    l->controller.rate = take_reals(b, n_columns);
    l->shooting.start = take_table(b, n_shoot, n_columns);
    l->shooting.fallback = take_table(b, n_shoot, n_columns);
    l->shooting.largest_dy = take_reals(b, n_columns);
    l->shooting.correction = take_reals(b, n_shoot);
    l->shooting.lsq_mem = take_table(b, n_shoot + 1, n_shoot + 2); /* GSID_LSQ_MEM_SIZE */
}

/* Check, count and lay out; the size is in b->used. */
static gsid_status plan(const gsid_plant_cfg *cfg, needs *n, gsid_plant_layout *l, gsid_block *b) {
    gsid_status status = check(cfg, n);
    if (status != GSID_OK) {
        return status;
    }
    gsid_plant_linear_count(cfg, &n->linear);
    if (n->linear.n_bodies != 1) {
        return GSID_E_CONFIG;
    }
    gsid_block_take(b, 1, 1, sizeof *l);
    take_blocks(cfg, n, l, b);
    return b->used < b->most ? GSID_OK : GSID_E_CONFIG;
}

size_t gsid_plant_size_within(const gsid_plant_cfg *cfg, size_t most) {
    needs n;
    gsid_plant_layout l;
    gsid_block b = {NULL, 0, most};
    memset(&l, 0, sizeof l);
    return plan(cfg, &n, &l, &b) == GSID_OK ? b.used : 0;
}

static void list_items(const gsid_plant_cfg *cfg, gsid_plant_layout *l) {
    for (uint32_t p = 0; p < cfg->n_free; p++) {
        const gsid_plant_free f = cfg->free_parameter[p];
        l->stack.column[(size_t)f.item * GSID_EFFECT_PARAMETERS_MAX + f.parameter] = FIRST_FREE + p;
    }
    uint32_t n_laws = 0, n_memories = 0;
    for (uint32_t i = 0; i < cfg->n_items; i++) {
        const gsid_plant_item *item = &l->stack.item[i];
        const uint32_t *column = l->stack.column + (size_t)i * GSID_EFFECT_PARAMETERS_MAX;
        if (item->effect->torque != NULL) {
            const uint32_t channel = is_backlash(item->effect) ? BACKLASH : AXIS;
            const uint32_t memory = item->effect->has_memory ? l->shape.n_rows - 1 - n_memories++ : NONE;
            l->laws.law[n_laws++] = (plant_law){item, column, channel, memory, 0};
        }
        if (item->effect->refresh_hz != NULL) {
            l->sensor.sampler = item;
            l->sensor.column = column;
        }
    }
}

static void set_kind(const gsid_plant_cfg *cfg, const needs *n, gsid_plant_layout *l) {
    l->command.ramp = cfg->first_order_hold ? GSID_Z_RATE + 1 : 0;
    l->stack.has_controller = n->n_controllers > 0;
    l->stack.looks_at_angle = n->looks_at_angle;
    l->stack.turns = cfg->output_angle && !n->looks_at_angle;
    l->stack.looks_at_command = n->looks_at_command;
    l->laws.can_hold = n->holds;
    l->laws.have_side = n->holds || n->n_memories > 0;
    l->laws.are_constant = n->is_constant;
    l->laws.may_be_steep = n->may_be_steep;
    l->laws.unit_rad = cfg->unit_rad > 0 ? cfg->unit_rad : UNIT_DEGREE;
}

gsid_status gsid_plant_lay_out(const gsid_plant_cfg *cfg, void *mem, size_t mem_size, gsid_plant_layout **layout) {
    if (mem == NULL) {
        return GSID_E_NULL;
    }
    needs n;
    gsid_plant_layout draft;
    gsid_block b = {(unsigned char *)mem, 0, SIZE_MAX};
    memset(&draft, 0, sizeof draft);
    const gsid_status status = plan(cfg, &n, &draft, &b);
    if (status != GSID_OK) {
        return status;
    }
    if (mem_size < b.used || !gsid_is_aligned(mem)) {
        return GSID_E_MEMORY;
    }
    memset(mem, 0, b.used);
    gsid_plant_layout *l = (gsid_plant_layout *)mem;
    *l = draft;
    set_kind(cfg, &n, l);
    l->linear.a.column = l->linear.draft.column = l->stack.column;
    memcpy(l->stack.item, cfg->item, cfg->n_items * sizeof *l->stack.item);
    list_items(cfg, l);
    *layout = l;
    return GSID_OK;
}

/* ---- values ---- */

/* Square of the angular frequency of the gear's spring between motor and load: twist times acceleration by twist. */
static gsid_real gear_frequency_squared(const gsid_linear *a) {
    gsid_real sum = 0;
    for (uint32_t i = 0; i < a->n_entries; i++) {
        for (uint32_t k = 0; a->entry[i].row == a->twist && k < a->n_entries; k++) {
            if (a->entry[k].row == a->entry[i].column && a->entry[k].column == a->twist) {
                sum -= a->entry[i].value * a->entry[k].value;
            }
        }
    }
    return sum > 0 ? sum : 0;
}

/* Square of the steps per second that a law needs with the values of its item, from the steepest slope of its torque. */
static gsid_real steps_squared(const gsid_plant_layout *l, const gsid_linear *linear, const plant_law *law,
                               const gsid_plant_item *item) {
    gsid_real steepest = 0;
    if (law->channel == BACKLASH) {
        return gear_frequency_squared(linear) / (GEAR_STEP_RAD * GEAR_STEP_RAD);
    }
    for (int zone = -1; zone <= 1 && !item->effect->may_be_steep; zone++) {
        const gsid_motion motion = {.side = 1, .zone = zone, .unit_rad = l->laws.unit_rad};
        gsid_torque t;
        memset(&t, 0, sizeof t);
        item->effect->torque(item, &motion, &t);
        const gsid_real slope = gsid_fabs(t.by_angle) + gsid_fabs(t.by_turned);
        steepest = slope > steepest ? slope : steepest;
    }
    return steepest / (STEP_RAD * STEP_RAD);
}

/* Steps that a length is cut into, and the delay's whole samples and fraction. */
typedef struct {
    uint32_t delay_samples, n_steps[2];
    gsid_real length_s[2], fastest;
} timing;

static gsid_status plan_timing(const gsid_plant_cfg *cfg, const gsid_plant_layout *l, const gsid_linear *linear,
                               timing *t) {
    const gsid_real samples = linear->delay_s * cfg->fs_hz;
    if (!(samples < GSID_PLANT_DELAY_MAX)) {
        return GSID_E_CONFIG;
    }
    t->fastest = gsid_plant_fastest(linear);
    if (!(t->fastest <= RATE_SAMPLES_MAX * cfg->fs_hz)) {
        return GSID_E_CONFIG;
    }
    gsid_real sum = 0;
    for (uint32_t i = 0; i < l->laws.n; i++) {
        sum += steps_squared(l, linear, &l->laws.law[i], &cfg->item[l->laws.law[i].item - l->stack.item]);
    }
    const gsid_real steps_per_s = gsid_sqrt(sum);
    if (!(steps_per_s <= STEPS_MAX * cfg->fs_hz)) {
        return GSID_E_CONFIG;
    }
    t->delay_samples = (uint32_t)samples;
    t->length_s[0] = (samples - (gsid_real)t->delay_samples) / cfg->fs_hz;
    t->length_s[1] = 1 / cfg->fs_hz - t->length_s[0];
    for (int i = 0; i < 2; i++) {
        t->n_steps[i] = t->length_s[i] > 0 ? 1 + (uint32_t)(t->length_s[i] * steps_per_s) : 0;
    }
    return GSID_OK;
}

/* The rows of the states; first those that laws depend on. */
static void order_rows(gsid_plant_layout *l) {
    const gsid_linear *a = &l->linear.a;
    uint32_t n = 0;
    l->shape.row[n++] = GSID_Z_ANGLE;
    l->shape.row[n++] = GSID_Z_RATE;
    if (a->twist != 0) {
        l->shape.row[n++] = a->twist;
    }
    const uint32_t command = l->stack.looks_at_command && a->command > GSID_Z_RATE ? a->command : 0;
    if (command != 0) {
        l->shape.row[n++] = command;
    }
    l->shape.n_look = n;
    for (uint32_t row = GSID_Z_RATE + 1; row < a->n; row++) {
        if (row != a->twist && row != command) {
            l->shape.row[n++] = row;
        }
    }
}

/* The states that a period's start is searched in: the angle only where something depends on it, and never the command. */
static void order_shooting(gsid_plant_layout *l) {
    l->shooting.n = 0;
    for (uint32_t row = GSID_Z_STATES; row < l->linear.a.n; row++) {
        const int is_known =
            row == GSID_Z_ANGLE ? !l->stack.looks_at_angle : l->command.ramp != 0 && row == l->command.ramp;
        if (!is_known) {
            l->shooting.row[l->shooting.n++] = row;
        }
    }
    for (uint32_t row = l->shape.n_rows - l->laws.n_memories; row < l->shape.n_rows; row++) {
        l->shooting.row[l->shooting.n++] = row;
    }
}

static void list_slope_columns(gsid_plant_layout *l, uint32_t n_free) {
    l->linear.n_slope_columns = 0;
    for (uint32_t by = FIRST_FREE; by < FIRST_FREE + n_free; by++) {
        uint32_t k = 0;
        while (k < l->linear.a.n_slopes && l->linear.a.slope[k].by != by) {
            k++;
        }
        if (k < l->linear.a.n_slopes) {
            l->linear.slope_column[l->linear.n_slope_columns++] = by;
        }
    }
}

/* Put the draft into effect. */
static void adopt(gsid_plant_layout *l, const timing *t, uint32_t n_free) {
    const gsid_linear built = l->linear.draft;
    l->linear.draft = l->linear.a;
    l->linear.a = built;
    l->linear.fastest = t->fastest;
    l->command.delay_samples = t->delay_samples;
    l->shape.width = l->linear.a.n + FORCING * l->laws.n_channels;
    order_rows(l);
    order_shooting(l);
    list_slope_columns(l, n_free);
    for (int i = 0; i < 2; i++) {
        l->motion.piece[i].n_steps = t->n_steps[i];
        if (t->n_steps[i] == 0) {
            continue;
        }
        l->motion.piece[i].step.length_s = t->length_s[i] / (gsid_real)t->n_steps[i];
        gsid_plant_flow_build(l, &l->motion.piece[i].step);
    }
}

/* Whether the memory was laid out for these effects. */
static int is_same_stack(const gsid_plant_cfg *cfg, const gsid_plant_layout *l) {
    uint32_t i = 0;
    while (i < cfg->n_items && cfg->item[i].effect == l->stack.item[i].effect) {
        i++;
    }
    return i == cfg->n_items;
}

static void set_refresh(const gsid_plant_cfg *cfg, gsid_plant_layout *l) {
    const gsid_real rate_hz = l->sensor.sampler != NULL ? l->sensor.sampler->effect->refresh_hz(l->sensor.sampler) : 0;
    l->motion.sample_s = 1 / cfg->fs_hz;
    l->sensor.refresh_s = rate_hz > 0 ? 1 / rate_hz : 0;
    l->sensor.refresh_samples = l->sensor.refresh_s * cfg->fs_hz;
}

gsid_status gsid_plant_take_values(const gsid_plant_cfg *cfg, gsid_plant_layout *l, int *has_same_states) {
    needs n;
    timing t;
    gsid_status status = check(cfg, &n);
    if (status != GSID_OK) {
        return status;
    }
    if (!is_same_stack(cfg, l)) {
        return GSID_E_CONFIG;
    }
    gsid_plant_linear_build(cfg, &l->linear.draft);
    status = plan_timing(cfg, l, &l->linear.draft, &t);
    if (status != GSID_OK) {
        return status;
    }
    *has_same_states = l->linear.draft.n == l->linear.a.n;
    memcpy(l->stack.item, cfg->item, cfg->n_items * sizeof *l->stack.item);
    set_refresh(cfg, l);
    adopt(l, &t, cfg->n_free);
    return GSID_OK;
}
