/* Fits of the axis that the peers were tried on, against the truth that made the data. GSID_TEST_QUICK=1: fewer repeats. */
#include <complex.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "gsid/host/fit.h"

#include "../../src/host/fit_stable.h"
#include "reference.h"

#ifdef GSID_WITH_NLOPT
#define WITH_NLOPT 1
#else
#define WITH_NLOPT 0
#endif

#define PI 3.14159265358979323846

typedef double complex cplx;
typedef cplx (*system_at)(cplx s); /* response at a complex frequency, without delay */

enum { N_LINES = 500, IMAGES = 100 }; /* terms fall as m^-2 and turn with the delay: good to 1e-6 of |G| */
static const double sample_s = 1.0 / 3000;

static double f_hz[N_LINES], sigma[N_LINES];
static gsid_cplx g[N_LINES];
static cplx truth[N_LINES];
static uint32_t n_lines;
static uint64_t seed;

static double draw(void) {
    seed = seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return ((double)(seed >> 11) + 0.5) / 9007199254740992.0;
}

static double draw_normal(void) {
    const double size = sqrt(-2 * log(draw()));
    return size * cos(2 * PI * draw());
}

static cplx axis(cplx s) {
    const double wa = 2 * PI * 165, wr = 2 * PI * 179;
    return 40 * (s + 11) / (s * s + 11 * s + 170) * (s * s + 0.03 * wa * s + wa * wa) /
           (s * s + 0.03 * wr * s + wr * wr) * (wr / wa) * (wr / wa);
}

static cplx small_system(cplx s) { /* poles -20 +- 60j, zero -90 */
    return 40 * (s + 90) / (s * s + 40 * s + 4000);
}

static cplx fast_system(cplx s) { /* 300 Hz, damping 0.3, and a zero as fast */
    const double w = 2 * PI * 300;
    return w * (s + w) / (s * s + 0.6 * w * s + w * w);
}

static cplx unstable_system(cplx s) {
    return 4000 / ((s - 20) * (s + 100));
}

/* Response of a system with delay; held: of a held input, as the sum of the images that sampling folds back. */
static cplx response(system_at system, double f, double delay_s, int held) {
    const cplx s = 2 * I * PI * f;
    if (!held) {
        return system(s) * cexp(-s * delay_s);
    }
    cplx sum = 0;
    for (int m = -IMAGES; m <= IMAGES; m++) {
        const cplx image = s + 2 * I * PI * m / sample_s;
        sum += system(image) * cexp(-image * delay_s) * (1 - cexp(-image * sample_s)) / (image * sample_s);
    }
    return sum;
}

/* Lines from df on. Errors as 75 periods of 6000 samples give them at a signal to noise ratio of 40 dB and amplitudes of 3: half
 * of the noise is white, half below 5 Hz. */
static void measure(system_at system, double delay_s, int held, uint32_t n, double df, uint64_t noise_seed) {
    double power = 0, low = 0;
    n_lines = n;
    seed = noise_seed;
    for (uint32_t k = 0; k < n; k++) {
        f_hz[k] = df * (k + 1);
        truth[k] = response(system, f_hz[k], delay_s, held);
        power += creal(truth[k] * conj(truth[k]));
        low += 1 / (1 + f_hz[k] * f_hz[k] / 25) / n;
    }
    for (uint32_t k = 0; k < n; k++) {
        const double shape = 0.5 + 0.5 / (1 + f_hz[k] * f_hz[k] / 25) / low;
        sigma[k] = sqrt(4 * power / 2 * 1e-4 * shape / 6000 / 75);
        g[k].re = creal(truth[k]) + sigma[k] / sqrt(2) * draw_normal();
        g[k].im = cimag(truth[k]) + sigma[k] / sqrt(2) * draw_normal();
    }
}

static double cost_of(const cplx *model) {
    double cost = 0;
    for (uint32_t k = 0; k < n_lines; k++) {
        cost += pow(cabs(g[k].re + I * g[k].im - model[k]) / sigma[k], 2);
    }
    return cost;
}

