#include "gsid/host/steady.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct gsid_steady {
    gsid_steady_cfg cfg;
    gsid_plant_item *item;
    gsid_plant plant;
    void *memory, *kept; /* of the plant; kept: NULL before the first gsid_steady_keep */
    size_t size;
    int is_found; /* the memory has the state of a search that ended */
    double *fine; /* [3 + n_free][steps] outputs at the steps of the input; NULL: one step a sample */
};

static size_t n_steps(const gsid_steady_cfg *cfg) {
    return (size_t)cfg->n_period * cfg->oversampling;
}

/* ---- creation ---- */

static gsid_status check(const gsid_steady_cfg *cfg) {
    if (cfg->u == NULL || cfg->plant.item == NULL || (cfg->plant.n_free > 0 && cfg->plant.free_parameter == NULL)) {
        return GSID_E_NULL;
    }
    if (cfg->n_period == 0 || cfg->oversampling == 0 || (uint64_t)cfg->n_period * cfg->oversampling > UINT32_MAX ||
        cfg->plant.n_items == 0 || !(cfg->tolerance >= 0)) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < cfg->plant.n_free; i++) {
        const gsid_plant_free *one = &cfg->plant.free_parameter[i];
        if (one->item >= cfg->plant.n_items || one->parameter >= GSID_EFFECT_PARAMETERS_MAX) {
            return GSID_E_CONFIG;
        }
    }
    for (size_t i = 0; i < n_steps(cfg); i++) {
        if (!isfinite(cfg->u[i])) {
            return GSID_E_NONFINITE;
        }
    }
    return GSID_OK;
}

gsid_status gsid_steady_create(const gsid_steady_cfg *cfg, gsid_steady **steady) {
    gsid_status status = cfg == NULL || steady == NULL ? GSID_E_NULL : check(cfg);
    if (status != GSID_OK) {
        return status;
    }
    gsid_steady *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return GSID_E_NO_MEMORY;
    }
    made->cfg = *cfg;
    made->item = malloc(cfg->plant.n_items * sizeof *made->item);
    if (cfg->oversampling > 1) {
        made->fine = malloc((3 + (size_t)cfg->plant.n_free) * n_steps(cfg) * sizeof *made->fine);
    }
    if (made->item == NULL || (cfg->oversampling > 1 && made->fine == NULL)) {
        gsid_steady_destroy(made);
        return GSID_E_NO_MEMORY;
    }
    memcpy(made->item, cfg->plant.item, cfg->plant.n_items * sizeof *made->item);
    made->cfg.plant.item = made->item;
    *steady = made;
    return GSID_OK;
}

void gsid_steady_destroy(gsid_steady *steady) {
    if (steady != NULL) {
        free(steady->item);
        free(steady->memory);
        free(steady->kept);
        free(steady->fine);
        free(steady);
    }
}

/* ---- start of a search ---- */

/* At rest, then on the orbit that the plant would have without its nonlinear torques, or where the axis was measured. */
static gsid_status lay_out(gsid_steady *s) {
    const size_t size = gsid_plant_mem_size(&s->cfg.plant);
    free(s->memory);
    s->plant = (gsid_plant){.layout = NULL};
    s->size = size;
    s->memory = malloc(size > 0 ? size : 1);
    if (s->memory == NULL) {
        return GSID_E_NO_MEMORY;
    }
    gsid_status status = gsid_plant_init(&s->plant, &s->cfg.plant, s->memory, size);
    if (status == GSID_OK) {
        status = gsid_plant_start_linear(&s->plant, (uint32_t)n_steps(&s->cfg), s->cfg.u);
        status = status == GSID_E_NONFINITE ? GSID_OK : status; /* it starts at rest */
    }
    if (status == GSID_OK && s->cfg.is_placed) {
        status = gsid_plant_place(&s->plant, s->cfg.angle, s->cfg.rate);
    }
    return status;
}

static gsid_status enter(gsid_steady *s, const double *value) {
    s->is_found = 0;
    for (uint32_t i = 0; i < s->cfg.plant.n_free && value != NULL; i++) {
        const gsid_plant_free *one = &s->cfg.plant.free_parameter[i];
        s->item[one->item].value[one->parameter] = value[i];
    }
    if (s->kept == NULL) {
        return lay_out(s);
    }
    memcpy(s->memory, s->kept, s->size);
    return gsid_plant_update(&s->plant);
}

