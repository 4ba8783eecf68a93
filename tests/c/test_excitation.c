/* Twiddle table, grids, phases and multisines, against long double closed forms. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "gsid/excitation.h"
#include "reference.h"

#define N_MAX 7000

static gsid_cplx table[N_MAX];

static long double unit_in_last_place(long double x) {
    int exponent;
    frexpl(x, &exponent);
    return ldexpl((long double)EPSILON, exponent - 1);
}

static void assert_within_ulp(gsid_real got, long double want, long double ulps) {
    assert_true(fabsl((long double)got - want) <= ulps * unit_in_last_place(want));
}

/* valgrind, and some machines, have a long double that is a double: then the reference is off by a unit itself */
static long double reference_ulps(void) {
    volatile long double sum = 1.0L, tiny = 0x1p-60L;
    sum += tiny;
    return sum > 1.0L || sizeof(gsid_real) == 4 ? 0 : 1;
}

static void table_is_good_to_a_unit_in_the_last_place(void **state) {
    (void)state;
    const uint32_t periods[] = {2, 3, 4, 5, 7, 8, 12, 2500, 6000, 6001};
    for (size_t p = 0; p < sizeof periods / sizeof periods[0]; p++) {
        uint32_t n = periods[p];
        assert_int_equal(gsid_twiddle_fill(n, table), GSID_OK);
        for (uint32_t i = 0; i < n; i++) {
            /* nearest quarter turn first: long double's own pi would spoil the small sines */
            int64_t quarter = ((int64_t)4 * i + n / 2) / n;
            long double angle = PI_L / 2 * (long double)((int64_t)4 * i - quarter * n) / n;
            long double c = cosl(angle), s = sinl(angle);
            const long double want[4][2] = {{c, s}, {-s, c}, {-c, -s}, {s, -c}};
            /* half a unit each from the sine and from the last addition, and 5 % for what both leave */
            assert_within_ulp(table[i].re, want[quarter % 4][0], 1.05L + reference_ulps());
            assert_within_ulp(table[i].im, want[quarter % 4][1], 1.05L + reference_ulps());
        }
    }
}

static void table_is_exact_where_it_can_be(void **state) {
    (void)state;
    assert_int_equal(gsid_twiddle_fill(6000, table), GSID_OK);
    const gsid_cplx quarter_turns[4] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
    for (uint32_t q = 0; q < 4; q++) {
        assert_true(table[1500 * q].re == quarter_turns[q].re && table[1500 * q].im == quarter_turns[q].im);
    }
    for (uint32_t i = 1; i < 6000; i++) {
        assert_true(table[6000 - i].re == table[i].re && table[6000 - i].im == -table[i].im);
    }
}

static void table_refuses(void **state) {
    (void)state;
    gsid_cplx one = {7, 7};
    assert_int_equal(gsid_twiddle_fill(6000, NULL), GSID_E_NULL);
    assert_int_equal(gsid_twiddle_fill(0, &one), GSID_E_CONFIG);
    assert_int_equal(gsid_twiddle_fill(1, &one), GSID_E_CONFIG);
    assert_int_equal(gsid_twiddle_fill((UINT32_C(1) << 30) + 1, &one), GSID_E_CONFIG);
    assert_true(one.re == 7 && one.im == 7);
}

static void grids_line_by_line(void **state) {
    (void)state;
    uint32_t line[8] = {0}, n = 0;
    assert_int_equal(gsid_lines_fill(GSID_GRID_FULL, 3, 7, 8, line, &n), GSID_OK);
    assert_int_equal(n, 5);
    for (uint32_t i = 0; i < n; i++) {
        assert_int_equal(line[i], 3 + i);
    }
    const uint32_t odd[4][3] = {{1, 7, 4}, {2, 7, 3}, {2, 8, 3}, {7, 7, 1}};
    for (int c = 0; c < 4; c++) {
        assert_int_equal(gsid_lines_fill(GSID_GRID_ODD, odd[c][0], odd[c][1], 8, line, &n), GSID_OK);
        assert_int_equal(n, odd[c][2]);
        for (uint32_t i = 0; i < n; i++) {
            assert_int_equal(line[i], (odd[c][0] | 1u) + 2 * i);
        }
    }
    assert_int_equal(gsid_lines_fill(GSID_GRID_FULL, 1, UINT32_MAX, 0, NULL, &n), GSID_OK);
    assert_true(n == UINT32_MAX);
}

