/* The linear part of a plant: the matrix A with its derivatives, and the motion z(t) = exp(A t) z(0). */
#include <float.h>
#include <string.h>

#include "plant_linear.h"

#ifdef GSID_SINGLE
#define ROUNDING_UNIT FLT_EPSILON
#else
#define ROUNDING_UNIT DBL_EPSILON
#endif

/* Lags shorter than this part of a sample are taken as delays: the difference is of second order, 1.2e-4 of the response
 * at half the sample rate. It also bounds the rates that the series below have to follow. */
#define INSTANT GSID_R(5e-3)

/* With |A t| <= 1/2 the next term, 0.5^15 / 15!, is below the rounding of double. */
#define SERIES_TERMS 14
#define SERIES_REACH GSID_R(0.5)

uint32_t gsid_linear_state(gsid_linear *to) {
    return to->n++;
}

static void append(gsid_linear_entry *list, uint32_t *n, gsid_linear_entry entry) {
    if (list != NULL) {
        list[*n] = entry;
    }
    (*n)++;
}

void gsid_linear_add(gsid_linear *to, uint32_t row, uint32_t column, gsid_real value) {
    const gsid_linear_entry entry = {row, column, 0, value};
    append(to->entry, &to->n_entries, entry);
}

/* While entries are only counted, every parameter counts as free. */
static uint32_t column_of(const gsid_linear *to, uint32_t item, uint32_t parameter) {
    if (to->column == NULL) {
        return 1;
    }
    return to->column[(size_t)item * GSID_EFFECT_PARAMETERS_MAX + parameter];
}

void gsid_linear_slope(gsid_linear *to, uint32_t item, uint32_t parameter, uint32_t row, uint32_t column,
                       gsid_real slope) {
    const gsid_linear_entry entry = {row, column, column_of(to, item, parameter), slope};
    if (entry.by != 0) {
        append(to->slope, &to->n_slopes, entry);
    }
}

void gsid_linear_delay(gsid_linear *to, uint32_t parameter, gsid_real delay_s) {
    const gsid_linear_entry entry = {0, 0, column_of(to, to->item, parameter), GSID_R(1.0)};
    to->delay_s += delay_s;
    if (entry.by != 0) {
        append(to->delay, &to->n_delays, entry);
    }
}

static void add_stage(const gsid_plant_cfg *cfg, gsid_linear *to, gsid_stage stage, int backlash) {
    for (uint32_t i = 0; i < cfg->n_items; i++) {
        const gsid_effect *effect = cfg->item[i].effect;
        const int is_backlash = stage == GSID_STAGE_TORQUE && effect->n_states > 0;
        if (effect->stage != stage || effect->linear == NULL || is_backlash != backlash) {
            continue;
        }
        to->item = i;
        effect->linear(&cfg->item[i], to);
    }
}

/* Torques that are not linear drive the axis; those of backlash also react on the motor. Their entries of z follow the
 * states. */
static void add_channels(const gsid_plant_cfg *cfg, gsid_linear *to) {
    uint32_t n_laws = 0;
    for (uint32_t i = 0; i < cfg->n_items; i++) {
        n_laws += cfg->item[i].effect->torque != NULL;
    }
    if (n_laws == 0) {
        return;
    }
    gsid_linear_add(to, GSID_Z_RATE, to->n, -1);
    if (to->twist != 0) {
        gsid_linear_add(to, GSID_Z_RATE, to->n + FORCING, -1);
        gsid_linear_add(to, to->reaction, to->n + FORCING, 1);
    }
}

/* Backlash comes first: it decides which row the motor drives. Lags shorter than instant_s are delays. */
static void build(const gsid_plant_cfg *cfg, gsid_real instant_s, gsid_linear *to) {
    to->n = GSID_Z_RATE + 1;
    to->command = GSID_Z_COMMAND;
    to->drive = GSID_Z_RATE;
    to->twist = to->reaction = to->n_bodies = to->rigid_body = 0;
    to->gain = 0;
    to->delay_s = 0;
    to->instant_s = instant_s;
    to->output_angle = cfg->output_angle;
    to->n_entries = to->n_slopes = to->n_delays = 0;
    memset(to->signal, 0, sizeof to->signal);
    to->signal[cfg->output_angle ? GSID_Z_ANGLE : GSID_Z_RATE] = 1;
    gsid_linear_add(to, GSID_Z_ANGLE, GSID_Z_RATE, 1);
    if (cfg->first_order_hold) {
        to->command = gsid_linear_state(to);
        gsid_linear_add(to, to->command, GSID_Z_COMMAND, 1);
    }
    add_stage(cfg, to, GSID_STAGE_TORQUE, 1);
    add_stage(cfg, to, GSID_STAGE_ACTUATOR, 0);
    add_stage(cfg, to, GSID_STAGE_TORQUE, 0);
    add_stage(cfg, to, GSID_STAGE_STRUCTURE, 0);
    to->sensor = to->n;
    add_stage(cfg, to, GSID_STAGE_SENSOR, 0);
    add_channels(cfg, to);
}