static gsid_fit_cfg ml(uint32_t n_poles, uint32_t n_zeros) {
    const gsid_fit_cfg cfg = {.method = GSID_METHOD_ML,
                              .n_poles = n_poles,
                              .n_zeros = n_zeros,
                              .sample_s = sample_s,
                              .delay = GSID_DELAY_FREE};
    return cfg;
}

static gsid_status run(const gsid_fit_cfg *cfg, gsid_fit_result *result) {
    const gsid_frd data = {.n_lines = n_lines, .f_hz = f_hz, .g = g, .sigma = sigma};
    memset(result, 0, sizeof *result);
    return gsid_fit_run(&data, cfg, result);
}

static void assert_poles_are_stable(const gsid_fit_result *r) {
    assert_int_equal(r->is_stable, 1);
    for (uint32_t i = 0; i < r->model.n_poles; i++) {
        const double size = hypot(r->poles[i].re, r->poles[i].im);
        assert_true(r->model.domain == GSID_DOMAIN_S ? r->poles[i].re < 0 : size < 1);
    }
}

static double delay_sigma(const gsid_fit_result *r) {
    return sqrt(r->cov[(size_t)r->n_parameters * r->n_parameters - 1]);
}

/* Nearest distance of a computed root to a wanted one. */
static double distance(uint32_t n, const gsid_cplx *root, cplx wanted) {
    double nearest = HUGE_VAL;
    for (uint32_t i = 0; i < n; i++) {
        nearest = fmin(nearest, cabs(root[i].re + I * root[i].im - wanted));
    }
    return nearest;
}

static void assert_true_order(const gsid_fit_cfg *cfg, double delay_s, double cost_true, uint64_t noise_seed) {
    gsid_fit_result r;
    const gsid_status status = run(cfg, &r);
    if (status != GSID_OK) {
        fail_msg("seed %u, delay %g: status %d", (unsigned)noise_seed, delay_s, status);
    }
    assert_poles_are_stable(&r);
    assert_int_equal(r.converged, 1);
    const double off = (r.model.delay_s - delay_s) / delay_sigma(&r);
    if (!(r.cost <= cost_true) || !(fabs(off) < 4)) { /* 4 sigma: wrong once in 16 000 */
        fail_msg("seed %u, delay %g: cost %.3f of the true model's, delay off by %.2f sigma", (unsigned)noise_seed,
                 delay_s, r.cost / cost_true, off);
    }
    /* the cost of n parameters is n/2 lower than the true model's, give or take sqrt(n/2): 9 parameters, 5 sigma */
    assert_true(r.cost > cost_true - 4.5 - 5 * sqrt(4.5));
    assert_true(fabs(r.cost - r.cost_ml) < 1e-9 * r.cost);
}

static void the_axis_with_its_own_order(void **state) {
    (void)state;
    const int n = repeats(10, 2);
    for (uint64_t s = 1; s <= (uint64_t)n; s++) {
        measure(axis, 0.0054, 0, N_LINES, 0.5, s);
        const gsid_fit_cfg cfg = ml(4, 3);
        assert_true_order(&cfg, 0.0054, cost_of(truth), s);
    }
}

static void poles_and_zeros_are_those_of_the_axis(void **state) {
    (void)state;
    gsid_fit_result r;
    measure(axis, 0.0054, 0, N_LINES, 0.5, 1);
    const gsid_fit_cfg cfg = ml(4, 3);
    assert_int_equal(run(&cfg, &r), GSID_OK);
    assert_int_equal(r.n_parameters, 9);
    assert_int_equal(r.n_zeros_found, 3);
    const double wr = 2 * PI * 179, wa = 2 * PI * 165;
    /* the resonance is known to 1e-4 of itself; the slow pair to a few hundredths */
    assert_true(distance(4, r.poles, wr * (-0.015 + I * sqrt(1 - 0.015 * 0.015))) < 2e-4 * wr);
    assert_true(distance(3, r.zeros, wa * (-0.015 - I * sqrt(1 - 0.015 * 0.015))) < 2e-4 * wa);
    assert_true(distance(4, r.poles, -5.5 + I * sqrt(170 - 5.5 * 5.5)) < 0.3);
    assert_true(distance(3, r.zeros, -11) < 0.3);
}

