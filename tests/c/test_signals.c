/* Binary sequences, sweeps, stepped sines and grids of lines, against the source's program and closed forms. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "gsid/signals.h"
#include "reference.h"

/* x = -ones(N,1)*A; x(mod([1:N].^2, N)+1) = A; x(1) = A, each chip held; three periods, to the bit */
static void quadratic_residues_are_the_source_s_program(void **state) {
    (void)state;
    enum { HOLD = 4 };
    const uint32_t primes[] = {3, 7, 11, 13, 1553};
    static int high[1553];
    for (size_t k = 0; k < sizeof primes / sizeof *primes; k++) {
        const uint32_t n = primes[k];
        memset(high, 0, sizeof high);
        for (uint32_t i = 1; i <= n; i++) {
            high[i * i % n] = 1;
        }
        high[0] = 1;
        gsid_prbs prbs;
        const gsid_prbs_cfg cfg = {GSID_PRBS_QUADRATIC_RESIDUE, n, HOLD, GSID_R(45.0)};
        assert_int_equal(gsid_prbs_init(&prbs, &cfg), GSID_OK);
        for (uint32_t i = 0; i < 3 * n * HOLD; i++) {
            gsid_real u;
            const int is_last = i % (n * HOLD) == n * HOLD - 1;
            assert_int_equal(gsid_prbs_step(&prbs, &u), is_last ? GSID_DONE : GSID_OK);
            assert_true(u == (high[i / HOLD % n] ? GSID_R(45.0) : -GSID_R(45.0)));
        }
    }
}

/* Every order has all its states, or the autocorrelation would not be N and -1. */
static void maximum_length_is_maximum(void **state) {
    (void)state;
    for (unsigned order = 2; order <= 20; order++) {
        const uint32_t n = (UINT32_C(1) << order) - 1;
        gsid_prbs prbs;
        const gsid_prbs_cfg cfg = {GSID_PRBS_MAXIMUM_LENGTH, n, 1, GSID_R(1.0)};
        assert_int_equal(gsid_prbs_init(&prbs, &cfg), GSID_OK);
        uint32_t n_high = 0, n_start = 0;
        for (uint32_t i = 0; i < n; i++) {
            gsid_real u;
            n_start += prbs.state == 1;
            assert_int_equal(gsid_prbs_step(&prbs, &u), i == n - 1 ? GSID_DONE : GSID_OK);
            n_high += u > 0;
        }
        assert_int_equal(n_high, (n + 1) / 2);
        assert_int_equal(n_start, 1);        /* not back before the end, */
        assert_int_equal(prbs.state, 1);     /* but then */
    }
}

static void valid_lengths(void **state) {
    (void)state;
    assert_int_equal(gsid_prbs_nearest(GSID_PRBS_QUADRATIC_RESIDUE, 1553), 1553);
    assert_int_equal(gsid_prbs_nearest(GSID_PRBS_QUADRATIC_RESIDUE, 1500), 1499);
    assert_int_equal(gsid_prbs_nearest(GSID_PRBS_QUADRATIC_RESIDUE, 9), 7); /* the shorter of 7 and 11 */
    assert_int_equal(gsid_prbs_nearest(GSID_PRBS_QUADRATIC_RESIDUE, 0), 3);
    assert_int_equal(gsid_prbs_nearest(GSID_PRBS_QUADRATIC_RESIDUE, UINT32_MAX), 16777213);
    assert_int_equal(gsid_prbs_nearest(GSID_PRBS_MAXIMUM_LENGTH, 1500), 1023);
    assert_int_equal(gsid_prbs_nearest(GSID_PRBS_MAXIMUM_LENGTH, 1600), 2047);
    assert_int_equal(gsid_prbs_nearest((gsid_prbs_kind)7, 1600), 0);
    gsid_prbs prbs;
    const gsid_prbs_cfg bad[] = {
        {GSID_PRBS_QUADRATIC_RESIDUE, 1551, 1, 1}, {GSID_PRBS_QUADRATIC_RESIDUE, 2, 1, 1},
        {GSID_PRBS_MAXIMUM_LENGTH, 1000, 1, 1},    {(gsid_prbs_kind)7, 7, 1, 1},
        {GSID_PRBS_MAXIMUM_LENGTH, 7, 0, 1},       {GSID_PRBS_MAXIMUM_LENGTH, 1023, 1u << 21, 1}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(gsid_prbs_init(&prbs, &bad[i]), GSID_E_CONFIG);
    }
    const gsid_prbs_cfg infinite = {GSID_PRBS_MAXIMUM_LENGTH, 7, 1, (gsid_real)INFINITY};
    assert_int_equal(gsid_prbs_init(&prbs, &infinite), GSID_E_NONFINITE);
}

