/* Fits of several responses with common poles: what is refused, what a failure leaves, and the answer's arrangement. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "gsid/host/mimo.h"

#define TWO_PI 6.283185307179586

enum { N_LINES = 60, N_CHANNELS = 2, N_POLES = 3 };

/* Poles -20 +- 300j and -100 rad/s; channel c has numerators of its own, and a delay. */
static gsid_cplx response(int channel, double f_hz, double delay_s) {
    const double w = TWO_PI * f_hz, q0 = 20.0 * 20 + 300.0 * 300, q1 = 40;
    const double re = q0 - w * w, im = q1 * w, size = re * re + im * im;
    const double b0 = channel == 0 ? 5e4 : -2e4, b1 = channel == 0 ? 30 : 200, c0 = channel == 0 ? 50 : 80;
    const double x = b0 * re + b1 * w * im, y = b1 * w * re - b0 * im; /* (b0 + j w b1) conj(section) */
    const double gr = x / size + c0 * 100 / (1e4 + w * w), gi = y / size - c0 * w / (1e4 + w * w);
    const double cosine = cos(w * delay_s), sine = -sin(w * delay_s);
    const gsid_cplx g = {gr * cosine - gi * sine, gr * sine + gi * cosine};
    return g;
}

typedef struct {
    double f_hz[N_LINES], sigma[N_LINES];
    gsid_cplx g[N_CHANNELS][N_LINES];
    gsid_frd channel[N_CHANNELS];
    gsid_mimo_cfg cfg;
    double section[N_POLES], num[N_CHANNELS * N_POLES], delay_s[N_CHANNELS];
    gsid_mimo_result result;
} bench;

static const uint32_t EACH[N_CHANNELS] = {0, 1};

static void make(bench *b) {
    const double delays[N_CHANNELS] = {1e-3, 2.2e-3};
    for (int k = 0; k < N_LINES; k++) {
        b->f_hz[k] = 2.0 * (k + 1);
        b->sigma[k] = 1e-6;
        for (int c = 0; c < N_CHANNELS; c++)
            b->g[c][k] = response(c, b->f_hz[k], delays[c]);
    }
    for (int c = 0; c < N_CHANNELS; c++) {
        const gsid_frd data = {.n_lines = N_LINES, .f_hz = b->f_hz, .g = b->g[c], .sigma = b->sigma};
        b->channel[c] = data;
        b->delay_s[c] = 0;
    }
    const gsid_mimo_cfg cfg = {.method = GSID_METHOD_ML, .n_poles = N_POLES, .n_delays = N_CHANNELS, .delay_of = EACH};
    const gsid_mimo_result result = {.section = b->section, .num = b->num, .delay_s = b->delay_s, .cost = -1};
    b->cfg = cfg;
    b->result = result;
    b->section[0] = -7;
}

static gsid_status run(bench *b) {
    return gsid_mimo_run(N_CHANNELS, b->channel, &b->cfg, &b->result);
}

static void exact_responses_give_sections_numerators_and_delays(void **state) {
    (void)state;
    bench b;
    make(&b);
    assert_int_equal(run(&b), GSID_OK);
    const double w = b.result.scale_rad_s;
    assert_true(fabs(b.section[0] * w * w / 90400 - 1) < 1e-6);
    assert_true(fabs(b.section[1] * w / 40 - 1) < 1e-6);
    assert_true(fabs(b.section[2] * w / 100 - 1) < 1e-6);
    assert_true(fabs(b.num[3] * w * w / -2e4 - 1) < 1e-5);
    assert_true(fabs(b.num[4] * w / 200 - 1) < 1e-5);
    assert_true(fabs(b.num[5] * w / 80 - 1) < 1e-5);
    assert_true(fabs(b.delay_s[0] - 1e-3) < 1e-8);
    assert_true(fabs(b.delay_s[1] - 2.2e-3) < 1e-8);
    assert_int_equal(b.result.n_parameters, N_CHANNELS * N_POLES + N_POLES + N_CHANNELS);
    assert_int_equal(b.result.converged, 1);
}

static void assert_refused(bench *b, gsid_status wanted) {
    assert_int_equal(run(b), wanted);
    assert_true(b->section[0] == -7);
    assert_true(b->result.cost == -1);
}

static void failures_leave_the_result(void **state) {
    (void)state;
    bench b;
    make(&b);
    b.cfg.n_poles = GSID_MIMO_POLES_MAX + 1;
    assert_refused(&b, GSID_E_CONFIG);
    make(&b);
    b.cfg.n_poles = 0;
    assert_refused(&b, GSID_E_CONFIG);
    make(&b);
    b.cfg.method = GSID_METHOD_LOG;
    assert_refused(&b, GSID_E_CONFIG);
    make(&b);
    b.cfg.n_delays = 1; /* the second channel asks for another one */
    assert_refused(&b, GSID_E_CONFIG);
    make(&b);
    b.cfg.domain = GSID_DOMAIN_Z; /* without a sample time */
    assert_refused(&b, GSID_E_CONFIG);
    make(&b);
    b.cfg.delay_of = NULL;
    assert_refused(&b, GSID_E_NULL);
    make(&b);
    b.result.num = NULL;
    assert_refused(&b, GSID_E_NULL);
    make(&b);
    b.channel[1].n_lines = N_POLES;
    assert_refused(&b, GSID_E_TOO_FEW);
    make(&b);
    b.g[1][3].re = NAN;
    assert_refused(&b, GSID_E_NONFINITE);
    make(&b);
    b.sigma[5] = 0;
    assert_refused(&b, GSID_E_CONFIG);
    make(&b);
    assert_int_equal(gsid_mimo_run(0, b.channel, &b.cfg, &b.result), GSID_E_CONFIG);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exact_responses_give_sections_numerators_and_delays),
        cmocka_unit_test(failures_leave_the_result),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