static void any_delay_is_found_unaided(void **state) {
    (void)state;
    const double delays[8] = {0, 0.0001, 0.0016, 0.0033, 0.0071, 0.0088, 0.0109, 0.012};
    const int step = repeats(1, 4);
    for (int i = 0; i < 8; i += step) {
        measure(axis, delays[i], 0, N_LINES, 0.5, 100 + (uint64_t)i);
        const gsid_fit_cfg cfg = ml(4, 3);
        assert_true_order(&cfg, delays[i], cost_of(truth), 100 + (uint64_t)i);
    }
}

/* Two or five poles too many: whatever they do, the model is stable, no worse than the truth, and settled. */
static void surplus_poles_stay_stable(void **state) {
    (void)state;
    const int n = repeats(4, 1);
    for (uint64_t s = 1; s <= (uint64_t)n; s++) {
        const uint32_t most = s == 1 ? (uint32_t)repeats(5, 2) : 2;
        for (uint32_t more = 2; more <= most; more += 3) {
            measure(axis, 0.0054, 0, N_LINES, 0.5, s);
            gsid_fit_result r;
            const gsid_fit_cfg cfg = ml(4 + more, 3 + more);
            const gsid_status status = run(&cfg, &r);
#ifndef GSID_WITH_NLOPT
            if (status == GSID_E_BACKEND) {
                continue;
            }
#endif
            if (status != GSID_OK || !(r.cost <= cost_of(truth))) {
                fail_msg("seed %u, %u more: status %d, cost %.3f of the true model's", (unsigned)s, more, status,
                         r.cost / cost_of(truth));
            }
            assert_poles_are_stable(&r);
        }
    }
}

/* The cost told is that of the model told, by the sum of images: not that of the data with another model's images off. */
static void assert_cost_is_of_the_model(const gsid_fit_result *r) {
    static cplx model[N_LINES];
    double brute = 0;
    for (uint32_t k = 0; k < n_lines; k++) {
        cplx sum = 0;
        for (int m = -IMAGES; m <= IMAGES; m++) {
            const cplx s = 2 * I * PI * (f_hz[k] + m / sample_s), v = s / r->model.scale_rad_s;
            cplx a = 0, b = 0;
            for (uint32_t i = r->model.n_poles + 1; i-- > 0;) {
                a = a * v + r->model.den[i];
            }
            for (uint32_t i = r->model.n_zeros + 1; i-- > 0;) {
                b = b * v + r->model.num[i];
            }
            sum += b / a * cexp(-s * r->model.delay_s) * (1 - cexp(-s * sample_s)) / (s * sample_s);
        }
        model[k] = sum;
    }
    brute = cost_of(model);
    /* both sums of images are good to 1e-6 of |G|, a hundredth of sigma */
    if (!(fabs(brute - r->cost) < 0.02 * r->cost)) {
        fail_msg("cost %.3f, by the sum of images %.3f", r->cost, brute);
    }
}

static void a_held_input_is_taken_into_account(void **state) {
    (void)state;
    const int n = repeats(2, 1);
    for (uint64_t s = 1; s <= (uint64_t)n; s++) {
        measure(axis, 0.0054, 1, N_LINES, 0.5, s);
        gsid_fit_cfg cfg = ml(4, 3);
        cfg.hold = 1;
        assert_true_order(&cfg, 0.0054, cost_of(truth), s);
        gsid_fit_result r;
        assert_int_equal(run(&cfg, &r), GSID_OK);
        assert_cost_is_of_the_model(&r);
        cfg = ml((uint32_t)repeats(6, 5), (uint32_t)repeats(5, 4)); /* surplus poles */
        cfg.hold = 1;
        const gsid_status status = run(&cfg, &r);
#ifndef GSID_WITH_NLOPT
        if (status == GSID_E_BACKEND) {
            continue;
        }
#endif
        assert_int_equal(status, GSID_OK);
        assert_poles_are_stable(&r);
        assert_true(r.cost <= cost_of(truth));
        assert_cost_is_of_the_model(&r);
    }
    /* half a sample of delay and the images are what the hold is about: without it the fit is worse */
    measure(small_system, 0.0007, 1, 60, 20, 3);
    gsid_fit_cfg cfg = ml(2, 1);
    gsid_fit_result r;
    assert_int_equal(run(&cfg, &r), GSID_OK);
    assert_true(r.cost > 2 * cost_of(truth));
    cfg.hold = 1;
    assert_true_order(&cfg, 0.0007, cost_of(truth), 3);
}

