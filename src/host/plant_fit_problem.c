#include "plant_fit_problem.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "gsid/catalogue.h"
#include "gsid/effect_facts.h"
#include "gsid/host/batch.h"
#include "gsid/host/greybox.h"

#define PI 3.14159265358979323846

typedef gsid_fit_problem problem;
typedef gsid_fit_part part;

/* ---- memory ---- */

static void *get(problem *p, size_t n, size_t size) {
    void **more = realloc(p->memory, (p->n_memory + 1) * sizeof *more);
    void *taken = calloc(n > 0 ? n : 1, size);
    if (more == NULL || taken == NULL) {
        free(taken);
        p->memory = more == NULL ? p->memory : more;
        p->failure = GSID_E_NO_MEMORY;
        return NULL;
    }
    p->memory = more;
    p->memory[p->n_memory++] = taken;
    return taken;
}

void gsid_fit_problem_free(gsid_fit_problem *p) {
    for (uint32_t i = 0; i < p->cfg->n_records && p->part != NULL; i++) {
        gsid_steady_destroy(p->part[i].steady);
    }
    for (size_t i = 0; i < p->n_memory; i++) {
        free(p->memory[i]);
    }
    free(p->memory);
}

/* ---- unknowns ---- */

static const gsid_effect_parameter *parameter(const problem *p, uint32_t i) {
    const gsid_plant_cfg *plant = &p->cfg->record[0].input.plant;
    const gsid_plant_free *one = &plant->free_parameter[i];
    return &plant->item[one->item].effect->parameter[one->parameter];
}

static double start_value(const problem *p, uint32_t record, uint32_t i) {
    const gsid_plant_cfg *plant = &p->cfg->record[record].input.plant;
    const gsid_plant_free *one = &plant->free_parameter[i];
    return plant->item[one->item].value[one->parameter];
}

static int is_own(const problem *p, uint32_t i) {
    return p->cfg->is_own != NULL && p->cfg->is_own[i];
}

/* Number of the unknown that holds a free parameter of a record. */
static size_t unknown(const problem *p, uint32_t record, uint32_t i) {
    return is_own(p, i) ? (size_t)record * p->n_own + p->column[i]
                        : (size_t)p->cfg->n_records * p->n_own + p->column[i] - p->n_own;
}

static double bound(const double *given, uint32_t i, double own, double null_value, double (*outer)(double, double)) {
    return given != NULL ? given[i] : outer(own, null_value); /* fmin and fmax leave a NaN out */
}

static void set_unknowns(problem *p) {
    const gsid_plant_fit_cfg *cfg = p->cfg;
    uint32_t n_own = 0, n_shared = 0;
    for (uint32_t i = 0; i < p->n_free; i++) {
        p->column[i] = is_own(p, i) ? n_own++ : p->n_own + n_shared++;
        /* A strength may be small beside its typical value, a shape may not. */
        p->least_size[i] = isnan(parameter(p, i)->null_value) ? 0 : fabs(parameter(p, i)->typical);
    }
    for (uint32_t r = 0; r < cfg->n_records; r++) {
        for (uint32_t i = 0; i < p->n_free; i++) {
            const gsid_effect_parameter *known = parameter(p, i);
            const size_t at = unknown(p, r, i);
            p->lower[at] = bound(cfg->lower, i, known->lower, known->null_value, fmin);
            p->upper[at] = bound(cfg->upper, i, known->upper, known->null_value, fmax);
            if (is_own(p, i) || r == 0) {
                p->start[at] = start_value(p, r, i);
            }
        }
        if (cfg->has_drift) {
            p->lower[(r + 1) * p->n_own - 1] = -INFINITY;
            p->upper[(r + 1) * p->n_own - 1] = INFINITY;
        }
    }
}

/* With backlash, a response that does not settle soon usually never does: it is not simulated longer, and not followed. */
static int has_backlash(const gsid_plant_cfg *plant) {
    for (uint32_t i = 0; i < plant->n_items; i++) {
        for (uint32_t k = 0; k < gsid_n_catalogue; k++) {
            const gsid_effect_facts *facts = gsid_catalogue_facts[k];
            if (facts->effect == plant->item[i].effect && facts->linear_part == GSID_LINEAR_BACKLASH) {
                return 1;
            }
        }
    }
    return 0;
}

/* ---- weights ---- */