void gsid_plant_linear_build(const gsid_plant_cfg *cfg, gsid_linear *to) {
    build(cfg, INSTANT / cfg->fs_hz, to);
}

void gsid_plant_linear_count(const gsid_plant_cfg *cfg, gsid_linear *to) {
    memset(to, 0, sizeof *to);
    build(cfg, INFINITY, to);
    const uint32_t n_delays = to->n_delays;
    build(cfg, GSID_R(-1.0), to);
    to->n_delays = n_delays;
}

/* States that follow from the command alone, each from those before it: a first-order hold, lags of the motor. */
static void mark_of_command(const gsid_linear *a, int is_of_command[GSID_Z_MAX]) {
    for (uint32_t i = 0; i < a->n; i++) {
        is_of_command[i] = i > GSID_Z_RATE && i < a->sensor;
        for (uint32_t k = 0; k < a->n_entries && is_of_command[i]; k++) {
            const gsid_linear_entry e = a->entry[k];
            const int is_known = e.column < GSID_Z_STATES || e.column == i || (e.column < i && is_of_command[e.column]);
            is_of_command[i] = e.row != i || is_known;
        }
    }
}

gsid_real gsid_plant_fastest(const gsid_linear *a) {
    gsid_real spring = 1, drive = 1, largest = 0, scale[GSID_Z_MAX], sum[GSID_Z_MAX] = {0};
    int is_of_command[GSID_Z_MAX] = {0};
    mark_of_command(a, is_of_command);
    for (uint32_t k = 0; k < a->n_entries; k++) {
        const gsid_linear_entry e = a->entry[k];
        const int is_spring = e.column == GSID_Z_ANGLE || (e.column == a->twist && a->twist != 0);
        if (is_spring && gsid_fabs(e.value) > spring) {
            spring = gsid_fabs(e.value);
        }
        if (e.column < a->n && is_of_command[e.column] && !is_of_command[e.row] && gsid_fabs(e.value) > drive) {
            drive = gsid_fabs(e.value);
        }
    }
    for (uint32_t i = 0; i < a->n; i++) {
        const int is_angle = i == GSID_Z_ANGLE || (i == a->twist && i != 0);
        scale[i] = is_angle ? gsid_sqrt(spring) : is_of_command[i] ? drive : GSID_R(1.0);
    }
    for (uint32_t k = 0; k < a->n_entries; k++) {
        const gsid_linear_entry e = a->entry[k];
        if (e.column >= GSID_Z_STATES && e.column < a->n) {
            sum[e.row] += gsid_fabs(e.value) * scale[e.row] / scale[e.column];
        }
    }
    for (uint32_t i = 0; i < a->n; i++) {
        largest = sum[i] > largest ? sum[i] : largest;
    }
    return largest;
}

/* ---- maps over a fixed length ---- */

typedef struct {
    const gsid_plant_layout *l;
    int regime;
    gsid_real scale;   /* of A */
    gsid_real forcing; /* time scale of the forcing parabola: its length is that of the whole step */
} generator;

/* to += factor from G, G = scale A with the forcing's shift, columns as in z. */
static void add_times(const generator *g, gsid_real factor, const gsid_real *from, gsid_real *to) {
    const gsid_plant_layout *l = g->l;
    const uint32_t w = l->shape.width;
    for (uint32_t k = 0; k < l->linear.a.n_entries; k++) {
        const gsid_linear_entry e = l->linear.a.entry[k];
        if (!gsid_plant_acts(&l->linear.a, g->regime, e)) {
            continue;
        }
        const gsid_real value = factor * g->scale * e.value;
        for (uint32_t i = 0; i < w; i++) {
            to[i * w + e.column] += value * from[i * w + e.row];
        }
    }
    for (uint32_t at = l->linear.a.n; at < w; at += FORCING) {
        for (uint32_t i = 0; i < w; i++) {
            to[i * w + at + 1] += factor * g->forcing * from[i * w + at];
            to[i * w + at + 2] += 2 * factor * g->forcing * from[i * w + at + 1];
        }
    }
}