static void every_method_answers(void **state) {
    (void)state;
    const char *const names[4] = {"LS", "IWLS", "NLS", "ML"};
    for (int method = GSID_METHOD_LS; method <= GSID_METHOD_ML; method++) {
        for (int hold = 0; hold < 2; hold++) {
            measure(small_system, 0.002, hold, 100, 2, 1);
            gsid_fit_cfg cfg = ml(2, 1);
            cfg.method = (gsid_method)method;
            cfg.hold = hold;
            gsid_fit_result r;
            const gsid_status status = run(&cfg, &r);
            const int on_grid = !WITH_NLOPT && method <= GSID_METHOD_IWLS; /* delay to a step of the scan only */
            if (status != (on_grid ? GSID_MAX_ITER : GSID_OK)) {
                fail_msg("%s: status %d", names[method], status);
            }
            assert_int_equal(r.converged, !on_grid);
            assert_true(isfinite(r.cost) && r.cost > 0 && isfinite(r.cost_ml));
            for (uint32_t i = 0; i < r.n_parameters; i++) {
                assert_true(r.cov[i * (r.n_parameters + 1)] > 0);
            }
            /* the output error methods come near the best there is; LS weighs errors at high frequency too much */
            const double off = fabs(r.model.delay_s - 0.002);
            if (on_grid) {
                assert_true(off < 0.5 / (8 * f_hz[n_lines - 1]) + 1e-6);
                continue;
            }
            assert_true(r.cost_ml < (method == GSID_METHOD_LS ? 1000 : 1.3) * cost_of(truth));
            assert_true(off < (method == GSID_METHOD_LS ? 5e-4 : 5 * delay_sigma(&r)));
        }
    }
}

static cplx thesis_axis(cplx s) { /* eq. 7.30: a slow pair, and a pole at 161 Hz */
    return (7617 * s + 87680) / (((s + 1027) * s + 11530) * s + 173500);
}

/* Bug: one start of the scan was kept, stable or not: LS refused the data at 12 of 41 delays. */
static void linear_methods_find_a_stable_model_at_any_delay(void **state) {
    (void)state;
    const int step = repeats(1, 16);
    for (int i = 0; i <= 40; i += step) {
        const double delay_s = 0.0003 * i + (i % 2 ? 0.00011 : 0);
        measure(thesis_axis, delay_s, 0, N_LINES, 0.5, 200 + (uint64_t)i);
        for (int method = GSID_METHOD_LS; method <= GSID_METHOD_IWLS; method++) {
            gsid_fit_cfg cfg = ml(3, 2);
            cfg.method = (gsid_method)method;
            gsid_fit_result r;
            const gsid_status status = run(&cfg, &r);
            double limit_s = 2.5e-4; /* what the noise makes of it: the third pole trades against the delay */
#if !WITH_NLOPT
            limit_s = method == GSID_METHOD_LS ? 4e-4 : 1e-3; /* the grid alone, and it says so */
            assert_int_equal(status, GSID_MAX_ITER);
            assert_int_equal(r.converged, 0);
#else
            if (status != GSID_OK) {
                fail_msg("method %d, delay %g: status %d", method, delay_s, status);
            }
#endif
            assert_poles_are_stable(&r);
            if (!(fabs(r.model.delay_s - delay_s) < limit_s)) {
                fail_msg("method %d, delay %g: %g found", method, delay_s, r.model.delay_s);
            }
        }
    }
}

