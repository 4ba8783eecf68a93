/* Streaming lines against a slow long double transform. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "gsid/excitation.h"
#include "gsid/spectrum.h"
#include "streamed_signal.h"

enum { N = 90, F = 6 };
static const uint32_t lines[F] = {0, 1, 7, 22, 44, 45}; /* mean, any, and N/2 */
static gsid_cplx twiddle[N];
static union {
    gsid_cplx align;
    unsigned char bytes[GSID_SPECTRUM_MEM_SIZE(F, 2) + 16];
} memory;

static int fill_twiddle(void **state) {
    (void)state;
    return gsid_twiddle_fill(N, twiddle) == GSID_OK ? 0 : -1;
}

static gsid_spectrum_cfg cfg_of(uint32_t n_channels, uint32_t n_first) {
    gsid_spectrum_cfg cfg = {N, F, n_channels, n_first, lines, twiddle};
    return cfg;
}

/* run one period and compare every line of every channel */
static void run_period(gsid_spectrum *s, uint64_t n_start, gsid_cplx *got) {
    for (uint64_t n = n_start; n < n_start + N; n++) {
        const gsid_real x[2] = {sample(n, 0), sample(n, 1)};
        assert_int_equal(gsid_spectrum_step(s, x), n == n_start + N - 1 ? GSID_DONE : GSID_OK);
    }
    assert_int_equal(gsid_spectrum_result(s, got), GSID_OK);
}

static void assert_lines(const gsid_cplx *got, uint64_t n_start, uint32_t n_channels) {
    for (uint32_t i = 0; i < F; i++) {
        for (uint32_t c = 0; c < n_channels; c++) {
            const gsid_cplx x = got[i * n_channels + c];
            /* N products, each rounded to half an epsilon of a partial sum below N, times 2/N: below N epsilon */
            const cplx_l want = slow_line(N, lines[i], n_start, c);
            assert_near((long double)x.re, want.re, N * EPSILON);
            assert_near((long double)x.im, want.im, N * EPSILON);
        }
    }
}

