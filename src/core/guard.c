#include "gsid/guard.h"

#include "real.h"

#define MEANING_CASE(name, code, meaning)                                                                              \
    case name:                                                                                                         \
        return meaning;

const char *gsid_trip_str(gsid_trip reason) {
    switch (reason) {
        GSID_TRIP_LIST(MEANING_CASE)
    case GSID_TRIP_END_:
    default:
        return "unknown reason";
    }
}

/* Comparisons are written so that what is not a number fails them. */
static int is_positive(gsid_real x) {
    return x > GSID_R(0.0);
}

static int is_within(gsid_real x, gsid_real lo, gsid_real hi) {
    return x >= lo && x <= hi;
}

gsid_status gsid_guard_init(gsid_guard *guard, const gsid_guard_cfg *cfg) {
    if (guard == NULL || cfg == NULL) {
        return GSID_E_NULL;
    }
    const gsid_status build = gsid_check_build();
    if (build != GSID_OK) {
        return build;
    }
    if (!is_positive(cfg->fs_hz) || !gsid_is_finite(cfg->fs_hz) || !is_positive(cfg->command_limit) ||
        !is_positive(cfg->rate_limit) || !(cfg->angle_lo < cfg->angle_hi) || !(cfg->reaction_s >= GSID_R(0.0)) ||
        !gsid_is_finite(cfg->reaction_s) || !gsid_is_finite(cfg->acceleration_per_command) ||
        !is_positive(cfg->deceleration)) {
        return GSID_E_CONFIG;
    }
    const gsid_guard off = {.cfg = *cfg,
                            .period_s = GSID_R(1.0) / cfg->fs_hz,
                            .ramp_step = cfg->n_ramp > 0 ? GSID_R(1.0) / (gsid_real)cfg->n_ramp : GSID_R(0.0),
                            .stop_per_rate2 = GSID_R(0.5) / cfg->deceleration};
    *guard = off;
    return GSID_OK;
}

gsid_status gsid_guard_start(gsid_guard *guard, gsid_real angle) {
    if (guard == NULL) {
        return GSID_E_NULL;
    }
    if (guard->state != GSID_GUARD_OFF || !is_positive(guard->cfg.fs_hz)) {
        return GSID_E_STATE;
    }
    if (!guard->cfg.angle_is_measured) {
        if (!gsid_is_finite(angle)) {
            return GSID_E_NONFINITE;
        }
        guard->angle = angle;
    }
    guard->state = GSID_GUARD_RAMP_IN;
    guard->ramp = 0;
    guard->n_missing = 0;
    return GSID_OK;
}

gsid_status gsid_guard_stop(gsid_guard *guard) {
    if (guard == NULL) {
        return GSID_E_NULL;
    }
    if (guard->state == GSID_GUARD_RAMP_IN || guard->state == GSID_GUARD_RUN) {
        guard->state = GSID_GUARD_RAMP_OUT;
    }
    return GSID_OK;
}

gsid_status gsid_guard_reset(gsid_guard *guard) {
    if (guard == NULL) {
        return GSID_E_NULL;
    }
    guard->state = GSID_GUARD_OFF;
    guard->reason = GSID_TRIP_NONE;
    guard->value = GSID_R(0.0);
    return GSID_OK;
}

/* The next position on the ramp, and the state in which it is reached. */
static void move_on_ramp(gsid_guard *guard) {
    switch (guard->state) {
    case GSID_GUARD_RAMP_IN:
        if (guard->ramp < guard->cfg.n_ramp) {
            guard->ramp++;
        } else {
            guard->state = GSID_GUARD_RUN;
        }
        break;
    case GSID_GUARD_RAMP_OUT:
        if (guard->ramp > 0) {
            guard->ramp--;
        } else {
            guard->state = GSID_GUARD_OFF;
        }
        break;
    case GSID_GUARD_OFF:
    case GSID_GUARD_RUN:
    case GSID_GUARD_TRIPPED:
        break;
    }
}

/* 0 .. 1 without a corner at either end: a corner would shake what the ramp is there to leave in peace. */
static gsid_real ramp_gain(const gsid_guard *guard) {
    if (guard->state == GSID_GUARD_RUN) {
        return GSID_R(1.0);
    }
    const gsid_real x = (gsid_real)guard->ramp * guard->ramp_step;
    return x * x * (GSID_R(3.0) - GSID_R(2.0) * x);
}