/* Small responses settle no sooner than large ones. */
static void nls_does_not_depend_on_the_unit(void **state) {
    (void)state;
    gsid_fit_result r[2];
    for (int small = 0; small < 2; small++) {
        measure(small_system, 0.002, 1, 200, 1, 1);
        for (uint32_t k = 0; k < n_lines && small; k++) {
            g[k].re /= 1048576;
            g[k].im /= 1048576;
            sigma[k] /= 1048576;
        }
        gsid_fit_cfg cfg = ml(2, 1);
        cfg.method = GSID_METHOD_NLS;
        cfg.hold = 1;
        assert_int_equal(run(&cfg, &r[small]), GSID_OK);
    }
    for (int i = 0; i < 2; i++) {
        assert_true(distance(2, r[1].poles, r[0].poles[i].re + I * r[0].poles[i].im) < 1e-9 * 63);
    }
    assert_true(fabs(r[1].model.delay_s - r[0].model.delay_s) < 1e-12);
}

static void a_delay_that_is_given_stays(void **state) {
    (void)state;
    measure(small_system, 0.002, 0, 200, 1, 1);
    gsid_fit_cfg cfg = ml(2, 1);
    gsid_fit_result r;
    cfg.delay = GSID_DELAY_FIXED;
    cfg.delay_s = 0.002;
    assert_int_equal(run(&cfg, &r), GSID_OK);
    assert_true(r.model.delay_s == 0.002 && r.cost <= cost_of(truth));
    assert_int_equal(r.n_parameters, 4);
    cfg.delay = GSID_DELAY_NONE;
    const gsid_status status = run(&cfg, &r); /* what cannot be fitted may end stable or not at all */
    assert_true(status == GSID_OK || status == GSID_MAX_ITER || status == GSID_E_UNSTABLE || status == GSID_E_BACKEND);
    if (status >= 0) {
        assert_true(r.model.delay_s == 0 && r.cost > 10 * cost_of(truth));
        assert_poles_are_stable(&r);
    }
    measure(small_system, 0, 0, 200, 1, 1);
    assert_int_equal(run(&cfg, &r), GSID_OK);
    assert_true(r.model.delay_s == 0 && r.cost <= cost_of(truth));
}

static void an_unstable_model_is_returned_only_on_request(void **state) {
    (void)state;
    measure(unstable_system, 0.002, 0, 100, 1, 1);
    for (int method = GSID_METHOD_LS; method <= GSID_METHOD_ML; method++) {
        for (int hold = 0; hold < 2; hold++) {
            gsid_fit_cfg cfg = ml(2, 0);
            cfg.method = (gsid_method)method;
            cfg.hold = hold;
            gsid_fit_result r;
            const gsid_status status = run(&cfg, &r);
            if (status >= 0) {
                assert_poles_are_stable(&r);
                for (uint32_t i = 0; i < 2;
                     i++) { /* a pole that wants to leave stops 1e-6 of the band before the axis */
                    assert_true(r.poles[i].re < -0.99e-6 * r.model.scale_rad_s);
                }
            } else {
                assert_true(status == GSID_E_UNSTABLE || status == GSID_E_BACKEND);
            }
#ifndef GSID_WITH_NLOPT
            assert_true(status < 0);
#endif
            if (hold) {
                continue;
            }
            cfg.allow_unstable = 1;
            const int on_grid = !WITH_NLOPT && method <= GSID_METHOD_IWLS;
            assert_int_equal(run(&cfg, &r), on_grid ? GSID_MAX_ITER : GSID_OK);
            assert_int_equal(r.is_stable, 0);
            assert_true(distance(2, r.poles, 20) < (on_grid ? 5 : 0.5));
        }
    }
}

