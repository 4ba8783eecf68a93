/* Gauss-Newton on the poles and delays that many responses share: the numerators are linear, and are solved for
 * wherever the poles go. Eq: MIM-3 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/residual.h"
#include "fit_sections.h"
#include "mimo_run.h"

#define DAMPING_FIRST 1e-3
#define DAMPING_LEAST 1e-12
#define DAMPING_MOST 1e8
#define DAMPING_FACTOR 4
#define ITERATIONS 60
#define TOLERANCE 0.005 /* as in gsid_estimate_ml: of V, or of V per line where that is less */
#define SHARED_MAX (GSID_MIMO_POLES_MAX + GSID_MIMO_CHANNELS_MAX)

/* Derivatives of the section that begins at `first` by its two numbers, at v: of its parameters x, or of q0 and q1
 * themselves. */
static void section_slopes(const mimo_run *r, const double *x, uint32_t first, gsid_cplx v, gsid_cplx *by) {
    const uint32_t order = gsid_fit_section_order(r->cfg.n_poles, first);
    if (x == NULL) {
        by[0] = gsid_cplx_make(1, 0);
        by[1] = v;
        return;
    }
    if (r->cfg.domain == GSID_DOMAIN_S) {
        gsid_fit_section_derivatives(GSID_DOMAIN_S, order, x + first, v, by);
        return;
    }
    gsid_fit_section_derivatives(GSID_DOMAIN_Z, order, x + first, gsid_cplx_div(gsid_cplx_make(1, 0), v), by);
    for (uint32_t i = 0; i < order; i++) {
        by[i] = gsid_cplx_mul(by[i], v);
        by[i] = order == 2 ? gsid_cplx_mul(by[i], v) : by[i];
    }
}

/* The two rows of one line: derivatives of the error by numerators, poles and delays, and the error's negative. */
static void fill_line(mimo_run *r, uint32_t channel, uint32_t k, const gsid_mimo_channel *model, const double *x) {
    const gsid_frd *data = &r->channel[channel];
    const uint32_t n = r->cfg.n_poles;
    const double w_rad_s = GSID_TWO_PI * data->f_hz[k];
    mimo_terms t;
    gsid_mimo_terms(model, data->f_hz[k], &t);
    const gsid_residual error = gsid_residual_at(data, k, t.g);
    for (uint32_t i = 0; i < r->n_local; i++) {
        gsid_mimo_put(r, i, gsid_residual_slope(&error, t.phi[i]));
    }
    for (uint32_t first = 0; first < n; first += 2) {
        gsid_cplx by[2];
        section_slopes(r, x, first, t.v, by);
        for (uint32_t i = 0; i < gsid_fit_section_order(n, first); i++) {
            const gsid_cplx slope = gsid_cplx_mul(t.by_section[first / 2], by[i]);
            gsid_mimo_put(r, r->n_local + first + i, gsid_residual_slope(&error, slope));
        }
    }
    for (uint32_t i = n; i < r->n_shared; i++) {
        gsid_mimo_put(r, r->n_local + i, gsid_cplx_make(0, 0));
    }
    if (r->n_shared > n) {
        gsid_mimo_put(r, r->n_local + n + r->cfg.delay_of[channel],
                      gsid_residual_slope(&error, gsid_cplx_make(w_rad_s * t.g.im, -w_rad_s * t.g.re)));
    }
    gsid_mimo_put(r, r->n_local + r->n_shared, gsid_cplx_scale(-1, error.value));
}

/* r->triangle and r->shared at a candidate whose numerators r->num holds; by_x 0: by q0 and q1. */
static gsid_status linearise(mimo_run *r, const mimo_candidate *c, int by_x) {
    double q[GSID_MIMO_POLES_MAX];
    gsid_status status = GSID_OK;
    gsid_mimo_sections(r, c->x, q);
    for (uint32_t channel = 0; channel < r->n_channels && status == GSID_OK; channel++) {
        const gsid_mimo_channel model = gsid_mimo_channel_at(r, channel, q, c->delay_s[channel]);
        status = gsid_mimo_begin(r, channel, r->n_shared);
        for (uint32_t k = 0; k < r->channel[channel].n_lines && status == GSID_OK; k++) {
            fill_line(r, channel, k, &model, by_x ? c->x : NULL);
            status = gsid_mimo_next(r, &r->equations[channel]);
        }
        if (status == GSID_OK) {
            status = gsid_mimo_end(r, &r->equations[channel]);
        }
    }
    return status == GSID_OK ? gsid_mimo_reduce(r, r->n_shared) : status;
}

