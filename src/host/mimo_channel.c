/* The response of one channel of a model with common poles, and its derivatives.  Eq: MIM-1 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/complex_math.h"
#include "fit_sections.h"
#include "mimo_run.h"

gsid_cplx gsid_mimo_variable(const gsid_mimo_channel *c, double f_hz) {
    const double w_rad_s = GSID_TWO_PI * f_hz;
    if (c->domain == GSID_DOMAIN_Z) {
        return gsid_cplx_cis(w_rad_s * c->rate);
    }
    return gsid_cplx_make(0, w_rad_s / c->rate);
}

/* S of the section that begins with pole `first`. */
static gsid_cplx section_at(const gsid_mimo_channel *c, uint32_t first, gsid_cplx v) {
    const double *q = c->section + first;
    if (gsid_fit_section_order(c->n_poles, first) == 1) {
        return gsid_cplx_make(v.re + q[0], v.im);
    }
    gsid_cplx section = gsid_cplx_mul(v, gsid_cplx_make(v.re + q[1], v.im));
    section.re += q[0];
    return section;
}

void gsid_mimo_basis(const gsid_mimo_channel *c, gsid_cplx v, gsid_cplx *phi) {
    for (uint32_t first = 0; first < c->n_poles; first += 2) {
        phi[first] = gsid_cplx_div(gsid_cplx_make(1, 0), section_at(c, first, v));
        if (first + 1 < c->n_poles) {
            phi[first + 1] = gsid_cplx_mul(v, phi[first]);
        }
    }
    if (c->direct) {
        phi[c->n_poles] = gsid_cplx_make(1, 0);
    }
}

/* With N and S of a section, e the delay: dG/dS = -e N / S^2. */
void gsid_mimo_terms(const gsid_mimo_channel *c, double f_hz, mimo_terms *t) {
    const uint32_t n_local = c->n_poles + (c->direct != 0);
    const gsid_cplx turn = gsid_cplx_cis(-GSID_TWO_PI * f_hz * c->delay_s);
    t->v = gsid_mimo_variable(c, f_hz);
    t->g = gsid_cplx_make(0, 0);
    gsid_mimo_basis(c, t->v, t->phi);
    for (uint32_t i = 0; i < n_local; i++) {
        t->phi[i] = gsid_cplx_mul(turn, t->phi[i]);
        t->g = gsid_cplx_add(t->g, gsid_cplx_scale(c->num[i], t->phi[i]));
    }
    for (uint32_t first = 0; first < c->n_poles; first += 2) {
        gsid_cplx part = gsid_cplx_scale(c->num[first], t->phi[first]);
        if (first + 1 < c->n_poles) {
            part = gsid_cplx_add(part, gsid_cplx_scale(c->num[first + 1], t->phi[first + 1]));
        }
        t->by_section[first / 2] = gsid_cplx_scale(-1, gsid_cplx_div(part, section_at(c, first, t->v)));
    }
}

static gsid_status check(const gsid_mimo_channel *c, uint32_t n_freq, const double *f_hz, const gsid_cplx *out) {
    if (c == NULL || c->section == NULL || c->num == NULL || (n_freq > 0 && (f_hz == NULL || out == NULL))) {
        return GSID_E_NULL;
    }
    if (c->n_poles < 1 || c->n_poles > GSID_MIMO_POLES_MAX || !(c->rate > 0) || !isfinite(c->rate) ||
        (c->domain != GSID_DOMAIN_S && c->domain != GSID_DOMAIN_Z)) {
        return GSID_E_CONFIG;
    }
    return GSID_OK;
}

gsid_status gsid_mimo_response(const gsid_mimo_channel *channel, uint32_t n_freq, const double *f_hz, gsid_cplx *g) {
    gsid_status status = check(channel, n_freq, f_hz, g);
    for (uint32_t k = 0; k < n_freq && status == GSID_OK; k++) {
        mimo_terms t;
        gsid_mimo_terms(channel, f_hz[k], &t);
        status = gsid_cplx_is_finite(t.g) ? GSID_OK : GSID_E_NONFINITE;
        if (status == GSID_OK) {
            g[k] = t.g;
        }
    }
    return status;
}

gsid_status gsid_mimo_gradient(const gsid_mimo_channel *channel, uint32_t n_freq, const double *f_hz,
                               gsid_cplx *gradient) {
    gsid_status status = check(channel, n_freq, f_hz, gradient);
    for (uint32_t k = 0; k < n_freq && status == GSID_OK; k++) {
        const double w_rad_s = GSID_TWO_PI * f_hz[k];
        mimo_terms t;
        gsid_mimo_terms(channel, f_hz[k], &t);
        status = gsid_cplx_is_finite(t.g) ? GSID_OK : GSID_E_NONFINITE;
        for (uint32_t i = 0; i < channel->n_poles + (channel->direct != 0) && status == GSID_OK; i++) {
            *gradient++ = t.phi[i];
        }
        for (uint32_t i = 0; i < channel->n_poles && status == GSID_OK; i++) {
            const gsid_cplx slope = t.by_section[i / 2];
            *gradient++ = i % 2 == 0 ? slope : gsid_cplx_mul(slope, t.v);
        }
        if (status == GSID_OK) {
            *gradient++ = gsid_cplx_make(w_rad_s * t.g.im, -w_rad_s * t.g.re);
        }
    }
    return status;
}

/* The section that begins with pole `first` as a transfer function; its scale is the size of its poles, for the exponential. */
static gsid_status section_model(const gsid_mimo_channel *c, uint32_t first, gsid_rational *model) {
    const double *q = c->section + first, *b = c->num + first;
    const uint32_t order = gsid_fit_section_order(c->n_poles, first);
    double size = order == 2 ? fmax(sqrt(fabs(q[0])), fabs(q[1])) : fabs(q[0]);
    size = size > 0 ? size : 1;
    const gsid_status status = gsid_rational_init(model, GSID_DOMAIN_S, order, order - 1, c->rate * size);
    if (status != GSID_OK) {
        return GSID_E_NONFINITE;
    }
    double power = size;
    model->den[order] = 1;
    for (uint32_t i = order; i-- > 0; power *= size) {
        model->den[i] = q[i] / power;
        model->num[i] = b[i] / power;
    }
    model->delay_s = c->delay_s;
    return GSID_OK;
}

gsid_status gsid_mimo_hold_response(const gsid_mimo_channel *channel, double sample_s, uint32_t n_freq,
                                    const double *f_hz, gsid_cplx *g) {
    gsid_status status = check(channel, n_freq, f_hz, g);
    if (status != GSID_OK) {
        return status;
    }
    if (channel->domain != GSID_DOMAIN_S || channel->direct) {
        return GSID_E_CONFIG;
    }
    gsid_cplx *total = calloc(2 * (size_t)n_freq + 1, sizeof *total), *part = total == NULL ? NULL : total + n_freq;
    status = total == NULL ? GSID_E_NO_MEMORY : GSID_OK;
    for (uint32_t first = 0; first < channel->n_poles && status == GSID_OK; first += 2) {
        gsid_rational model;
        status = section_model(channel, first, &model);
        if (status == GSID_OK) {
            status = gsid_hold_response(&model, sample_s, n_freq, f_hz, part);
        }
        for (uint32_t k = 0; k < n_freq && status == GSID_OK; k++) {
            total[k] = gsid_cplx_add(total[k], part[k]);
        }
    }
    if (status == GSID_OK && n_freq > 0) {
        memcpy(g, total, n_freq * sizeof *g);
    }
    free(total);
    return status;
}