static void domain_z(void **state) {
    (void)state;
    gsid_rational m;
    assert_int_equal(gsid_rational_init(&m, GSID_DOMAIN_Z, 2, 1, 0.004), GSID_OK);
    m.den[1] = -1.5;
    m.den[2] = 0.7;
    m.num[0] = 0.1;
    m.num[1] = 0.05;
    m.delay_s = 0.0054;
    seed = 1;
    n_lines = 100;
    for (uint32_t k = 0; k < n_lines; k++) {
        gsid_cplx exact;
        f_hz[k] = 1.2 * (k + 1);
        sigma[k] = 2e-3;
        assert_int_equal(gsid_rational_eval(&m, 1, &f_hz[k], &exact), GSID_OK);
        truth[k] = exact.re + I * exact.im;
        g[k].re = exact.re + sigma[k] / sqrt(2) * draw_normal();
        g[k].im = exact.im + sigma[k] / sqrt(2) * draw_normal();
    }
    gsid_fit_cfg cfg = ml(2, 1);
    cfg.domain = GSID_DOMAIN_Z;
    cfg.sample_s = 0.004;
    gsid_fit_result r;
    assert_int_equal(run(&cfg, &r), GSID_OK);
    assert_poles_are_stable(&r);
    assert_true(r.cost <= cost_of(truth));
    assert_true(fabs(r.model.delay_s - 0.0054) < 4 * delay_sigma(&r));
    assert_true(distance(2, r.poles, 0.75 + I * sqrt(0.7 - 0.75 * 0.75)) < 0.01);
    assert_true(distance(r.n_zeros_found, r.zeros, -0.5) < 0.1);
}

/* Lines 100 Hz apart cannot tell a delay from the same and 10 ms more: the shorter one is meant. */
static void delays_that_repeat_are_not_taken(void **state) {
    (void)state;
    measure(fast_system, 0.0015, 0, 14, 100, 1);
    const gsid_fit_cfg cfg = ml(2, 1);
    assert_true_order(&cfg, 0.0015, cost_of(truth), 1);
}

/* Intervals of each parameter that hold the truth in n experiments: as many as their level says, within 4 standard deviations
 * of the binomial (wrong once in 16 000). */
static void assert_binomial(const char *what, double level, const int held[5], int n) {
    const double scatter = 4 * sqrt(n * level * (1 - level));
    for (int j = 0; j < 5; j++) {
        if (fabs(held[j] - n * level) > scatter) {
            fail_msg("%s, parameter %d: %d of %d intervals hold the truth, wanted are %.0f +- %.0f", what, j, held[j],
                     n, n * level, scatter);
        }
    }
}

/* Repeated experiments: each interval holds the truth as often as it says. Those of 95 % show a covariance that is too small;
 * for one that is too large their upper bound lies above n. That shows at 68 %: a doubled covariance would hold 84 %, where
 * the bound is 81 % of 200. */
static void assert_coverage(gsid_method method, int hold, int n) {
    const double wanted[5] = {4000, 40, 3600, 40, 0.002}; /* den, num in plain s, ascending; delay */
    int held_95[5] = {0}, held_68[5] = {0};
    for (int i = 0; i < n; i++) {
        measure(small_system, 0.002, hold, 60, 3, 1000 + (uint64_t)i);
        gsid_fit_cfg cfg = ml(2, 1);
        cfg.method = method;
        cfg.hold = hold;
        cfg.delay_max_s = 0.004;
        gsid_fit_result r;
        assert_int_equal(run(&cfg, &r), GSID_OK);
        const double scale = r.model.scale_rad_s, unit[5] = {scale * scale, scale, scale * scale, scale, 1};
        const double found[5] = {r.model.den[0], r.model.den[1], r.model.num[0], r.model.num[1], r.model.delay_s};
        for (int j = 0; j < 5; j++) {
            const double off = fabs(found[j] * unit[j] - wanted[j]) / (unit[j] * sqrt(r.cov[6 * j]));
            held_95[j] += off < 1.959964;
            held_68[j] += off < 1;
        }
    }
    char what[64];
    snprintf(what, sizeof what, "method %d, hold %d, 95 %%", (int)method, hold);
    assert_binomial(what, 0.95, held_95, n);
    snprintf(what, sizeof what, "method %d, hold %d, 68 %%", (int)method, hold);
    assert_binomial(what, 0.682689, held_68, n);
}

static void intervals_hold_the_truth(void **state) {
    (void)state;
    print_message("seeds 1000 on\n");
    assert_coverage(GSID_METHOD_ML, 0, repeats(200, 10));
    assert_coverage(GSID_METHOD_NLS, 0, repeats(200, 5));
    assert_coverage(GSID_METHOD_ML, 1, repeats(60, 3));
}

