/* The robust method and the free lines, against two-pass long double formulas on lines made up here. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "gsid/distortion.h"
#include "gsid/excitation.h"
#include "reference.h"

enum { N = 48, EXCITED = 3, LINES = 6, FREE = LINES - EXCITED, M = 5, P = 4 };
static const uint32_t lines[LINES] = {3, 7, 15, 2, 5, 20}; /* free: below, between and above the excited ones */
static gsid_cplx twiddle[N];
static union {
    gsid_cplx align;
    unsigned char bytes[GSID_DISTORTION_MEAN_SIZE(LINES, EXCITED) + GSID_FRF_SPREAD_MEM_SIZE(N, LINES, 1) + 16];
} memory;

static int fill_twiddle(void **state) {
    (void)state;
    return gsid_twiddle_fill(N, twiddle) == GSID_OK ? 0 : -1;
}

/* Lines of realisation m and period p: input of its own phases, response near 2 - j, distortion that all periods of a
 * realisation share, noise that they do not. The samples of a period are the sum of its lines. */
static cplx_l line_u(int m, int p, int i) {
    const long double phase = 10 * noise_at((uint64_t)(100 + 7 * m + i));
    const long double size = i < EXCITED ? 1 : 0.1L;
    const uint64_t at = (uint64_t)(1000 + 97 * (m * P + p) + i);
    return (cplx_l){size * cosl(phase) + 0.01L * noise_at(at), size * sinl(phase) + 0.01L * noise_at(at + 500000)};
}

static cplx_l line_y(int m, int p, int i) {
    const cplx_l u = line_u(m, p, i);
    const uint64_t at = (uint64_t)(9000 + 89 * (m * P + p) + i), shared = (uint64_t)(70000 + 11 * m + i);
    return (cplx_l){2 * u.re + u.im + 0.2L * noise_at(shared) + 0.05L * noise_at(at),
                    2 * u.im - u.re + 0.2L * noise_at(shared + 5000) + 0.05L * noise_at(at + 700000)};
}

static gsid_real sample(cplx_l (*line)(int, int, int), int m, int p, int n) {
    long double sum = 0;
    for (int i = 0; i < LINES; i++) {
        const long double angle = 2 * PI_L * (long double)(lines[i] * (uint32_t)n % N) / N;
        const cplx_l x = line(m, p, i);
        sum += x.re * cosl(angle) - x.im * sinl(angle);
    }
    return (gsid_real)sum;
}

static gsid_distortion_cfg cfg_of(uint32_t input_is_known) {
    gsid_distortion_cfg cfg = {N, LINES, EXCITED, 0, lines, twiddle, input_is_known};
    return cfg;
}

