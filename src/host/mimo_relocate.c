/* Iteratively reweighted linear fits of many responses with common poles.  Eq: MIM-2 */
#include <math.h>
#include <string.h>

#include "../core/residual.h"
#include "fit_sections.h"
#include "mimo_run.h"
#include "roots.h"

#define DAMPING_FIRST 0.01 /* of the poles to begin with */
#define SWEEPS_MAX 200
#define POLE_TOLERANCE 1e-13

/* Lightly damped pairs, evenly over the band; the one that is left real, in its middle. */
void gsid_mimo_spread_poles(const mimo_run *r, mimo_candidate *c) {
    gsid_cplx pole[GSID_MIMO_POLES_MAX];
    const uint32_t n = r->cfg.n_poles, n_pairs = n / 2;
    const int in_s = r->cfg.domain == GSID_DOMAIN_S;
    const double w_max = in_s ? 1 : r->scale_rad_s * r->cfg.sample_s;
    for (uint32_t i = 0; i < n; i++) {
        const double w = w_max * (i / 2 + 0.5) / (n_pairs + (n % 2) * 0.5);
        const gsid_cplx s = {i / 2 < n_pairs ? -DAMPING_FIRST * w : -w_max / 2, i / 2 < n_pairs ? (i % 2 ? -w : w) : 0};
        pole[i] = in_s ? s : gsid_cplx_scale(exp(s.re), gsid_cplx_cis(s.im));
    }
    gsid_fit_sections_from_poles(r->cfg.domain, n, 0, pole, c->x);
}

/* Rows of one channel: sum of num phi - g' sum of c phi = g', g' the response without the delay. */
static gsid_status fill_channel(mimo_run *r, uint32_t channel, const double *q, double delay_s) {
    const gsid_frd *data = &r->channel[channel];
    const uint32_t n = r->cfg.n_poles;
    const gsid_mimo_channel model = gsid_mimo_channel_at(r, channel, q, delay_s);
    gsid_status status = gsid_mimo_begin(r, channel, n);
    for (uint32_t k = 0; k < data->n_lines && status == GSID_OK; k++) {
        gsid_cplx phi[GSID_MIMO_POLES_MAX + 1];
        const double weight = gsid_residual_weight(data, k);
        const gsid_cplx turn = gsid_cplx_cis(GSID_TWO_PI * data->f_hz[k] * delay_s);
        const gsid_cplx g = gsid_cplx_scale(weight, gsid_cplx_mul(turn, data->g[k]));
        gsid_mimo_basis(&model, gsid_mimo_variable(&model, data->f_hz[k]), phi);
        for (uint32_t i = 0; i < r->n_local; i++) {
            gsid_mimo_put(r, i, gsid_cplx_scale(weight, phi[i]));
        }
        for (uint32_t i = 0; i < n; i++) {
            gsid_mimo_put(r, r->n_local + i, gsid_cplx_scale(-1, gsid_cplx_mul(g, phi[i])));
        }
        gsid_mimo_put(r, r->n_local + n, g);
        status = gsid_mimo_next(r, &r->equations[channel]);
    }
    return status == GSID_OK ? gsid_mimo_end(r, &r->equations[channel]) : status;
}

/* f/f' at z of f = (1 + sum of c phi) times all sections, a polynomial of degree n_poles. */
static gsid_cplx newton_step(uint32_t n, const double *q, const double *c, gsid_cplx z) {
    gsid_cplx sigma = {1, 0}, d_sigma = {0, 0}, log_derivative = {0, 0};
    for (uint32_t first = 0; first < n; first += 2) {
        const int is_pair = gsid_fit_section_order(n, first) == 2;
        gsid_cplx s = {z.re + q[first], z.im}, ds = {1, 0}, num = {c[first], 0};
        const double b1 = is_pair ? c[first + 1] : 0;
        if (is_pair) {
            s = gsid_cplx_mul(z, gsid_cplx_make(z.re + q[first + 1], z.im));
            s.re += q[first];
            ds = gsid_cplx_make(2 * z.re + q[first + 1], 2 * z.im);
            num = gsid_cplx_make(num.re + b1 * z.re, b1 * z.im);
        }
        const gsid_cplx ratio = gsid_cplx_div(ds, s), term = gsid_cplx_div(num, s);
        sigma = gsid_cplx_add(sigma, term);
        const gsid_cplx slope = gsid_cplx_div(gsid_cplx_make(b1, 0), s);
        d_sigma = gsid_cplx_add(d_sigma, gsid_cplx_sub(slope, gsid_cplx_mul(term, ratio)));
        log_derivative = gsid_cplx_add(log_derivative, ratio);
    }
    log_derivative = gsid_cplx_add(log_derivative, gsid_cplx_div(d_sigma, sigma));
    return gsid_cplx_div(gsid_cplx_make(1, 0), log_derivative);
}

