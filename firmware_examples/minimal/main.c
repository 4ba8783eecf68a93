/* The minimum that measures a frequency response in an existing loop: the code between the lines of dashes. The rest of this
 * file is an axis to measure, and the output of the response. */
#include <stdio.h>

/* ---- copy from here ---- */
#include "gsid/excitation.h"
#include "gsid/frf.h"

enum { N_PERIOD = 600, N_LINES = 50, N_SETTLE = 2 * N_PERIOD, N_GOOD = 8 }; /* at 3 kHz: 5 to 250 Hz in 2.0 s */

static gsid_cplx twiddle[N_PERIOD], input[N_LINES];
static uint32_t line[N_LINES], n_lines;
static gsid_real amplitude[N_LINES], phase_rad[N_LINES], excitation[N_PERIOD];
static gsid_cplx memory[GSID_FRF_MEM_SIZE(N_LINES, 0) / sizeof(gsid_cplx) + 1];
static gsid_frf frf;
static uint32_t n; /* sample of the excitation */

/* Background, at the start and to start again: a multisine of 1 unit per line, and the measurement of the response. */
static gsid_status measure_init(void) {
    gsid_multisine multisine;
    const gsid_multisine_cfg sines = {N_PERIOD, N_LINES, line, amplitude, phase_rad, twiddle};
    const gsid_frf_cfg cfg = {N_PERIOD, N_LINES, N_SETTLE, line, twiddle, input};
    gsid_status status = gsid_twiddle_fill(N_PERIOD, twiddle);
    n = 0;
    status = status ? status : gsid_lines_fill(GSID_GRID_FULL, 1, N_LINES, N_LINES, line, &n_lines);
    status = status ? status : gsid_amplitude_shape(N_LINES, line, 0, amplitude);
    status = status ? status : gsid_phase_schroeder(N_LINES, amplitude, phase_rad);
    status = status ? status : gsid_multisine_init(&multisine, &sines);
    status = status ? status : gsid_multisine_table(&multisine, excitation);
    status = status ? status : gsid_multisine_spectrum(&multisine, input);
    return status ? status : gsid_frf_init(&frf, &cfg, memory, sizeof memory);
}

/* Every tick, where the sensor is read. Returns the excitation to add to the command. */
static gsid_real measure_tick(gsid_real y) {
    if (gsid_frf_step(&frf, 0, y) == GSID_E_NONFINITE) {
        gsid_frf_skip(&frf, 1); /* a refused sample counts as lost: its period is left out */
    }
    const gsid_real u = excitation[n];
    n = n + 1 < N_PERIOD ? n + 1
                         : 0; /* do not use a count of ticks modulo N: the phase would jump when the count wraps */
    return u;
}
/* ---- to here ---- */

/* A lag of about 20 ms from command to rate; y is read at the instant from which u is applied. */
static gsid_real axis_rate;
static void axis_apply(gsid_real u) {
    axis_rate += GSID_R(0.0166666667) * (u - axis_rate);
}

int main(void) {
    if (measure_init() != GSID_OK) {
        return 1;
    }
    while (frf.n_periods < N_GOOD) {
        axis_apply(measure_tick(axis_rate));
    }

    static gsid_cplx g[N_LINES];
    const gsid_frf_out out = {.g = g};
    if (gsid_frf_result(&frf, &out) != GSID_OK) {
        return 1;
    }
    puts("f_hz,g_re,g_im");
    for (uint32_t i = 0; i < N_LINES; i++) {
        printf("%g,%.6g,%.6g\n", (double)line[i] * 3000 / N_PERIOD, (double)g[i].re, (double)g[i].im);
    }
    return 0;
}
