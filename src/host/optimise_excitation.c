#include "gsid/host/optimise_excitation.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "backend/backend.h"

static gsid_status check(const gsid_optimise_cfg *cfg, const double *phase_rad) {
    double largest = 0;
    if (cfg->n_lines < 1 || cfg->line[0] < 1 || cfg->line[cfg->n_lines - 1] > UINT32_C(1) << 24) {
        return GSID_E_CONFIG;
    }
    if (cfg->travel != NULL && (!(cfg->limit_command > 0) || !(cfg->limit_travel > 0))) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < cfg->n_lines; i++) {
        if (!isfinite(cfg->amplitude[i]) || !isfinite(phase_rad[i]) ||
            (cfg->travel != NULL && (!isfinite(cfg->travel[i].re) || !isfinite(cfg->travel[i].im)))) {
            return GSID_E_NONFINITE;
        }
        if (cfg->amplitude[i] < 0 || (i > 0 && cfg->line[i] <= cfg->line[i - 1])) {
            return GSID_E_CONFIG;
        }
        largest = fmax(largest, cfg->amplitude[i]);
    }
    return largest > 0 ? GSID_OK : GSID_E_CONFIG;
}

#ifdef GSID_WITH_NLOPT

enum { POINTS_PER_TURN = 16, ORDER_FIRST = 4, ORDER_LAST = 256, N_PER_STAGE = 150 };

/* A signal that is made small: the command, or the travel it causes. Its lines are line_k exp(j phase_k). */
typedef struct {
    const gsid_cplx *line; /* [n_lines] at phase 0, over the limit */
    double *x;             /* [n] samples, then what the gradient is made of */
} signal;

typedef struct {
    const gsid_optimise_cfg *cfg;
    gsid_real_transform *transform; /* as of gsid_transform_plan */
    uint32_t n, n_signals;
    unsigned order; /* of the norm: a power of 2 */
    signal signals[2];
    gsid_cplx *turn;     /* [n_lines] exp(j phase) */
    gsid_cplx *spectrum; /* [n / 2 + 1] */
    double least;        /* smallest peak met */
    double *best;        /* [n_lines] its phases */
} search;

static double make_samples(search *s, signal *a) {
    const gsid_optimise_cfg *cfg = s->cfg;
    memset(s->spectrum, 0, (s->n / 2 + 1) * sizeof *s->spectrum);
    for (uint32_t i = 0; i < cfg->n_lines; i++) {
        const gsid_cplx l = a->line[i], t = s->turn[i];
        /* half: the transform adds the negative frequencies */
        s->spectrum[cfg->line[i]] = (gsid_cplx){0.5 * (l.re * t.re - l.im * t.im), 0.5 * (l.re * t.im + l.im * t.re)};
    }
    gsid_transform_to_samples(s->transform, s->n, s->spectrum, a->x);
    double peak = 0;
    for (uint32_t i = 0; i < s->n; i++) {
        const double size = fabs(a->x[i]);
        peak = size > peak ? size : peak;
    }
    return peak;
}

/* x becomes (x/peak)^(order - 1); returns the sum of (x/peak)^order. */
static double raise(double *x, uint32_t n, double peak, unsigned order) {
    const double scale = 1 / peak;
    double sum = 0;
    for (uint32_t i = 0; i < n; i++) {
        const double v = x[i] * scale, v2 = v * v;
        double even = v2; /* v^(order - 2), by squaring: order - 2 = 2 + 4 + ... + order/2 */
        double power = v2;
        for (unsigned o = 4; o < order; o *= 2) {
            power *= power;
            even *= power;
        }
        x[i] = even * v;
        sum += x[i] * v;
    }
    return sum;
}

static void add_gradient(search *s, const signal *a, double scale, double *gradient) {
    const gsid_optimise_cfg *cfg = s->cfg;
    gsid_transform_to_lines(s->transform, s->n, a->x, s->spectrum);
    for (uint32_t i = 0; i < cfg->n_lines; i++) {
        const gsid_cplx l = a->line[i], t = s->turn[i], w = s->spectrum[cfg->line[i]];
        const gsid_cplx z = {l.re * t.re - l.im * t.im, l.re * t.im + l.im * t.re};
        gradient[i] -= scale * (z.im * w.re - z.re * w.im); /* Im(z conj(w)) */
    }
}

