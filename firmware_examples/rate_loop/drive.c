#include "drive.h"

#include <math.h>
#include <string.h>

#include "handover.h"

#define COMMAND_LIMIT 10.0f
#define EXCITATION_PEAK 5.0f
#define KP 3.0f
#define KI 0.005f

/* For an axis with 7.4 deg/s^2 per command, a delay of 5.4 ms and a permitted travel of +-2 deg. */
static const gsid_guard_cfg limits = {.command_limit = COMMAND_LIMIT,
                                      .rate_limit = 20.0f,
                                      .angle_lo = -2.0f,
                                      .angle_hi = 2.0f,
                                      .reaction_s = 5.4e-3f,
                                      .acceleration_per_command = 7.4f,
                                      .deceleration = 20.0f};

static void send(const drive *d, uint8_t kind, uint8_t flags, uint32_t tick, float a, float b) {
    const gsid_frame frame = {.kind = kind, .flags = flags, .tick = tick, .a = a, .b = b};
    uint8_t bytes[GSID_LINK_FRAME_MAX];
    line_send(bytes, gsid_link_encode(&frame, d->link.session, bytes));
}

gsid_status drive_init(drive *d) {
    memset(d, 0, sizeof *d);
    d->hello_due = 1;
    return experiment_init(&d->experiment, EXCITATION_PEAK, &limits);
}

/* ---- receive interrupt ---- */

int drive_receive(drive *d, uint8_t byte) {
    gsid_frame frame;
    size_t n_frames = 0;
    const uint32_t damaged = d->link.n_damaged;
    gsid_link_decode(&d->link, 1, &byte, 1, &frame, &n_frames);
    d->n_damaged += d->link.n_damaged - damaged;
    if (n_frames > 0 && d->n_come - d->n_taken < DRIVE_FRAMES) {
        d->frame[d->n_come % DRIVE_FRAMES] = frame;
        d->n_come++; /* last: the tick reads it first */
    }
    return n_frames > 0 || d->link.n_damaged != damaged;
}

/* ---- tick ---- */

/* End the run: STOP makes the axis set its command to zero within this tick. */
static void end(drive *d, drive_why why) {
    d->why = why;
    d->why_tick = d->tick;
    d->state = DRIVE_ENDED;
    send(d, GSID_FRAME_STOP, 0, 0, 0.0f, 0.0f);
}

/* Send the command of the next tick, or end the run if the experiment has ended. sample: NULL when it was lost; the controller
 * then uses the last rate. The frame's second command, that of the tick after next, is left empty: it is not known yet. */
static void command_next(drive *d, const gsid_guard_sample *sample) {
    if (sample != NULL) {
        d->rate_deg_s = sample->rate;
    }
    const float command = rate_controller_step(&d->controller, 0.0f, d->rate_deg_s);
    float u = command + experiment_excite(&d->experiment, sample, command);
    u = u > COMMAND_LIMIT ? COMMAND_LIMIT : u < -COMMAND_LIMIT ? -COMMAND_LIMIT : u;
    d->n_silent = 0;
    if (d->experiment.state == EXPERIMENT_MEASURED) {
        end(d, DRIVE_MEASURED);
    } else if (d->experiment.state == EXPERIMENT_STOPPED) {
        end(d, d->experiment.guard.state == GSID_GUARD_TRIPPED ? DRIVE_TRIPPED : DRIVE_LOSSES);
    } else {
        send(d, GSID_FRAME_COMMAND, 0, ++d->tick, u, NAN);
    }
}

static void take_sample(drive *d, const gsid_frame *frame) {
    if (frame->tick != d->tick) {
        return; /* already counted as lost */
    }
    if ((frame->flags & GSID_FLAG_LOST_COUNT) != d->lost_count) {
        d->lost_count = frame->flags & GSID_FLAG_LOST_COUNT;
        experiment_settle(&d->experiment);
    } else {
        experiment_measure(&d->experiment, frame->a, frame->b);
    }
    const gsid_guard_sample sample = {.rate = frame->b};
    command_next(d, &sample);
}

static void lose_sample(drive *d) {
    if (++d->n_lost >= DRIVE_LOST_MAX) {
        end(d, DRIVE_LOSSES);
    } else {
        experiment_skip(&d->experiment);
        command_next(d, NULL);
    }
}

/* Whether a HELLO is the reply of an axis with this version of the protocol, to the session opened last. */
static int is_answer(const drive *d, const gsid_frame *hello) {
    return hello->flags == GSID_LINK_VERSION && hello->tick == d->link.session &&
           fabsf(hello->a - EXPERIMENT_FS_HZ) < 0.5f;
}

static void take_frame(drive *d, const gsid_frame *frame) {
    const int running = d->state == DRIVE_RUNNING;
    if (frame->kind == GSID_FRAME_SAMPLE && running) {
        take_sample(d, frame);
    } else if (frame->kind == GSID_FRAME_STOP && running) {
        end(d, DRIVE_STOP_RECEIVED);
    } else if (frame->kind == GSID_FRAME_HELLO && running) {
        end(d, DRIVE_RESTARTED);
    } else if (frame->kind == GSID_FRAME_HELLO && is_answer(d, frame)) {
        d->axis_answered = 1;
    }
}

