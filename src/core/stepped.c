#include "gsid/signals.h"
#include "real.h"

static gsid_status begin_line(gsid_stepped *s) {
    s->settle = s->cfg.n_settle;
    s->n = 0;
    return gsid_sine_init(&s->sine, s->cfg.n_period, s->cfg.line[s->i], s->cfg.amplitude[s->i], GSID_R(0.0),
                          s->cfg.twiddle);
}

gsid_status gsid_stepped_init(gsid_stepped *stepped, const gsid_stepped_cfg *cfg) {
    if (stepped == NULL || cfg == NULL || cfg->line == NULL || cfg->amplitude == NULL || cfg->twiddle == NULL) {
        return GSID_E_NULL;
    }
    if (cfg->n_lines < 1 || cfg->n_periods < 1 || cfg->n_period < 2 || cfg->n_periods > UINT32_MAX / cfg->n_period) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < cfg->n_lines; i++) {
        if (cfg->line[i] < 1 || cfg->line[i] >= (cfg->n_period + 1) / 2) {
            return GSID_E_CONFIG;
        }
    }
    gsid_stepped s = {.cfg = *cfg, .i = cfg->n_lines};
    gsid_status status = GSID_OK;
    while (s.i-- > 0 && status == GSID_OK) { /* each line is tried, the first one last */
        status = begin_line(&s);
    }
    if (status == GSID_OK) {
        s.i = 0;
        *stepped = s;
    }
    return status;
}

gsid_status gsid_stepped_step(gsid_stepped *stepped, gsid_real *u) {
    if (stepped == NULL || u == NULL) {
        return GSID_E_NULL;
    }
    if (stepped->cfg.line == NULL || stepped->i >= stepped->cfg.n_lines) {
        return GSID_E_STATE;
    }
    gsid_sine_step(&stepped->sine, u);
    if (stepped->settle > 0) {
        stepped->settle--;
        return GSID_SETTLING;
    }
    stepped->n++;
    if (stepped->n < stepped->cfg.n_periods * stepped->cfg.n_period) {
        return GSID_OK;
    }
    stepped->i++;
    if (stepped->i < stepped->cfg.n_lines) {
        begin_line(stepped);
    }
    return GSID_DONE;
}