/* A step of the shared parameters. */
typedef struct {
    double lower[SHARED_MAX], upper[SHARED_MAX]; /* of the step */
    double length[SHARED_MAX];                   /* of the columns, for the damping */
    int is_held[SHARED_MAX];                     /* 1: at a bound */
    double step[SHARED_MAX];
} shared_step;

static void set_limits(const mimo_run *r, const mimo_candidate *c, shared_step *s) {
    const uint32_t n = r->n_shared;
    const double limit_s = gsid_mimo_delay_limit(r);
    for (uint32_t j = 0; j < n; j++) {
        double least = 0, most = limit_s, now;
        if (j < r->cfg.n_poles) {
            now = c->x[j];
            gsid_mimo_bounds(r, j, &least, &most);
        } else {
            now = gsid_mimo_group_delay(r, j - r->cfg.n_poles, c);
            most = fmax(most, now); /* the scan's thinned lines may end lower: its limit is longer then */
        }
        s->lower[j] = least - now;
        s->upper[j] = most - now;
        s->length[j] = 0;
        for (uint32_t i = 0; i <= j; i++) {
            s->length[j] = hypot(s->length[j], r->shared[(size_t)i * (n + 1) + j]);
        }
        if (s->length[j] == 0) {
            s->length[j] = 1;
        }
    }
}

/* s->step <- the minimiser of |R step - rest|^2 + damping |D step|^2, the held ones where they are. */
static gsid_status solve_held(mimo_run *r, double damping, shared_step *s) {
    const uint32_t n = r->n_shared;
    gsid_lsq lsq;
    double row[SHARED_MAX], x[SHARED_MAX];
    gsid_status status = gsid_lsq_init(&lsq, n, r->lsq_mem, r->lsq_size);
    for (uint32_t i = 0; i < n && status == GSID_OK; i++) {
        double rest = r->shared[(size_t)i * (n + 1) + n];
        for (uint32_t j = 0; j < n; j++) {
            const double value = r->shared[(size_t)i * (n + 1) + j];
            row[j] = s->is_held[j] ? 0 : value;
            rest -= s->is_held[j] ? value * s->step[j] : 0;
        }
        status = gsid_lsq_add(&lsq, row, rest);
    }
    for (uint32_t i = 0; i < n && status == GSID_OK; i++) {
        memset(row, 0, sizeof row);
        row[i] = s->is_held[i] ? 0 : sqrt(damping) * s->length[i];
        status = gsid_lsq_add(&lsq, row, 0);
    }
    if (status == GSID_OK) {
        status = gsid_lsq_solve(&lsq, 0, x, NULL);
    }
    for (uint32_t i = 0; i < n && status >= 0; i++) {
        s->step[i] = s->is_held[i] ? s->step[i] : x[i];
    }
    return status;
}

/* The same within the limits: what goes beyond one is held there, and the others are solved for again. */
static gsid_status solve_bounded(mimo_run *r, double damping, shared_step *s) {
    memset(s->is_held, 0, sizeof s->is_held);
    for (int changed = 1; changed;) {
        changed = 0;
        const gsid_status status = solve_held(r, damping, s);
        if (status < 0) {
            return status;
        }
        for (uint32_t i = 0; i < r->n_shared; i++) {
            if (s->is_held[i] || (s->step[i] >= s->lower[i] && s->step[i] <= s->upper[i])) {
                continue;
            }
            s->step[i] = fmin(fmax(s->step[i], s->lower[i]), s->upper[i]);
            s->is_held[i] = changed = 1;
        }
    }
    return GSID_OK;
}