static void init(gsid_distortion *d, const gsid_distortion_cfg *cfg) {
    assert_int_equal(gsid_distortion_init(d, cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
}

typedef struct {
    gsid_cplx bla[EXCITED];
    gsid_real var_noise[EXCITED], var_total[EXCITED], std_nonlinear[EXCITED], level[FREE], level_noise[FREE];
} result;

static gsid_status read_out(const gsid_distortion *d, result *r) {
    const gsid_distortion_out out = {r->bla, r->var_noise, r->var_total, r->std_nonlinear, r->level, r->level_noise};
    return gsid_distortion_result(d, &out);
}

static cplx_l sub(cplx_l a, cplx_l b) {
    return (cplx_l){a.re - b.re, a.im - b.im};
}

static cplx_l mul(cplx_l a, cplx_l b) {
    return (cplx_l){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

static long double abs2(cplx_l a) {
    return a.re * a.re + a.im * a.im;
}

static cplx_l divide(cplx_l a, cplx_l b) {
    const cplx_l conj = {b.re / abs2(b), -b.im / abs2(b)};
    return mul(a, conj);
}

/* Mean over periods; the exact input where it is known: that of period 0. */
static cplx_l mean_of(cplx_l (*line)(int, int, int), int m, int i) {
    cplx_l mean = {0, 0};
    for (int p = 0; p < P; p++) {
        const cplx_l x = line(m, p, i);
        mean.re += x.re / P, mean.im += x.im / P;
    }
    return mean;
}

static cplx_l input_of(int m, int i, int is_known) {
    if (is_known) {
        return i < EXCITED ? line_u(m, 0, i) : (cplx_l){0, 0};
    }
    return mean_of(line_u, m, i);
}

/* Variance of the mean of Y - g U over periods, in two passes. */
static long double error_variance(int m, int i, cplx_l g, int is_known) {
    const cplx_l mean = sub(mean_of(line_y, m, i), mul(g, input_of(m, i, is_known)));
    long double sum = 0;
    for (int p = 0; p < P; p++) {
        const cplx_l u = is_known ? input_of(m, i, 1) : line_u(m, p, i);
        sum += abs2(sub(sub(line_y(m, p, i), mul(g, u)), mean));
    }
    return sum / (P - 1) / P;
}

static cplx_l response(int m, int i, int is_known) {
    return divide(mean_of(line_y, m, i), input_of(m, i, is_known));
}

/* On the chord between the excited lines beside a free one, the nearest beyond the ends. */
static cplx_l response_at_free(int m, int i, int is_known) {
    if (lines[i] < lines[0]) {
        return response(m, 0, is_known);
    }
    for (int e = 1; e < EXCITED; e++) {
        if (lines[i] < lines[e]) {
            const cplx_l low = response(m, e - 1, is_known), high = response(m, e, is_known);
            const long double share = (long double)(lines[i] - lines[e - 1]) / (lines[e] - lines[e - 1]);
            return (cplx_l){low.re + share * (high.re - low.re), low.im + share * (high.im - low.im)};
        }
    }
    return response(m, EXCITED - 1, is_known);
}

/* A line is a sum of N samples of a size near 3: N epsilon times that, doubled by the division and the squares. */
static const long double tolerance = 8 * (long double)N * EPSILON;

/* eqs. 5.13 to 5.16 as they are written */
static void assert_result(const result *r, int is_known) {
    for (int i = 0; i < EXCITED; i++) {
        cplx_l bla = {0, 0};
        long double noise_variance = 0, total = 0;
        for (int m = 0; m < M; m++) {
            const cplx_l g = response(m, i, is_known);
            bla.re += g.re / M, bla.im += g.im / M;
            noise_variance += error_variance(m, i, g, is_known) / abs2(input_of(m, i, is_known)) / (M * M);
        }
        for (int m = 0; m < M; m++) {
            total += abs2(sub(response(m, i, is_known), bla)) / (M * (M - 1));
        }
        assert_near((long double)r->bla[i].re, bla.re, tolerance);
        assert_near((long double)r->bla[i].im, bla.im, tolerance);
        assert_near((long double)r->var_noise[i], noise_variance, tolerance);
        assert_near((long double)r->var_total[i], total, tolerance);
        assert_true(total > noise_variance); /* or eq. 5.16 would not be tested */
        assert_near((long double)r->std_nonlinear[i], sqrtl(M * (total - noise_variance)), 8 * tolerance);
    }
    for (int i = EXCITED; i < LINES; i++) {
        long double power = 0, noise_power = 0;
        for (int m = 0; m < M; m++) {
            const cplx_l g = response_at_free(m, i, is_known);
            power += abs2(sub(mean_of(line_y, m, i), mul(g, input_of(m, i, is_known)))) / M;
            noise_power += error_variance(m, i, g, is_known) / M;
        }
        assert_near((long double)r->level[i - EXCITED], sqrtl(power), 8 * tolerance);
        assert_near((long double)r->level_noise[i - EXCITED], sqrtl(noise_power), 8 * tolerance);
    }
}

static void start(gsid_distortion *d, int m) {
    gsid_cplx known[LINES];
    for (int i = 0; i < LINES; i++) {
        const cplx_l u = input_of(m, i, 1);
        known[i] = (gsid_cplx){(gsid_real)u.re, (gsid_real)u.im};
    }
    static gsid_cplx kept[LINES]; /* outlives the call, as the header asks */
    memcpy(kept, known, sizeof kept);
    assert_int_equal(gsid_distortion_start(d, kept), GSID_OK);
}

static void sample_by_sample_is_the_two_pass_formula(void **state) {
    (void)state;
    for (int kind = 0; kind < 4; kind++) {
        const uint32_t is_known = kind % 2;
        gsid_distortion_cfg cfg = cfg_of(is_known);
        gsid_distortion d;
        result r;
        if (kind < 2) {
            init(&d, &cfg);
        } else {
            assert_true(gsid_distortion_spread_mem_size(&cfg) > gsid_distortion_mem_size(&cfg));
            assert_int_equal(gsid_distortion_init_spread(&d, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
        }
        for (int m = 0; m < M; m++) {
            start(&d, m);
            for (int n = 0; n < P * N; n++) {
                gsid_distortion_step(&d, sample(line_u, m, n / N, n % N), sample(line_y, m, n / N, n % N));
            }
            assert_int_equal(gsid_distortion_finish(&d), GSID_OK);
        }
        assert_int_equal(d.n_realisations, M);
        assert_int_equal(d.n_periods, M * P);
        assert_int_equal(read_out(&d, &r), GSID_OK);
        assert_result(&r, (int)is_known);
    }
}

static void whole_periods_give_the_same(void **state) {
    (void)state;
    gsid_distortion_cfg cfg = cfg_of(0);
    gsid_distortion d;
    result r;
    init(&d, &cfg);
    for (int m = 0; m < M; m++) {
        start(&d, m);
        for (int p = 0; p < P; p++) {
            gsid_cplx both[2 * LINES];
            for (int i = 0; i < LINES; i++) {
                const cplx_l y = line_y(m, p, i), u = line_u(m, p, i);
                both[2 * i] = (gsid_cplx){(gsid_real)y.re, (gsid_real)y.im};
                both[2 * i + 1] = (gsid_cplx){(gsid_real)u.re, (gsid_real)u.im};
            }
            assert_int_equal(gsid_distortion_add_period(&d, both), GSID_OK);
        }
        assert_int_equal(gsid_distortion_finish(&d), GSID_OK);
    }
    assert_int_equal(read_out(&d, &r), GSID_OK);
    assert_result(&r, 0);
}

static void one_realisation_has_no_scatter_over_realisations(void **state) {
    (void)state;
    gsid_distortion_cfg cfg = cfg_of(0);
    gsid_distortion d;
    result r;
    init(&d, &cfg);
    assert_int_equal(read_out(&d, &r), GSID_E_TOO_FEW);
    start(&d, 0);
    for (int n = 0; n < 2 * N; n++) {
        gsid_distortion_step(&d, sample(line_u, 0, n / N, n % N), sample(line_y, 0, n / N, n % N));
    }
    assert_int_equal(gsid_distortion_finish(&d), GSID_OK);
    assert_int_equal(read_out(&d, &r), GSID_E_TOO_FEW);
    const gsid_distortion_out out = {.bla = r.bla, .var_noise = r.var_noise, .level = r.level};
    assert_int_equal(gsid_distortion_result(&d, &out), GSID_OK);
}

static void a_realisation_is_added_when_it_is_finished(void **state) {
    (void)state;
    gsid_distortion_cfg cfg = cfg_of(0);
    gsid_distortion d;
    init(&d, &cfg);
    assert_int_equal(gsid_distortion_step(&d, 0, 0), GSID_E_STATE); /* none is under way */
    assert_int_equal(gsid_distortion_finish(&d), GSID_E_STATE);
    start(&d, 0);
    for (int n = 0; n < N; n++) {
        gsid_distortion_step(&d, sample(line_u, 0, 0, n), sample(line_y, 0, 0, n));
    }
    assert_int_equal(gsid_distortion_finish(&d), GSID_E_TOO_FEW); /* one period has no scatter */
    assert_int_equal(gsid_distortion_skip(&d, 1), GSID_OK);       /* its period is lost */
    for (int n = 1; n < 2 * N; n++) {
        gsid_distortion_step(&d, sample(line_u, 0, 1, n % N), sample(line_y, 0, 1, n % N));
    }
    assert_int_equal(gsid_distortion_finish(&d), GSID_OK);
    assert_int_equal(d.n_periods, 2);
    assert_int_equal(gsid_distortion_finish(&d), GSID_E_STATE);
    assert_int_equal(d.n_realisations, 1);
}

static void a_line_without_input_is_not_excited(void **state) {
    (void)state;
    gsid_distortion_cfg cfg = cfg_of(1);
    gsid_distortion d;
    init(&d, &cfg);
    const gsid_cplx none[LINES] = {{1, 0}, {0, 0}, {1, 0}};
    assert_int_equal(gsid_distortion_start(&d, none), GSID_OK);
    for (int n = 0; n < 2 * N; n++) {
        gsid_distortion_step(&d, 0, sample(line_y, 0, n / N, n % N));
    }
    assert_int_equal(gsid_distortion_finish(&d), GSID_E_TOO_FEW);
    assert_int_equal(d.n_realisations, 0);
}

static void what_cannot_be_is_refused(void **state) {
    (void)state;
    gsid_distortion d;
    gsid_distortion_cfg good = cfg_of(0), bad;
    const uint32_t descending[LINES] = {7, 3, 15, 2, 5, 20}, free_descending[LINES] = {3, 7, 15, 5, 2, 20};
    assert_int_equal(gsid_distortion_init(&d, &good, memory.bytes, gsid_distortion_mem_size(&good) - 1), GSID_E_MEMORY);
    assert_int_equal(gsid_distortion_mem_size(&good), GSID_DISTORTION_MEM_SIZE(LINES, EXCITED, 1));
    assert_int_equal(gsid_distortion_init(NULL, &good, memory.bytes, sizeof memory), GSID_E_NULL);
    bad = good, bad.n_excited = 0;
    assert_int_equal(gsid_distortion_init(&d, &bad, memory.bytes, sizeof memory), GSID_E_CONFIG);
    bad = good, bad.n_excited = LINES + 1;
    assert_int_equal(gsid_distortion_init(&d, &bad, memory.bytes, sizeof memory), GSID_E_CONFIG);
    bad = good, bad.line = descending;
    assert_int_equal(gsid_distortion_init(&d, &bad, memory.bytes, sizeof memory), GSID_E_CONFIG);
    bad = good, bad.line = free_descending;
    assert_int_equal(gsid_distortion_mem_size(&bad), 0);
    bad = good, bad.line = NULL;
    assert_int_equal(gsid_distortion_mem_size(&bad), 0);
    assert_int_equal(gsid_distortion_spread_mem_size(&bad), 0);
    assert_int_equal(gsid_distortion_mem_size(NULL), 0);
    assert_int_equal(gsid_distortion_spread_mem_size(NULL), 0);
    bad = good, bad.input_is_known = 1;
    init(&d, &bad);
    assert_int_equal(gsid_distortion_start(&d, NULL), GSID_E_NULL);
    const gsid_cplx infinite[LINES] = {{1, 0}, {(gsid_real)INFINITY, 0}, {1, 0}};
    assert_int_equal(gsid_distortion_start(&d, infinite), GSID_E_NONFINITE);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sample_by_sample_is_the_two_pass_formula),
        cmocka_unit_test(whole_periods_give_the_same),
        cmocka_unit_test(one_realisation_has_no_scatter_over_realisations),
        cmocka_unit_test(a_realisation_is_added_when_it_is_finished),
        cmocka_unit_test(a_line_without_input_is_not_excited),
        cmocka_unit_test(what_cannot_be_is_refused),
    };
    return cmocka_run_group_tests(tests, fill_twiddle, NULL);
}
