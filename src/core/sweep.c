#include "complex_math.h"
#include "gsid/signals.h"
#include "real.h"

static int is_within(const gsid_sweep_cfg *cfg, gsid_real line) {
    return line > GSID_R(0.0) && GSID_R(2.0) * line < (gsid_real)cfg->n_period;
}

/* Limits so far apart that their ratio, or its inverse, is not a number of full precision: beyond any use, and the exponential of
 * the ratio's logarithm could overflow. */
static int is_too_wide(const gsid_sweep_cfg *cfg) {
    const gsid_real ratio = cfg->line_stop / cfg->line_start;
    return cfg->kind == GSID_SWEEP_LOGARITHMIC && !(ratio >= GSID_SMALLEST && ratio <= 1 / GSID_SMALLEST);
}

static gsid_status check_cfg(const gsid_sweep_cfg *cfg) {
    if (!gsid_is_finite(cfg->line_start) || !gsid_is_finite(cfg->line_stop) || !gsid_is_finite(cfg->amplitude) ||
        !gsid_is_finite(cfg->phase_rad)) {
        return GSID_E_NONFINITE;
    }
    const int is_kind = cfg->kind == GSID_SWEEP_LINEAR || cfg->kind == GSID_SWEEP_LOGARITHMIC;
    const int moves = cfg->line_start < cfg->line_stop || cfg->line_start > cfg->line_stop;
    return is_kind && cfg->n_period >= 2 && cfg->n_period <= GSID_N_PERIOD_MAX && is_within(cfg, cfg->line_start) &&
                   is_within(cfg, cfg->line_stop) && moves && !is_too_wide(cfg)
               ? GSID_OK
               : GSID_E_CONFIG;
}

/* Turns after a share of the period, 0 .. 1: EXC-6, EXC-7. Between near lines b^s - 1 is small, and exp(x) - 1 would be mostly
 * rounding. */
static gsid_real turns_after(const gsid_sweep_cfg *cfg, gsid_real log_ratio, gsid_real share) {
    if (cfg->kind == GSID_SWEEP_LINEAR) {
        return share * (cfg->line_start + GSID_R(0.5) * share * (cfg->line_stop - cfg->line_start));
    }
    return cfg->line_start * (gsid_expm1(share * log_ratio) / log_ratio);
}

static gsid_real log_ratio_of(const gsid_sweep_cfg *cfg) {
    return gsid_log(cfg->line_stop / cfg->line_start);
}

gsid_real gsid_sweep_turns(const gsid_sweep_cfg *cfg) {
    if (cfg == NULL || check_cfg(cfg) != GSID_OK) {
        return (gsid_real)NAN;
    }
    return turns_after(cfg, log_ratio_of(cfg), GSID_R(1.0));
}

gsid_status gsid_sweep_init(gsid_sweep *sweep, const gsid_sweep_cfg *cfg) {
    if (sweep == NULL || cfg == NULL) {
        return GSID_E_NULL;
    }
    gsid_status status = check_cfg(cfg);
    if (status != GSID_OK) {
        return status;
    }
    sweep->cfg = *cfg;
    sweep->log_ratio = log_ratio_of(cfg);
    sweep->n = 0;
    return GSID_OK;
}

gsid_status gsid_sweep_step(gsid_sweep *sweep, gsid_real *u) {
    if (sweep == NULL || u == NULL) {
        return GSID_E_NULL;
    }
    const gsid_sweep_cfg *cfg = &sweep->cfg;
    if (cfg->n_period == 0) {
        return GSID_E_STATE;
    }
    gsid_real turns = turns_after(cfg, sweep->log_ratio, (gsid_real)sweep->n / (gsid_real)cfg->n_period);
    turns -= gsid_floor(turns); /* before the product with 2 pi rounds it */
    *u = cfg->amplitude * gsid_sin(GSID_TWO_PI * turns + cfg->phase_rad);
    sweep->n++;
    if (sweep->n < cfg->n_period) {
        return GSID_OK;
    }
    sweep->n = 0;
    return GSID_DONE;
}