/* By how much the step lowers the linearised V. */
static double promised(const mimo_run *r, const shared_step *s) {
    const uint32_t n = r->n_shared;
    double drop = 0;
    for (uint32_t i = 0; i < n; i++) {
        const double *row = r->shared + (size_t)i * (n + 1);
        double left = row[n];
        for (uint32_t j = i; j < n; j++) {
            left -= row[j] * s->step[j];
        }
        drop += row[n] * row[n] - left * left;
    }
    return drop;
}

static void try_damping(mimo_run *r, const mimo_candidate *from, double damping, shared_step *s, mimo_candidate *to) {
    *to = *from;
    to->cost = HUGE_VAL;
    if (solve_bounded(r, damping, s) < 0) {
        return;
    }
    for (uint32_t i = 0; i < r->cfg.n_poles; i++) {
        to->x[i] += s->step[i];
    }
    for (uint32_t channel = 0; channel < r->n_channels && r->n_shared > r->cfg.n_poles; channel++) {
        to->delay_s[channel] += s->step[r->cfg.n_poles + r->cfg.delay_of[channel]];
    }
    gsid_mimo_solve(r, to);
}

/* The damping is raised until V falls; it is lowered for the next step. */
static void best_step(mimo_run *r, const mimo_candidate *from, double *damping, shared_step *s, mimo_candidate *to) {
    try_damping(r, from, *damping, s, to);
    while (!(to->cost < from->cost) && *damping < DAMPING_MOST) {
        *damping *= DAMPING_FACTOR;
        try_damping(r, from, *damping, s, to);
    }
    *damping = fmax(*damping / DAMPING_FACTOR, DAMPING_LEAST);
}

gsid_status gsid_mimo_search(mimo_run *r, mimo_candidate *c) {
    shared_step *s = calloc(1, sizeof *s);
    if (s == NULL) {
        return GSID_E_NO_MEMORY;
    }
    double n_lines = 0, damping = DAMPING_FIRST;
    for (uint32_t channel = 0; channel < r->n_channels; channel++) {
        n_lines += r->channel[channel].n_lines;
    }
    gsid_status status = GSID_OK;
    int settled = 0;
    gsid_mimo_solve(r, c);
    for (int i = 0; i < ITERATIONS && !settled && status >= 0; i++) {
        const double little = TOLERANCE * fmin(1, c->cost / n_lines);
        mimo_candidate trial;
        status = linearise(r, c, 1);
        if (status < 0) {
            break;
        }
        set_limits(r, c, s);
        status = solve_bounded(r, 0, s);
        settled = status >= 0 && promised(r, s) <= little;
        best_step(r, c, &damping, s, &trial);
        settled |= !(c->cost - trial.cost > little);
        if (trial.cost < c->cost) {
            *c = trial;
        }
    }
    gsid_mimo_solve(r, c);
    free(s);
    return status < 0 ? status : settled ? GSID_OK : GSID_MAX_ITER;
}

gsid_status gsid_mimo_covariance(mimo_run *r, const mimo_candidate *c, double *cov) {
    const size_t n = (size_t)r->n_channels * r->n_local + r->n_shared;
    const size_t size = gsid_lsq_mem_size((uint32_t)n);
    void *mem = malloc(size);
    gsid_lsq lsq;
    gsid_status status = mem == NULL ? GSID_E_NO_MEMORY : linearise(r, c, 0);
    if (status == GSID_OK) {
        status = gsid_lsq_init(&lsq, (uint32_t)n, mem, size);
    }
    if (status == GSID_OK) {
        memcpy(lsq.r, r->triangle, (n + 1) * (n + 1) * sizeof *lsq.r);
        lsq.n_rows = (uint32_t)n + 1;
        status = gsid_lsq_covariance(&lsq, cov);
    }
    for (size_t i = 0; i < n * n && status == GSID_OK; i++) {
        cov[i] /= 2; /* as in gsid_estimate_covariance */
    }
    free(mem);
    return status;
}