static void lines_are_the_transform_across_period_ends(void **state) {
    (void)state;
    const uint32_t firsts[3] = {0, 1, 77};
    for (uint32_t n_channels = 1; n_channels <= 2; n_channels++) {
        for (int f = 0; f < 3; f++) {
            gsid_spectrum_cfg cfg = cfg_of(n_channels, firsts[f]);
            gsid_spectrum s;
            gsid_cplx got[2 * F];
            assert_int_equal(gsid_spectrum_init(&s, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
            for (uint64_t p = 0; p < 3; p++) {
                run_period(&s, firsts[f] + p * N, got);
                assert_lines(got, firsts[f] + p * N, n_channels);
            }
            assert_int_equal(gsid_spectrum_step(&s, (const gsid_real[2]){1, 1}), GSID_OK);
            assert_int_equal(gsid_spectrum_reset(&s), GSID_OK); /* a restart in the middle of a period */
            run_period(&s, firsts[f], got);
            assert_lines(got, firsts[f], n_channels);
        }
    }
}

static void a_unit_sine_reads_its_amplitude_and_phase(void **state) {
    (void)state;
    gsid_spectrum_cfg cfg = cfg_of(1, 0);
    gsid_spectrum s;
    gsid_cplx got[F];
    assert_int_equal(gsid_spectrum_init(&s, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
    for (uint32_t n = 0; n < N; n++) { /* 2.5 cos(2 pi 7 n / N + 1) + 0.75 */
        gsid_real x = GSID_R(0.75) + (gsid_real)(2.5L * cosl(2 * PI_L * 7 * n / N + 1));
        gsid_spectrum_step(&s, &x);
    }
    assert_int_equal(gsid_spectrum_result(&s, got), GSID_OK);
    assert_true(fabsl((long double)got[0].re - 0.75L) < N * EPSILON);
    assert_true(fabsl((long double)got[2].re - 2.5L * cosl(1)) < N * EPSILON);
    assert_true(fabsl((long double)got[2].im - 2.5L * sinl(1)) < N * EPSILON);
    assert_true(fabsl((long double)got[3].re) < N * EPSILON && fabsl((long double)got[3].im) < N * EPSILON);
}

static void period_one_and_period_one_million_are_equal_to_the_bit(void **state) {
    (void)state;
    gsid_spectrum_cfg cfg = cfg_of(2, 11);
    gsid_spectrum s;
    gsid_cplx first[2 * F], late[2 * F];
    assert_int_equal(gsid_spectrum_init(&s, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
    run_period(&s, 0, first);
    assert_int_equal(gsid_spectrum_skip(&s, 1000000u * N), GSID_DONE);
    run_period(&s, 0, late);
    assert_memory_equal(first, late, sizeof first);
    assert_int_equal(gsid_spectrum_skip(&s, UINT32_MAX / N * N), GSID_DONE); /* weeks at 3 kHz, in one call */
    run_period(&s, 0, late);
    assert_memory_equal(first, late, sizeof first);
    /* and by a path that stops in the middle of periods: 7 + 1000 N - 7 samples */
    assert_int_equal(gsid_spectrum_skip(&s, 7), GSID_OK);
    assert_int_equal(gsid_spectrum_skip(&s, 1000u * N - 7), GSID_DONE);
    run_period(&s, 0, late);
    assert_memory_equal(first, late, sizeof first);
}

static void a_skip_keeps_the_time(void **state) {
    (void)state;
    gsid_spectrum_cfg cfg = cfg_of(1, 0);
    gsid_spectrum s;
    gsid_cplx with_zeros[F], skipped[F];
    const gsid_real zero = 0;
    const uint32_t losses[2] = {30, N}; /* inside the first period, or the first samples of the second */
    for (int i = 0; i < 2; i++) {
        for (int way = 0; way < 2; way++) { /* ten samples skipped, or summed as zeros: the same sums */
            assert_int_equal(gsid_spectrum_init(&s, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
            for (uint32_t n = 0; n < 2 * N && !(i == 0 && n == N); n++) {
                gsid_real x = sample(n, 0);
                if (n < losses[i] || n >= losses[i] + 10) {
                    gsid_spectrum_step(&s, &x);
                } else if (way == 0) {
                    gsid_spectrum_step(&s, &zero);
                } else if (n == losses[i]) {
                    assert_int_equal(gsid_spectrum_skip(&s, 10), GSID_OK);
                }
            }
            assert_int_equal(gsid_spectrum_result(&s, way == 0 ? with_zeros : skipped), GSID_OK);
        }
        assert_memory_equal(with_zeros, skipped, sizeof skipped);
    }
    /* past the end of a period nothing of it is left */
    gsid_real x = 1;
    gsid_spectrum_step(&s, &x);
    assert_int_equal(gsid_spectrum_skip(&s, N - 1), GSID_DONE);
    assert_int_equal(gsid_spectrum_result(&s, skipped), GSID_E_STATE);
    run_period(&s, 2 * N, skipped);
    assert_lines(skipped, 2 * N, 1);
    assert_int_equal(gsid_spectrum_skip(&s, 0), GSID_OK); /* no time passed: the result still stands */
    assert_int_equal(gsid_spectrum_result(&s, skipped), GSID_OK);
}

static void refused_samples_change_nothing(void **state) {
    (void)state;
    gsid_spectrum_cfg cfg = cfg_of(2, 0);
    gsid_spectrum s;
    gsid_cplx clean[2 * F], disturbed[2 * F];
    assert_int_equal(gsid_spectrum_init(&s, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
    run_period(&s, 0, clean);
    const gsid_real bad[3][2] = {{(gsid_real)NAN, 0}, {0, (gsid_real)INFINITY}, {-(gsid_real)INFINITY, 0}};
    for (uint32_t n = 0; n < N; n++) {
        assert_int_equal(gsid_spectrum_step(&s, bad[n % 3]), GSID_E_NONFINITE);
        gsid_spectrum_step(&s, (const gsid_real[2]){sample(n, 0), sample(n, 1)});
    }
    assert_int_equal(gsid_spectrum_step(&s, bad[0]), GSID_E_NONFINITE); /* the finished period stays too */
    assert_int_equal(gsid_spectrum_result(&s, disturbed), GSID_OK);
    assert_memory_equal(clean, disturbed, sizeof clean);
}

static void memory_is_counted_and_checked(void **state) {
    (void)state;
    for (uint32_t n_channels = 1; n_channels <= 2; n_channels++) {
        gsid_spectrum_cfg cfg = cfg_of(n_channels, 0);
        const size_t size = gsid_spectrum_mem_size(&cfg);
        assert_int_equal(size, GSID_SPECTRUM_MEM_SIZE(F, n_channels));
        assert_int_equal(size, F * (n_channels * 2 * sizeof(gsid_real) + 4));
        gsid_spectrum s, untouched;
        memset(&s, 0, sizeof s);
        untouched = s;
        memset(memory.bytes, 0x5A, sizeof memory.bytes);
        assert_int_equal(gsid_spectrum_init(&s, &cfg, memory.bytes, size - 1), GSID_E_MEMORY);
        assert_int_equal(gsid_spectrum_init(&s, &cfg, memory.bytes + 1, size), GSID_E_MEMORY);
        assert_memory_equal(&s, &untouched, sizeof s);
        assert_int_equal(memory.bytes[0], 0x5A);
        assert_int_equal(gsid_spectrum_init(&s, &cfg, memory.bytes, size), GSID_OK);
        gsid_cplx got[2 * F];
        run_period(&s, 0, got);
        assert_int_equal(memory.bytes[size], 0x5A); /* not a byte more than asked for */
    }
}

static void every_refusal(void **state) {
    (void)state;
    const gsid_spectrum_cfg good = cfg_of(1, 0);
    gsid_spectrum s, untouched;
    gsid_cplx got[F];
    const gsid_real x = 1;
    memset(&s, 0, sizeof s);
    untouched = s;
    assert_int_equal(gsid_spectrum_reset(&s), GSID_E_STATE);
    assert_int_equal(gsid_spectrum_step(&s, &x), GSID_E_STATE);
    assert_int_equal(gsid_spectrum_skip(&s, 1), GSID_E_STATE);
    assert_int_equal(gsid_spectrum_result(&s, got), GSID_E_STATE);
#define REFUSED(field, value, status)                                                                                  \
    do {                                                                                                               \
        gsid_spectrum_cfg bad = good;                                                                                  \
        bad.field = (value);                                                                                           \
        assert_int_equal(gsid_spectrum_mem_size(&bad), 0);                                                             \
        assert_int_equal(gsid_spectrum_init(&s, &bad, memory.bytes, sizeof memory.bytes), status);                     \
    } while (0)
    const uint32_t too_high[F] = {0, 1, 7, 22, 44, 46};
    REFUSED(line, NULL, GSID_E_NULL);
    REFUSED(twiddle, NULL, GSID_E_NULL);
    REFUSED(n_period, 1, GSID_E_CONFIG);
    REFUSED(n_period, (UINT32_C(1) << 30) + 1, GSID_E_CONFIG);
    REFUSED(n_lines, 0, GSID_E_CONFIG);
    REFUSED(n_channels, 0, GSID_E_CONFIG);
    REFUSED(n_channels, 3, GSID_E_CONFIG);
    REFUSED(n_first, N, GSID_E_CONFIG);
    REFUSED(line, too_high, GSID_E_CONFIG);
    assert_int_equal(gsid_spectrum_mem_size(NULL), 0);
    assert_int_equal(gsid_spectrum_init(&s, NULL, memory.bytes, sizeof memory.bytes), GSID_E_NULL);
    assert_int_equal(gsid_spectrum_init(&s, &good, NULL, 1000), GSID_E_NULL);
    assert_int_equal(gsid_spectrum_init(NULL, &good, memory.bytes, sizeof memory.bytes), GSID_E_NULL);
    assert_memory_equal(&s, &untouched, sizeof s);
    assert_int_equal(gsid_spectrum_init(&s, &good, memory.bytes, sizeof memory.bytes), GSID_OK);
    assert_int_equal(gsid_spectrum_reset(NULL), GSID_E_NULL);
    assert_int_equal(gsid_spectrum_step(NULL, &x), GSID_E_NULL);
    assert_int_equal(gsid_spectrum_step(&s, NULL), GSID_E_NULL);
    assert_int_equal(gsid_spectrum_skip(NULL, 1), GSID_E_NULL);
    assert_int_equal(gsid_spectrum_result(NULL, got), GSID_E_NULL);
    assert_int_equal(gsid_spectrum_result(&s, NULL), GSID_E_NULL);
    assert_int_equal(gsid_spectrum_result(&s, got), GSID_E_STATE);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lines_are_the_transform_across_period_ends),
        cmocka_unit_test(a_unit_sine_reads_its_amplitude_and_phase),
        cmocka_unit_test(period_one_and_period_one_million_are_equal_to_the_bit),
        cmocka_unit_test(a_skip_keeps_the_time),
        cmocka_unit_test(refused_samples_change_nothing),
        cmocka_unit_test(memory_is_counted_and_checked),
        cmocka_unit_test(every_refusal),
    };
    return cmocka_run_group_tests_name("spectrum", tests, fill_twiddle, NULL);
}
