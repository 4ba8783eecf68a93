/* Time of one tick of the streaming response with the spread engine [ns], the input known and measured; called by bench_frf.py.
 * 500 lines of 6000 samples, at full work in every tick; nothing but the core is in the loop. */
#include <math.h>
#include <stdio.h>
#include <time.h>

#include "gsid/gsid.h"

enum { N_PERIOD = 6000, N_LINES = 500, N_PERIODS = 100, N_TURNS = 9 };

static gsid_cplx twiddle[N_PERIOD], u_known[N_LINES];
static uint32_t line[N_LINES];
static gsid_real u[N_PERIOD], y[N_PERIOD];
static uint64_t memory[GSID_FRF_SPREAD_MEM_SIZE(N_PERIOD, N_LINES, 1) / sizeof(uint64_t) + 1];

static int set_up(gsid_frf *frf, int measured) {
    const gsid_frf_cfg cfg = {.n_period = N_PERIOD,
                              .n_lines = N_LINES,
                              .line = line,
                              .twiddle = twiddle,
                              .u_known = measured ? NULL : u_known};
    return gsid_frf_init_spread(frf, &cfg, memory, sizeof memory) == GSID_OK;
}

static void run(gsid_frf *frf, uint32_t n_periods) {
    for (uint32_t p = 0; p < n_periods; p++) {
        for (uint32_t n = 0; n < N_PERIOD; n++) {
            gsid_frf_step(frf, u[n], y[n]);
        }
    }
}

/* The least of several runs, each after periods that fill the pipeline; negative when it did not measure. */
static double nanoseconds(int measured) {
    double least = HUGE_VAL;
    for (int turn = 0; turn < N_TURNS; turn++) {
        gsid_frf frf;
        if (!set_up(&frf, measured)) {
            return -1;
        }
        run(&frf, 2);
        const clock_t start = clock();
        run(&frf, N_PERIODS);
        least = fmin(least, (double)(clock() - start) / CLOCKS_PER_SEC);
        if (frf.n_periods < N_PERIODS) {
            return -1;
        }
    }
    return 1e9 * least / ((double)N_PERIODS * N_PERIOD);
}

int main(void) {
    gsid_twiddle_fill(N_PERIOD, twiddle);
    for (uint32_t i = 0; i < N_LINES; i++) {
        line[i] = i + 1;
        u_known[i].re = 1;
    }
    for (uint32_t n = 0; n < N_PERIOD; n++) {
        u[n] = (gsid_real)sin(0.7 * n * n);
        y[n] = (gsid_real)sin(0.3 * n * n);
    }
    const double known = nanoseconds(0), measured = nanoseconds(1);
    printf("{\"known\": %.2f, \"measured\": %.2f}\n", known, measured);
    return known > 0 && measured > 0 ? 0 : 1;
}
