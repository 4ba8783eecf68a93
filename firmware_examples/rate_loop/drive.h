/* The drive: rate controller, experiment, and the host's end of the serial line (docs/reference/protocol.md). This code does not
 * depend on the board. The axis is at the other end of the line. Each sample starts the next tick, so that drive and simulated
 * axis run in lock-step.
 *
 * There are three contexts: the receive interrupt, the tick, the background. The tick may interrupt the background, the receive
 * interrupt may interrupt both. No interrupt is masked: `state` shows which context owns the shared data, and its owner hands
 * them over by writing `state`. */
#ifndef DRIVE_H
#define DRIVE_H

#include "gsid/link.h"

#include "controller.h"
#include "experiment.h"

/* After 0.25 s of silence on the line the excitation must be zero (docs/reference/protocol.md). The guard tolerates
 * EXPERIMENT_N_MISSING_MAX samples lost in a row: the next one trips it. Images for tests wait longer. */
#ifndef DRIVE_SILENCE_MS
#define DRIVE_SILENCE_MS 80
typedef char drive_is_silent_for_250_ms_at_most[(EXPERIMENT_N_MISSING_MAX + 1) * DRIVE_SILENCE_MS <= 250 ? 1 : -1];
#endif

/* Times in periods of the timer, not in ticks: in lock-step a slow axis makes the ticks longer. */
enum {
    DRIVE_HELLO_EVERY = EXPERIMENT_FS_HZ, /* 1 s */
    DRIVE_SILENCE_MAX = DRIVE_SILENCE_MS *
        (EXPERIMENT_FS_HZ / 1000), /* without the expected sample: it counts as lost */
    DRIVE_LOST_MAX = 16 /* lost samples in one run, after which it ends */
};

typedef enum {
    DRIVE_WAITING = 0, /* owned by the background: command zero, sends HELLO until an axis replies */
    DRIVE_RUNNING = 1, /* owned by the tick: the loop is closed, the experiment runs */
    DRIVE_ENDED = 2, /* owned by the background: command zero, the model is to be fitted */
    DRIVE_REPORTING = 3 /* owned by the background: command zero, the report is being sent */
} drive_state;

/* Why a run ended. */
typedef enum {
    DRIVE_NEVER_RAN = 0,
    DRIVE_MEASURED = 1,
    DRIVE_TRIPPED = 2, /* the guard removed the excitation */
    DRIVE_LOSSES = 3, /* too many samples or periods lost */
    DRIVE_STOP_RECEIVED = 4, /* the axis sent STOP */
    DRIVE_RESTARTED = 5, /* the axis sent HELLO: it has restarted */
    DRIVE_REFUSED = 6 /* the experiment could not be started */
} drive_why;

/* Flags of a RESULT frame: its contents. */
typedef enum {
    DRIVE_RESULT_STATE = 0, /* tick: at which the run ended; a: drive_why; b: good periods */
    DRIVE_RESULT_G = 1, /* tick: line number; a, b: response, real and imaginary part */
    DRIVE_RESULT_SIGMA = 2, /* tick: line number; a: frequency [Hz]; b: standard deviation of the response */
    DRIVE_RESULT_FIT = 3, /* tick: status of the fit, plus 128; a: delay [s]; b: cost */
    DRIVE_RESULT_NUM = 4, /* tick: power of s/scale; a: coefficient; b: scale [rad/s] */
    DRIVE_RESULT_DEN = 5, /* the same */
    DRIVE_RESULT_TRIP = 6 /* tick: gsid_trip of the last run; a: value that exceeded its limit; b: angle [deg] */
} drive_result;

enum { DRIVE_FRAMES = 4 }; /* queue of frames for the tick, a power of two; usually one is waiting */

typedef struct {
    volatile drive_state state;
    drive_why why; /* of the end of the last run */
    uint32_t why_tick;
    /* From the receive interrupt to the tick. */
    gsid_link link; /* except its session, which the background sets while WAITING */
    gsid_frame frame[DRIVE_FRAMES];
    volatile uint32_t n_come, n_taken; /* frames received and processed since the start */
    volatile uint32_t n_damaged; /* damaged frames since the start */
    /* Owned by the tick. */
    uint32_t tick; /* number of the tick whose sample is expected */
    uint32_t n_silent; /* periods of the timer since the last command was sent */
    uint32_t damage_seen; /* n_damaged at the last tick */
    uint32_t lost_count; /* the axis's count of lost commands */
    uint32_t n_lost;
    int begin; /* 1: the first command of a run is due */
    float rate_deg_s; /* last measured rate */
    rate_controller controller;
    /* From the tick to the background. */
    volatile int axis_answered, hello_due;
    /* Owned by the background. */
    gsid_status fit_status;
    uint32_t n_reported; /* frames of the report so far */
    experiment experiment;
} drive;

/* Background, once. */
gsid_status drive_init(drive *d);

/* Receive interrupt: process a byte. Returns 1 when the tick is due: a frame is complete, or a damaged one was discarded. */
int drive_receive(drive *d, uint8_t byte);

/* Tick. by_timer: 1 when the timer triggered it, 0 when drive_receive did. */
void drive_tick(drive *d, int by_timer);

/* Background, for ever. Returns 0 when there is nothing to do before the next interrupt. */
int drive_background(drive *d);

/* ---- functions of the board ---- */

/* Send all bytes, or none when there is no room; never wait. Called by the tick while RUNNING, by the background
 * otherwise. */
void line_send(const uint8_t *bytes, size_t n_bytes);

/* Number of bytes that line_send would accept now. */
size_t line_room(void);

#endif