static void grids_refuse(void **state) {
    (void)state;
    uint32_t line[2] = {9, 9}, n = 9;
    assert_int_equal(gsid_lines_fill(GSID_GRID_FULL, 1, 2, 2, line, NULL), GSID_E_NULL);
    assert_int_equal(gsid_lines_fill(GSID_GRID_FULL, 0, 2, 2, line, &n), GSID_E_CONFIG);
    assert_int_equal(gsid_lines_fill(GSID_GRID_FULL, 3, 2, 2, line, &n), GSID_E_CONFIG);
    assert_int_equal(gsid_lines_fill(GSID_GRID_ODD, 2, 2, 2, line, &n), GSID_E_CONFIG);
    assert_int_equal(gsid_lines_fill((gsid_grid)5, 1, 2, 2, line, &n), GSID_E_CONFIG);
    assert_int_equal(gsid_lines_fill(GSID_GRID_FULL, 1, 3, 2, line, &n), GSID_E_MEMORY);
    assert_true(line[0] == 9 && line[1] == 9 && n == 9);
}

static void amplitude_follows_the_slope(void **state) {
    (void)state;
    const uint32_t line[4] = {5, 50, 500, 1000};
    gsid_real a[4];
    assert_int_equal(gsid_amplitude_shape(4, line, GSID_R(-10.0), a), GSID_OK);
    for (int i = 0; i < 4; i++) {
        assert_true(fabs((double)a[i] - 1.0 / sqrt(line[i] / 5.0)) <= 4 * EPSILON);
    }
    assert_int_equal(gsid_amplitude_shape(4, line, GSID_R(0.0), a), GSID_OK);
    for (int i = 0; i < 4; i++) {
        assert_true(a[i] == 1);
    }
}

static void amplitude_refuses(void **state) {
    (void)state;
    const uint32_t line[2] = {1, 2}, falling[2] = {2, 2}, zero[2] = {0, 1};
    gsid_real a[2] = {7, 7};
    assert_int_equal(gsid_amplitude_shape(2, NULL, 0, a), GSID_E_NULL);
    assert_int_equal(gsid_amplitude_shape(2, line, 0, NULL), GSID_E_NULL);
    assert_int_equal(gsid_amplitude_shape(0, line, 0, a), GSID_E_CONFIG);
    assert_int_equal(gsid_amplitude_shape(2, falling, 0, a), GSID_E_CONFIG);
    assert_int_equal(gsid_amplitude_shape(2, zero, 0, a), GSID_E_CONFIG);
    assert_int_equal(gsid_amplitude_shape(2, line, (gsid_real)NAN, a), GSID_E_NONFINITE);
    assert_int_equal(gsid_amplitude_shape(2, line, GSID_R(1e6), a), GSID_E_NONFINITE);
    assert_true(a[0] == 7 && a[1] == 7);
}

static double turns_apart(double a_rad, double b_rad) {
    return fabs(remainder(a_rad - b_rad, 2.0 * (double)PI_L)) / (2.0 * (double)PI_L);
}

static void flat_schroeder_is_the_closed_form(void **state) {
    (void)state;
    enum { F = 500 };
    static gsid_real a[F], phase[F];
    for (int i = 0; i < F; i++) {
        a[i] = GSID_R(3.0);
    }
    assert_int_equal(gsid_phase_schroeder(F, a, phase), GSID_OK);
    for (int k = 1; k <= F; k++) {
        assert_true(phase[k - 1] >= 0 && (double)phase[k - 1] < 2.0 * (double)PI_L);
        double closed = -(double)(PI_L * (k * (k - 1) % (2 * F)) / F);
        /* the running sums round F times */
        assert_true(turns_apart((double)phase[k - 1], closed) < 4 * F * EPSILON);
    }
}

