/* What the tests of the estimators share: a model, its response in long double, and lines measured from it. */
#ifndef ESTIMATE_BENCH_H
#define ESTIMATE_BENCH_H

#include <complex.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "gsid/estimate.h"
#include "reference.h"

typedef long double complex wide;

enum { N_LINES = 500, N_MAX = GSID_RATIONAL_PARAMETERS_MAX };

static gsid_real f_hz[N_LINES], sigma[N_LINES];
static gsid_cplx g[N_LINES];
static gsid_real memory[GSID_ESTIMATE_MEM_SIZE(9, 8) / sizeof(gsid_real) + 1];

static uint32_t seed;

static inline double draw(void) {
    seed = 1664525u * seed + 1013904223u;
    return (seed + 0.5) / 4294967296.0;
}

static inline double draw_normal(void) {
    const double size = sqrt(-2 * log(draw()));
    return size * cos(2 * (double)PI_L * draw());
}

static inline gsid_frd data_of(uint32_t n_lines, const gsid_real *s) {
    const gsid_frd data = {.n_lines = n_lines, .f_hz = f_hz, .g = g, .sigma = s};
    return data;
}

static inline gsid_rational new_model(gsid_domain domain, uint32_t n_poles, uint32_t n_zeros, double rate) {
    gsid_rational m;
    memset(&m, 0, sizeof m); /* the padding too: whole objects are compared */
    assert_int_equal(gsid_rational_init(&m, domain, n_poles, n_zeros, (gsid_real)rate), GSID_OK);
    return m;
}

/* G of the model, in long double */
static inline wide response(const gsid_rational *m, long double f) {
    const long double w = 2 * PI_L * f;
    const wide v = m->domain == GSID_DOMAIN_S ? I * w / m->scale_rad_s : cexpl(-I * w * m->sample_s);
    wide a = 0, b = 0;
    for (uint32_t i = m->n_poles + 1; i-- > 0;) {
        a = a * v + m->den[i];
    }
    for (uint32_t i = m->n_zeros + 1; i-- > 0;) {
        b = b * v + m->num[i];
    }
    return cexpl(-I * w * m->delay_s) * b / a;
}

/* Lines from df on, without noise or with errors of standard deviation sigma. */
static inline void measure(const gsid_rational *truth, uint32_t n_lines, double df, int noisy) {
    for (uint32_t k = 0; k < n_lines; k++) {
        f_hz[k] = (gsid_real)(df * (k + 1));
        const wide exact = response(truth, f_hz[k]);
        const double error = noisy ? (double)sigma[k] / sqrt(2) : 0;
        g[k].re = (gsid_real)(creall(exact) + error * draw_normal());
        g[k].im = (gsid_real)(cimagl(exact) + error * draw_normal());
    }
}

/* a second order with a zero: poles at 0.3 of the scale, damping 0.3 */
static inline gsid_rational second_order(gsid_domain domain) {
    gsid_rational m = new_model(domain, 2, 1, domain == GSID_DOMAIN_S ? 2 * (double)PI_L * 50 : 0.005);
    const double den[2][3] = {{0.09, 0.18, 1}, {1, -1.5, 0.7}}, num[2] = {0.1, 0.05};
    for (int i = 0; i < 3; i++) {
        m.den[i] = (gsid_real)den[domain][i];
    }
    for (int i = 0; i < 2; i++) {
        m.num[i] = (gsid_real)num[i];
    }
    m.delay_s = (gsid_real)0.004;
    return m;
}

#endif