/* to += factor from dG, by the parameter of a column. */
static void add_times_slope(const generator *g, uint32_t by, gsid_real factor, const gsid_real *from, gsid_real *to) {
    const gsid_plant_layout *l = g->l;
    const uint32_t w = l->shape.width;
    for (uint32_t k = 0; k < l->linear.a.n_slopes; k++) {
        const gsid_linear_entry e = l->linear.a.slope[k];
        if (e.by != by || !gsid_plant_acts(&l->linear.a, g->regime, e)) {
            continue;
        }
        const gsid_real value = factor * g->scale * e.value;
        for (uint32_t i = 0; i < w; i++) {
            to[i * w + e.column] += value * from[i * w + e.row];
        }
    }
}

/* to += a b */
static void add_product(uint32_t w, const gsid_real *a, const gsid_real *b, gsid_real *to) {
    for (uint32_t i = 0; i < w; i++) {
        for (uint32_t k = 0; k < w; k++) {
            const gsid_real aik = a[i * w + k];
            if (aik == 0) {
                continue;
            }
            for (uint32_t j = 0; j < w; j++) {
                to[i * w + j] += aik * b[k * w + j];
            }
        }
    }
}

/* exp(G) = sum G^k / k!, and its derivatives: T <- T G / k, dT <- (dT G + T dG) / k. */
static void sum_series(const generator *g, gsid_real *map) {
    const gsid_plant_layout *l = g->l;
    const size_t w = l->shape.width, n = w * w, n_maps = 1 + (size_t)l->linear.n_slope_columns;
    gsid_real *term = l->linear.square, *next = l->linear.square + n_maps * n;
    memset(map, 0, n_maps * n * sizeof *map);
    memset(term, 0, n_maps * n * sizeof *term);
    for (size_t i = 0; i < w; i++) {
        map[i * w + i] = term[i * w + i] = 1;
    }
    for (int k = 1; k <= SERIES_TERMS; k++) {
        const gsid_real factor = 1 / (gsid_real)k;
        memset(next, 0, n_maps * n * sizeof *next);
        add_times(g, factor, term, next);
        for (size_t p = 0; p + 1 < n_maps; p++) {
            add_times(g, factor, term + (p + 1) * n, next + (p + 1) * n);
            add_times_slope(g, l->linear.slope_column[p], factor, term, next + (p + 1) * n);
        }
        for (size_t i = 0; i < n_maps * n; i++) {
            map[i] += next[i];
        }
        gsid_real *spare = term;
        term = next;
        next = spare;
    }
}

/* exp(2 G) = exp(G)^2 */
static void square(const gsid_plant_layout *l, gsid_real *map) {
    const size_t w = l->shape.width, n = w * w, n_maps = 1 + (size_t)l->linear.n_slope_columns;
    gsid_real *to = l->linear.square;
    memset(to, 0, n_maps * n * sizeof *to);
    add_product(l->shape.width, map, map, to);
    for (size_t p = 1; p < n_maps; p++) {
        add_product(l->shape.width, map, map + p * n, to + p * n);
        add_product(l->shape.width, map + p * n, map, to + p * n);
    }
    memcpy(map, to, n_maps * n * sizeof *to);
}

static void build_map(const gsid_plant_layout *l, gsid_real length_s, int regime, gsid_real *map) {
    uint32_t n_doublings = 0;
    gsid_real part = 1;
    for (; l->linear.fastest * length_s * part > SERIES_REACH; part *= GSID_R(0.5)) {
        n_doublings++;
    }
    const generator g = {l, regime, length_s * part, part};
    sum_series(&g, map);
    for (uint32_t k = 0; k < n_doublings; k++) {
        square(l, map);
    }
}

void gsid_plant_flow_build(gsid_plant_layout *l, plant_flow *flow) {
    for (int regime = 0; regime < REGIMES; regime++) {
        for (int part = WHOLE; part <= HALF; part++) {
            if (flow->map[regime][part] != NULL) {
                build_map(l, part == WHOLE ? flow->length_s : flow->length_s / 2, regime, flow->map[regime][part]);
            }
        }
    }
}

static gsid_real dot(size_t n, const gsid_real *row, const gsid_real *z, size_t n_columns) {
    gsid_real sum = 0;
    for (size_t k = 0; k < n; k++) {
        sum += row[k] * z[k * n_columns];
    }
    return sum;
}

void gsid_plant_flow_move(const gsid_plant_layout *l, const gsid_real *map, uint32_t n_rows, const gsid_real *z,
                          gsid_real *to) {
    const size_t w = l->shape.width, n_columns = l->shape.n_columns;
    const uint32_t n_active = l->shape.n_active;
    if (n_active == 1) {
        for (uint32_t i = 0; i < n_rows; i++) {
            to[l->shape.row[i] * n_columns] = dot(w, map + l->shape.row[i] * w, z, n_columns);
        }
        return;
    }
    for (uint32_t i = 0; i < n_rows; i++) {
        const gsid_real *m = map + l->shape.row[i] * w;
        gsid_real *out = to + l->shape.row[i] * n_columns;
        memset(out, 0, n_active * sizeof *out);
        for (size_t k = 0; k < w; k++) {
            const gsid_real mk = m[k], *from = z + k * n_columns;
            if (mk == 0) {
                continue;
            }
            for (uint32_t c = 0; c < n_active; c++) {
                out[c] += mk * from[c];
            }
        }
        if (l->shape.n_free == 0) {
            continue;
        }
        for (uint32_t p = 0; p < l->linear.n_slope_columns; p++) {
            out[l->linear.slope_column[p]] += dot(w, m + (p + 1) * w * w, z, n_columns);
        }
    }
}