/* Roots of the sections, pushed off a little: there f is known as a ratio only, and real roots must not stay a pair. */
static void start_at_poles(uint32_t n, const double *q, gsid_cplx *z) {
    for (uint32_t first = 0; first < n; first += 2) {
        if (gsid_fit_section_order(n, first) == 1) {
            z[first] = gsid_cplx_make(-q[first], 0);
        } else {
            const double half = -q[first + 1] / 2, rest = half * half - q[first], root = sqrt(fabs(rest));
            z[first] = rest < 0 ? gsid_cplx_make(half, root) : gsid_cplx_make(half + root, 0);
            z[first + 1] = rest < 0 ? gsid_cplx_make(half, -root) : gsid_cplx_make(half - root, 0);
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        const double size = 1e-3 * (sqrt(gsid_cplx_abs2(z[i])) + 1e-3);
        z[i] = gsid_cplx_add(z[i], gsid_cplx_scale(size, gsid_cplx_cis(2.4 * i + 0.3)));
    }
}

/* Zeros of 1 + sum of c phi, by Aberth's iteration: no coefficients of a high polynomial are ever formed. */
static gsid_status find_zeros(uint32_t n, const double *q, const double *c, gsid_cplx *z) {
    uint32_t n_moving = n;
    start_at_poles(n, q, z);
    for (int sweep = 0; sweep < SWEEPS_MAX && n_moving > 0; sweep++) {
        n_moving = 0;
        for (uint32_t i = 0; i < n; i++) {
            const gsid_cplx step = newton_step(n, q, c, z[i]);
            const gsid_cplx one = {1, 0};
            gsid_cplx repulsion = {0, 0};
            for (uint32_t j = 0; j < n; j++) {
                if (j != i) {
                    repulsion = gsid_cplx_add(repulsion, gsid_cplx_div(one, gsid_cplx_sub(z[i], z[j])));
                }
            }
            const gsid_cplx shrink = gsid_cplx_sub(one, gsid_cplx_mul(step, repulsion));
            const gsid_cplx move = gsid_cplx_div(step, shrink);
            if (!gsid_cplx_is_finite(move)) { /* on a root, or on a stationary point, from which the others free it */
                continue;
            }
            z[i] = gsid_cplx_sub(z[i], move);
            n_moving += gsid_cplx_abs2(move) > POLE_TOLERANCE * POLE_TOLERANCE * (gsid_cplx_abs2(z[i]) + 1e-12);
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        if (!gsid_cplx_is_finite(z[i])) {
            return GSID_E_SINGULAR;
        }
    }
    gsid_pair_conjugates(n, z);
    return GSID_OK;
}

static gsid_status relocate_once(mimo_run *r, mimo_candidate *c) {
    double q[GSID_MIMO_POLES_MAX], sigma[GSID_MIMO_POLES_MAX];
    gsid_cplx z[GSID_MIMO_POLES_MAX];
    const uint32_t n = r->cfg.n_poles;
    gsid_mimo_sections(r, c->x, q);
    gsid_status status = GSID_OK;
    for (uint32_t channel = 0; channel < r->n_channels && status == GSID_OK; channel++) {
        status = fill_channel(r, channel, q, c->delay_s[channel]);
    }
    if (status == GSID_OK) {
        status = gsid_mimo_reduce(r, n);
    }
    gsid_lsq shared;
    if (status == GSID_OK) {
        status = gsid_lsq_init(&shared, n, r->lsq_mem, r->lsq_size);
    }
    if (status != GSID_OK) {
        return status;
    }
    memcpy(shared.r, r->shared, ((size_t)n + 1) * ((size_t)n + 1) * sizeof *shared.r);
    shared.n_rows = n + 1;
    status = gsid_lsq_solve(&shared, 0, sigma, NULL);
    if (status >= 0) {
        status = find_zeros(n, q, sigma, z);
    }
    if (status == GSID_OK) {
        gsid_fit_sections_from_poles(r->cfg.domain, n, r->cfg.allow_unstable, z, c->x);
    }
    for (uint32_t i = 0; i < n && status == GSID_OK; i++) {
        double lower, upper;
        gsid_mimo_bounds(r, i, &lower, &upper);
        c->x[i] = fmin(fmax(c->x[i], lower), upper);
    }
    return status;
}

/* The iterate of least V is kept: the iteration does not descend, and with noise it does not settle either. */
gsid_status gsid_mimo_relocate(mimo_run *r, uint32_t n_iterations, mimo_candidate *c) {
    mimo_candidate trial = *c, best = *c;
    gsid_status status = GSID_OK;
    best.cost = HUGE_VAL;
    for (uint32_t i = 0; i < n_iterations && status == GSID_OK; i++) {
        status = relocate_once(r, &trial);
        if (status != GSID_OK) {
            break;
        }
        gsid_mimo_solve(r, &trial);
        if (trial.cost < best.cost) {
            best = trial;
        }
    }
    if (!(best.cost < HUGE_VAL)) {
        return status < 0 ? status : GSID_E_SINGULAR;
    }
    *c = best;
    return GSID_OK;
}