static void assert_refused(gsid_status status, const gsid_frd *data, const gsid_fit_cfg *cfg) {
    gsid_fit_result r, before;
    memset(&r, 7, sizeof r);
    memcpy(&before, &r, sizeof r);
    assert_int_equal(gsid_fit_run(data, cfg, &r), status);
    assert_memory_equal(&r, &before, sizeof r);
}

/* Data of the tests of refusals. */
static gsid_frd good_data(void) {
    measure(small_system, 0.002, 0, 50, 4, 1);
    return (gsid_frd){.n_lines = n_lines, .f_hz = f_hz, .g = g, .sigma = sigma};
}

static void missing_arguments_are_refused(void **state) {
    (void)state;
    const gsid_frd good = good_data();
    const gsid_fit_cfg cfg = ml(2, 1);
    gsid_frd data = good;
    assert_int_equal(gsid_fit_run(&good, &cfg, NULL), GSID_E_NULL);
    assert_refused(GSID_E_NULL, NULL, &cfg);
    assert_refused(GSID_E_NULL, &good, NULL);
    data.f_hz = NULL;
    assert_refused(GSID_E_NULL, &data, &cfg);
    data = good;
    data.g = NULL;
    assert_refused(GSID_E_NULL, &data, &cfg);
    data = good;
    data.sigma = NULL;
    assert_refused(GSID_E_NULL, &data, &cfg);
    data = good;
    data.n_lines = 2;
    assert_refused(GSID_E_TOO_FEW, &data, &cfg); /* four numbers for five parameters */
}

static void bad_numbers_are_refused(void **state) {
    (void)state;
    const gsid_frd good = good_data();
    const gsid_fit_cfg cfg = ml(2, 1);
    const double bad[2] = {NAN, INFINITY};
    for (int i = 0; i < 2; i++) {
        double *const fields[4] = {&f_hz[3], &g[3].re, &g[49].im, &sigma[3]};
        for (int j = 0; j < 4; j++) {
            const double kept = *fields[j];
            *fields[j] = bad[i];
            assert_refused(GSID_E_NONFINITE, &good, &cfg);
            *fields[j] = kept;
        }
    }
    for (double wrong = 0; wrong >= -1; wrong--) {
        const double kept = sigma[3];
        sigma[3] = wrong;
        assert_refused(GSID_E_CONFIG, &good, &cfg);
        sigma[3] = kept;
    }
}

static void bad_settings_are_refused(void **state) {
    (void)state;
    const gsid_frd good = good_data();
    const gsid_fit_cfg cfg = ml(2, 1);
#define REFUSED(field, value)                                                                                          \
    do {                                                                                                               \
        gsid_fit_cfg wrong_cfg = cfg;                                                                                  \
        wrong_cfg.field = (value);                                                                                     \
        assert_refused(GSID_E_CONFIG, &good, &wrong_cfg);                                                              \
    } while (0)
    REFUSED(n_poles, GSID_ORDER_MAX + 1);
    REFUSED(n_zeros, GSID_ORDER_MAX + 1);
    REFUSED(domain, (gsid_domain)2);
    REFUSED(delay, (gsid_delay_mode)3);
    REFUSED(delay_s, NAN);
    REFUSED(delay_max_s, -1);
    REFUSED(delay_max_s, NAN);
    REFUSED(delay_max_s, 513 / f_hz[49]); /* more than 4096 steps of 1/(8 f_max) */
#undef REFUSED
}

static void a_bad_sample_time_is_refused(void **state) {
    (void)state;
    const gsid_frd good = good_data();
    const gsid_fit_cfg cfg = ml(2, 1);
    gsid_fit_cfg needs_sample = cfg;
    needs_sample.domain = GSID_DOMAIN_Z;
    const double samples[5] = {0, -1, NAN, INFINITY, 0.5 / f_hz[49]};
    for (int i = 0; i < 5; i++) {
        needs_sample.sample_s = samples[i];
        assert_refused(GSID_E_CONFIG, &good, &needs_sample);
    }
    gsid_fit_cfg held = cfg;
    held.hold = 1;
    held.sample_s = 0;
    assert_refused(GSID_E_CONFIG, &good, &held);
    held.sample_s = sample_s;
    held.n_zeros = 3;
    assert_refused(GSID_E_CONFIG, &good, &held);
    held.n_zeros = 1;
    held.domain = GSID_DOMAIN_Z;
    assert_refused(GSID_E_CONFIG, &good, &held);
}

