/* What the steps of a rational fit share: properties of the run, and the best candidates. */
#include "fit_run.h"

#include <math.h>

#include "../core/complex_math.h"

double gsid_fit_highest_frequency(const gsid_frd *data) {
    double f = 0;
    for (uint32_t k = 0; k < data->n_lines; k++) {
        f = fmax(f, fabs(data->f_hz[k]));
    }
    return f;
}

uint32_t gsid_fit_n_parameters(const gsid_fit_cfg *cfg) {
    return cfg->n_poles + cfg->n_zeros + 1 + (cfg->delay == GSID_DELAY_FREE ? 1u : 0u);
}

int gsid_fit_is_linear(const fit_run *r) {
    return r->cfg.method == GSID_METHOD_LS || r->cfg.method == GSID_METHOD_IWLS;
}

double gsid_fit_equivalent_weight(const fit_run *r, const gsid_rational *model, uint32_t k) {
    if (!gsid_fit_is_linear(r)) {
        return 1 / r->sigma[k];
    }
    const double given = r->cfg.exponent > 0 ? r->cfg.exponent : 1;
    const double exponent = r->cfg.method == GSID_METHOD_LS ? 0 : given;
    const gsid_cplx v = gsid_rational_variable(model, GSID_TWO_PI * r->data->f_hz[k]);
    return pow(gsid_cplx_abs2(gsid_cplx_polynomial(model->n_poles, model->den, v)), (1 - exponent) / 2);
}

static int is_stable(const gsid_rational *model) {
    int stable = 0;
    return gsid_rational_is_stable(model, &stable) == GSID_OK && stable;
}

int gsid_fit_is_admissible(const fit_run *r, const gsid_rational *model) {
    const int late_enough =
        !r->cfg.bound_delay || r->cfg.delay != GSID_DELAY_FREE || model->delay_s >= r->cfg.delay_min_s;
    return (r->cfg.allow_unstable || is_stable(model)) && late_enough;
}

void gsid_fit_keep_best(const fit_candidate *c, uint32_t n_kept, fit_candidate *kept) {
    if (!(c->cost < kept[n_kept - 1].cost)) {
        return;
    }
    uint32_t i = n_kept - 1;
    for (; i > 0 && c->cost < kept[i - 1].cost; i--) {
        kept[i] = kept[i - 1];
    }
    kept[i] = *c;
}
