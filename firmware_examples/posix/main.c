/* The rate controller of rate_loop with an experiment, as a plain program: the experiment needs two calls in the loop. The axis
 * is simulated by gsid itself (plant.h), so that the true parameters are known. Prints the response and the model. */
#include <stdio.h>

#include "gsid/catalogue.h"
#include "gsid/plant.h"

#include "../rate_loop/controller.h"
#include "../rate_loop/experiment.h"

#define COMMAND_LIMIT 10.0f
#define EXCITATION_PEAK 5.0f
#define NOISE_DEG_S 0.01f

static experiment beside;
static gsid_plant axis;
static gsid_cplx axis_memory[4096];

static gsid_status axis_init(void) {
    static gsid_plant_item stack[] = {{.value = {GSID_R(7.4)}},
                                      {.value = {GSID_R(10.0)}},
                                      {.value = {GSID_R(0.0051)}},
                                      {.value = {GSID_R(60.0), GSID_R(0.03), GSID_R(0.3)}}};
    static const char *const id[] = {"rigid_body", "viscous_friction", "transport_delay", "flexible_mode"};
    for (uint32_t i = 0; i < sizeof stack / sizeof stack[0]; i++) {
        stack[i].effect = gsid_catalogue_find(id[i]);
    }
    const gsid_plant_cfg cfg = {.fs_hz = EXPERIMENT_FS_HZ, .n_items = sizeof stack / sizeof stack[0], .item = stack};
    return gsid_plant_init(&axis, &cfg, axis_memory, sizeof axis_memory);
}

/* Noise of the sensor, approximately normal: the sum of twelve uniform numbers. */
static float noise(void) {
    static uint32_t seed = 1;
    float sum = -6.0f;
    for (int i = 0; i < 12; i++) {
        seed = 1664525u * seed + 1013904223u;
        sum += (float)(seed >> 8) / 16777216.0f;
    }
    return NOISE_DEG_S * sum;
}

static float clipped(float u) {
    return u > COMMAND_LIMIT ? COMMAND_LIMIT : u < -COMMAND_LIMIT ? -COMMAND_LIMIT : u;
}

static void print_result(void) {
    const gsid_rational *m = &beside.model;
    printf("# scale_rad_s: %.9g\n# delay_s: %.9g\n# cost: %.9g\n# num:", (double)m->scale_rad_s, (double)m->delay_s,
           (double)beside.cost);
    for (uint32_t i = 0; i <= m->n_zeros; i++) {
        printf(" %.9g", (double)m->num[i]);
    }
    printf("\n# den:");
    for (uint32_t i = 0; i <= m->n_poles; i++) {
        printf(" %.9g", (double)m->den[i]);
    }
    printf("\nf_hz,g_re,g_im,std_g\n");
    for (uint32_t i = 0; i < EXPERIMENT_N_LINES; i++) {
        printf("%.9g,%.9g,%.9g,%.9g\n", (double)beside.f_hz[i], (double)beside.g[i].re, (double)beside.g[i].im,
               (double)beside.sigma[i]);
    }
}

int main(void) {
    const gsid_guard_cfg limits = {.command_limit = COMMAND_LIMIT,
                                   .rate_limit = 20,
                                   .angle_lo = -2,
                                   .angle_hi = 2,
                                   .reaction_s = GSID_R(0.0054),
                                   .acceleration_per_command = GSID_R(7.4),
                                   .deceleration = 20};
    rate_controller controller = {.kp = 3.0f, .ki = 0.005f, .limit = COMMAND_LIMIT};
    if (axis_init() != GSID_OK || experiment_init(&beside, EXCITATION_PEAK, &limits) != GSID_OK ||
        experiment_start(&beside) != GSID_OK) {
        return 1;
    }
    gsid_real u = 0;
    while (beside.state == EXPERIMENT_RUNNING) { /* one pass is one tick */
        gsid_real y;
        if (gsid_plant_step(&axis, u, &y, NULL) != GSID_OK) { /* the rate at the instant from which u is applied */
            return 1;
        }
        y += noise();
        experiment_measure(&beside, u, y);
        const gsid_guard_sample sample = {.rate = y};
        const float command = rate_controller_step(&controller, 0.0f, (float)y);
        u = clipped(command + (float)experiment_excite(&beside, &sample, command));
    }
    if (beside.state == EXPERIMENT_STOPPED) {
        fprintf(stderr, "stopped: %s\n", gsid_trip_str(beside.guard.reason));
        return 1;
    }
    const gsid_status status = experiment_fit(&beside);
    if (status < 0) {
        fprintf(stderr, "fit: %s\n", gsid_status_str(status));
        return 1;
    }
    print_result();
    return 0;
}