static void sweeps_are_their_formulas_in_every_period(void **state) {
    (void)state;
    enum { N = 600 };
    const long double k0 = 2, k1 = 90, b = k1 / k0;
    for (int kind = GSID_SWEEP_LINEAR; kind <= GSID_SWEEP_LOGARITHMIC; kind++) {
        gsid_sweep sweep;
        const gsid_sweep_cfg cfg = {(gsid_sweep_kind)kind, N, 2, 90, GSID_R(16.0), GSID_R(0.75)};
        static gsid_real first[N];
        assert_int_equal(gsid_sweep_init(&sweep, &cfg), GSID_OK);
        for (int n = 0; n < 3 * N; n++) {
            gsid_real u;
            const long double s = (long double)(n % N) / N;
            const long double turns =
                kind == GSID_SWEEP_LINEAR ? s * (k0 + s * (k1 - k0) / 2) : k0 * (powl(b, s) - 1) / logl(b);
            assert_int_equal(gsid_sweep_step(&sweep, &u), n % N == N - 1 ? GSID_DONE : GSID_OK);
            /* turns to some units in the last place, times 2 pi, times the amplitude */
            assert_near((long double)u, 16 * sinl(2 * PI_L * turns + 0.75L), 16 * 2 * PI_L * 4 * (1 + turns) * EPSILON);
            if (n < N) {
                first[n] = u;
            }
            assert_true(u == first[n % N]);
        }
        assert_near((long double)gsid_sweep_turns(&cfg),
                    kind == GSID_SWEEP_LINEAR ? (k0 + k1) / 2 : (k1 - k0) / logl(b), 100 * 4 * EPSILON);
    }
    const gsid_sweep_cfg bad[] = {{GSID_SWEEP_LINEAR, N, 5, 5, 1, 0},
                                  {GSID_SWEEP_LINEAR, N, 0, 5, 1, 0},
                                  {GSID_SWEEP_LINEAR, N, 5, N / 2, 1, 0},
                                  {GSID_SWEEP_LOGARITHMIC, 1, 5, 6, 1, 0},
                                  {(gsid_sweep_kind)5, N, 5, 6, 1, 0}};
    gsid_sweep sweep;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(gsid_sweep_init(&sweep, &bad[i]), GSID_E_CONFIG);
        assert_true(isnan(gsid_sweep_turns(&bad[i])));
    }
    const gsid_sweep_cfg infinite = {GSID_SWEEP_LINEAR, N, 5, (gsid_real)NAN, 1, 0};
    assert_int_equal(gsid_sweep_init(&sweep, &infinite), GSID_E_NONFINITE);
}

/* EXC-7 as it is written takes 1 from a number near 1: in float 0.4 % of 100 turns were lost between lines 100 and 101, and a
 * third of them between 1000 and 1001. */
static void a_sweep_between_near_lines_has_all_its_turns(void **state) {
    (void)state;
    enum { N = 6000 };
    const gsid_real lines[][2] = {{100, 101},         {101, 100},          {1000, 1001}, {2900, GSID_R(2900.5)},
                                  {GSID_R(0.5), 250}, {2500, GSID_R(1e-3)}};
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        const gsid_sweep_cfg cfg = {GSID_SWEEP_LOGARITHMIC, N, lines[i][0], lines[i][1], 1, 0};
        const long double k0 = (long double)cfg.line_start, ratio = logl((long double)cfg.line_stop / k0);
        const long double all = k0 * expm1l(ratio) / ratio, tolerance = (4 + fabsl(ratio)) * EPSILON;
        gsid_sweep sweep;
        gsid_real u;
        assert_near((long double)gsid_sweep_turns(&cfg), all, tolerance * all);
        assert_int_equal(gsid_sweep_init(&sweep, &cfg), GSID_OK);
        for (int n = 0; n < N; n++) {
            const long double turns = k0 * expm1l(n * ratio / N) / ratio;
            assert_true(gsid_sweep_step(&sweep, &u) >= 0);
            assert_near((long double)u, sinl(2 * PI_L * turns), 2 * PI_L * tolerance * (turns + 1));
        }
    }
}

