/* The guard of an excitation: it passes the excitation while the axis is within its limits, and removes it in the tick in which
 * a limit is exceeded or predicted to be exceeded.
 *
 *            start            ramp complete
 *     OFF ----------> RAMP_IN -------------> RUN
 *      ^                 |  stop              | stop
 *      |                 +------> RAMP_OUT <--+
 *      +--------------------------'  ramp complete
 *
 *     RAMP_IN, RUN, RAMP_OUT -- any limit --> TRIPPED -- reset --> OFF
 *
 * The controller's own command is never changed: the guard acts on the excitation only. */
#ifndef GSID_GUARD_H
#define GSID_GUARD_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
    GSID_GUARD_OFF = 0,
    GSID_GUARD_RAMP_IN = 1,
    GSID_GUARD_RUN = 2,
    GSID_GUARD_RAMP_OUT = 3,
    GSID_GUARD_TRIPPED = 4
} gsid_guard_state;

/* X(name, code, meaning). AHEAD: the prediction exceeds the limit, the measurement does not yet. */
#define GSID_TRIP_LIST(X)                                                                                              \
    X(GSID_TRIP_NONE, 0, "not tripped")                                                                                \
    X(GSID_TRIP_SAMPLE, 1, "a sample was not finite")                                                                  \
    X(GSID_TRIP_MISSING, 2, "too many samples in a row were missing")                                                  \
    X(GSID_TRIP_RATE, 3, "the rate passed its limit")                                                                  \
    X(GSID_TRIP_TRAVEL, 4, "the angle left its range")                                                                 \
    X(GSID_TRIP_COMMAND, 5, "the command with the excitation passed its limit, or was not finite")                     \
    X(GSID_TRIP_RATE_AHEAD, 6, "the rate would pass its limit before the axis answers")                                \
    X(GSID_TRIP_TRAVEL_AHEAD, 7, "the axis could no longer stop within its range of angles")

#define GSID_TRIP_ENUM(name, code, meaning) name = code,
typedef enum { GSID_TRIP_LIST(GSID_TRIP_ENUM) GSID_TRIP_END_ = 127 } gsid_trip;

/* Angle is the integral of rate over seconds, whatever the unit of rate. An infinite limit is not monitored. */
typedef struct {
    gsid_real fs_hz;                    /* sample rate, > 0 */
    gsid_real command_limit;            /* of |command + excitation|, > 0 */
    gsid_real rate_limit;               /* of |rate|, > 0 */
    gsid_real angle_lo, angle_hi;       /* range of the angle, lo < hi */
    int angle_is_measured;              /* 0: the angle is the integral of the rate, from the one given at the start, and
                                           of the rate's offset: 0.01 deg/s are 0.6 deg in a minute */
    gsid_real reaction_s;               /* time until the axis answers a command, >= 0 and finite: its delay */
    gsid_real acceleration_per_command; /* rate per second and unit of command, finite: what acts on until then */
    gsid_real deceleration;             /* rate per second that the axis surely loses without excitation, > 0 */
    uint32_t n_ramp;                    /* ticks of the ramp in and of the ramp out; with the axis's settling, at most
                                           gsid_frf_cfg.n_settle */
    uint32_t n_missing_max;             /* samples in a row that may be missing */
} gsid_guard_cfg;

/* What was measured in a tick. */
typedef struct {
    gsid_real rate;
    gsid_real angle; /* used only if angle_is_measured */
} gsid_guard_sample;

typedef struct {
    gsid_guard_cfg cfg;
    gsid_guard_state state;
    gsid_trip reason;          /* why it tripped; stays until the reset */
    gsid_real value;           /* value that exceeded the limit: rate, angle or command, or the number of missing samples */
    gsid_real rate, angle;     /* the last ones known */
    gsid_real rate_ahead;      /* predicted, when the axis begins to answer */
    gsid_real angle_ahead;     /* predicted, where it comes to rest */
    uint32_t ramp;             /* private: position on the ramp, 0 .. n_ramp */
    uint32_t n_missing;        /* private: missing samples in a row */
    gsid_real command;         /* private: the one in force */
    gsid_real period_s;        /* private */
    gsid_real ramp_step;       /* private: 1 / n_ramp */
    gsid_real stop_per_rate2;  /* private: 1 / (2 deceleration) */
} gsid_guard;

/** Name a reason in words.
 *  @return the meaning, never NULL; "unknown reason" for a value off the list.  Context: ISR-safe. */
const char *gsid_trip_str(gsid_trip reason);

/** Check the limits and switch off.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG a limit out of its range, or not a number; GSID_E_BUILD.  Context: background. */
gsid_status gsid_guard_init(gsid_guard *guard, const gsid_guard_cfg *cfg);

/** Begin to let the excitation through.
 *  @param[in] angle  where the axis is now, finite; not used if the angle is measured
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE not initialised, or not OFF: after a trip call gsid_guard_reset
 *          first; GSID_E_NONFINITE
 *  Context: that of gsid_guard_step, or while it cannot interrupt; so are stop and reset. */
gsid_status gsid_guard_start(gsid_guard *guard, gsid_real angle);

/** Ramp out, from wherever the ramp is; does nothing when OFF or TRIPPED.
 *  @return GSID_OK; GSID_E_NULL */
gsid_status gsid_guard_stop(gsid_guard *guard);

/** Acknowledge a trip, and switch off at once.
 *  @return GSID_OK; GSID_E_NULL */
gsid_status gsid_guard_reset(gsid_guard *guard);

/** Compute the allowed excitation of this tick. Call it in every tick, with or without a sample.
 *  Eq: GRD-1 (the predictions).
 *  @param[in]  sample      what was measured; NULL: no sample came. The rate is then taken to be the last one known
 *  @param[in]  command     the controller's own command of this tick
 *  @param[in]  excitation  the excitation of this tick
 *  @param[out] allowed     what may be added to the command: the excitation, times the ramp; 0 when OFF or TRIPPED
 *  @return GSID_OK; GSID_SETTLING on a ramp; GSID_TRIPPED see guard->reason; GSID_E_NULL nothing changed
 *  Cost: some 40 multiplications, additions and comparisons, whatever happens.  Context: ISR-safe, one writer. */
gsid_status gsid_guard_step(gsid_guard *guard, const gsid_guard_sample *sample, gsid_real command, gsid_real excitation,
                            gsid_real *allowed);

#ifdef __cplusplus
}
#endif

#endif