static double less_one(double dof) { /* (dof - 1) / dof */
    return isinf(dof) ? 1 : (dof - 1) / dof;
}

static void set_weights(const problem *p, part *one) {
    const gsid_plant_fit_record *cfg = one->cfg;
    double largest = 0, sum = 0;
    for (uint32_t k = 0; k < cfg->n_lines; k++) {
        largest = fmax(largest, hypot(cfg->y[k].re, cfg->y[k].im));
    }
    const double least = fmax(pow(p->cfg->settings.noise_floor * largest, 2), DBL_MIN);
    for (uint32_t k = 0; k < cfg->n_lines; k++) {
        const double variance = fmax(cfg->variance[k], least), parts = cfg->line[k] == 0 ? 1 : 2;
        /* The mean of 1/s^2 is nu / (nu - 1) times that of 1/variance. */
        one->weight[k] = one->of_noise[k] = sqrt(less_one(cfg->dof) * parts * cfg->n_periods / variance);
        sum += variance;
    }
    one->noise_rms = sqrt(sum / (2 * cfg->n_periods));
}

static double quietest(const problem *p) {
    double least = INFINITY;
    for (uint32_t r = 0; r < p->cfg->n_records; r++) {
        for (uint32_t k = 0; k < p->part[r].cfg->n_lines; k++) {
            least = fmin(least, 1 / (p->part[r].of_noise[k] * p->part[r].of_noise[k]));
        }
    }
    return least;
}

static void scale_row(double *row, size_t n, double factor) {
    for (size_t i = 0; i < n; i++) {
        row[i] *= factor;
    }
}

void gsid_fit_problem_weigh(gsid_fit_problem *p, int power) {
    const double unit = quietest(p);
    const size_t width = (size_t)p->n_own + p->n_shared + 1;
    for (uint32_t r = 0; r < p->cfg->n_records; r++) {
        part *one = &p->part[r];
        double *row = one->state[p->kept].row;
        for (uint32_t k = 0; k < one->cfg->n_lines; k++) {
            /* The mean square of a cosine is half its squared amplitude. */
            const double equal = sqrt((one->cfg->line[k] == 0 ? 2 : 1) / unit);
            const double weight = one->of_noise[k] * pow(equal / one->of_noise[k], power);
            scale_row(row + k * width, width, weight / one->weight[k]);
            scale_row(row + (one->cfg->n_lines + k) * width, width, weight / one->weight[k]);
            one->weight[k] = weight;
        }
    }
}

double gsid_fit_problem_dof(const gsid_fit_problem *p) {
    double least = INFINITY;
    for (uint32_t r = 0; r < p->cfg->n_records; r++) {
        least = fmin(least, p->part[r].cfg->dof);
    }
    return least;
}

/* ---- equations ---- */

/* Line k of n / N - (N - 1) / (2 N): the sum of n w^n over a period is N / (w - 1) if w^N = 1. */
static gsid_cplx ramp(uint32_t line, uint32_t n_period) {
    if (line == 0) {
        return (gsid_cplx){0, 0};
    }
    return (gsid_cplx){-1.0 / n_period, 1 / (tan(PI * line / n_period) * n_period)};
}

static void put(const part *one, gsid_fit_state *to, size_t width, uint32_t k, uint32_t column, gsid_cplx value) {
    to->row[k * width + column] = value.re * one->weight[k];
    to->row[(one->cfg->n_lines + k) * width + column] = one->cfg->line[k] == 0 ? 0 : value.im * one->weight[k];
}

static void make_rows(const problem *p, const part *one, gsid_fit_state *to, double drift) {
    const uint32_t n_lines = one->cfg->n_lines;
    const size_t width = (size_t)p->n_own + p->n_shared + 1;
    for (uint32_t k = 0; k < n_lines; k++) {
        gsid_cplx error = {one->cfg->y[k].re - one->line[k].re, one->cfg->y[k].im - one->line[k].im};
        if (p->cfg->has_drift) {
            const gsid_cplx slope = ramp(one->cfg->line[k], one->cfg->input.n_period);
            put(one, to, width, k, p->n_own - 1, slope);
            error.re -= drift * slope.re;
            error.im -= drift * slope.im;
        }
        for (uint32_t i = 0; i < p->n_free; i++) {
            put(one, to, width, k, p->column[i], one->line[(size_t)(1 + i) * n_lines + k]);
        }
        put(one, to, width, k, (uint32_t)width - 1, error);
    }
}

