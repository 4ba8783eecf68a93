/* What the tests of plants share: a stack in static memory, and a command with many lines. */
#ifndef PLANT_BENCH_H
#define PLANT_BENCH_H

#include <string.h>

#include "gsid/catalogue.h"
#include "gsid/plant.h"
#include "reference.h"

#define PI 3.14159265358979323846
#define FS 3000.0
#define ITEMS_MAX 12
#define FREE_MAX 24

typedef struct {
    gsid_plant plant;
    gsid_plant_cfg cfg;
    gsid_plant_item item[ITEMS_MAX];
    gsid_plant_free free_parameter[FREE_MAX];
    union {
        gsid_cplx align;
        unsigned char bytes[1 << 20];
    } memory;
} bench;

static inline void bench_clear(bench *b) {
    memset(&b->cfg, 0, sizeof b->cfg);
    b->cfg.fs_hz = (gsid_real)FS;
    b->cfg.item = b->item;
    b->cfg.free_parameter = b->free_parameter;
}

/* Add an effect with its typical values.  @return its item */
static inline gsid_plant_item *bench_add(bench *b, const char *id) {
    gsid_plant_item *item = &b->item[b->cfg.n_items++];
    memset(item, 0, sizeof *item);
    item->effect = gsid_catalogue_find(id);
    assert_non_null(item->effect);
    for (uint32_t k = 0; k < item->effect->n_parameters; k++) {
        item->value[k] = item->effect->parameter[k].typical;
    }
    return item;
}

static inline gsid_plant_item *bench_add_with(bench *b, const char *id, double v0, double v1, double v2) {
    gsid_plant_item *item = bench_add(b, id);
    item->value[0] = (gsid_real)v0;
    item->value[1] = (gsid_real)v1;
    item->value[2] = (gsid_real)v2;
    return item;
}

/* Every parameter of every item is free. */
static inline void bench_free_all(bench *b) {
    b->cfg.n_free = 0;
    for (uint32_t i = 0; i < b->cfg.n_items; i++) {
        for (uint32_t k = 0; k < b->item[i].effect->n_parameters; k++) {
            b->free_parameter[b->cfg.n_free++] = (gsid_plant_free){i, k};
        }
    }
}

static inline void bench_init(bench *b) {
    assert_in_range(gsid_plant_mem_size(&b->cfg), 1, sizeof b->memory);
    assert_int_equal(gsid_plant_init(&b->plant, &b->cfg, b->memory.bytes, sizeof b->memory), GSID_OK);
}

static inline gsid_real bench_step(bench *b, gsid_real command) {
    gsid_real out;
    assert_int_equal(gsid_plant_step(&b->plant, command, &out, NULL), GSID_OK);
    return out;
}

/* Step n_periods from rest, and compare the sensitivities of the last one with the periodic ones, dy [n_free][n_period]. A step of
 * sample n gets u[n + lead]. */
static inline void bench_compare_stepped(bench *b, int n_period, const gsid_real *u, int lead, int n_periods,
                                         const gsid_real *dy, double tolerance) {
    gsid_real now[FREE_MAX], out;
    double largest[FREE_MAX] = {0}, worst[FREE_MAX] = {0};
    assert_int_equal(gsid_plant_reset(&b->plant), GSID_OK);
    for (int n = 0; n < n_periods * n_period; n++) {
        assert_int_equal(gsid_plant_step(&b->plant, u[(n + lead) % n_period], &out, now), GSID_OK);
        for (uint32_t p = 0; n >= (n_periods - 1) * n_period && p < b->cfg.n_free; p++) {
            const double periodic = (double)dy[p * (uint32_t)n_period + (uint32_t)(n % n_period)];
            largest[p] = fmax(largest[p], fabs(periodic));
            worst[p] = fmax(worst[p], fabs((double)now[p] - periodic));
        }
    }
    for (uint32_t p = 0; p < b->cfg.n_free; p++) {
        if (!(worst[p] <= tolerance * largest[p])) {
            fail_msg("free parameter %u: off by %.3g of %.3g", p, worst[p] / largest[p], largest[p]);
        }
    }
}

/* The axis of the source: gain, friction, spring, delay, mode and gyro. */
static inline void bench_add_source(bench *b) {
    bench_add_with(b, "transport_delay", 5.4e-3, 0, 0);
    bench_add_with(b, "rigid_body", 7.4, 0, 0);
    bench_add_with(b, "viscous_friction", 11.0, 0, 0);
    bench_add_with(b, "cable_spring", 170.0, 0, 0);
    bench_add_with(b, "flexible_mode", 179.0, 0.015, 0.15);
    bench_add_with(b, "sensor_lag", 1e-3, 0, 0);
}

/* One period of n samples: odd lines with phases of no pattern, their amplitude falling as 1/line. */
static inline double bench_command(uint32_t n_period, uint32_t n, double size) {
    double sum = 0.0;
    for (uint32_t line = 1; line < 40 && line < n_period / 2; line += 2) {
        sum += cos(2.0 * PI * (double)(line * n % n_period) / n_period + 1.7 * line * line) / line;
    }
    return size * sum;
}

/* A command with many lines, of this size. */
static inline void bench_fill(gsid_real *u, uint32_t n_period, double size) {
    for (uint32_t n = 0; n < n_period; n++) {
        u[n] = (gsid_real)bench_command(n_period, n, size);
    }
}

#endif
