/* Whole records against the streaming core, sample by sample. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "gsid/excitation.h"
#include "gsid/host/batch.h"

enum { N_MAX = 250, P = 5, F = 4 };

static gsid_cplx twiddle[N_MAX];
static gsid_cplx memory[400];
static double x[P * N_MAX], y[P * N_MAX];

static int fill_samples(void **state) {
    (void)state;
    for (uint32_t n = 0; n < P * N_MAX; n++) { /* any bounded signals */
        x[n] = sin(0.3 * n + 1e-3 * n * n);
        y[n] = cos(0.2 * n) + 0.1 * sin(7e-4 * n * n);
    }
    return 0;
}

static void batch_equals_streaming_to_rounding(void **state) {
    (void)state;
    const uint32_t periods[5] = {2, 45, 240, 250, 45}; /* odd, of small and large factors, and one that was before */
    for (int i = 0; i < 5; i++) {
        const uint32_t n_period = periods[i], line[F] = {0, n_period / 2, 1, n_period / 3};
        gsid_cplx all[P][F], one[F];
        gsid_spectrum s;
        gsid_twiddle_fill(n_period, twiddle);
        const gsid_spectrum_cfg cfg = {n_period, F, 1, 0, line, twiddle};
        assert_int_equal(gsid_spectrum_init(&s, &cfg, memory, sizeof memory), GSID_OK);
        assert_int_equal(gsid_batch_spectra(P, n_period, x, F, line, all[0]), GSID_OK);
        for (uint32_t p = 0; p < P; p++) {
            for (uint32_t n = 0; n < n_period; n++) {
                gsid_spectrum_step(&s, &x[p * n_period + n]);
            }
            gsid_spectrum_result(&s, one);
            for (int f = 0; f < F; f++) {
                /* n_period roundings of partial sums below n_period, times 2/n_period */
                assert_true(fabs(all[p][f].re - one[f].re) <= n_period * DBL_EPSILON);
                assert_true(fabs(all[p][f].im - one[f].im) <= n_period * DBL_EPSILON);
            }
        }
    }
}

/* Found by review: plan and buffers of any length were kept as long as the process lives. */
static void a_period_too_long_to_keep_leaves_the_next_as_they_are(void **state) {
    (void)state;
    const uint32_t n_long = (UINT32_C(1) << 20) + 1024, periods[3] = {n_long, 240, n_long}, line[1] = {3};
    double *long_x = malloc(n_long * sizeof *long_x);
    assert_non_null(long_x);
    for (int i = 0; i < 3; i++) {
        gsid_cplx found[1];
        for (uint32_t n = 0; n < periods[i]; n++) {
            long_x[n] = sin(6.283185307179586 * 3 * n / periods[i]);
        }
        assert_int_equal(gsid_batch_spectra(1, periods[i], long_x, 1, line, found), GSID_OK);
        /* -j, and rounding of a transform: a few units for each of its 20 stages, and of the sine's argument */
        assert_true(fabs(found[0].re) < 1e-13 && fabs(found[0].im + 1) < 1e-13);
    }
    free(long_x);
}

static void spectra_refuse(void **state) {
    (void)state;
    const uint32_t line[2] = {1, 125}, beyond[2] = {1, 126};
    gsid_cplx lines[P * 2], untouched[P * 2];
    memset(lines, 0x5A, sizeof lines);
    memcpy(untouched, lines, sizeof lines);
    assert_int_equal(gsid_batch_spectra(P, 250, NULL, 2, line, lines), GSID_E_NULL);
    assert_int_equal(gsid_batch_spectra(P, 250, x, 2, NULL, lines), GSID_E_NULL);
    assert_int_equal(gsid_batch_spectra(P, 250, x, 2, line, NULL), GSID_E_NULL);
    assert_int_equal(gsid_batch_spectra(0, 250, x, 2, line, lines), GSID_E_CONFIG);
    assert_int_equal(gsid_batch_spectra(P, 1, x, 2, line, lines), GSID_E_CONFIG);
    assert_int_equal(gsid_batch_spectra(1, (UINT32_C(1) << 30) + 1, x, 2, line, lines), GSID_E_CONFIG);
    assert_int_equal(gsid_batch_spectra(P, 250, x, 0, line, lines), GSID_E_CONFIG);
    assert_int_equal(gsid_batch_spectra(P, 250, x, 2, beyond, lines), GSID_E_CONFIG);
    for (uint32_t n = P * 250 - 4; n < P * 250; n++) { /* samples are looked at in fours: any place in them */
        const double was = x[n], bad[2] = {(double)NAN, -(double)INFINITY};
        for (int i = 0; i < 2; i++) {
            x[n] = bad[i];
            assert_int_equal(gsid_batch_spectra(P, 250, x, 2, line, lines), GSID_E_NONFINITE);
            assert_int_equal(gsid_batch_spectra(1, 249, x + n - 248, 1, line, lines), GSID_E_NONFINITE);
        }
        x[n] = was;
    }
    assert_memory_equal(lines, untouched, sizeof lines);
}

