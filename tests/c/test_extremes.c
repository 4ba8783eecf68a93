/* Signals in units that are far off, and counts at their ends: the answer is that of the same signals in other units, or it says
 * that it is not known. It was a variance of 0 in silence. */
#include <string.h>

#include "gsid/distortion.h"
#include "gsid/excitation.h"
#include "reference.h"

enum { N = 60, F = 4, P = 6 };
static const uint32_t lines[F] = {1, 4, 11, 29};
static gsid_cplx twiddle[N];
static union {
    gsid_cplx align;
    unsigned char bytes[GSID_FRF_SPREAD_MEM_SIZE(N, F, 1) + GSID_DISTORTION_MEAN_SIZE(F, F) + GSID_FRF_MEM_SIZE(F, 1)];
} memory;

/* Exponents of the range of numbers: of float times STEP. */
#ifdef GSID_SINGLE
enum { STEP = 1 };
#else
enum { STEP = 8 };
#endif
static const int octaves[] = {-130, -120, -100, -80, -66, -50, -40, -20, 0, 20, 40, 55, 66, 80, 100, 120};
enum { N_OCTAVES = sizeof octaves / sizeof octaves[0] };

static int fill_twiddle(void **state) {
    (void)state;
    return gsid_twiddle_fill(N, twiddle) == GSID_OK ? 0 : -1;
}

static gsid_real times_2_to(gsid_real x, int octave) {
    return (gsid_real)ldexp((double)x, octave);
}

static gsid_real input(uint64_t n) {
    long double u = 0.02L * noise_at(n);
    for (int i = 0; i < F; i++) {
        u += cosl(2 * PI_L * (long double)(lines[i] * (n % N) % N) / N + i);
    }
    return (gsid_real)u;
}

static gsid_real output(uint64_t n) {
    return (gsid_real)(0.5L * (long double)input(n + N - 1) + 0.05L * noise_at(n + 1000000) + 0.3L * noise_at(n));
}

typedef struct {
    gsid_status status;
    gsid_cplx g[F];
    gsid_real var_g[F], var_y[F], var_u[F];
} result;

static const gsid_cplx known[F] = {{1, 0}, {1, 1}, {0, -1}, {GSID_R(0.5), 0}};