/* Any pole and zero that cancel make a gain. */
static void data_that_determine_no_model_are_refused(void **state) {
    (void)state;
    const gsid_frd good = good_data();
    const gsid_fit_cfg cfg = ml(2, 1);
    for (uint32_t k = 0; k < n_lines; k++) {
        g[k].re = 2, g[k].im = 0;
    }
    gsid_fit_cfg gain = cfg;
    gain.n_poles = gain.n_zeros = 1;
    gain.delay = GSID_DELAY_NONE;
    gain.allow_unstable = 1;
    assert_refused(GSID_E_SINGULAR, &good, &gain);
    memset(f_hz, 0, sizeof f_hz);
    assert_refused(GSID_E_CONFIG, &good, &cfg);
}

/* Bug: the numerator of least squares took the place of the start's where it raised V, here by a line of small variance
 * and opposite phase. Between the signs the logarithmic V is infinite, so that the search ended at 6 times V. */
static void a_reflected_start_is_left_only_for_a_lower_cost(void **state) {
    (void)state;
    if (!WITH_NLOPT) {
        print_message("skipped without NLopt, which searches among stable models\n");
        skip();
    }
    n_lines = 20;
    for (uint32_t k = 0; k < n_lines; k++) {
        f_hz[k] = 1e-3 * (k + 1);
        g[k] = (gsid_cplx){1, 0};
        sigma[k] = 1;
    }
    g[0].re = -0.01;
    sigma[0] = sqrt(0.01 / (2 * n_lines)); /* its pull on a gain is twice that of all others */
    const gsid_frd data = {.n_lines = n_lines, .f_hz = f_hz, .g = g, .sigma = sigma, .logarithmic = 1};
    const gsid_fit_bounds bounds = {.stride = 1}; /* a step of no length is none */
    gsid_rational model;
    assert_int_equal(gsid_rational_init(&model, GSID_DOMAIN_S, 2, 0, 2 * PI), GSID_OK);
    model.num[0] = model.den[0] = 900;
    model.den[1] = -40;
    model.den[2] = 1;
    double start;
    assert_int_equal(gsid_estimate_cost(&data, &model, &start), GSID_OK);
    double cost = 1e-6 * start; /* of an unstable model that stable ones are far from */
    assert_true(gsid_fit_stable(&data, &bounds, &model, &cost) >= 0);
    assert_true(cost < 1.01 * start); /* reflected, the poles turn phases by 2e-4 at most */
    assert_true(model.num[0] / model.den[0] > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_axis_with_its_own_order),
        cmocka_unit_test(poles_and_zeros_are_those_of_the_axis),
        cmocka_unit_test(any_delay_is_found_unaided),
        cmocka_unit_test(surplus_poles_stay_stable),
        cmocka_unit_test(a_held_input_is_taken_into_account),
        cmocka_unit_test(every_method_answers),
        cmocka_unit_test(linear_methods_find_a_stable_model_at_any_delay),
        cmocka_unit_test(nls_does_not_depend_on_the_unit),
        cmocka_unit_test(a_delay_that_is_given_stays),
        cmocka_unit_test(an_unstable_model_is_returned_only_on_request),
        cmocka_unit_test(domain_z),
        cmocka_unit_test(delays_that_repeat_are_not_taken),
        cmocka_unit_test(intervals_hold_the_truth),
        cmocka_unit_test(missing_arguments_are_refused),
        cmocka_unit_test(bad_numbers_are_refused),
        cmocka_unit_test(bad_settings_are_refused),
        cmocka_unit_test(a_bad_sample_time_is_refused),
        cmocka_unit_test(data_that_determine_no_model_are_refused),
        cmocka_unit_test(a_reflected_start_is_left_only_for_a_lower_cost),
    };
    return cmocka_run_group_tests_name("fit", tests, NULL, NULL);
}