static const uint32_t frf_line[2] = {3, 7};

static void start(gsid_frf *frf) {
    gsid_twiddle_fill(100, twiddle);
    const gsid_frf_cfg cfg = {.n_period = 100, .n_lines = 2, .n_settle = 30, .line = frf_line, .twiddle = twiddle};
    assert_int_equal(gsid_frf_init(frf, &cfg, memory, sizeof memory), GSID_OK);
}

static void read_out(const gsid_frf *frf, gsid_cplx *g, double *var_g) {
    const gsid_frf_out out = {.g = g, .var_g = var_g};
    assert_int_equal(gsid_frf_result(frf, &out), GSID_OK);
}

static void blocks_of_any_size_give_the_same_bits(void **state) {
    (void)state;
    enum { LENGTH = 1030 };
    uint8_t valid[LENGTH];
    memset(valid, 1, sizeof valid);
    valid[250] = valid[251] = 0;
    gsid_frf frf;
    gsid_cplx by_sample[2], by_block[2];
    double var_sample[2], var_block[2];
    start(&frf);
    for (int n = 0; n < LENGTH; n++) {
        valid[n] ? gsid_frf_step(&frf, x[n], y[n]) : gsid_frf_skip(&frf, 1);
    }
    read_out(&frf, by_sample, var_sample);
    assert_int_equal(frf.n_periods, 9);
    assert_int_equal(frf.n_spoiled, 1);
    const size_t sizes[4] = {1, 7, 100, LENGTH};
    for (int i = 0; i < 4; i++) {
        start(&frf);
        for (size_t n = 0; n < LENGTH; n += sizes[i]) {
            size_t take = n + sizes[i] < LENGTH ? sizes[i] : LENGTH - n;
            assert_int_equal(gsid_batch_frf_step(&frf, take, x + n, y + n, valid + n), GSID_OK);
        }
        read_out(&frf, by_block, var_block);
        assert_memory_equal(by_sample, by_block, sizeof by_block);
        assert_memory_equal(var_sample, var_block, sizeof var_block);
    }
}

static void a_refused_block_leaves_the_object_as_it_was(void **state) {
    (void)state;
    gsid_frf frf, before;
    static gsid_cplx memory_before[sizeof memory / sizeof memory[0]];
    double bad[3] = {0, INFINITY, 0};
    const double good[3] = {0, 0, 0};
    const uint8_t without[3] = {1, 0, 1};
    memset(&frf, 0, sizeof frf);
    assert_int_equal(gsid_batch_frf_step(NULL, 3, good, good, NULL), GSID_E_NULL);
    assert_int_equal(gsid_batch_frf_step(&frf, 3, NULL, good, NULL), GSID_E_NULL);
    assert_int_equal(gsid_batch_frf_step(&frf, 3, good, NULL, NULL), GSID_E_NULL);
    assert_int_equal(gsid_batch_frf_step(&frf, 3, good, good, NULL), GSID_E_STATE);
    start(&frf);
    before = frf;
    memcpy(memory_before, memory, sizeof memory);
    assert_int_equal(gsid_batch_frf_step(&frf, 3, bad, good, NULL), GSID_E_NONFINITE);
    assert_int_equal(gsid_batch_frf_step(&frf, 3, good, bad, NULL), GSID_E_NONFINITE);
    assert_memory_equal(&frf, &before, sizeof frf);
    assert_memory_equal(memory, memory_before, sizeof memory);
    assert_int_equal(gsid_batch_frf_step(&frf, 3, good, bad, without), GSID_OK); /* not a sample: not looked at */
}

typedef struct {
    gsid_cplx g[2], y[2], u[2], cov_yu[2];
    double var_g[2], var_y[2], var_u[2];
    gsid_frf_out out;
} means;

static void read_means(const gsid_frf *frf, means *m) {
    const gsid_frf_out out = {m->g, m->var_g, m->y, m->u, m->var_y, m->var_u, m->cov_yu};
    m->out = out;
    assert_int_equal(gsid_frf_result(frf, &out), GSID_OK);
}

static void assert_near(const void *found, const void *expected, size_t n_bytes) {
    const double *a = found, *b = expected;
    for (size_t i = 0; i < n_bytes / sizeof *a; i++) {
        assert_true(fabs(a[i] - b[i]) <= 1e-12 * fabs(b[i]) + 1e-18);
    }
}