/* The ratio of the limits overflowed: GSID_OK, and nothing but NaN. */
static void a_sweep_of_too_many_octaves_is_refused(void **state) {
    (void)state;
#ifdef GSID_SINGLE
    const gsid_real least = GSID_R(1e-45), small = FLT_MIN;
#else
    const gsid_real least = 5e-324, small = DBL_MIN;
#endif
    const gsid_real refused[][2] = {{least, 10}, {10, least}, {small / 64, 2900}, {2900, small / 64}};
    const gsid_real fine[][2] = {{least, 4 * least}, {small, GSID_R(0.5)}, {GSID_R(0.5), small}, {small, 8 * small}};
    gsid_sweep sweep;
    gsid_real u;
    for (size_t i = 0; i < 4; i++) {
        gsid_sweep_cfg cfg = {GSID_SWEEP_LOGARITHMIC, 6000, refused[i][0], refused[i][1], 1, 0};
        assert_int_equal(gsid_sweep_init(&sweep, &cfg), GSID_E_CONFIG);
        assert_true(isnan(gsid_sweep_turns(&cfg)));
        cfg.kind = GSID_SWEEP_LINEAR;
        assert_int_equal(gsid_sweep_init(&sweep, &cfg), GSID_OK);
        assert_true(isfinite(gsid_sweep_turns(&cfg)));
    }
    for (size_t i = 0; i < 4; i++) {
        const gsid_sweep_cfg cfg = {GSID_SWEEP_LOGARITHMIC, 6000, fine[i][0], fine[i][1], 1, 0};
        const long double k0 = (long double)cfg.line_start, ratio = logl((long double)cfg.line_stop / k0);
        const long double all = k0 * expm1l(ratio) / ratio, tolerance = (4 + fabsl(ratio)) * EPSILON;
        assert_int_equal(gsid_sweep_init(&sweep, &cfg), GSID_OK);
        assert_near((long double)gsid_sweep_turns(&cfg), all, tolerance * all + (long double)least);
        for (int n = 0; n < 6000; n++) {
            assert_true(gsid_sweep_step(&sweep, &u) >= 0 && isfinite(u));
        }
    }
}

static void a_stepped_sine_settles_and_lasts_line_by_line(void **state) {
    (void)state;
    enum { N = 40, LINES = 3, SETTLE = 7, PERIODS = 2 };
    static gsid_cplx twiddle[N];
    const uint32_t line[LINES] = {5, 1, 19};
    const gsid_real amplitude[LINES] = {1, 2, GSID_R(0.5)};
    gsid_twiddle_fill(N, twiddle);
    gsid_stepped s;
    const gsid_stepped_cfg cfg = {N, LINES, SETTLE, PERIODS, line, amplitude, twiddle};
    assert_int_equal(gsid_stepped_init(&s, &cfg), GSID_OK);
    gsid_real u;
    for (uint32_t i = 0; i < LINES; i++) {
        for (uint32_t n = 0; n < SETTLE + PERIODS * N; n++) {
            const gsid_status want = n < SETTLE ? GSID_SETTLING : n == SETTLE + PERIODS * N - 1 ? GSID_DONE : GSID_OK;
            assert_int_equal(s.i, i);
            assert_int_equal(gsid_stepped_step(&s, &u), want);
            assert_near((long double)u, (long double)amplitude[i] * cosl(2 * PI_L * (long double)(line[i] * n % N) / N),
                        4 * EPSILON);
        }
    }
    assert_int_equal(s.i, LINES);
    assert_int_equal(gsid_stepped_step(&s, &u), GSID_E_STATE);
    const uint32_t zero[LINES] = {5, 0, 19}, nyquist[LINES] = {5, 1, 20};
    gsid_stepped_cfg bad = cfg;
    bad.line = zero;
    assert_int_equal(gsid_stepped_init(&s, &bad), GSID_E_CONFIG);
    bad.line = nyquist;
    assert_int_equal(gsid_stepped_init(&s, &bad), GSID_E_CONFIG);
    bad = cfg, bad.n_periods = 0;
    assert_int_equal(gsid_stepped_init(&s, &bad), GSID_E_CONFIG);
    const gsid_real infinite[LINES] = {1, (gsid_real)INFINITY, 1};
    bad = cfg, bad.amplitude = infinite;
    assert_int_equal(gsid_stepped_init(&s, &bad), GSID_E_NONFINITE);
}

static void of_each_group_one_odd_line_is_left_out(void **state) {
    (void)state;
    uint32_t line[64], again[64], n, n_again;
    assert_int_equal(gsid_lines_odd_random(2, 100, 4, 5, 0, NULL, &n), GSID_OK);
    assert_int_equal(n, 49 - 12); /* odd lines 3 .. 99, twelve whole groups */
    assert_int_equal(gsid_lines_odd_random(2, 100, 4, 5, n - 1, line, &n), GSID_E_MEMORY);
    assert_int_equal(gsid_lines_odd_random(2, 100, 4, 5, 64, line, &n), GSID_OK);
    uint32_t kept[12] = {0};
    for (uint32_t i = 0; i < n; i++) {
        assert_int_equal(line[i] % 2, 1);
        assert_true(line[i] >= 3 && line[i] <= 99 && (i == 0 || line[i] > line[i - 1]));
        if ((line[i] - 3) / 8 < 12) {
            kept[(line[i] - 3) / 8]++;
        }
    }
    for (int g = 0; g < 12; g++) {
        assert_int_equal(kept[g], 3);
    }
    gsid_lines_odd_random(2, 100, 4, 6, 64, again, &n_again);
    assert_int_equal(n_again, n);
    assert_memory_not_equal(line, again, n * sizeof *line);
    assert_int_equal(gsid_lines_odd_random(4, 4, 4, 5, 64, line, &n), GSID_E_CONFIG);
    assert_int_equal(gsid_lines_odd_random(1, 9, 1, 5, 64, line, &n), GSID_E_CONFIG);
    assert_int_equal(gsid_lines_odd_random(1, 9, 4, 5, 64, line, NULL), GSID_E_NULL);
}

