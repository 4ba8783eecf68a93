#include "experiment.h"

#include <math.h>

#include "handover.h"

#ifdef GSID_SINGLE
#define SQRT sqrtf
#else
#define SQRT sqrt
#endif
#define PI GSID_R(3.14159265358979)

/* Delays at which a fit is started, for any axis: 0 to 12 ms. */
enum { N_DELAYS = 13 };
#define DELAY_STEP_S GSID_R(1e-3)

static gsid_status fill_excitation(experiment *e, gsid_real peak) {
    /* Temporary, for the table only: the arrays of the result are not in use yet. */
    gsid_real *amplitude = e->f_hz, *phase_rad = e->sigma;
    const gsid_multisine_cfg cfg = {EXPERIMENT_N_PERIOD, EXPERIMENT_N_LINES, e->line, amplitude, phase_rad, e->twiddle};
    gsid_multisine multisine;
    gsid_status status = gsid_amplitude_shape(EXPERIMENT_N_LINES, e->line, 0, amplitude);
    if (status == GSID_OK) {
        status = gsid_phase_schroeder(EXPERIMENT_N_LINES, amplitude, phase_rad);
    }
    if (status == GSID_OK) {
        status = gsid_multisine_init(&multisine, &cfg);
    }
    if (status == GSID_OK) {
        status = gsid_multisine_table(&multisine, e->excitation);
    }
    gsid_real most = 0;
    for (uint32_t i = 0; status == GSID_OK && i < EXPERIMENT_N_PERIOD; i++) {
        const gsid_real size = e->excitation[i] < 0 ? -e->excitation[i] : e->excitation[i];
        most = size > most ? size : most;
    }
    for (uint32_t i = 0; status == GSID_OK && i < EXPERIMENT_N_PERIOD; i++) {
        e->excitation[i] *= peak / most;
    }
    return status;
}

gsid_status experiment_init(experiment *e, gsid_real peak, const gsid_guard_cfg *limits) {
    uint32_t n_lines;
    gsid_guard_cfg guard = *limits;
    guard.fs_hz = EXPERIMENT_FS_HZ;
    guard.n_ramp = EXPERIMENT_N_RAMP;
    guard.n_missing_max = EXPERIMENT_N_MISSING_MAX;
    e->state = EXPERIMENT_IDLE;
    gsid_status status = gsid_guard_init(&e->guard, &guard);
    if (status == GSID_OK) {
        status = gsid_twiddle_fill(EXPERIMENT_N_PERIOD, e->twiddle);
    }
    if (status == GSID_OK) {
        status = gsid_lines_fill(GSID_GRID_FULL, 1, EXPERIMENT_N_LINES, EXPERIMENT_N_LINES, e->line, &n_lines);
    }
    return status == GSID_OK ? fill_excitation(e, peak) : status;
}

gsid_status experiment_start(experiment *e) {
    /* The controller responds to the excitation, so the input must be measured. */
    const gsid_frf_cfg cfg = {.n_period = EXPERIMENT_N_PERIOD,
                              .n_lines = EXPERIMENT_N_LINES,
                              .n_settle = EXPERIMENT_N_SETTLE,
                              .line = e->line,
                              .twiddle = e->twiddle};
    gsid_status status = gsid_frf_init_spread(&e->frf, &cfg, e->memory, sizeof e->memory);
    gsid_guard_reset(&e->guard);
    if (status == GSID_OK) {
        status = gsid_guard_start(&e->guard, 0); /* the range of angles is relative to this angle */
    }
    e->n = 0;
    e->n_left_out = 0;
    HANDOVER();
    if (status == GSID_OK) {
        e->state = EXPERIMENT_RUNNING; /* last: from here on the object belongs to the tick */
    }
    return status;
}

gsid_real experiment_excite(experiment *e, const gsid_guard_sample *sample, gsid_real command) {
    if (e->state != EXPERIMENT_RUNNING) {
        return 0;
    }
    gsid_real allowed = 0;
    if (gsid_guard_step(&e->guard, sample, command, e->excitation[e->n], &allowed) == GSID_TRIPPED) {
        e->state = EXPERIMENT_STOPPED;
    }
    e->n = e->n + 1 < EXPERIMENT_N_PERIOD ? e->n + 1 : 0;
    return allowed;
}

