/* Mean and (co)variance over periods, against two-pass long double formulas; lost, refused and settling samples. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "gsid/excitation.h"
#include "gsid/frf.h"
#include "reference.h"

enum { N = 60, F = 4, P = 12 };
static const uint32_t lines[F] = {1, 4, 11, 29};
static gsid_cplx twiddle[N];
static union {
    gsid_cplx align;
    unsigned char bytes[GSID_FRF_MEM_SIZE(F, 1) + 16];
} memory;

static int fill_twiddle(void **state) {
    (void)state;
    return gsid_twiddle_fill(N, twiddle) == GSID_OK ? 0 : -1;
}

static gsid_real input(uint64_t n) {
    long double u = 0.02L * noise_at(n);
    for (int i = 0; i < F; i++) {
        u += (1 + 0.2L * i) * cosl(2 * PI_L * (long double)(lines[i] * (n % N) % N) / N + i);
    }
    return (gsid_real)u;
}

/* half the input a sample ago with noise of its own and, correlated with the input's, a share of that */
static gsid_real output(uint64_t n) {
    return (gsid_real)(0.5L * (long double)input(n + N - 1) + 0.05L * noise_at(n + 1000000) + 0.3L * noise_at(n));
}

static gsid_frf_cfg cfg_of(const gsid_cplx *u_known, uint32_t n_settle) {
    gsid_frf_cfg cfg = {
        .n_period = N, .n_lines = F, .n_settle = n_settle, .line = lines, .twiddle = twiddle, .u_known = u_known};
    return cfg;
}