/* The same measurement with its signals times powers of two. */
static result measure(int engine, int is_known, int octave_u, int octave_y) {
    gsid_cplx u_known[F];
    gsid_frf frf;
    result r;
    for (int i = 0; i < F; i++) {
        u_known[i] = (gsid_cplx){times_2_to(known[i].re, octave_u), times_2_to(known[i].im, octave_u)};
    }
    const gsid_frf_cfg cfg = {
        .n_period = N, .n_lines = F, .line = lines, .twiddle = twiddle, .u_known = is_known ? u_known : NULL};
    gsid_status (*init)(gsid_frf *, const gsid_frf_cfg *, void *, size_t) =
        engine ? gsid_frf_init_spread : gsid_frf_init;
    assert_int_equal(init(&frf, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
    for (uint64_t n = 0; n < P * N; n++) {
        assert_true(gsid_frf_step(&frf, times_2_to(input(n), octave_u), times_2_to(output(n), octave_y)) >= 0);
    }
    assert_true(gsid_frf_finish(&frf) >= 0);
    const gsid_frf_out out = {.g = r.g, .var_g = r.var_g, .var_y = r.var_y, .var_u = r.var_u};
    r.status = gsid_frf_result(&frf, &out);
    return r;
}

static void assert_scaled_or_unknown(gsid_real got, gsid_real unit, int octave) {
    const long double want = ldexpl((long double)unit, octave);
    if (!(isinf(got) && got > 0)) {
        assert_near((long double)got, want, 1e-3L * want);
    }
}

/* Where nothing leaves the range: squares of the deviations, which are some 2^-9 of the lines, and of the lines. */
static int is_ordinary(int octave_u, int octave_y) {
    const int least = octave_u < octave_y ? octave_u : octave_y, most = octave_u > octave_y ? octave_u : octave_y;
    return least >= -38 * STEP && most <= 55 * STEP && octave_y - octave_u < 55 * STEP &&
           octave_u - octave_y < 55 * STEP;
}

static void a_response_is_right_or_unknown_in_any_unit(void **state) {
    (void)state;
    for (int kind = 0; kind < 4; kind++) {
        const result unit = measure(kind % 2, kind / 2, 0, 0);
        assert_int_equal(unit.status, GSID_OK);
        for (int at = 0; at < N_OCTAVES * N_OCTAVES; at += repeats(1, 13)) {
            const int u = STEP * octaves[at / N_OCTAVES], y = STEP * octaves[at % N_OCTAVES];
            const result r = measure(kind % 2, kind / 2, u, y);
            int n_unknown = 0;
            assert_true(r.status == GSID_OK || r.status == GSID_RANGE || r.status == GSID_E_NONFINITE);
            assert_true(r.status == GSID_OK || !is_ordinary(u, y));
            for (int i = 0; i < F && r.status >= 0; i++) {
                assert_scaled_or_unknown(r.var_g[i], unit.var_g[i], 2 * (y - u));
                n_unknown += isinf(r.var_g[i]) ? 1 : 0;
                if (isinf(r.var_g[i])) {
                    continue;
                }
                assert_scaled_or_unknown(r.var_y[i], unit.var_y[i], 2 * y);
                assert_scaled_or_unknown(r.var_u[i], unit.var_u[i], 2 * u);
                assert_true(isfinite(r.g[i].re) && isfinite(r.g[i].im));
                if (is_ordinary(u, y)) { /* the same bits */
                    assert_true(r.g[i].re == times_2_to(unit.g[i].re, y - u));
                    assert_true(r.var_g[i] == times_2_to(unit.var_g[i], 2 * (y - u)));
                }
            }
            assert_true(r.status < 0 || (n_unknown > 0) == (r.status == GSID_RANGE));
        }
    }
}

/* No noise is no noise, and no signal no signal. */
static void exact_signals_have_a_variance_of_0(void **state) {
    (void)state;
    gsid_frf frf;
    gsid_real var_g[F];
    const gsid_frf_out out = {.var_g = var_g};
    for (int is_silent = 0; is_silent < 2; is_silent++) {
        const gsid_frf_cfg cfg = {.n_period = N, .n_lines = F, .line = lines, .twiddle = twiddle};
        assert_int_equal(gsid_frf_init(&frf, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
        for (uint64_t n = 0; n < P * N; n++) {
            gsid_frf_step(&frf, input(n % N), is_silent ? 0 : output(n % N));
        }
        assert_int_equal(gsid_frf_result(&frf, &out), GSID_OK);
        for (int i = 0; i < F; i++) {
            assert_true(var_g[i] == 0);
        }
    }
}

/* ---- distortion ---- */

enum { EXCITED = 3 };

static gsid_status finish_realisation(gsid_distortion *d, int octave_u, int octave_y) {
    assert_int_equal(gsid_distortion_start(d, NULL), GSID_OK);
    for (uint64_t n = 0; n < P * N; n++) {
        gsid_distortion_step(d, times_2_to(input(n), octave_u), times_2_to(output(n), octave_y));
    }
    return gsid_distortion_finish(d);
}

static void distortion_is_right_or_refused_in_any_unit(void **state) {
    (void)state;
    const gsid_distortion_cfg cfg = {
        .n_period = N, .n_lines = F, .n_excited = EXCITED, .line = lines, .twiddle = twiddle};
    gsid_real unit[2][F], got[2][F];
    gsid_distortion d;
    for (int at = -1; at < N_OCTAVES * N_OCTAVES; at += at < 0 ? 1 : repeats(1, 13)) {
        const int u = at < 0 ? 0 : STEP * octaves[at / N_OCTAVES], y = at < 0 ? 0 : STEP * octaves[at % N_OCTAVES];
        assert_int_equal(gsid_distortion_init(&d, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
        const gsid_status status = finish_realisation(&d, u, y);
        if (status < 0) {
            assert_true(at >= 0 && !is_ordinary(u, y));
            assert_int_equal(status, GSID_E_NONFINITE);
            assert_int_equal(d.n_realisations, 0);
            continue;
        }
        const gsid_distortion_out out = {.var_noise = (at < 0 ? unit : got)[0], .level = (at < 0 ? unit : got)[1]};
        assert_int_equal(gsid_distortion_result(&d, &out), GSID_OK);
        for (int i = 0; i < EXCITED && at >= 0; i++) {
            assert_near((long double)got[0][i], ldexpl((long double)unit[0][i], 2 * (y - u)),
                        1e-3L * ldexpl((long double)unit[0][i], 2 * (y - u)));
        }
        if (at >= 0) {
            assert_near((long double)got[1][0], ldexpl((long double)unit[1][0], y),
                        1e-3L * ldexpl((long double)unit[1][0], y));
        }
    }
}

/* ---- counts ---- */

/* After 2^32 periods the count was 0, and the next period's share in the means 1/0. */
static void counts_stay_at_the_most_they_can_say(void **state) {
    (void)state;
    for (int engine = 0; engine < 2; engine++) {
        gsid_frf frf, other;
        static union {
            gsid_cplx align;
            unsigned char bytes[GSID_FRF_SPREAD_MEM_SIZE(N, F, 1)];
        } other_memory;
        gsid_cplx g[F];
        const gsid_frf_out out = {.g = g};
        const gsid_frf_cfg cfg = {.n_period = N, .n_lines = F, .line = lines, .twiddle = twiddle};
        gsid_status (*init)(gsid_frf *, const gsid_frf_cfg *, void *, size_t) =
            engine ? gsid_frf_init_spread : gsid_frf_init;
        assert_int_equal(init(&frf, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
        for (uint64_t n = 0; n < 2 * N; n++) {
            gsid_frf_step(&frf, input(n), output(n));
        }
        gsid_frf_finish(&frf);
        frf.n_periods = frf.n_spoiled = frf.n_refused = UINT32_MAX - 1;
        for (uint64_t n = 2 * N; n < 6 * N; n++) {
            gsid_frf_step(&frf, input(n), output(n));
        }
        gsid_frf_finish(&frf);
        assert_int_equal(gsid_frf_result(&frf, &out), GSID_OK);
        for (int i = 0; i < F; i++) {
            assert_true(isfinite(g[i].re) && isfinite(g[i].im));
        }
        for (int k = 0; k < 3; k++) {
            gsid_frf_step(&frf, (gsid_real)NAN, 0);
            gsid_frf_skip(&frf, N);
        }
        gsid_frf_skip(&frf, UINT32_MAX);
        assert_true(frf.n_periods == UINT32_MAX && frf.n_spoiled == UINT32_MAX && frf.n_refused == UINT32_MAX);
        gsid_frf_finish(&frf);
        assert_int_equal(init(&other, &cfg, other_memory.bytes, sizeof other_memory.bytes), GSID_OK);
        for (uint64_t n = 0; n < N; n++) {
            gsid_frf_step(&other, input(n), output(n));
        }
        gsid_frf_finish(&other);
        other.n_spoiled = other.n_refused = 7;
        assert_int_equal(gsid_frf_merge(&frf, &other), GSID_OK);
        assert_true(frf.n_periods == UINT32_MAX && frf.n_spoiled == UINT32_MAX && frf.n_refused == UINT32_MAX);
        gsid_cplx both[2 * F] = {{1, 0}, {1, 0}, {1, 0}, {1, 0}, {1, 0}, {1, 0}, {1, 0}, {1, 0}};
        assert_int_equal(gsid_frf_add_period(&frf, both), GSID_OK);
        assert_true(frf.n_periods == UINT32_MAX);
        assert_int_equal(gsid_frf_result(&frf, &out), GSID_OK);
        for (int i = 0; i < F; i++) {
            assert_true(isfinite(g[i].re) && isfinite(g[i].im));
        }
    }
}

static void counts_of_realisations_stay_too(void **state) {
    (void)state;
    const gsid_distortion_cfg cfg = {
        .n_period = N, .n_lines = F, .n_excited = EXCITED, .line = lines, .twiddle = twiddle};
    gsid_cplx bla[EXCITED];
    const gsid_distortion_out out = {.bla = bla};
    gsid_distortion d;
    assert_int_equal(gsid_distortion_init(&d, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
    assert_int_equal(finish_realisation(&d, 0, 0), GSID_OK);
    d.n_realisations = d.n_periods = UINT32_MAX;
    assert_int_equal(finish_realisation(&d, 0, 0), GSID_OK);
    assert_true(d.n_realisations == UINT32_MAX && d.n_periods == UINT32_MAX);
    assert_int_equal(gsid_distortion_result(&d, &out), GSID_OK);
    for (int i = 0; i < EXCITED; i++) {
        assert_true(isfinite(bla[i].re) && isfinite(bla[i].im));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_response_is_right_or_unknown_in_any_unit),
        cmocka_unit_test(exact_signals_have_a_variance_of_0),
        cmocka_unit_test(distortion_is_right_or_refused_in_any_unit),
        cmocka_unit_test(counts_stay_at_the_most_they_can_say),
        cmocka_unit_test(counts_of_realisations_stay_too),
    };
    return cmocka_run_group_tests_name("extremes", tests, fill_twiddle, NULL);
}