/* The spread engine adds a period during the next one: the experiment ends that much later. */
static void judge_period(experiment *e) {
    if (e->frf.n_periods >= EXPERIMENT_N_GOOD) {
        e->state = EXPERIMENT_MEASURED;
    } else if (e->frf.n_spoiled >= EXPERIMENT_N_SPOILED_MAX) {
        e->state = EXPERIMENT_STOPPED;
    }
}

static void judge(experiment *e, gsid_status status) {
    if (status == GSID_DONE || status == GSID_SPOILED) {
        judge_period(e);
    }
}

void experiment_skip(experiment *e) {
    if (e->state != EXPERIMENT_RUNNING) {
        return;
    }
    e->n_left_out -= e->n_left_out > 0 ? 1u : 0u;
    judge(e, gsid_frf_skip(&e->frf, 1));
}

void experiment_measure(experiment *e, gsid_real u, gsid_real y) {
    if (e->state != EXPERIMENT_RUNNING) {
        return;
    }
    const gsid_status status = e->n_left_out > 0 ? GSID_E_NONFINITE : gsid_frf_step(&e->frf, u, y);
    if (status == GSID_E_NONFINITE) {
        experiment_skip(e);
    } else {
        judge(e, status);
    }
}

void experiment_settle(experiment *e) {
    e->n_left_out = EXPERIMENT_N_SETTLE + 1;
    experiment_skip(e);
}

/* The best of the linear fits over a grid of delays. V has a local minimum every few samples of delay, and Gauss-Newton
 * converges to the one nearest to its start. */
static gsid_status start_of_fit(const gsid_frd *data, gsid_rational *model, void *work, size_t work_size) {
    const gsid_iwls_cfg cfg = {.n_iterations = 8};
    gsid_rational best = *model;
    gsid_real least = 0;
    gsid_status found = GSID_E_SINGULAR;
    for (uint32_t i = 0; i < N_DELAYS; i++) {
        gsid_rational trial = *model;
        gsid_real cost;
        trial.delay_s = (gsid_real)i * DELAY_STEP_S;
        const gsid_status status = gsid_estimate_iwls(data, &cfg, &trial, &cost, work, work_size);
        if (status >= 0 && (found < 0 || cost < least)) {
            best = trial;
            least = cost;
            found = status;
        }
    }
    *model = best;
    return found;
}

gsid_status experiment_fit(experiment *e) {
    const gsid_frf_out out = {.g = e->g, .var_g = e->sigma};
    gsid_status status = gsid_frf_result(&e->frf, &out);
    if (status != GSID_OK) {
        return status;
    }
    for (uint32_t i = 0; i < EXPERIMENT_N_LINES; i++) {
        e->f_hz[i] = (gsid_real)e->line[i] * (GSID_R(1.0) * EXPERIMENT_FS_HZ / EXPERIMENT_N_PERIOD);
        e->sigma[i] = SQRT(e->sigma[i]);
    }
    const gsid_frd data = {.n_lines = EXPERIMENT_N_LINES, .f_hz = e->f_hz, .g = e->g, .sigma = e->sigma};
    const gsid_ml_cfg ml = {.free_delay = 1};
    /* Powers of s are near 1 at a fast line, where the poles and zeros of interest are. */
    status = gsid_rational_init(&e->model, GSID_DOMAIN_S, EXPERIMENT_N_POLES, EXPERIMENT_N_ZEROS,
                                2 * PI * e->f_hz[EXPERIMENT_N_LINES - 1] / 4);
    if (status == GSID_OK) {
        status = start_of_fit(&data, &e->model, e->work, sizeof e->work);
    }
    return status < 0 ? status : gsid_estimate_ml(&data, &ml, &e->model, &e->cost, e->work, sizeof e->work);
}