static void init(gsid_frf *frf, const gsid_frf_cfg *cfg) {
    assert_int_equal(gsid_frf_init(frf, cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
}

static gsid_status run(gsid_frf *frf, uint64_t n_start, uint64_t n_end) {
    gsid_status status = GSID_OK;
    for (uint64_t n = n_start; n < n_end; n++) {
        status = gsid_frf_step(frf, input(n), output(n));
    }
    return status;
}

typedef struct {
    gsid_cplx g[F], y[F], u[F], cov_yu[F];
    gsid_real var_g[F], var_y[F], var_u[F];
} result;

static gsid_status read_out(const gsid_frf *frf, result *r) {
    const gsid_frf_out out = {r->g, r->var_g, r->y, r->u, r->var_y, r->var_u, r->cov_yu};
    return gsid_frf_result(frf, &out);
}

static cplx_l slow_line(gsid_real (*signal)(uint64_t), uint32_t k, uint64_t n_start) {
    cplx_l sum = {0, 0};
    for (uint64_t n = n_start; n < n_start + N; n++) {
        long double angle = 2 * PI_L * (long double)(k * (n % N) % N) / N;
        sum.re += (long double)signal(n) * cosl(angle) * 2 / N;
        sum.im -= (long double)signal(n) * sinl(angle) * 2 / N;
    }
    return sum;
}

static cplx_l times_conj(cplx_l a, cplx_l b) {
    return (cplx_l){a.re * b.re + a.im * b.im, a.im * b.re - a.re * b.im};
}

/* eqs. 4.10 and 4.11 in two passes over the periods that start at the given samples */
typedef struct {
    cplx_l y, u, cov_yu;
    long double var_y, var_u;
} moments;

static moments slow_moments(uint32_t k, int n_periods, const uint64_t *starts) {
    moments m;
    cplx_l y[P], u[P];
    memset(&m, 0, sizeof m);
    for (int p = 0; p < n_periods; p++) {
        y[p] = slow_line(output, k, starts[p]);
        u[p] = slow_line(input, k, starts[p]);
        m.y.re += y[p].re / n_periods, m.y.im += y[p].im / n_periods;
        m.u.re += u[p].re / n_periods, m.u.im += u[p].im / n_periods;
    }
    for (int p = 0; p < n_periods; p++) {
        cplx_l dy = {y[p].re - m.y.re, y[p].im - m.y.im}, du = {u[p].re - m.u.re, u[p].im - m.u.im};
        m.var_y += times_conj(dy, dy).re / (n_periods - 1);
        m.var_u += times_conj(du, du).re / (n_periods - 1);
        m.cov_yu.re += times_conj(dy, du).re / (n_periods - 1);
        m.cov_yu.im += times_conj(dy, du).im / (n_periods - 1);
    }
    return m;
}

/* Sums of N samples round to N epsilon of signals near 1. A variance is of deviations s near 0.05, so that an error e
 * of a line moves it by 2 s e: below N epsilon too. */
static const long double tolerance = (long double)N * EPSILON;

static void assert_result(const result *r, int n_periods, const uint64_t *starts) {
    for (int i = 0; i < F; i++) {
        moments m = slow_moments(lines[i], n_periods, starts);
        long double u2 = m.u.re * m.u.re + m.u.im * m.u.im, y2 = m.y.re * m.y.re + m.y.im * m.y.im;
        cplx_l g = times_conj(m.y, m.u);
        assert_near((long double)r->y[i].re, m.y.re, tolerance);
        assert_near((long double)r->y[i].im, m.y.im, tolerance);
        assert_near((long double)r->u[i].re, m.u.re, tolerance);
        assert_near((long double)r->u[i].im, m.u.im, tolerance);
        assert_near((long double)r->g[i].re, g.re / u2, 4 * tolerance);
        assert_near((long double)r->g[i].im, g.im / u2, 4 * tolerance);
        assert_near((long double)r->var_y[i], m.var_y, tolerance);
        assert_near((long double)r->var_u[i], m.var_u, tolerance);
        assert_near((long double)r->cov_yu[i].re, m.cov_yu.re, tolerance);
        assert_near((long double)r->cov_yu[i].im, m.cov_yu.im, tolerance);
        /* eq. 7.29 as it is written, over the periods */
        cplx_l yu_conj = {m.y.re * m.u.re + m.y.im * m.u.im, m.y.im * m.u.re - m.y.re * m.u.im};
        long double cross = times_conj(m.cov_yu, yu_conj).re / (u2 * y2);
        long double var_g = y2 / u2 * (m.var_y / y2 + m.var_u / u2 - 2 * cross) / n_periods;
        assert_near((long double)r->var_g[i], var_g, 4 * tolerance);
    }
}

static void measured_input_is_the_two_pass_formula(void **state) {
    (void)state;
    const uint32_t settles[3] = {0, N, 37}; /* 37: not a whole period, the phases stay those of sample 0 */
    for (int s = 0; s < 3; s++) {
        gsid_frf_cfg cfg = cfg_of(NULL, settles[s]);
        gsid_frf frf;
        result r;
        uint64_t starts[P];
        init(&frf, &cfg);
        for (int p = 0; p < P; p++) {
            starts[p] = settles[s] + (uint64_t)p * N;
        }
        if (settles[s] > 0) {
            assert_int_equal(run(&frf, 0, settles[s]), GSID_SETTLING);
        }
        for (int p = 0; p < P; p++) {
            assert_int_equal(run(&frf, starts[p], starts[p] + N - 1), GSID_OK);
            assert_int_equal(run(&frf, starts[p] + N - 1, starts[p] + N), GSID_DONE);
            assert_int_equal(frf.n_periods, p + 1);
        }
        assert_int_equal(read_out(&frf, &r), GSID_OK);
        assert_result(&r, P, starts);
    }
}

static void known_input_divides_by_it(void **state) {
    (void)state;
    const gsid_cplx known[F] = {{1, 1}, {0, -2}, {GSID_R(0.5), 0}, {0, 0}};
    gsid_frf_cfg cfg = cfg_of(known, 0);
    gsid_frf frf;
    result r;
    uint64_t starts[P];
    init(&frf, &cfg);
    for (int p = 0; p < P; p++) {
        starts[p] = (uint64_t)p * N;
    }
    for (uint64_t n = 0; n < P * N; n++) {
        gsid_frf_step(&frf, (gsid_real)NAN, output(n)); /* u is not looked at */
    }
    assert_int_equal(frf.n_refused, 0);
    assert_int_equal(read_out(&frf, &r), GSID_OK);
    for (int i = 0; i < F; i++) {
        moments m = slow_moments(lines[i], P, starts);
        cplx_l u = {(long double)known[i].re, (long double)known[i].im};
        long double u2 = u.re * u.re + u.im * u.im;
        assert_true(r.u[i].re == known[i].re && r.u[i].im == known[i].im);
        assert_true(r.var_u[i] == 0 && r.cov_yu[i].re == 0 && r.cov_yu[i].im == 0);
        assert_near((long double)r.var_y[i], m.var_y, tolerance);
        if (u2 > 0) {
            assert_near((long double)r.g[i].re, times_conj(m.y, u).re / u2, 4 * tolerance);
            assert_near((long double)r.g[i].im, times_conj(m.y, u).im / u2, 4 * tolerance);
            assert_near((long double)r.var_g[i], m.var_y / (P * u2), 4 * tolerance);
        } else { /* not excited: nothing is known of g, and no NaN comes out */
            assert_true(r.g[i].re == 0 && r.g[i].im == 0 && isinf(r.var_g[i]));
        }
    }
}

static void noise_common_to_input_and_output_leaves_no_variance(void **state) {
    (void)state;
    gsid_frf_cfg cfg = cfg_of(NULL, 0);
    gsid_frf frf;
    result r;
    init(&frf, &cfg);
    for (uint64_t n = 0; n < P * N; n++) {
        gsid_frf_step(&frf, input(n), 2 * input(n));
    }
    assert_int_equal(read_out(&frf, &r), GSID_OK);
    for (int i = 0; i < F; i++) {
        assert_near((long double)r.g[i].re, 2, tolerance);
        assert_true(r.var_g[i] >= 0 && r.var_g[i] < tolerance * r.var_y[i]);
    }
}

static void lost_samples_spoil_their_periods_only(void **state) {
    (void)state;
    gsid_frf_cfg cfg = cfg_of(NULL, 10);
    gsid_frf frf;
    result r;
    const uint64_t good[5] = {10, 10 + 2 * N, 10 + 6 * N, 10 + 9 * N, 10 + 10 * N};
    init(&frf, &cfg);
    run(&frf, 0, 7);
    assert_int_equal(gsid_frf_skip(&frf, 2), GSID_SETTLING); /* lost in the settling: no harm */
    assert_int_equal(run(&frf, 9, 10), GSID_SETTLING);
    assert_int_equal(run(&frf, good[0], good[0] + N), GSID_DONE);
    assert_int_equal(run(&frf, 10 + N, 15 + N), GSID_OK); /* one sample in the second period */
    assert_int_equal(gsid_frf_skip(&frf, 1), GSID_OK);
    assert_int_equal(run(&frf, 16 + N, 10 + 2 * N), GSID_SPOILED);
    assert_int_equal(frf.n_spoiled, 1);
    assert_int_equal(run(&frf, good[1], good[1] + N), GSID_DONE);
    run(&frf, 10 + 3 * N, 20 + 3 * N); /* from the fourth period into the sixth */
    assert_int_equal(gsid_frf_skip(&frf, 2 * N), GSID_SPOILED);
    assert_int_equal(frf.n_spoiled, 3);
    assert_int_equal(run(&frf, 20 + 5 * N, 10 + 6 * N), GSID_SPOILED);
    assert_int_equal(frf.n_spoiled, 4);
    assert_int_equal(run(&frf, good[2], good[2] + N), GSID_DONE);
    assert_int_equal(gsid_frf_skip(&frf, 2 * N), GSID_SPOILED); /* exactly two: the next one is whole */
    assert_int_equal(frf.n_spoiled, 6);
    assert_int_equal(gsid_frf_skip(&frf, 0), GSID_OK);
    assert_int_equal(run(&frf, good[3], good[4] + N), GSID_DONE);
    assert_int_equal(frf.n_periods, 5);
    assert_int_equal(read_out(&frf, &r), GSID_OK);
    assert_result(&r, 5, good);
}

static void the_last_sample_of_the_settling_is_settling(void **state) {
    (void)state;
    gsid_frf_cfg cfg = cfg_of(NULL, 1);
    gsid_frf frf;
    init(&frf, &cfg);
    assert_int_equal(gsid_frf_skip(&frf, 1), GSID_SETTLING);
    assert_int_equal(run(&frf, 1, 1 + N), GSID_DONE);
}

static void a_skip_out_of_the_settling_reaches_the_periods(void **state) {
    (void)state;
    gsid_frf_cfg cfg = cfg_of(NULL, 10);
    gsid_frf frf;
    result r;
    const uint64_t good[2] = {10 + 3 * N, 10 + 4 * N};
    init(&frf, &cfg);
    assert_int_equal(gsid_frf_skip(&frf, 3), GSID_SETTLING);
    assert_int_equal(gsid_frf_skip(&frf, 1), GSID_SETTLING);
    assert_int_equal(gsid_frf_skip(&frf, 6 + 2 * N + 5), GSID_SPOILED);
    assert_int_equal(frf.n_spoiled, 2);
    assert_int_equal(run(&frf, 15 + 2 * N, 10 + 3 * N), GSID_SPOILED);
    assert_int_equal(run(&frf, good[0], good[1] + N), GSID_DONE);
    assert_int_equal(read_out(&frf, &r), GSID_OK);
    assert_result(&r, 2, good);
}

static void refused_samples_are_counted_and_change_nothing(void **state) {
    (void)state;
    gsid_frf_cfg cfg = cfg_of(NULL, 5);
    gsid_frf frf;
    result clean, disturbed;
    init(&frf, &cfg);
    run(&frf, 0, 5 + 3 * N);
    assert_int_equal(read_out(&frf, &clean), GSID_OK);
    init(&frf, &cfg);
    for (uint64_t n = 0; n < 5 + 3 * N; n++) {
        assert_int_equal(gsid_frf_step(&frf, (gsid_real)NAN, 0), GSID_E_NONFINITE);
        assert_int_equal(gsid_frf_step(&frf, 0, (gsid_real)INFINITY), GSID_E_NONFINITE);
        run(&frf, n, n + 1);
    }
    assert_int_equal(frf.n_refused, 2 * (5 + 3 * N));
    assert_int_equal(read_out(&frf, &disturbed), GSID_OK);
    assert_memory_equal(&clean, &disturbed, sizeof clean);
}

static void a_million_periods_later_the_answer_is_the_same_to_the_bit(void **state) {
    (void)state;
    gsid_frf_cfg cfg = cfg_of(NULL, 0);
    gsid_frf frf;
    result early, late;
    init(&frf, &cfg);
    run(&frf, 0, 3 * N);
    read_out(&frf, &early);
    init(&frf, &cfg);
    assert_int_equal(gsid_frf_skip(&frf, 1000000u * N), GSID_SPOILED);
    assert_int_equal(frf.n_spoiled, 1000000);
    run(&frf, 0, 3 * N);
    assert_int_equal(read_out(&frf, &late), GSID_OK);
    assert_memory_equal(&early, &late, sizeof early);
}

/* What gsid_frf_step says of long runs in float. */
static void means_of_a_million_periods(void **state) {
    (void)state;
    enum { MANY = 1000000 };
    const gsid_cplx one[F] = {{1, 0}, {1, 0}, {1, 0}, {1, 0}};
    gsid_frf_cfg cfg = cfg_of(one, 0);
    gsid_frf frf;
    result r;
    long double mean[2] = {0, 0}, squares = 0;
    init(&frf, &cfg);
    for (uint64_t p = 0; p < MANY; p++) {
        const gsid_real e[2] = {(gsid_real)(0.01L * noise_at(2 * p)), (gsid_real)(0.01L * noise_at(2 * p + 1))};
        gsid_cplx period[F];
        for (int i = 0; i < F; i++) {
            period[i].re = (gsid_real)i + e[0];
            period[i].im = e[1];
        }
        gsid_frf_add_period(&frf, period);
        mean[0] += (long double)e[0] / MANY;
        mean[1] += (long double)e[1] / MANY;
        squares += (long double)e[0] * (long double)e[0] + (long double)e[1] * (long double)e[1];
    }
    const long double variance = (squares - MANY * (mean[0] * mean[0] + mean[1] * mean[1])) / (MANY - 1);
    assert_int_equal(read_out(&frf, &r), GSID_OK);
    for (int i = 0; i < F; i++) {
        /* in float the mean stands still once the update rounds to nothing: after 2^24 r periods, of noise r Y each */
        const long double floor = i * sqrtl(sqrtl(variance) / (i > 0 ? i : 1) / 16777216.0L) + 1e-9L;
        assert_true(fabsl((long double)r.y[i].re - i - mean[0]) < 2 * floor);
        assert_true(fabsl((long double)r.y[i].im - mean[1]) < 2 * floor);
        assert_true(fabsl((long double)r.var_y[i] / variance - 1) < 1e-3L);
    }
}

static void reading_in_between_changes_nothing(void **state) {
    (void)state;
    gsid_frf_cfg cfg = cfg_of(NULL, 0);
    gsid_frf frf;
    result once, often;
    init(&frf, &cfg);
    run(&frf, 0, 4 * N);
    read_out(&frf, &once);
    init(&frf, &cfg);
    for (uint64_t n = 0; n < 4 * N; n++) {
        run(&frf, n, n + 1);
        if (frf.n_periods >= 2) {
            read_out(&frf, &often);
        }
    }
    assert_memory_equal(&once, &often, sizeof once);
}

static void memory_is_counted_and_checked(void **state) {
    (void)state;
    const gsid_cplx known[F] = {{1, 0}, {1, 0}, {1, 0}, {1, 0}};
    for (int measured = 0; measured <= 1; measured++) {
        gsid_frf_cfg cfg = cfg_of(measured ? NULL : known, 0);
        const size_t size = gsid_frf_mem_size(&cfg);
        assert_int_equal(size, GSID_FRF_MEM_SIZE(F, measured));
        if (sizeof(gsid_real) == 4 && !measured) {
            assert_int_equal(size, 24 * F); /* the figure promised for firmware */
        }
        gsid_frf frf, untouched;
        memset(&frf, 0, sizeof frf);
        untouched = frf;
        memset(memory.bytes, 0x5A, sizeof memory.bytes);
        assert_int_equal(gsid_frf_init(&frf, &cfg, memory.bytes, size - 1), GSID_E_MEMORY);
        assert_int_equal(gsid_frf_init(&frf, &cfg, memory.bytes + 1, size), GSID_E_MEMORY);
        assert_memory_equal(&frf, &untouched, sizeof frf);
        assert_int_equal(memory.bytes[0], 0x5A);
        assert_int_equal(gsid_frf_init(&frf, &cfg, memory.bytes, size), GSID_OK);
        run(&frf, 0, 2 * N);
        assert_int_equal(memory.bytes[size], 0x5A); /* not a byte more than asked for */
    }
}

static void too_few_periods(void **state) {
    (void)state;
    gsid_frf_cfg cfg = cfg_of(NULL, 0);
    gsid_frf frf;
    result r;
    gsid_cplx g[F];
    const gsid_frf_out means = {.g = g};
    memset(&r, 0x5A, sizeof r);
    const result untouched = r;
    init(&frf, &cfg);
    run(&frf, 0, N - 1);
    assert_int_equal(gsid_frf_result(&frf, &means), GSID_E_TOO_FEW);
    run(&frf, N - 1, N);
    assert_int_equal(gsid_frf_result(&frf, &means), GSID_OK);
    assert_int_equal(read_out(&frf, &r), GSID_E_TOO_FEW);
    assert_memory_equal(&r, &untouched, sizeof r);
    run(&frf, N, 2 * N);
    assert_int_equal(read_out(&frf, &r), GSID_OK);
    assert_memory_equal(r.g, (gsid_frf_result(&frf, &means), g), sizeof g);
}

static void every_refusal(void **state) {
    (void)state;
    const gsid_frf_cfg good = cfg_of(NULL, 0);
    gsid_frf frf, untouched;
    result r;
    memset(&frf, 0, sizeof frf);
    untouched = frf;
    assert_int_equal(gsid_frf_step(&frf, 0, 0), GSID_E_STATE);
    assert_int_equal(gsid_frf_skip(&frf, 1), GSID_E_STATE);
    assert_int_equal(read_out(&frf, &r), GSID_E_STATE);
#define REFUSED(field, value, status)                                                                                  \
    do {                                                                                                               \
        gsid_frf_cfg bad = good;                                                                                       \
        bad.field = (value);                                                                                           \
        assert_int_equal(gsid_frf_mem_size(&bad), 0);                                                                  \
        assert_int_equal(gsid_frf_init(&frf, &bad, memory.bytes, sizeof memory.bytes), status);                        \
    } while (0)
    const uint32_t zero[F] = {0, 4, 11, 29}, nyquist[F] = {1, 4, 11, 30};
    const gsid_cplx infinite[F] = {{1, 0}, {1, 0}, {1, 0}, {0, (gsid_real)INFINITY}};
    REFUSED(line, NULL, GSID_E_NULL);
    REFUSED(twiddle, NULL, GSID_E_NULL);
    REFUSED(line, zero, GSID_E_CONFIG);
    REFUSED(line, nyquist, GSID_E_CONFIG);
    REFUSED(n_lines, 0, GSID_E_CONFIG);
    REFUSED(n_period, 0, GSID_E_CONFIG);
    REFUSED(n_period, 1, GSID_E_CONFIG);
    REFUSED(n_period, (UINT32_C(1) << 30) + 1, GSID_E_CONFIG);
    REFUSED(u_known, infinite, GSID_E_NONFINITE);
    assert_int_equal(gsid_frf_mem_size(NULL), 0);
    assert_int_equal(gsid_frf_init(NULL, &good, memory.bytes, sizeof memory.bytes), GSID_E_NULL);
    assert_int_equal(gsid_frf_init(&frf, NULL, memory.bytes, sizeof memory.bytes), GSID_E_NULL);
    assert_int_equal(gsid_frf_init(&frf, &good, NULL, sizeof memory.bytes), GSID_E_NULL);
    assert_memory_equal(&frf, &untouched, sizeof frf);
    init(&frf, &good);
    assert_int_equal(gsid_frf_step(NULL, 0, 0), GSID_E_NULL);
    assert_int_equal(gsid_frf_skip(NULL, 1), GSID_E_NULL);
    assert_int_equal(gsid_frf_result(NULL, &(gsid_frf_out){.g = r.g}), GSID_E_NULL);
    assert_int_equal(gsid_frf_result(&frf, NULL), GSID_E_NULL);
}

static void parts_measured_apart_merge_to_the_whole(void **state) {
    (void)state;
    static union {
        gsid_cplx align;
        unsigned char bytes[GSID_FRF_MEM_SIZE(F, 1)];
    } part_memory[3];
    const int n_periods[3] = {5, 0, P - 5};
    gsid_frf_cfg cfg = cfg_of(NULL, 0);
    gsid_frf part[3];
    uint64_t starts[P], at = 0;
    for (int p = 0; p < P; p++) {
        starts[p] = (uint64_t)p * N;
    }
    for (int i = 0; i < 3; i++) {
        assert_int_equal(gsid_frf_init(&part[i], &cfg, part_memory[i].bytes, sizeof part_memory[i].bytes), GSID_OK);
        run(&part[i], at, at + (uint64_t)n_periods[i] * N);
        at += (uint64_t)n_periods[i] * N;
    }
    run(&part[2], at, at + N / 2); /* a period under way does not count */
    part[2].n_spoiled = 3;
    assert_int_equal(gsid_frf_merge(&part[1], &part[2]), GSID_OK); /* into one that is empty */
    assert_int_equal(gsid_frf_merge(&part[0], &part[1]), GSID_OK);
    assert_int_equal(part[0].n_periods, P);
    assert_int_equal(part[0].n_spoiled, 3);
    result r;
    assert_int_equal(read_out(&part[0], &r), GSID_OK);
    assert_result(&r, P, starts);
}

static void only_the_same_measurement_merges(void **state) {
    (void)state;
    static union {
        gsid_cplx align;
        unsigned char bytes[GSID_FRF_MEM_SIZE(F, 1)];
    } other_memory;
    const uint32_t other_lines[F] = {1, 4, 11, 28};
    const gsid_cplx known[F] = {{1, 1}, {0, -2}, {2, 0}, {3, 0}};
    gsid_cplx other_known[F];
    gsid_frf_cfg cfg = cfg_of(NULL, 0), lines_differ = cfg, input_known = cfg_of(known, 0);
    gsid_frf_cfg input_differs = cfg_of(other_known, 0);
    lines_differ.line = other_lines;
    gsid_frf frf, other;
    memset(&other, 0, sizeof other);
    init(&frf, &cfg);
    assert_int_equal(gsid_frf_merge(&frf, NULL), GSID_E_NULL);
    assert_int_equal(gsid_frf_merge(&frf, &other), GSID_E_STATE);
    assert_int_equal(gsid_frf_merge(&frf, &frf), GSID_E_CONFIG);
    const gsid_frf_cfg *different[2] = {&lines_differ, &input_known};
    for (int i = 0; i < 2; i++) {
        gsid_frf_init(&other, different[i], other_memory.bytes, sizeof other_memory.bytes);
        assert_int_equal(gsid_frf_merge(&frf, &other), GSID_E_CONFIG);
    }
    for (int part = 0; part < 4;
         part++) { /* other has a known input too; larger and smaller, real and imaginary part */
        const gsid_real change = part % 2 ? GSID_R(1.0) : GSID_R(-1.0);
        memcpy(other_known, known, sizeof known);
        *(part < 2 ? &other_known[2].re : &other_known[2].im) += change;
        init(&frf, &input_differs);
        assert_int_equal(gsid_frf_merge(&frf, &other), GSID_E_CONFIG);
    }
}

static void whole_periods_are_taken_as_lines(void **state) {
    (void)state;
    gsid_frf_cfg cfg = cfg_of(NULL, 0);
    gsid_frf frf;
    result r;
    uint64_t starts[P];
    init(&frf, &cfg);
    for (int p = 0; p < P; p++) {
        gsid_cplx both[2 * F];
        starts[p] = (uint64_t)p * N;
        for (int i = 0; i < F; i++) {
            const cplx_l y = slow_line(output, lines[i], starts[p]), u = slow_line(input, lines[i], starts[p]);
            both[2 * i] = (gsid_cplx){(gsid_real)y.re, (gsid_real)y.im};
            both[2 * i + 1] = (gsid_cplx){(gsid_real)u.re, (gsid_real)u.im};
        }
        assert_int_equal(gsid_frf_add_period(&frf, both), GSID_OK);
        both[3].im = (gsid_real)NAN;
        assert_int_equal(gsid_frf_add_period(&frf, both), GSID_E_NONFINITE);
    }
    assert_int_equal(read_out(&frf, &r), GSID_OK);
    assert_result(&r, P, starts);
    assert_int_equal(gsid_frf_add_period(&frf, NULL), GSID_E_NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parts_measured_apart_merge_to_the_whole),
        cmocka_unit_test(only_the_same_measurement_merges),
        cmocka_unit_test(whole_periods_are_taken_as_lines),
        cmocka_unit_test(measured_input_is_the_two_pass_formula),
        cmocka_unit_test(known_input_divides_by_it),
        cmocka_unit_test(noise_common_to_input_and_output_leaves_no_variance),
        cmocka_unit_test(lost_samples_spoil_their_periods_only),
        cmocka_unit_test(the_last_sample_of_the_settling_is_settling),
        cmocka_unit_test(a_skip_out_of_the_settling_reaches_the_periods),
        cmocka_unit_test(refused_samples_are_counted_and_change_nothing),
        cmocka_unit_test(a_million_periods_later_the_answer_is_the_same_to_the_bit),
        cmocka_unit_test(means_of_a_million_periods),
        cmocka_unit_test(reading_in_between_changes_nothing),
        cmocka_unit_test(memory_is_counted_and_checked),
        cmocka_unit_test(too_few_periods),
        cmocka_unit_test(every_refusal),
    };
    return cmocka_run_group_tests_name("frf", tests, fill_twiddle, NULL);
}