static void shaped_schroeder_is_the_double_sum(void **state) {
    (void)state;
    enum { F = 60 };
    gsid_real a[F], phase[F];
    long double total = 0;
    for (int i = 0; i < F; i++) {
        a[i] = GSID_R(2.0) / (gsid_real)(1 + i % 7);
        total += (long double)a[i] * a[i];
    }
    assert_int_equal(gsid_phase_schroeder(F, a, phase), GSID_OK);
    for (int k = 0; k < F; k++) {
        long double sum = 0;
        for (int l = 0; l < k; l++) {
            sum += (k - l) * (long double)a[l] * a[l] / total;
        }
        assert_true(turns_apart((double)phase[k], (double)(-2 * PI_L * sum)) < 4 * F * EPSILON);
    }
    gsid_real scaled[F];
    for (int i = 0; i < F; i++) { /* the scale does not matter, exact for a power of two */
        scaled[i] = a[i] / 8;
    }
    assert_int_equal(gsid_phase_schroeder(F, scaled, scaled), GSID_OK);
    assert_memory_equal(scaled, phase, sizeof phase);
    assert_int_equal(gsid_phase_schroeder(F, a, a), GSID_OK); /* in place */
    assert_memory_equal(a, phase, sizeof a);
}

static void schroeder_refuses(void **state) {
    (void)state;
    const gsid_real good[2] = {1, 1}, negative[2] = {1, -1}, zero[2] = {0, 0}, nan[2] = {1, (gsid_real)NAN};
    gsid_real phase[2] = {7, 7};
    assert_int_equal(gsid_phase_schroeder(2, NULL, phase), GSID_E_NULL);
    assert_int_equal(gsid_phase_schroeder(2, good, NULL), GSID_E_NULL);
    assert_int_equal(gsid_phase_schroeder(0, good, phase), GSID_E_CONFIG);
    assert_int_equal(gsid_phase_schroeder(2, negative, phase), GSID_E_CONFIG);
    assert_int_equal(gsid_phase_schroeder(2, zero, phase), GSID_E_CONFIG);
    assert_int_equal(gsid_phase_schroeder(2, nan, phase), GSID_E_NONFINITE);
    assert_true(phase[0] == 7 && phase[1] == 7);
}

static void random_phases_are_uniform_and_the_same_in_both_precisions(void **state) {
    (void)state;
    enum { F = 4096 };
    static gsid_real phase[F];
    assert_int_equal(gsid_phase_random(F, 0, phase), GSID_OK);
    /* first outputs of SplitMix64 from state 0: E220A8397B1DCDAF, 6E789E6AA1B965F4 */
    assert_true(turns_apart((double)phase[0], 2 * (double)PI_L * (0xE220A8397B1DCDAFu / 18446744073709551616.0)) <
                EPSILON);
    assert_true(turns_apart((double)phase[1], 2 * (double)PI_L * (0x6E789E6AA1B965F4u / 18446744073709551616.0)) <
                EPSILON);
    int count[8] = {0};
    for (int i = 0; i < F; i++) {
        assert_true(phase[i] >= 0 && (double)phase[i] < 2.0 * (double)PI_L);
        count[(int)((double)phase[i] / (2.0 * (double)PI_L) * 8.0)]++;
    }
    double chi2 = 0;
    for (int b = 0; b < 8; b++) {
        chi2 += (count[b] - F / 8.0) * (count[b] - F / 8.0) / (F / 8.0);
    }
    assert_true(chi2 < 24.3); /* 7 degrees of freedom, one in a thousand; the seed is fixed */
    assert_int_equal(gsid_phase_random(4, 1, NULL), GSID_E_NULL);
    assert_int_equal(gsid_phase_random(0, 1, phase), GSID_E_CONFIG);
}

enum { N = 120, F = 6 };
static const uint32_t odd_lines[F] = {1, 3, 9, 21, 47, 59};
static const gsid_real amplitudes[F] = {1, GSID_R(0.5), GSID_R(-0.25), 2, 0, GSID_R(0.125)};
static const gsid_real phases[F] = {0, 1, GSID_R(-2.0), 3, 4, GSID_R(5.5)};

static gsid_multisine_cfg small_cfg(void) {
    gsid_twiddle_fill(N, table);
    gsid_multisine_cfg cfg = {N, F, odd_lines, amplitudes, phases, table};
    return cfg;
}