/* Simulate one record and make its equations: independent of the other records. */
static void simulate(void *of_work, uint32_t record) {
    problem *p = of_work;
    part *one = &p->part[record];
    gsid_fit_state *to = &one->state[1 - p->kept];
    const gsid_plant_fit_record *cfg = one->cfg;
    for (uint32_t i = 0; i < p->n_free; i++) {
        one->value[i] = p->x[unknown(p, record, i)];
    }
    one->status = gsid_steady_run(one->steady, one->value, !p->has_backlash, &to->answer);
    if (one->status == GSID_OK) {
        one->status =
            gsid_batch_spectra(1 + p->n_free, cfg->input.n_period, to->signal, cfg->n_lines, cfg->line, one->line);
    }
    if (one->status == GSID_OK) {
        make_rows(p, one, to, p->cfg->has_drift ? p->x[(size_t)(record + 1) * p->n_own - 1] : 0);
    }
}

static gsid_status simulate_all(problem *p) {
    const uint32_t n = p->cfg->n_records;
    for (uint32_t r = 0; r < n; r++) {
        p->part[r].status = GSID_E_STATE; /* should the caller leave one out */
    }
    if (p->cfg->each != NULL) {
        if (p->cfg->each(p->cfg->user, n, simulate, p) != 0) {
            return GSID_E_STOPPED;
        }
    } else {
        for (uint32_t r = 0; r < n; r++) {
            simulate(p, r);
        }
    }
    for (uint32_t r = 0; r < n; r++) {
        if (p->part[r].status < 0) {
            return p->part[r].status;
        }
    }
    return GSID_OK;
}

/* ---- reduction ---- */

static double size_of(const problem *p, const double *x, uint32_t j) {
    const size_t n_all_own = (size_t)p->cfg->n_records * p->n_own;
    const uint32_t column = j < n_all_own ? j % p->n_own : (uint32_t)(j - n_all_own) + p->n_own;
    for (uint32_t i = 0; i < p->n_free; i++) {
        if (p->column[i] == column) {
            return fmax(fabs(x[j]), p->least_size[i]);
        }
    }
    return INFINITY; /* a drift is never held */
}

static void hold_silent(const problem *p, const double *x, double *r) {
    for (uint32_t j = 0; j < p->n; j++) {
        double length = 0;
        for (uint32_t i = 0; i < p->n; i++) {
            length = hypot(length, r[(size_t)i * p->n + j]);
        }
        if (length * size_of(p, x, j) < p->cfg->settings.silent) {
            for (uint32_t i = 0; i < p->n; i++) {
                r[(size_t)i * p->n + j] = 0;
            }
        }
    }
}

static double cost_of(const problem *p, int state) {
    const size_t width = (size_t)p->n_own + p->n_shared + 1;
    double sum = 0;
    for (uint32_t i = 0; i < p->cfg->n_records; i++) {
        for (size_t k = 0; k < 2 * (size_t)p->part[i].cfg->n_lines; k++) {
            const double residual = p->part[i].state[state].row[(k + 1) * width - 1];
            sum += residual * residual;
        }
    }
    return sum;
}

static gsid_status reduce(problem *p, int state, const double *x, double *cost, double *r, double *q) {
    const uint32_t n = p->n;
    *cost = cost_of(p, state);
    if (!isfinite(*cost)) {
        return GSID_E_NONFINITE;
    }
    for (uint32_t i = 0; i < p->cfg->n_records; i++) {
        p->rows[i] = p->part[i].state[state].row;
    }
    const gsid_arrow arrow = {p->cfg->n_records, p->n_own, p->n_shared, p->n_rows, p->rows};
    const gsid_status status = gsid_arrow_reduce(&arrow, p->triangle);
    if (status != GSID_OK) {
        return status;
    }
    for (uint32_t i = 0; i < n; i++) {
        memcpy(r + (size_t)i * n, p->triangle + (size_t)i * (n + 1), n * sizeof *r);
        q[i] = p->triangle[(size_t)i * (n + 1) + n];
    }
    hold_silent(p, x, r);
    return GSID_OK;
}