void drive_tick(drive *d, int by_timer) {
    if (d->state == DRIVE_RUNNING && d->begin) {
        const gsid_guard_sample at_rest = {.rate = 0};
        d->begin = 0;
        command_next(d, &at_rest);
    }
    while (d->n_taken != d->n_come) {
        HANDOVER();
        take_frame(d, &d->frame[d->n_taken % DRIVE_FRAMES]);
        HANDOVER();
        d->n_taken++;
    }
    const uint32_t n_damaged = d->n_damaged;
    const int damage = n_damaged != d->damage_seen;
    d->damage_seen = n_damaged;
    d->n_silent += by_timer ? 1u : 0u;
    if (d->state == DRIVE_RUNNING && (damage || d->n_silent >= DRIVE_SILENCE_MAX)) {
        lose_sample(d);
    } else if (d->state == DRIVE_WAITING && d->n_silent >= DRIVE_HELLO_EVERY) {
        d->n_silent = 0;
        d->hello_due = 1;
    }
}

/* ---- background ---- */

static void report_state(const drive *d) {
    const gsid_guard *guard = &d->experiment.guard;
    send(d, GSID_FRAME_RESULT, DRIVE_RESULT_TRIP, (uint32_t)guard->reason, guard->value, guard->angle);
    send(d, GSID_FRAME_RESULT, DRIVE_RESULT_STATE, d->why_tick, (float)d->why, (float)d->experiment.frf.n_periods);
}

static void start(drive *d) {
    const rate_controller at_rest = {.kp = KP, .ki = KI, .limit = COMMAND_LIMIT};
    d->axis_answered = 0;
    if (d->why != DRIVE_NEVER_RAN) {
        report_state(d); /* of the last run: a new axis or host may not have received it */
    }
    if (experiment_start(&d->experiment) != GSID_OK) {
        end(d, DRIVE_REFUSED);
        return;
    }
    d->controller = at_rest;
    d->rate_deg_s = 0;
    d->lost_count = d->n_lost = 0;
    d->tick = UINT32_MAX; /* the next command is that of tick 0; the tick sends it, to be ready for the reply */
    d->begin = 1;
    HANDOVER();
    d->state = DRIVE_RUNNING; /* last: from here on the object belongs to the tick */
}

/* If the drive can be reset during a run, draw the first id from a source that a reset does not repeat. */
static void open_session(drive *d) {
    d->link.session = (uint16_t)(d->link.session < GSID_LINK_SESSION_MAX ? d->link.session + 1u : 1u);
    send(d, GSID_FRAME_HELLO, GSID_LINK_VERSION, d->link.session, 0.0f, 0.0f);
}

static void wait(drive *d) {
    if (d->axis_answered) {
        start(d);
    } else if (d->hello_due) {
        d->hello_due = 0;
        open_session(d);
    }
}

/* Send frame i of the report: the lines of the response first, then the model. Returns 0 after the last frame. */
static int report_next(const drive *d, uint32_t i) {
    const experiment *e = &d->experiment;
    const gsid_rational *m = &e->model;
    if (i == 0) {
        report_state(d);
        return d->why == DRIVE_MEASURED;
    }
    i--;
    if (i < 2 * EXPERIMENT_N_LINES) {
        const uint32_t line = i / 2;
        if (i % 2 == 0) {
            send(d, GSID_FRAME_RESULT, DRIVE_RESULT_G, e->line[line], e->g[line].re, e->g[line].im);
        } else {
            send(d, GSID_FRAME_RESULT, DRIVE_RESULT_SIGMA, e->line[line], e->f_hz[line], e->sigma[line]);
        }
        return 1;
    }
    i -= 2 * EXPERIMENT_N_LINES;
    if (i <= EXPERIMENT_N_ZEROS) {
        send(d, GSID_FRAME_RESULT, DRIVE_RESULT_NUM, i, m->num[i], m->scale_rad_s);
    } else if (i <= EXPERIMENT_N_ZEROS + 1 + EXPERIMENT_N_POLES) {
        send(d, GSID_FRAME_RESULT, DRIVE_RESULT_DEN, i - EXPERIMENT_N_ZEROS - 1, m->den[i - EXPERIMENT_N_ZEROS - 1],
             m->scale_rad_s);
    } else {
        send(d, GSID_FRAME_RESULT, DRIVE_RESULT_FIT, (uint32_t)(d->fit_status + 128), m->delay_s, e->cost);
    }
    return i <= EXPERIMENT_N_ZEROS + 1 + EXPERIMENT_N_POLES;
}

static int report(drive *d) {
    if (line_room() < 2 * GSID_LINK_FRAME_MAX) {
        return 0;
    }
    if (!report_next(d, d->n_reported++)) {
        d->n_silent = 0;
        d->state = DRIVE_WAITING;
    }
    return 1;
}

int drive_background(drive *d) {
    const drive_state state = d->state;
    HANDOVER();
    switch (state) {
    case DRIVE_WAITING:
        wait(d);
        return 0;
    case DRIVE_ENDED:
        d->fit_status = d->why == DRIVE_MEASURED ? experiment_fit(&d->experiment) : GSID_OK;
        d->n_reported = 0;
        d->axis_answered = 0;
        d->state = DRIVE_REPORTING;
        return 1;
    case DRIVE_REPORTING:
        return report(d);
    default:
        return 0;
    }
}
