/* The drive: rate controller, experiment, and their end of the serial line (docs/reference/protocol.md), without a line of what they
 * run on. The axis is at the other end of the line; the drive is what the protocol calls the host, and takes the sample
 * of a tick for the cue to the next one, so that drive and simulated axis go in lock-step.
 *
 * Three contexts: the receive interrupt, the tick, the background. The tick may interrupt the background, the receive
 * interrupt both. Nothing is masked: `state` says who may touch what, and each side hands it to the other. */
#ifndef DRIVE_H
#define DRIVE_H

#include "gsid/link.h"

#include "controller.h"
#include "experiment.h"

/* The line may be silent for 0.25 s, then the excitation is to be gone (docs/reference/protocol.md). The guard stands
 * EXPERIMENT_N_MISSING_MAX samples lost in a row: the next one trips it. Images for tests wait longer. */
#ifndef DRIVE_SILENCE_MS
#define DRIVE_SILENCE_MS 80
typedef char drive_is_silent_for_250_ms_at_most[(EXPERIMENT_N_MISSING_MAX + 1) * DRIVE_SILENCE_MS <= 250 ? 1 : -1];
#endif

/* By the timer, since in lock-step a slow partner stretches the ticks. */
enum {
    DRIVE_HELLO_EVERY = EXPERIMENT_FS_HZ, /* 1 s */
    DRIVE_SILENCE_MAX = DRIVE_SILENCE_MS * (EXPERIMENT_FS_HZ / 1000), /* without the sample that is due: it is lost */
    DRIVE_LOST_MAX = 16 /* samples of one run: the line is no good */
};

typedef enum {
    DRIVE_WAITING = 0, /* background's: command zero, says HELLO until an axis answers */
    DRIVE_RUNNING = 1, /* tick's: the loop is closed, the experiment runs */
    DRIVE_ENDED = 2, /* background's: command zero; the answer is to be worked out */
    DRIVE_REPORTING = 3 /* background's: command zero; the answer goes up */
} drive_state;

/* Why a run has ended. */
typedef enum {
    DRIVE_NEVER_RAN = 0,
    DRIVE_MEASURED = 1,
    DRIVE_TRIPPED = 2, /* the guard took the excitation away */
    DRIVE_LOSSES = 3, /* too many samples or periods lost */
    DRIVE_ASKED = 4, /* STOP came */
    DRIVE_RESTARTED = 5, /* the axis said HELLO: it has begun anew */
    DRIVE_REFUSED = 6 /* the experiment could not be started */
} drive_why;

/* Flags of a RESULT frame: what it carries. */
typedef enum {
    DRIVE_RESULT_STATE = 0, /* tick: at which the run ended; a: drive_why; b: good periods */
    DRIVE_RESULT_G = 1, /* tick: line number; a, b: response, real and imaginary part */
    DRIVE_RESULT_SIGMA = 2, /* tick: line number; a: frequency [Hz]; b: standard deviation of the response */
    DRIVE_RESULT_FIT = 3, /* tick: status of the fit, plus 128; a: delay [s]; b: cost */
    DRIVE_RESULT_NUM = 4, /* tick: power of s/scale; a: coefficient; b: scale [rad/s] */
    DRIVE_RESULT_DEN = 5, /* the same */
    DRIVE_RESULT_TRIP = 6 /* tick: gsid_trip of the last run; a: what passed its limit; b: angle [deg] */
} drive_result;

enum { DRIVE_FRAMES = 4 }; /* waiting for the tick: one is usual, a power of two */

typedef struct {
    volatile drive_state state;
    drive_why why; /* of the last run's end */
    uint32_t why_tick;
    /* From the receive interrupt to the tick. */
    gsid_link link; /* but for its session, which the background sets while WAITING */
    gsid_frame frame[DRIVE_FRAMES];
    volatile uint32_t n_come, n_taken; /* frames ever */
    volatile uint32_t n_damaged; /* frames ever */
    /* The tick's. */
    uint32_t tick; /* whose sample is due */
    uint32_t n_silent; /* timer's turns since the last command went */
    uint32_t damage_seen;
    uint32_t lost_count; /* the axis's count of lost commands */
    uint32_t n_lost;
    int begin; /* a run: its first command is due */
    float rate_deg_s; /* measured last */
    rate_controller controller;
    /* From the tick to the background. */
    volatile int axis_answered, hello_due;
    /* The background's. */
    gsid_status fit_status;
    uint32_t n_reported; /* frames of the report so far */
    experiment experiment;
} drive;

/* Background, once. */
gsid_status drive_init(drive *d);

/* Receive interrupt: take a byte. Returns 1 when the tick is due: a frame is there, or what came was damaged. */
int drive_receive(drive *d, uint8_t byte);

/* Tick. by_timer: 1 when the timer called it, 0 when drive_receive asked for it. */
void drive_tick(drive *d, int by_timer);

/* Background, for ever. Returns 0 when there is nothing to do before the next interrupt. */
int drive_background(drive *d);

/* ---- what the board provides ---- */

/* Send bytes, never waiting: all or, when there is no room, none. Called by the tick while RUNNING, by the background
 * otherwise. */
void line_send(const uint8_t *bytes, size_t n_bytes);

/* Bytes that line_send would take now. */
size_t line_room(void);

#endif