static void quasi_log_lines_are_the_nearest_odd_ones(void **state) {
    (void)state;
    uint32_t line[64], n;
    assert_int_equal(gsid_lines_quasi_log(1, 1000, 8, 64, line, &n), GSID_OK);
    for (uint32_t i = 0; i < n; i++) {
        assert_true(line[i] % 2 == 1 && (i == 0 || line[i] > line[i - 1]));
    }
    assert_int_equal(line[0], 1);
    /* above 10 the ideal lines, 1.33 apart, are further apart than odd ones: each is met within 1 */
    for (int k = 8; k <= 23; k++) {
        const long double ideal = powl(10, k / 8.0L);
        long double nearest = 1e9L;
        for (uint32_t i = 0; i < n; i++) {
            nearest = fminl(nearest, fabsl((long double)line[i] - ideal));
        }
        assert_true(nearest <= 1.001L);
    }
    /* Bug: too small an array was filled before it was refused. */
    const uint32_t n_lines = n;
    line[0] = 77;
    assert_int_equal(gsid_lines_quasi_log(1, 1000, 8, n_lines - 1, line, &n), GSID_E_MEMORY);
    assert_int_equal(line[0], 77);
    assert_int_equal(gsid_lines_quasi_log(1, 1000, 0, 64, line, &n), GSID_E_CONFIG);
    assert_int_equal(gsid_lines_quasi_log(2, 2, 8, 64, line, &n), GSID_E_CONFIG);
}

/* Bug: in float a ratio that rounds to 1 never came to an end, in double it took seconds. */
static void quasi_log_lines_of_any_density_are_odd_lines(void **state) {
    (void)state;
    static const uint32_t density[] = {2001, 100000, 40000000, UINT32_MAX};
    uint32_t line[500], n;
    for (size_t d = 0; d < sizeof density / sizeof *density; d++) {
        assert_int_equal(gsid_lines_quasi_log(1, 1000, density[d], 500, line, &n), GSID_OK);
        assert_int_equal(n, 500);
        for (uint32_t i = 0; i < n; i++) {
            assert_int_equal(line[i], 2 * i + 1);
        }
    }
}

static void no_pointer_no_signal(void **state) {
    (void)state;
    gsid_real u;
    gsid_prbs prbs;
    gsid_sweep sweep;
    gsid_stepped stepped;
    memset(&prbs, 0, sizeof prbs);
    memset(&sweep, 0, sizeof sweep);
    memset(&stepped, 0, sizeof stepped);
    assert_int_equal(gsid_prbs_init(&prbs, NULL), GSID_E_NULL);
    assert_int_equal(gsid_sweep_init(NULL, &sweep.cfg), GSID_E_NULL);
    assert_int_equal(gsid_stepped_init(&stepped, &stepped.cfg), GSID_E_NULL);
    assert_int_equal(gsid_prbs_step(&prbs, NULL), GSID_E_NULL);
    assert_int_equal(gsid_prbs_step(&prbs, &u), GSID_E_STATE);
    assert_int_equal(gsid_sweep_step(&sweep, &u), GSID_E_STATE);
    assert_int_equal(gsid_stepped_step(&stepped, &u), GSID_E_STATE);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(quadratic_residues_are_the_source_s_program),
        cmocka_unit_test(maximum_length_is_maximum),
        cmocka_unit_test(valid_lengths),
        cmocka_unit_test(sweeps_are_their_formulas_in_every_period),
        cmocka_unit_test(a_sweep_between_near_lines_has_all_its_turns),
        cmocka_unit_test(a_sweep_of_too_many_octaves_is_refused),
        cmocka_unit_test(a_stepped_sine_settles_and_lasts_line_by_line),
        cmocka_unit_test(of_each_group_one_odd_line_is_left_out),
        cmocka_unit_test(quasi_log_lines_are_the_nearest_odd_ones),
        cmocka_unit_test(quasi_log_lines_of_any_density_are_odd_lines),
        cmocka_unit_test(no_pointer_no_signal),
    };
    return cmocka_run_group_tests_name("signals", tests, NULL, NULL);
}