static void multisine_is_the_sum_of_cosines(void **state) {
    (void)state;
    gsid_multisine_cfg cfg = small_cfg();
    gsid_multisine m;
    assert_int_equal(gsid_multisine_init(&m, &cfg), GSID_OK);
    for (uint32_t n = 0; n < N; n++) {
        gsid_real u;
        assert_int_equal(gsid_multisine_step(&m, &u), n == N - 1 ? GSID_DONE : GSID_OK);
        long double sum = 0;
        for (int i = 0; i < F; i++) {
            long double angle = 2 * PI_L * ((long double)(odd_lines[i] * n % N) / N) + (long double)phases[i];
            sum += (long double)amplitudes[i] * cosl(angle);
        }
        /* amplitudes add up to 3.9, a few roundings each; angles of the reference up to 12 rad round where its long
         * double is a double */
        assert_true(fabsl((long double)u - sum) < 48 * EPSILON);
    }
}

static void table_equals_stream_and_every_period_equals_the_first(void **state) {
    (void)state;
    gsid_multisine_cfg cfg = small_cfg();
    gsid_multisine m;
    gsid_real one[N], other[N];
    assert_int_equal(gsid_multisine_init(&m, &cfg), GSID_OK);
    assert_int_equal(gsid_multisine_table(&m, one), GSID_OK);
    for (int period = 0; period < 50; period++) {
        for (uint32_t n = 0; n < N; n++) {
            gsid_multisine_step(&m, &other[n]);
        }
        assert_memory_equal(one, other, sizeof one);
    }
    gsid_multisine_step(&m, &other[0]); /* a restart in the middle */
    assert_int_equal(gsid_multisine_init(&m, &cfg), GSID_OK);
    gsid_multisine_step(&m, &other[0]);
    assert_memory_equal(one, other, sizeof one[0]);
    /* odd lines only: the second half period is the first one turned over */
    for (uint32_t n = 0; n < N / 2; n++) {
        assert_true(fabs((double)(one[n] + one[n + N / 2])) < 8 * EPSILON);
    }
}

static void spectrum_is_amplitude_and_phase(void **state) {
    (void)state;
    gsid_multisine_cfg cfg = small_cfg();
    gsid_multisine m;
    gsid_cplx lines[F];
    assert_int_equal(gsid_multisine_init(&m, &cfg), GSID_OK);
    assert_int_equal(gsid_multisine_spectrum(&m, lines), GSID_OK);
    for (int i = 0; i < F; i++) {
        assert_true(fabs((double)lines[i].re - (double)amplitudes[i] * cos((double)phases[i])) < 4 * EPSILON);
        assert_true(fabs((double)lines[i].im - (double)amplitudes[i] * sin((double)phases[i])) < 4 * EPSILON);
    }
}

static void sine_refuses(void **state) {
    (void)state;
    enum { N = 12 };
    static gsid_cplx twiddle[N];
    gsid_sine sine, before;
    memset(&sine, 0, sizeof sine);
    before = sine;
    assert_int_equal(gsid_sine_init(NULL, N, 1, 1, 0, twiddle), GSID_E_NULL);
    assert_int_equal(gsid_sine_init(&sine, N, 1, 1, 0, NULL), GSID_E_NULL);
    assert_int_equal(gsid_sine_init(&sine, 1, 0, 1, 0, twiddle), GSID_E_CONFIG);
    assert_int_equal(gsid_sine_init(&sine, (UINT32_C(1) << 30) + 1, 1, 1, 0, twiddle), GSID_E_CONFIG);
    assert_int_equal(gsid_sine_init(&sine, N, N / 2 + 1, 1, 0, twiddle), GSID_E_CONFIG);
    assert_int_equal(gsid_sine_init(&sine, N, 1, (gsid_real)NAN, 0, twiddle), GSID_E_NONFINITE);
    assert_int_equal(gsid_sine_init(&sine, N, 1, 1, (gsid_real)INFINITY, twiddle), GSID_E_NONFINITE);
    assert_memory_equal(&sine, &before, sizeof sine);
    assert_int_equal(gsid_sine_init(&sine, N, N / 2, 1, 0, twiddle), GSID_OK);
}