static void merged_means_are_those_of_merged_measurements(void **state) {
    (void)state;
    enum { SETTLE = 30, FIRST = SETTLE + 300, ALL = SETTLE + 1000 };
    static gsid_cplx memory_b[sizeof memory / sizeof memory[0]];
    gsid_frf a, b;
    means first, second, whole, kept;
    start(&a);
    const gsid_frf_cfg cfg = {.n_period = 100, .n_lines = 2, .line = frf_line, .twiddle = twiddle};
    assert_int_equal(gsid_frf_init(&b, &cfg, memory_b, sizeof memory_b), GSID_OK);
    assert_int_equal(gsid_batch_frf_step(&a, FIRST, x, y, NULL), GSID_OK);
    assert_int_equal(gsid_batch_frf_step(&b, ALL - FIRST, x + FIRST, y + FIRST, NULL), GSID_OK);
    read_means(&a, &first);
    read_means(&b, &second);
    assert_int_equal(gsid_frf_merge(&a, &b), GSID_OK);
    read_means(&a, &whole);
    assert_int_equal(gsid_batch_frf_merge(2, 3, &first.out, 7, &second.out), GSID_OK);
    assert_near(&first, &whole, offsetof(means, out));
    double variance[2];
    assert_int_equal(gsid_batch_frf_error_variance(2, &whole.out, whole.g, variance), GSID_OK);
    for (int i = 0; i < 2; i++) {
        const double u2 = whole.u[i].re * whole.u[i].re + whole.u[i].im * whole.u[i].im;
        assert_true(fabs(variance[i] / u2 / 10 / whole.var_g[i] - 1) < 1e-12);
    }

    kept = first;
    kept.out = first.out;
    assert_int_equal(gsid_batch_frf_merge(2, 0, &first.out, 7, &second.out), GSID_E_CONFIG);
    assert_int_equal(gsid_batch_frf_merge(2, UINT32_MAX, &first.out, 1, &second.out), GSID_E_CONFIG);
    assert_int_equal(gsid_batch_frf_divide(2, 0, &first.out), GSID_E_CONFIG);
    assert_int_equal(gsid_batch_frf_merge(2, 3, NULL, 7, &second.out), GSID_E_NULL);
    second.out.cov_yu = NULL;
    assert_int_equal(gsid_batch_frf_merge(2, 3, &first.out, 7, &second.out), GSID_E_NULL);
    assert_int_equal(gsid_batch_frf_divide(2, 7, &second.out), GSID_E_NULL);
    assert_int_equal(gsid_batch_frf_error_variance(2, &second.out, second.g, variance), GSID_E_NULL);
    assert_memory_equal(&first, &kept, offsetof(means, out));
    first.u[0].re = first.u[0].im = 0; /* nothing is known there */
    assert_int_equal(gsid_batch_frf_divide(2, 10, &first.out), GSID_OK);
    assert_true(first.g[0].re == 0 && isinf(first.var_g[0]) && isfinite(first.var_g[1]));
}

static void derivatives_at_many_frequencies_are_those_at_each(void **state) {
    (void)state;
    enum { N_FREQ = 5, N_PARAMETERS = 5 };
    gsid_rational m;
    assert_int_equal(gsid_rational_init(&m, GSID_DOMAIN_S, 2, 1, 300), GSID_OK);
    m.num[0] = 0.4, m.num[1] = -0.1, m.den[0] = 1.1, m.den[1] = 0.2, m.den[2] = 1, m.delay_s = 2e-3;
    const double f_hz[N_FREQ] = {0, 1, 20, 47.7, 300}, bad[2] = {1, NAN};
    gsid_cplx g[N_FREQ], gradient[N_FREQ * N_PARAMETERS], one, row[N_PARAMETERS];
    assert_int_equal(gsid_batch_rational_gradient(&m, N_FREQ, f_hz, g, gradient), GSID_OK);
    for (int k = 0; k < N_FREQ; k++) {
        assert_int_equal(gsid_rational_gradient(&m, f_hz[k], &one, row), GSID_OK);
        assert_memory_equal(&one, g + k, sizeof one);
        assert_memory_equal(row, gradient + (size_t)k * N_PARAMETERS, sizeof row);
    }
    assert_int_equal(gsid_batch_rational_gradient(&m, 2, bad, g, gradient), GSID_E_NONFINITE);
    assert_int_equal(gsid_batch_rational_gradient(&m, 0, NULL, NULL, NULL), GSID_OK);
    assert_int_equal(gsid_batch_rational_gradient(NULL, 1, f_hz, g, gradient), GSID_E_NULL);
    assert_int_equal(gsid_batch_rational_gradient(&m, 1, NULL, g, gradient), GSID_E_NULL);
    assert_int_equal(gsid_batch_rational_gradient(&m, 1, f_hz, NULL, gradient), GSID_E_NULL);
    assert_int_equal(gsid_batch_rational_gradient(&m, 1, f_hz, g, NULL), GSID_E_NULL);
    m.n_poles = GSID_ORDER_MAX + 1;
    assert_int_equal(gsid_batch_rational_gradient(&m, 1, f_hz, g, gradient), GSID_E_CONFIG);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(batch_equals_streaming_to_rounding),
        cmocka_unit_test(a_period_too_long_to_keep_leaves_the_next_as_they_are),
        cmocka_unit_test(spectra_refuse),
        cmocka_unit_test(blocks_of_any_size_give_the_same_bits),
        cmocka_unit_test(a_refused_block_leaves_the_object_as_it_was),
        cmocka_unit_test(merged_means_are_those_of_merged_measurements),
        cmocka_unit_test(derivatives_at_many_frequencies_are_those_at_each),
    };
    return cmocka_run_group_tests_name("host batch", tests, fill_samples, NULL);
}
