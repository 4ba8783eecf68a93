/* An experiment in parallel with a rate controller: 500 lines over 10 periods, then a model with three poles, two zeros and a
 * delay.
 *
 * The loop calls experiment_measure and experiment_excite; all other functions belong to the background. All memory is in the
 * struct. A tick never waits for the background. Shared data belong to one side at a time: `state` shows to which. */
#ifndef EXPERIMENT_H
#define EXPERIMENT_H

#include "gsid/estimate.h"
#include "gsid/excitation.h"
#include "gsid/frf.h"
#include "gsid/guard.h"

#ifdef EXPERIMENT_SHORT /* for tests of faults on the line */
enum { EXPERIMENT_N_PERIOD = 600, EXPERIMENT_N_LINES = 50, EXPERIMENT_N_GOOD = 4, EXPERIMENT_N_RAMP = 60 };
#else
enum { EXPERIMENT_N_PERIOD = 6000, EXPERIMENT_N_LINES = 500, EXPERIMENT_N_GOOD = 10, EXPERIMENT_N_RAMP = 600 };
#endif

enum {
    EXPERIMENT_FS_HZ = 3000, /* the lines end at 250 Hz */
    EXPERIMENT_N_SETTLE = EXPERIMENT_N_PERIOD,
    EXPERIMENT_N_MISSING_MAX = 2, /* samples in a row */
    EXPERIMENT_N_SPOILED_MAX = 4, /* lost periods after which the experiment is aborted */
    EXPERIMENT_N_POLES = 3,
    EXPERIMENT_N_ZEROS = 2
};

typedef enum {
    EXPERIMENT_IDLE = 0,
    EXPERIMENT_RUNNING = 1,
    EXPERIMENT_MEASURED = 2, /* the background may fit */
    EXPERIMENT_STOPPED = 3 /* aborted: the guard tripped, or too many periods were lost */
} experiment_state;

typedef struct {
    volatile experiment_state
        state; /* written by one side at a time: the tick while RUNNING, the background otherwise */
    uint32_t n; /* sample of the excitation */
    uint32_t n_left_out; /* further samples to discard while the axis settles */
    gsid_guard guard;
    gsid_frf frf;
    gsid_cplx twiddle[EXPERIMENT_N_PERIOD];
    gsid_real excitation[EXPERIMENT_N_PERIOD];
    uint32_t line[EXPERIMENT_N_LINES];
    gsid_cplx memory[GSID_FRF_SPREAD_MEM_SIZE(EXPERIMENT_N_PERIOD, EXPERIMENT_N_LINES, 1) / sizeof(gsid_cplx) + 1];
    /* The result, from the background. */
    gsid_real f_hz[EXPERIMENT_N_LINES], sigma[EXPERIMENT_N_LINES];
    gsid_cplx g[EXPERIMENT_N_LINES];
    gsid_real work[GSID_ESTIMATE_MEM_SIZE(EXPERIMENT_N_POLES, EXPERIMENT_N_ZEROS) / sizeof(gsid_real)];
    gsid_rational model;
    gsid_real cost; /* sum of squared errors over sigma */
} experiment;

/* Background, once: fill the tables.
 *  peak    of the excitation, unit of the command
 *  limits  of the guard; the rest of its configuration is the experiment's */
gsid_status experiment_init(experiment *e, gsid_real peak, const gsid_guard_cfg *limits);

/* Background, while not RUNNING: start a new experiment. */
gsid_status experiment_start(experiment *e);

/* Tick: returns the excitation to add to the controller's command. It is 0 unless RUNNING, and from the tick in which the guard
 * trips.
 *  sample  measured in this tick; NULL: no sample arrived */
gsid_real experiment_excite(experiment *e, const gsid_guard_sample *sample, gsid_real command);

/* Tick: take the command in force and the output sampled at the same instant. */
void experiment_measure(experiment *e, gsid_real u, gsid_real y);

/* Tick: a sample was lost. Its period is left out. */
void experiment_skip(experiment *e);

/* Tick: the axis was disturbed. This sample and those of the settling time are left out. */
void experiment_settle(experiment *e);

/* Background, when MEASURED: response, its standard deviation, and the model. */
gsid_status experiment_fit(experiment *e);

#endif