gsid_status gsid_fit_problem_at(void *user, const double *x, double *cost, double *r, double *q) {
    problem *p = user;
    if (p->failure != GSID_OK) {
        return p->failure;
    }
    p->x = x;
    gsid_status status = simulate_all(p);
    if (status == GSID_OK) {
        status = reduce(p, 1 - p->kept, x, cost, r, q);
    }
    for (uint32_t i = 0; i < p->cfg->n_records && status == GSID_OK && p->has_backlash; i++) {
        const double change = p->part[i].state[1 - p->kept].answer.residual;
        status = change > p->cfg->settings.unsettled * p->part[i].noise_rms ? GSID_MAX_ITER : GSID_OK;
    }
    return status;
}

void gsid_fit_problem_keep(void *user) {
    problem *p = user;
    p->kept = 1 - p->kept;
    for (uint32_t i = 0; i < p->cfg->n_records && p->keeps_orbit; i++) {
        const gsid_status status = gsid_steady_keep(p->part[i].steady);
        p->failure = status < 0 ? status : p->failure;
    }
}

gsid_status gsid_fit_problem_kept(gsid_fit_problem *p, const double *x, double *cost, double *r, double *q) {
    return reduce(p, p->kept, x, cost, r, q);
}

/* ---- layout ---- */

static void lay_out_state(problem *p, const part *one, gsid_fit_state *state) {
    const size_t n = one->cfg->input.n_period;
    state->row = get(p, 2 * one->cfg->n_lines * ((size_t)p->n_own + p->n_shared + 1), sizeof *state->row);
    state->signal = get(p, (1 + (size_t)p->n_free) * n, sizeof *state->signal);
    state->answer.y = state->signal;
    state->answer.dy = state->signal == NULL ? NULL : state->signal + n;
    state->answer.angle = get(p, n, sizeof *state->answer.angle);
    state->answer.rate = get(p, n, sizeof *state->answer.rate);
}

static gsid_status lay_out_part(problem *p, uint32_t record) {
    part *one = &p->part[record];
    one->cfg = &p->cfg->record[record];
    const uint32_t n_lines = one->cfg->n_lines;
    p->n_rows[record] = 2 * n_lines;
    one->of_noise = get(p, n_lines, sizeof *one->of_noise);
    one->weight = get(p, n_lines, sizeof *one->weight);
    one->value = get(p, p->n_free, sizeof *one->value);
    one->line = get(p, (1 + (size_t)p->n_free) * n_lines, sizeof *one->line);
    lay_out_state(p, one, &one->state[0]);
    lay_out_state(p, one, &one->state[1]);
    if (p->failure != GSID_OK) {
        return p->failure;
    }
    set_weights(p, one);
    gsid_steady_cfg input = one->cfg->input;
    input.tolerance = p->cfg->settings.settled * one->noise_rms;
    return gsid_steady_create(&input, &one->steady);
}

gsid_status gsid_fit_problem_make(const gsid_plant_fit_cfg *cfg, gsid_fit_problem *p) {
    *p = (gsid_fit_problem){.cfg = cfg, .n_free = cfg->record[0].input.plant.n_free};
    p->keeps_orbit = cfg->solver != GSID_SOLVER_NLOPT; /* NLopt's points do not follow each other */
    p->has_backlash = has_backlash(&cfg->record[0].input.plant);
    p->n_own = cfg->has_drift ? 1 : 0;
    for (uint32_t i = 0; i < p->n_free; i++) {
        *(is_own(p, i) ? &p->n_own : &p->n_shared) += 1;
    }
    p->n = cfg->n_records * p->n_own + p->n_shared;
    p->column = get(p, p->n_free, sizeof *p->column);
    p->least_size = get(p, p->n_free, sizeof *p->least_size);
    p->lower = get(p, p->n, sizeof *p->lower);
    p->upper = get(p, p->n, sizeof *p->upper);
    p->start = get(p, p->n, sizeof *p->start);
    p->part = get(p, cfg->n_records, sizeof *p->part);
    p->n_rows = get(p, cfg->n_records, sizeof *p->n_rows);
    p->rows = get(p, cfg->n_records, sizeof *p->rows);
    p->triangle = get(p, ((size_t)p->n + 1) * (p->n + 1), sizeof *p->triangle);
    gsid_status status = p->failure;
    if (status == GSID_OK) {
        set_unknowns(p);
    }
    for (uint32_t r = 0; r < cfg->n_records && status == GSID_OK; r++) {
        status = lay_out_part(p, r);
    }
    return status;
}