gsid_status gsid_steady_keep(gsid_steady *steady) {
    if (steady == NULL) {
        return GSID_E_NULL;
    }
    if (!steady->is_found) {
        return GSID_E_STATE;
    }
    if (steady->kept == NULL) {
        steady->kept = malloc(steady->size > 0 ? steady->size : 1);
    }
    if (steady->kept == NULL) {
        return GSID_E_NO_MEMORY;
    }
    memcpy(steady->kept, steady->memory, steady->size);
    return GSID_OK;
}

/* ---- search ---- */

/* Every oversampling-th number of a row of steps. */
static void sample(const gsid_steady *s, const double *fine, double *row) {
    for (size_t i = 0; i < s->cfg.n_period; i++) {
        row[i] = fine[i * s->cfg.oversampling];
    }
}

static double rms(uint32_t n, const double *y) {
    double sum = 0;
    for (uint32_t i = 0; i < n; i++) {
        sum += y[i] * y[i];
    }
    return sqrt(sum / n);
}

static gsid_status search(gsid_steady *s, uint32_t n_settle, uint32_t n_newton, int with_dy,
                          gsid_steady_answer *answer) {
    const size_t n = n_steps(&s->cfg);
    const uint32_t n_free = s->cfg.plant.n_free;
    double *row[3] = {answer->y, answer->angle, answer->rate};
    double *dy = with_dy && n_free > 0 ? answer->dy : NULL, *fine_dy = dy;
    double *at_step[3] = {row[0], row[1], row[2]};
    if (s->fine != NULL) {
        for (size_t i = 0; i < 3; i++) {
            at_step[i] = s->fine + i * n;
        }
        fine_dy = dy == NULL ? NULL : s->fine + 3 * n;
    }
    const gsid_status status = gsid_plant_periodic(&s->plant, (uint32_t)n, s->cfg.u, n_settle, n_newton, at_step[0],
                                                   fine_dy, at_step[1], at_step[2], &answer->residual);
    if (status < 0) {
        return status;
    }
    if (s->fine != NULL) {
        for (int i = 0; i < 3; i++) {
            sample(s, at_step[i], row[i]);
        }
        for (uint32_t i = 0; i < n_free && dy != NULL; i++) {
            sample(s, fine_dy + i * n, dy + (size_t)i * s->cfg.n_period);
        }
    }
    s->is_found = 1;
    const double enough = fmax(GSID_STEADY_RESIDUAL * rms(s->cfg.n_period, answer->y), s->cfg.tolerance);
    answer->is_settled = status == GSID_OK || answer->residual <= enough;
    return GSID_OK;
}

static int is_complete(const gsid_steady *steady, const gsid_steady_answer *answer) {
    return steady != NULL && answer != NULL && answer->y != NULL && answer->angle != NULL && answer->rate != NULL;
}

gsid_status gsid_steady_run(gsid_steady *steady, const double *value, int is_patient, gsid_steady_answer *answer) {
    if (!is_complete(steady, answer)) {
        return GSID_E_NULL;
    }
    const uint32_t n_settle = steady->kept == NULL && !steady->cfg.is_placed ? GSID_STEADY_SETTLE : 0;
    gsid_status status = enter(steady, value);
    if (status == GSID_OK) {
        status = search(steady, n_settle, GSID_STEADY_NEWTON, 1, answer);
    }
    if (status == GSID_OK && !answer->is_settled && is_patient) {
        status = search(steady, GSID_STEADY_SETTLE_LONGER, GSID_STEADY_NEWTON, 1, answer);
    }
    return status;
}

static int may_be_far(gsid_status status) {
    return status != GSID_E_NO_MEMORY && status != GSID_E_STOPPED;
}

gsid_status gsid_steady_run_near(gsid_steady *steady, const double *value, gsid_steady_answer *answer) {
    if (!is_complete(steady, answer)) {
        return GSID_E_NULL;
    }
    gsid_status status = GSID_E_STATE;
    if (steady->kept != NULL) {
        status = enter(steady, value);
        if (status != GSID_OK) {
            return status;
        }
        status = search(steady, 1, 0, 0, answer);
    }
    if (status == GSID_OK && answer->is_settled) {
        return GSID_OK;
    }
    if (status < 0 && !may_be_far(status)) {
        return status;
    }
    gsid_steady_answer full = *answer; /* far from what was kept: one step of Newton's method is taken first */
    full.dy = NULL;
    status = gsid_steady_run(steady, value, 1, &full);
    answer->residual = full.residual;
    answer->is_settled = full.is_settled;
    return status;
}