/* Take over what was measured. */
static gsid_trip observe(gsid_guard *guard, const gsid_guard_sample *sample) {
    const gsid_guard_cfg *cfg = &guard->cfg;
    if (sample == NULL) {
        guard->n_missing += guard->n_missing < UINT32_MAX;
    } else {
        if (!gsid_is_finite(sample->rate) || (cfg->angle_is_measured && !gsid_is_finite(sample->angle))) {
            return GSID_TRIP_SAMPLE;
        }
        guard->n_missing = 0;
        guard->rate = sample->rate;
    }
    if (cfg->angle_is_measured && sample != NULL) {
        guard->angle = sample->angle;
    } else {
        guard->angle += guard->rate * guard->period_s;
    }
    return guard->n_missing > cfg->n_missing_max ? GSID_TRIP_MISSING : GSID_TRIP_NONE;
}

/* GRD-1. The command in force goes on acting until the axis answers another one; then it slows down to rest. */
static void predict(gsid_guard *guard) {
    const gsid_real r = guard->cfg.reaction_s, w = guard->rate;
    const gsid_real w_ahead = w + guard->cfg.acceleration_per_command * guard->command * r;
    guard->rate_ahead = w_ahead;
    guard->angle_ahead =
        guard->angle + (w + w_ahead) * (r / 2) + w_ahead * (gsid_fabs(w_ahead) * guard->stop_per_rate2);
}

/* The first limit that is passed, and by which value. What was measured comes before what is predicted. */
static gsid_trip check_limits(const gsid_guard *guard, gsid_real command, gsid_real *value) {
    const gsid_guard_cfg *cfg = &guard->cfg;
    const struct {
        gsid_trip reason;
        gsid_real value, lo, hi;
    } limits[] = {
        {GSID_TRIP_RATE, guard->rate, -cfg->rate_limit, cfg->rate_limit},
        {GSID_TRIP_TRAVEL, guard->angle, cfg->angle_lo, cfg->angle_hi},
        {GSID_TRIP_COMMAND, command, -cfg->command_limit, cfg->command_limit},
        {GSID_TRIP_RATE_AHEAD, guard->rate_ahead, -cfg->rate_limit, cfg->rate_limit},
        {GSID_TRIP_TRAVEL_AHEAD, guard->angle_ahead, cfg->angle_lo, cfg->angle_hi},
    };
    for (uint32_t i = 0; i < sizeof limits / sizeof *limits; i++) {
        *value = limits[i].value;
        if (!is_within(limits[i].value, limits[i].lo, limits[i].hi)) {
            return limits[i].reason;
        }
    }
    return gsid_is_finite(command) ? GSID_TRIP_NONE : GSID_TRIP_COMMAND; /* where no limit is watched */
}

static int is_active(const gsid_guard *guard) {
    return guard->state != GSID_GUARD_OFF && guard->state != GSID_GUARD_TRIPPED;
}

static gsid_status status_of(const gsid_guard *guard) {
    switch (guard->state) {
    case GSID_GUARD_RAMP_IN:
    case GSID_GUARD_RAMP_OUT:
        return GSID_SETTLING;
    case GSID_GUARD_TRIPPED:
        return GSID_TRIPPED;
    case GSID_GUARD_OFF:
    case GSID_GUARD_RUN:
    default:
        return GSID_OK;
    }
}

gsid_status gsid_guard_step(gsid_guard *guard, const gsid_guard_sample *sample, gsid_real command, gsid_real excitation,
                            gsid_real *allowed) {
    if (guard == NULL || allowed == NULL) {
        return GSID_E_NULL;
    }
    gsid_trip reason = observe(guard, sample);
    predict(guard);
    *allowed = GSID_R(0.0);
    if (is_active(guard)) {
        move_on_ramp(guard);
        const gsid_real wanted = ramp_gain(guard) * excitation;
        gsid_real value = reason == GSID_TRIP_MISSING ? (gsid_real)guard->n_missing : GSID_R(0.0);
        if (reason == GSID_TRIP_NONE) {
            reason = check_limits(guard, command + wanted, &value);
        }
        if (reason == GSID_TRIP_NONE) {
            *allowed = wanted;
        } else {
            guard->state = GSID_GUARD_TRIPPED;
            guard->reason = reason;
            guard->value = value;
        }
    }
    guard->command = gsid_is_finite(command) ? command + *allowed : GSID_R(0.0);
    return status_of(guard);
}
