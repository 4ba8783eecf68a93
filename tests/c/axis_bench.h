/* What the tests of the simulated axis share: the axis with all but what is tested switched off, and its signals. */
#ifndef AXIS_BENCH_H
#define AXIS_BENCH_H

#include "gsid/host/axis.h"
#include "reference.h"

#define PI 3.14159265358979323846
#define N_MAX 40000

static double u[N_MAX], y[N_MAX], angle[N_MAX], u_applied[N_MAX];

/* The axis of the source with everything off but what moves it: no noise, no fan, no command limit. */
static inline gsid_axis_cfg quiet(void) {
    gsid_axis_cfg cfg;
    assert_int_equal(gsid_axis_cfg_init(&cfg), GSID_OK);
    cfg.command_limit = cfg.noise_rms = cfg.noise_low_rms = cfg.fan_amplitude = 0.0;
    return cfg;
}

/* Rigid body only: what the gyro shows is the rate at this very instant. */
static inline gsid_axis_cfg rigid(void) {
    gsid_axis_cfg cfg = quiet();
    cfg.mode_f_hz = cfg.mode_residue = cfg.gyro_lag_s = cfg.delay_s = 0.0;
    return cfg;
}

static inline void run(const gsid_axis_cfg *cfg, uint32_t n) {
    gsid_axis *axis;
    assert_int_equal(gsid_axis_create(&axis, cfg), GSID_OK);
    assert_int_equal(gsid_axis_step(axis, n, u, u_applied, y, angle), GSID_OK);
    gsid_axis_destroy(axis);
}

static inline void step_of(double size, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) {
        u[i] = size;
    }
}

#endif
