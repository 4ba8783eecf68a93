/* What the steps of a MIMO fit share: the model, its equations, its delays. */
#include "mimo_run.h"

#include <math.h>
#include <string.h>

#include "../core/residual.h"
#include "fit_run.h"
#include "fit_sections.h"

#define FARTHEST 100   /* of a pole, in units of the highest frequency */
#define SCAN_PERIODS 3 /* of the highest frequency: the default range of delays */

/* ---- the model */

gsid_mimo_channel gsid_mimo_channel_at(const mimo_run *r, uint32_t channel, const double *q, double delay_s) {
    const gsid_mimo_channel c = {.domain = r->cfg.domain,
                                 .n_poles = r->cfg.n_poles,
                                 .direct = r->cfg.direct,
                                 .rate = r->cfg.domain == GSID_DOMAIN_Z ? r->cfg.sample_s : r->scale_rad_s,
                                 .section = q,
                                 .num = r->num + (size_t)channel * r->n_local,
                                 .delay_s = delay_s};
    return c;
}

void gsid_mimo_sections(const mimo_run *r, const double *x, double *q) {
    const int in_s = r->cfg.domain == GSID_DOMAIN_S;
    for (uint32_t first = 0; first < r->cfg.n_poles; first += 2) {
        double c[3];
        const uint32_t order = gsid_fit_section_order(r->cfg.n_poles, first);
        gsid_fit_section_coefficients(r->cfg.domain, order, x + first, c);
        q[first] = in_s ? c[0] : c[order];
        if (order == 2) {
            q[first + 1] = c[1];
        }
    }
}

void gsid_mimo_bounds(const mimo_run *r, uint32_t j, double *lower, double *upper) {
    const int is_product = j % 2 == 0 && gsid_fit_section_order(r->cfg.n_poles, j) == 2;
    gsid_fit_section_bounds(r->cfg.domain, lower, upper);
    *lower = r->cfg.allow_unstable ? -HUGE_VAL : *lower;
    *upper = r->cfg.allow_unstable ? HUGE_VAL : fmin(*upper, is_product ? FARTHEST * FARTHEST : FARTHEST);
}

/* ---- equations */

gsid_status gsid_mimo_begin(mimo_run *r, uint32_t channel, uint32_t n_shared) {
    r->n_waiting = 0;
    return gsid_lsq_init(&r->equations[channel], r->n_local + n_shared, r->mem[channel], r->mem_size);
}

void gsid_mimo_put(mimo_run *r, uint32_t column, gsid_cplx value) {
    double *at = r->block + (size_t)column * GSID_LSQ_BLOCK + r->n_waiting;
    at[0] = value.re;
    at[1] = value.im;
}

gsid_status gsid_mimo_end(mimo_run *r, gsid_lsq *equations) {
    const uint32_t n_rows = r->n_waiting;
    r->n_waiting = 0;
    return n_rows > 0 ? gsid_lsq_add_block(equations, n_rows, r->block) : GSID_OK;
}

gsid_status gsid_mimo_next(mimo_run *r, gsid_lsq *equations) {
    r->n_waiting += 2;
    return r->n_waiting < GSID_LSQ_BLOCK ? GSID_OK : gsid_mimo_end(r, equations);
}

double gsid_mimo_solve_channel(mimo_run *r, uint32_t channel, const double *q, double delay_s) {
    const gsid_frd *data = &r->channel[channel];
    const gsid_mimo_channel model = gsid_mimo_channel_at(r, channel, q, delay_s);
    gsid_lsq *equations = &r->equations[channel];
    double cost = HUGE_VAL;
    gsid_status status = gsid_mimo_begin(r, channel, 0);
    for (uint32_t k = 0; k < data->n_lines && status == GSID_OK; k++) {
        gsid_cplx phi[GSID_MIMO_POLES_MAX + 1];
        const gsid_cplx turn = gsid_cplx_cis(-GSID_TWO_PI * data->f_hz[k] * delay_s);
        const gsid_residual error = gsid_residual_at(data, k, gsid_cplx_make(0, 0));
        gsid_mimo_basis(&model, gsid_mimo_variable(&model, data->f_hz[k]), phi);
        for (uint32_t i = 0; i < r->n_local; i++) {
            gsid_mimo_put(r, i, gsid_residual_slope(&error, gsid_cplx_mul(turn, phi[i])));
        }
        gsid_mimo_put(r, r->n_local, gsid_cplx_scale(-1, error.value));
        status = gsid_mimo_next(r, equations);
    }
    if (status == GSID_OK) {
        status = gsid_mimo_end(r, equations);
    }
    if (status == GSID_OK) {
        status = gsid_lsq_solve(equations, 0, r->num + (size_t)channel * r->n_local, &cost);
    }
    return status >= 0 && isfinite(cost) ? cost : HUGE_VAL;
}

void gsid_mimo_solve(mimo_run *r, mimo_candidate *c) {
    double q[GSID_MIMO_POLES_MAX];
    gsid_mimo_sections(r, c->x, q);
    c->cost = 0;
    for (uint32_t channel = 0; channel < r->n_channels; channel++) {
        c->cost += gsid_mimo_solve_channel(r, channel, q, c->delay_s[channel]);
    }
}

gsid_status gsid_mimo_reduce(mimo_run *r, uint32_t n_shared) {
    const size_t first = (size_t)r->n_channels * r->n_local, width = first + n_shared + 1;
    for (uint32_t channel = 0; channel < r->n_channels; channel++) {
        r->row[channel] = r->equations[channel].r; /* a triangle is as good as the rows it came from */
        r->n_rows[channel] = r->n_local + n_shared + 1;
    }
    const gsid_arrow arrow = {r->n_channels, r->n_local, n_shared, r->n_rows, r->row};
    const gsid_status status = gsid_arrow_reduce(&arrow, r->triangle);
    for (size_t i = 0; i <= n_shared && status == GSID_OK; i++) {
        memcpy(r->shared + i * (n_shared + 1), r->triangle + (first + i) * width + first,
               ((size_t)n_shared + 1) * sizeof *r->shared);
    }
    return status;
}

/* ---- delays */

double gsid_mimo_highest_frequency(uint32_t n_channels, const gsid_frd *channel) {
    double f_hz = 0;
    for (uint32_t i = 0; i < n_channels; i++) {
        f_hz = fmax(f_hz, gsid_fit_highest_frequency(&channel[i]));
    }
    return f_hz;
}

double gsid_mimo_delay_limit(const mimo_run *r) {
    if (r->cfg.delay_max_s > 0) {
        return r->cfg.delay_max_s;
    }
    return SCAN_PERIODS / gsid_mimo_highest_frequency(r->n_channels, r->channel);
}

double gsid_mimo_group_delay(const mimo_run *r, uint32_t group, const mimo_candidate *c) {
    uint32_t channel = 0;
    while (channel + 1 < r->n_channels && r->cfg.delay_of[channel] != group) {
        channel++;
    }
    return c->delay_s[channel];
}

void gsid_mimo_set_group(const mimo_run *r, uint32_t group, double value, double *of_channel) {
    for (uint32_t channel = 0; channel < r->n_channels; channel++) {
        if (r->cfg.delay_of[channel] == group) {
            of_channel[channel] = value;
        }
    }
}

double gsid_mimo_group_cost(mimo_run *r, const double *q, uint32_t group, double delay_s) {
    double cost = 0;
    for (uint32_t channel = 0; channel < r->n_channels; channel++) {
        if (r->cfg.delay_of[channel] == group) {
            cost += gsid_mimo_solve_channel(r, channel, q, delay_s);
        }
    }
    return cost;
}