static void multisine_refuses(void **state) {
    (void)state;
    const gsid_multisine_cfg good = small_cfg();
    gsid_multisine m, before;
    gsid_real u = 7;
    gsid_cplx line;
    memset(&m, 0, sizeof m);
    before = m;
    assert_int_equal(gsid_multisine_step(&m, &u), GSID_E_STATE);
    assert_int_equal(gsid_multisine_table(&m, &u), GSID_E_STATE);
    assert_int_equal(gsid_multisine_spectrum(&m, &line), GSID_E_STATE);
    assert_int_equal(gsid_multisine_init(NULL, &good), GSID_E_NULL);
    assert_int_equal(gsid_multisine_init(&m, NULL), GSID_E_NULL);
#define REFUSED(field, value, status)                                                                                  \
    do {                                                                                                               \
        gsid_multisine_cfg bad = good;                                                                                 \
        bad.field = (value);                                                                                           \
        assert_int_equal(gsid_multisine_init(&m, &bad), status);                                                       \
    } while (0)
    const uint32_t at_nyquist[F] = {1, 3, 9, 21, 47, 60}, zero[F] = {0, 3, 9, 21, 47, 59},
                   twice[F] = {1, 3, 3, 4, 5, 6};
    const gsid_real infinite[F] = {1, 1, 1, 1, 1, (gsid_real)INFINITY};
    REFUSED(line, NULL, GSID_E_NULL);
    REFUSED(amplitude, NULL, GSID_E_NULL);
    REFUSED(phase_rad, NULL, GSID_E_NULL);
    REFUSED(twiddle, NULL, GSID_E_NULL);
    REFUSED(line, at_nyquist, GSID_E_CONFIG);
    REFUSED(line, zero, GSID_E_CONFIG);
    REFUSED(line, twice, GSID_E_CONFIG);
    REFUSED(n_lines, 0, GSID_E_CONFIG);
    REFUSED(n_period, 1, GSID_E_CONFIG);
    REFUSED(n_period, (UINT32_C(1) << 30) + 1, GSID_E_CONFIG);
    REFUSED(amplitude, infinite, GSID_E_NONFINITE);
    REFUSED(phase_rad, infinite, GSID_E_NONFINITE);
    assert_memory_equal(&m, &before, sizeof m);
    assert_int_equal(gsid_multisine_init(&m, &good), GSID_OK);
    assert_int_equal(gsid_multisine_step(NULL, &u), GSID_E_NULL);
    assert_int_equal(gsid_multisine_step(&m, NULL), GSID_E_NULL);
    assert_int_equal(gsid_multisine_table(NULL, &u), GSID_E_NULL);
    assert_int_equal(gsid_multisine_table(&m, NULL), GSID_E_NULL);
    assert_int_equal(gsid_multisine_spectrum(NULL, &line), GSID_E_NULL);
    assert_int_equal(gsid_multisine_spectrum(&m, NULL), GSID_E_NULL);
    assert_true(u == 7);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(table_is_good_to_a_unit_in_the_last_place),
        cmocka_unit_test(table_is_exact_where_it_can_be),
        cmocka_unit_test(table_refuses),
        cmocka_unit_test(grids_line_by_line),
        cmocka_unit_test(grids_refuse),
        cmocka_unit_test(amplitude_follows_the_slope),
        cmocka_unit_test(amplitude_refuses),
        cmocka_unit_test(flat_schroeder_is_the_closed_form),
        cmocka_unit_test(shaped_schroeder_is_the_double_sum),
        cmocka_unit_test(schroeder_refuses),
        cmocka_unit_test(random_phases_are_uniform_and_the_same_in_both_precisions),
        cmocka_unit_test(multisine_is_the_sum_of_cosines),
        cmocka_unit_test(table_equals_stream_and_every_period_equals_the_first),
        cmocka_unit_test(spectrum_is_amplitude_and_phase),
        cmocka_unit_test(sine_refuses),
        cmocka_unit_test(multisine_refuses),
    };
    return cmocka_run_group_tests_name("excitation", tests, NULL, NULL);
}