/* ---- motion over any length ---- */

/* next = G term / k in all active columns. */
static void next_term(const generator *g, gsid_real factor, const gsid_real *term, gsid_real *next) {
    const gsid_plant_layout *l = g->l;
    const size_t n_columns = l->shape.n_columns;
    for (uint32_t i = 0; i < l->shape.width; i++) {
        memset(next + i * n_columns, 0, l->shape.n_active * sizeof *next);
    }
    for (uint32_t k = 0; k < l->linear.a.n_entries; k++) {
        const gsid_linear_entry e = l->linear.a.entry[k];
        if (!gsid_plant_acts(&l->linear.a, g->regime, e)) {
            continue;
        }
        const gsid_real value = factor * g->scale * e.value, *from = term + e.column * n_columns;
        gsid_real *to = next + e.row * n_columns;
        for (uint32_t c = 0; c < l->shape.n_active; c++) {
            to[c] += value * from[c];
        }
    }
    for (uint32_t k = 0; l->shape.n_free > 0 && k < l->linear.a.n_slopes; k++) {
        const gsid_linear_entry e = l->linear.a.slope[k];
        if (gsid_plant_acts(&l->linear.a, g->regime, e)) {
            next[e.row * n_columns + e.by] += factor * g->scale * e.value * term[e.column * n_columns];
        }
    }
    for (uint32_t at = l->linear.a.n; at < l->shape.width; at += FORCING) {
        gsid_real *to = next + at * n_columns;
        const gsid_real *from = term + at * n_columns;
        for (uint32_t c = 0; c < l->shape.n_active; c++) {
            to[c] = factor * g->forcing * from[n_columns + c];
            to[n_columns + c] = 2 * factor * g->forcing * from[2 * n_columns + c];
        }
    }
}

/* Terms until the next is below rounding; three more for what the forcing's parabola adds at the start of the chain. */
static int terms_for(gsid_real reach) {
    int n = 1;
    for (gsid_real term = reach; term > ROUNDING_UNIT / 4 && n < SERIES_TERMS - 3; term *= reach / (gsid_real)n) {
        n++;
    }
    return n + 3;
}

static void copy_rows(const gsid_plant_layout *l, const gsid_real *from, gsid_real *to) {
    for (uint32_t i = 0; i < l->shape.width; i++) {
        memcpy(to + (size_t)i * l->shape.n_columns, from + (size_t)i * l->shape.n_columns,
               l->shape.n_active * sizeof *to);
    }
}

uint32_t gsid_plant_series_parts(const gsid_plant_layout *l, gsid_real length_s) {
    return 1 + (uint32_t)(l->linear.fastest * length_s / SERIES_REACH);
}

void gsid_plant_series_move(const gsid_plant_layout *l, gsid_real length_s, uint32_t n_rows, const gsid_real *z,
                            gsid_real *to) {
    const size_t n_columns = l->shape.n_columns;
    const uint32_t n_parts = gsid_plant_series_parts(l, length_s);
    const generator g = {l, gsid_plant_regime(l), length_s / (gsid_real)n_parts, 1 / (gsid_real)n_parts};
    const int n_terms = terms_for(l->linear.fastest * g.scale);
    gsid_real *sum = l->linear.term[0], *term = l->linear.term[1], *next = l->linear.term[2];
    copy_rows(l, z, sum);
    for (uint32_t part = 0; part < n_parts; part++) {
        copy_rows(l, sum, term);
        for (int k = 1; k <= n_terms; k++) {
            next_term(&g, 1 / (gsid_real)k, term, next);
            for (uint32_t i = 0; i < l->shape.width; i++) {
                for (uint32_t c = 0; c < l->shape.n_active; c++) {
                    sum[i * n_columns + c] += next[i * n_columns + c];
                }
            }
            gsid_real *spare = term;
            term = next;
            next = spare;
        }
    }
    for (uint32_t i = 0; i < n_rows; i++) {
        memcpy(to + l->shape.row[i] * n_columns, sum + l->shape.row[i] * n_columns, l->shape.n_active * sizeof *sum);
    }
}