/* EXC-9: the logarithm of the norm, which keeps its slope whatever the order. */
static double objective(unsigned n_lines, const double *phase_rad, double *gradient, void *user) {
    search *s = user;
    for (unsigned i = 0; i < n_lines; i++) {
        s->turn[i] = (gsid_cplx){cos(phase_rad[i]), sin(phase_rad[i])};
    }
    double peak = 0;
    for (uint32_t k = 0; k < s->n_signals; k++) {
        peak = fmax(peak, make_samples(s, &s->signals[k]));
    }
    if (peak < s->least) {
        s->least = peak;
        memcpy(s->best, phase_rad, n_lines * sizeof *s->best);
    }
    double sum = 0;
    for (uint32_t k = 0; k < s->n_signals; k++) {
        sum += raise(s->signals[k].x, s->n, peak, s->order);
    }
    if (gradient != NULL) {
        memset(gradient, 0, n_lines * sizeof *gradient);
        for (uint32_t k = 0; k < s->n_signals; k++) {
            add_gradient(s, &s->signals[k], 1 / (peak * sum), gradient);
        }
    }
    return log(peak) + log(sum / s->n) / s->order;
}

static uint32_t grid_of(uint32_t top_line) {
    uint32_t n = 1024;
    while (n < POINTS_PER_TURN * top_line) {
        n *= 2;
    }
    return n;
}

static gsid_status search_phases(search *s, double *phase_rad) {
    const uint32_t n_max = s->cfg->n_per_stage > 0 ? s->cfg->n_per_stage : N_PER_STAGE;
    for (s->order = ORDER_FIRST; s->order <= ORDER_LAST; s->order *= 2) {
        if (gsid_nlopt_descend(s->cfg->n_lines, objective, s, (int)n_max, phase_rad) == GSID_E_NO_MEMORY) {
            return GSID_E_NO_MEMORY;
        }
    }
    return GSID_OK;
}

/* Lines of both signals at phase 0, each over its limit. */
static void fill_lines(const gsid_optimise_cfg *cfg, gsid_cplx *command, gsid_cplx *travel) {
    for (uint32_t i = 0; i < cfg->n_lines; i++) {
        const double a = cfg->amplitude[i];
        if (cfg->travel == NULL) {
            command[i] = (gsid_cplx){a, 0};
            continue;
        }
        command[i] = (gsid_cplx){a / cfg->limit_command, 0};
        travel[i] = (gsid_cplx){a * cfg->travel[i].re / cfg->limit_travel, a * cfg->travel[i].im / cfg->limit_travel};
    }
}

gsid_status gsid_optimise_phases(const gsid_optimise_cfg *cfg, double *phase_rad, double *peak) {
    if (cfg == NULL || cfg->line == NULL || cfg->amplitude == NULL || phase_rad == NULL || peak == NULL) {
        return GSID_E_NULL;
    }
    gsid_status status = check(cfg, phase_rad);
    if (status != GSID_OK) {
        return status;
    }
    const uint32_t n_lines = cfg->n_lines, n = grid_of(cfg->line[n_lines - 1]);
    search s = {.cfg = cfg, .n = n, .n_signals = cfg->travel == NULL ? 1 : 2, .least = INFINITY};
    status = gsid_transform_plan(n, &s.transform);
    if (status != GSID_OK) {
        return status;
    }
    gsid_cplx *lines = malloc((3 * (size_t)n_lines + n / 2 + 1) * sizeof *lines);
    double *reals = malloc((2 * (size_t)n + 2 * (size_t)n_lines) * sizeof *reals);
    if (lines != NULL && reals != NULL) {
        s.turn = lines + 2 * (size_t)n_lines;
        s.spectrum = s.turn + n_lines;
        s.best = reals + 2 * (size_t)n;
        double *phase = s.best + n_lines;
        for (uint32_t k = 0; k < 2; k++) {
            s.signals[k] = (signal){lines + (size_t)k * n_lines, reals + (size_t)k * n};
        }
        fill_lines(cfg, lines, lines + n_lines);
        memcpy(phase, phase_rad, n_lines * sizeof *phase);
        status = search_phases(&s, phase);
        if (status == GSID_OK) {
            memcpy(phase_rad, s.best, n_lines * sizeof *phase_rad);
            *peak = s.least;
        }
    } else {
        status = GSID_E_NO_MEMORY;
    }
    free(reals);
    free(lines);
    gsid_transform_forget(s.transform);
    return status;
}

#else

gsid_status gsid_optimise_phases(const gsid_optimise_cfg *cfg, double *phase_rad, double *peak) {
    if (cfg == NULL || cfg->line == NULL || cfg->amplitude == NULL || phase_rad == NULL || peak == NULL) {
        return GSID_E_NULL;
    }
    gsid_status status = check(cfg, phase_rad);
    return status == GSID_OK ? GSID_E_BACKEND : status;
}

#endif
