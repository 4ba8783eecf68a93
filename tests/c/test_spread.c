/* The spread transform against a slow long double transform and against the direct engine; its plan of work. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "gsid/excitation.h"
#include "gsid/frf.h"
#include "gsid/spread.h"
#include "streamed_signal.h"

enum { N_MAX = 720, F_MAX = N_MAX / 2 + 1 };
static uint32_t lines[F_MAX];
static gsid_cplx twiddle[N_MAX];
static union {
    gsid_cplx align;
    unsigned char bytes[GSID_FRF_SPREAD_MEM_SIZE(N_MAX, F_MAX, 1) + 16];
} memory;

/* periods with every radix, alone and mixed, each odd power of two, and the smallest */
static const uint32_t periods[] = {4, 6, 8, 10, 14, 16, 18, 32, 50, 64, 98, 90, 120, 210, 420, 600, 686, 720};
enum { N_PERIODS = sizeof periods / sizeof *periods };

/* all lines from 0 to N/2 */
static gsid_spectrum_cfg cfg_of(uint32_t n_period, uint32_t n_channels, uint32_t n_first) {
    for (uint32_t i = 0; i <= n_period / 2; i++) {
        lines[i] = i;
    }
    assert_int_equal(gsid_twiddle_fill(n_period, twiddle), GSID_OK);
    const gsid_spectrum_cfg cfg = {n_period, n_period / 2 + 1, n_channels, n_first, lines, twiddle};
    return cfg;
}

static gsid_status step(gsid_spread *s, uint64_t n) {
    const gsid_real x[2] = {sample(n, 0), sample(n, 1)};
    return gsid_spread_step(s, x);
}

static void assert_lines(const gsid_spread *s, uint64_t n_start) {
    const uint32_t n_period = s->cfg.n_period, every = (uint32_t)repeats(1, 13);
    for (uint32_t i = 0; i < s->cfg.n_lines; i += every) {
        for (uint32_t c = 0; c < s->cfg.n_channels; c++) {
            gsid_cplx x;
            assert_int_equal(gsid_spread_line(s, i, c, &x), GSID_OK);
            /* Each of at most ten stages and the split rounds a value below N a few times: 2/N of that, with room. */
            const cplx_l want = slow_line(n_period, lines[i], n_start, c);
            assert_near((long double)x.re, want.re, 20 * EPSILON);
            assert_near((long double)x.im, want.im, 20 * EPSILON);
        }
    }
}

static void every_smooth_period_is_transformed_during_the_next(void **state) {
    (void)state;
    for (int i = 0; i < N_PERIODS; i++) {
        const uint32_t n_period = periods[i];
        for (uint32_t n_channels = 1; n_channels <= 2; n_channels++) {
            const uint32_t n_first = n_channels == 1 ? 0 : n_period - 1;
            const gsid_spectrum_cfg cfg = cfg_of(n_period, n_channels, n_first);
            gsid_spread s;
            assert_int_equal(gsid_spread_init(&s, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
            assert_true(s.n_ticks + (cfg.n_lines + s.lines_per_tick - 1) / s.lines_per_tick < n_period);
            gsid_cplx x;
            for (uint32_t n = 0; n < 3 * n_period; n++) {
                const int is_done = n >= n_period && n % n_period + 1 == s.n_ticks;
                assert_int_equal(step(&s, n_first + n), is_done ? GSID_DONE : GSID_OK);
                if (is_done) {
                    assert_lines(&s, n_first + n + 1 - s.n_ticks - n_period);
                } else if (n < n_period) {
                    assert_int_equal(gsid_spread_line(&s, 0, 0, &x), GSID_E_STATE);
                }
            }
        }
    }
}

static void a_gap_spoils_its_period_only_and_keeps_the_time(void **state) {
    (void)state;
    enum { N = 120 };
    const gsid_spectrum_cfg cfg = cfg_of(N, 2, 5);
    gsid_spread s;
    gsid_cplx x;
    assert_int_equal(gsid_spread_init(&s, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
    uint32_t n = 5;
    for (; n < 5 + N; n++) {
        step(&s, n);
    }
    /* lost while the first period is transformed: that goes on, the second is not transformed */
    uint32_t n_done = 0;
    for (; n < 5 + 2 * N; n++) {
        const gsid_status status = n % 7 == 0 ? gsid_spread_skip(&s, 1) : step(&s, n);
        n_done += status == GSID_DONE;
        assert_int_equal(status == GSID_SPOILED, n + 1 == 5 + 2 * N);
        if (status == GSID_DONE) {
            assert_lines(&s, 5);
        }
    }
    assert_int_equal(n_done, 1);
    assert_int_equal(gsid_spread_line(&s, 0, 0, &x), GSID_E_STATE);
    /* the third is whole again, and transformed even though nothing but losses follows it */
    for (; n < 5 + 3 * N; n++) {
        assert_int_equal(step(&s, n), GSID_OK);
    }
    assert_int_equal(gsid_spread_skip(&s, N - 1), GSID_DONE);
    assert_lines(&s, 5 + 2 * N);
    assert_int_equal(gsid_spread_skip(&s, 0), GSID_OK);
    assert_lines(&s, 5 + 2 * N);
    assert_int_equal(gsid_spread_skip(&s, 1), GSID_SPOILED);
    /* weeks later, in one call and at any sample of the period */
    assert_int_equal(gsid_spread_skip(&s, UINT32_MAX / N * N + 10), GSID_SPOILED);
    assert_int_equal(gsid_spread_skip(&s, N - 10), GSID_SPOILED);
    for (uint32_t i = 0; i < N; i++) {
        assert_int_equal(step(&s, 5 + i), GSID_OK);
    }
    assert_int_equal(gsid_spread_finish(&s), GSID_DONE);
    assert_int_equal(gsid_spread_finish(&s), GSID_OK);
    assert_lines(&s, 5);
    assert_int_equal(gsid_spread_reset(&s), GSID_OK); /* a restart in the middle of it all */
    assert_int_equal(gsid_spread_line(&s, 0, 0, &x), GSID_E_STATE);
    for (uint32_t i = 0; i < N; i++) {
        assert_int_equal(step(&s, 5 + i), GSID_OK);
    }
    gsid_spread_finish(&s);
    assert_lines(&s, 5);
}

/* Every slice at most what the plan allows: seen from outside, by the ticks that the transform takes for itself. */
static void the_work_of_a_period_fits_its_ticks_for_every_length(void **state) {
    (void)state;
    uint32_t n_smooth = 0;
    for (uint32_t n_period = 2; n_period <= N_MAX; n_period++) {
        uint32_t rest = n_period / 2;
        for (uint32_t prime = 2; prime <= 7; prime++) {
            while (rest % prime == 0) {
                rest /= prime;
            }
        }
        const int is_smooth = n_period % 2 == 0 && n_period >= 4 && rest == 1;
        const gsid_spectrum_cfg cfg = {n_period, n_period / 2 + 1, 2, 0, lines, twiddle};
        for (uint32_t i = 0; i <= n_period / 2; i++) {
            lines[i] = i;
        }
        assert_int_equal(gsid_spread_mem_size(&cfg) > 0, is_smooth);
        if (!is_smooth) {
            continue;
        }
        n_smooth++;
        gsid_spread s;
        assert_int_equal(gsid_spread_init(&s, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
        uint32_t ticks = 0;
        for (uint32_t n = 0; n < 2 * n_period; n++) {
            if (step(&s, n) == GSID_DONE) {
                ticks = n + 1 - n_period;
            }
        }
        assert_int_equal(ticks, s.n_ticks);
        assert_true(ticks + (cfg.n_lines + s.lines_per_tick - 1) / s.lines_per_tick < n_period);
    }
    assert_in_range(n_smooth, 70, 90);
}

static void refused_samples_change_nothing(void **state) {
    (void)state;
    enum { N = 64 };
    const gsid_spectrum_cfg cfg = cfg_of(N, 2, 0);
    gsid_spread s;
    assert_int_equal(gsid_spread_init(&s, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
    const gsid_real bad[3][2] = {{(gsid_real)NAN, 0}, {0, (gsid_real)INFINITY}, {-(gsid_real)INFINITY, 0}};
    for (uint32_t n = 0; n < 2 * N; n++) {
        assert_int_equal(gsid_spread_step(&s, bad[n % 3]), GSID_E_NONFINITE);
        if (step(&s, n) == GSID_DONE) {
            assert_lines(&s, 0);
        }
    }
}

/* ---- the FRF by both engines ---- */

typedef struct {
    gsid_cplx g[F_MAX], y[F_MAX], u[F_MAX], cov_yu[F_MAX];
    gsid_real var_g[F_MAX], var_y[F_MAX], var_u[F_MAX];
} results;

static gsid_status read_all(const gsid_frf *frf, results *r) {
    const gsid_frf_out out = {r->g, r->var_g, r->y, r->u, r->var_y, r->var_u, r->cov_yu};
    return gsid_frf_result(frf, &out);
}

static gsid_cplx u_known[F_MAX];

/* some lines in no order, of an input that is known or measured */
static gsid_frf_cfg frf_cfg_of(uint32_t n_period, uint32_t n_settle, int is_known) {
    const uint32_t n_lines = n_period / 2 - 1;
    assert_int_equal(gsid_twiddle_fill(n_period, twiddle), GSID_OK);
    for (uint32_t i = 0; i < n_lines; i++) {
        lines[i] = i % 2 == 0 ? i + 1 : n_lines - (n_lines % 2 == 0) - i + 1;
        u_known[i] = (gsid_cplx){1, (gsid_real)i};
    }
    const gsid_frf_cfg cfg = {.n_period = n_period,
                              .n_lines = n_lines,
                              .n_settle = n_settle,
                              .line = lines,
                              .twiddle = twiddle,
                              .u_known = is_known ? u_known : NULL};
    return cfg;
}

/* Which samples are lost: bursts inside a period, across a period's end, over more than a period. */
static int is_lost(uint32_t n_period, uint32_t n) {
    return n == 2 * n_period + 3 || (n >= 4 * n_period - 2 && n < 4 * n_period + 2) ||
           (n >= 6 * n_period + n_period / 2 && n < 8 * n_period);
}

/* Runs the samples, lost ones told in blocks or one by one; counts what the steps said. */
static void run_frf(gsid_frf *frf, uint32_t n_samples, int in_blocks, uint32_t *n_done, uint32_t *n_spoiled) {
    const uint32_t n_period = frf->cfg.n_period;
    *n_done = *n_spoiled = 0;
    for (uint32_t n = 0; n < n_samples;) {
        gsid_status status;
        if (is_lost(n_period, n)) {
            uint32_t length = 1;
            while (in_blocks && n + length < n_samples && is_lost(n_period, n + length)) {
                length++;
            }
            status = gsid_frf_skip(frf, length);
            n += length;
        } else {
            status = gsid_frf_step(frf, sample(n, 1), sample(n, 0));
            n++;
        }
        assert_true(status >= 0);
        *n_done += status == GSID_DONE;
        *n_spoiled += status == GSID_SPOILED;
    }
}

static void assert_close(const gsid_cplx *a, const gsid_cplx *b, uint32_t n, double tolerance) {
    for (uint32_t i = 0; i < n; i++) {
        assert_true(fabs((double)(a[i].re - b[i].re)) <= tolerance && fabs((double)(a[i].im - b[i].im)) <= tolerance);
    }
}

static void the_engines_agree_to_rounding_through_losses_and_settling(void **state) {
    (void)state;
    static results direct, spread, blocks;
    const uint32_t n_periods_all[3] = {90, 128, 8};
    for (int i = 0; i < 12; i++) {
        const uint32_t n_period = n_periods_all[i % 3], n_settle = i < 6 ? 0 : n_period + 5;
        const gsid_frf_cfg cfg = frf_cfg_of(n_period, n_settle, i % 2);
        const uint32_t n_samples = n_settle + 12 * n_period;
        uint32_t n_done, n_spoiled;
        gsid_frf frf;
        assert_int_equal(gsid_frf_init(&frf, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
        run_frf(&frf, n_samples, 0, &n_done, &n_spoiled);
        const uint32_t n_good = frf.n_periods, n_bad = frf.n_spoiled;
        assert_true(n_good >= 6 && n_bad >= 4 && n_good + n_bad == 12);
        assert_int_equal(read_all(&frf, &direct), GSID_OK);

        for (int in_blocks = 0; in_blocks < 2; in_blocks++) {
            assert_int_equal(gsid_frf_init_spread(&frf, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
            run_frf(&frf, n_samples, in_blocks, &n_done, &n_spoiled);
            assert_int_equal(frf.n_periods, n_good - 1); /* the last one is still to come */
            assert_int_equal(gsid_frf_finish(&frf), GSID_DONE);
            assert_int_equal(gsid_frf_finish(&frf), GSID_OK);
            assert_int_equal(frf.n_periods, n_good);
            assert_int_equal(frf.n_spoiled, n_bad);
            assert_int_equal(read_all(&frf, in_blocks ? &blocks : &spread), GSID_OK);
            if (!in_blocks) {
                assert_int_equal(n_done, n_good - 1);
                assert_int_equal(n_spoiled, n_bad);
            }
        }
        const uint32_t n = cfg.n_lines;
        assert_memory_equal(spread.g, blocks.g, n * sizeof *spread.g);
        assert_memory_equal(spread.var_g, blocks.var_g, n * sizeof *spread.var_g);
        /* lines of size 0.1 to 1; a period's line is good to N epsilon (direct), and enters means and products */
        const double tolerance = 4.0 * n_period * EPSILON;
        assert_close(spread.y, direct.y, n, tolerance);
        assert_close(spread.u, direct.u, n, i % 2 ? 0 : tolerance);
        assert_close(spread.cov_yu, direct.cov_yu, n, tolerance);
        for (uint32_t k = 0; k < n; k++) {
            assert_true(fabs((double)(spread.var_y[k] - direct.var_y[k])) < tolerance);
            assert_true(fabs((double)(spread.var_u[k] - direct.var_u[k])) < tolerance);
        }
    }
}

/* A mutant passed that added all lines in the tick after the transform, and a few beyond the last one. */
static void no_tick_adds_more_lines_than_planned(void **state) {
    (void)state;
    const uint32_t n_periods_all[3] = {90, 128, 8};
    uint32_t most = 0;
    for (uint32_t i = 0; i < 6; i++) {
        const gsid_frf_cfg cfg = frf_cfg_of(n_periods_all[i % 3], 0, i % 2);
        gsid_frf frf;
        assert_int_equal(gsid_frf_init_spread(&frf, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
        uint32_t n_ticks = 0;
        for (uint64_t n = 0; n < 3 * cfg.n_period; n++) {
            const uint32_t before = frf.line_next;
            assert_true(gsid_frf_step(&frf, sample(n, 1), sample(n, 0)) >= 0);
            if (frf.line_next > before) {
                assert_in_range(frf.line_next, before + 1, before + frf.spread.lines_per_tick);
                n_ticks++;
            }
            assert_true(frf.line_next <= cfg.n_lines);
        }
        const uint32_t n_of_period = (cfg.n_lines + frf.spread.lines_per_tick - 1) / frf.spread.lines_per_tick;
        assert_int_equal(n_ticks, 2 * n_of_period); /* the third period's lines are still to come */
        most = n_of_period > most ? n_of_period : most;
    }
    assert_true(most > 1);
}

static void a_million_periods_later_the_answer_is_the_same_to_the_bit(void **state) {
    (void)state;
    enum { N = 90 };
    const gsid_frf_cfg cfg = frf_cfg_of(N, 11, 0);
    static results early, late;
    for (int is_late = 0; is_late < 2; is_late++) {
        gsid_frf frf;
        assert_int_equal(gsid_frf_init_spread(&frf, &cfg, memory.bytes, sizeof memory.bytes), GSID_OK);
        assert_int_equal(gsid_frf_skip(&frf, 11), GSID_SETTLING);
        if (is_late) {
            assert_int_equal(gsid_frf_skip(&frf, 1000000u * N), GSID_SPOILED);
            assert_int_equal(frf.n_spoiled, 1000000);
        }
        for (uint32_t n = 0; n < 3 * N; n++) {
            gsid_frf_step(&frf, sample(n, 1), sample(n, 0));
        }
        gsid_frf_finish(&frf);
        assert_int_equal(read_all(&frf, is_late ? &late : &early), GSID_OK);
    }
    assert_memory_equal(&early, &late, sizeof early);
}

static void the_example_of_the_design_is_exact_to_rounding(void **state) {
    (void)state;
    enum { N = 6000, F = 500 };
    static gsid_cplx table[N], direct[F], big[GSID_FRF_SPREAD_MEM_SIZE(N, F, 0) / sizeof(gsid_cplx) + 1];
    static uint32_t line[F];
    for (uint32_t i = 0; i < F; i++) {
        line[i] = i + 1;
    }
    assert_int_equal(gsid_twiddle_fill(N, table), GSID_OK);
    static gsid_cplx ones[F];
    for (uint32_t i = 0; i < F; i++) {
        ones[i].re = 1;
    }
    const gsid_frf_cfg cfg = {.n_period = N, .n_lines = F, .line = line, .twiddle = table, .u_known = ones};
    /* 20 bytes a line in float besides the period's two buffers, 36 in double */
    assert_int_equal(gsid_frf_spread_mem_size(&cfg), F * (3 * sizeof(gsid_real) + 8) + 2 * N * sizeof(gsid_real));
    gsid_frf frf;
    static gsid_cplx spread[F];
    double largest = 0, apart = 0;
    for (int engine = 0; engine < 2; engine++) {
        assert_int_equal((engine ? gsid_frf_init_spread : gsid_frf_init)(&frf, &cfg, big, sizeof big), GSID_OK);
        for (uint32_t n = 0; n < 2 * N; n++) {
            gsid_frf_step(&frf, 0, sample(n, 0) + sample(n % N, 1));
        }
        gsid_frf_finish(&frf);
        assert_int_equal(gsid_frf_result(&frf, &(gsid_frf_out){.g = engine ? spread : direct}), GSID_OK);
    }
    for (uint32_t i = 0; i < F; i++) {
        largest = fmax(largest, hypot((double)direct[i].re, (double)direct[i].im));
        apart = fmax(apart, hypot((double)(spread[i].re - direct[i].re), (double)(spread[i].im - direct[i].im)));
    }
    /* the direct sum is the worse of the two: 6000 roundings of a random walk, sqrt(6000) epsilon of its largest */
    print_message("  500 lines of 6000: the engines are %.1e of the largest line apart\n", apart / largest);
    assert_true(apart < 77 * EPSILON * largest);
}

static void memory_is_counted_and_checked(void **state) {
    (void)state;
    for (int is_known = 0; is_known < 2; is_known++) {
        const gsid_frf_cfg cfg = frf_cfg_of(90, 0, is_known);
        const size_t size = gsid_frf_spread_mem_size(&cfg);
        assert_int_equal(size, GSID_FRF_SPREAD_MEM_SIZE(90, cfg.n_lines, !is_known));
        assert_int_equal(gsid_frf_mem_size(&cfg), GSID_FRF_MEM_SIZE(cfg.n_lines, !is_known));
        gsid_frf frf, untouched;
        memset(&frf, 0, sizeof frf);
        untouched = frf;
        memset(memory.bytes, 0x5A, sizeof memory.bytes);
        assert_int_equal(gsid_frf_init_spread(&frf, &cfg, memory.bytes, size - 1), GSID_E_MEMORY);
        assert_int_equal(gsid_frf_init_spread(&frf, &cfg, memory.bytes + 1, size), GSID_E_MEMORY);
        assert_memory_equal(&frf, &untouched, sizeof frf);
        assert_int_equal(memory.bytes[0], 0x5A);
        assert_int_equal(gsid_frf_init_spread(&frf, &cfg, memory.bytes, size), GSID_OK);
        for (uint32_t n = 0; n < 400; n++) {
            gsid_frf_step(&frf, sample(n, 1), sample(n, 0));
        }
        assert_int_equal(memory.bytes[size], 0x5A); /* not a byte more than asked for */
    }
    const gsid_spectrum_cfg cfg = cfg_of(90, 2, 0);
    assert_int_equal(gsid_spread_mem_size(&cfg), GSID_SPREAD_MEM_SIZE(90, 46, 2));
}

static void every_refusal(void **state) {
    (void)state;
    const gsid_spectrum_cfg good = cfg_of(90, 1, 0);
    gsid_spread s, untouched;
    gsid_cplx x;
    const gsid_real one = 1;
    memset(&s, 0, sizeof s);
    untouched = s;
    assert_int_equal(gsid_spread_reset(&s), GSID_E_STATE);
    assert_int_equal(gsid_spread_step(&s, &one), GSID_E_STATE);
    assert_int_equal(gsid_spread_skip(&s, 1), GSID_E_STATE);
    assert_int_equal(gsid_spread_finish(&s), GSID_E_STATE);
    assert_int_equal(gsid_spread_line(&s, 0, 0, &x), GSID_E_STATE);
#define REFUSED(field, value, status)                                                                                  \
    do {                                                                                                               \
        gsid_spectrum_cfg bad = good;                                                                                  \
        bad.field = (value);                                                                                           \
        assert_int_equal(gsid_spread_mem_size(&bad), 0);                                                               \
        assert_int_equal(gsid_spread_init(&s, &bad, memory.bytes, sizeof memory.bytes), status);                       \
    } while (0)
    REFUSED(line, NULL, GSID_E_NULL);
    REFUSED(twiddle, NULL, GSID_E_NULL);
    REFUSED(n_period, 105, GSID_E_CONFIG);  /* odd */
    REFUSED(n_period, 2, GSID_E_CONFIG);    /* too short */
    REFUSED(n_period, 4 * 11, GSID_E_CONFIG);
    REFUSED(n_period, (UINT32_C(1) << 31), GSID_E_CONFIG);
    REFUSED(n_lines, 0, GSID_E_CONFIG);
    REFUSED(n_lines, 47, GSID_E_CONFIG);
    REFUSED(n_channels, 3, GSID_E_CONFIG);
    REFUSED(n_first, 90, GSID_E_CONFIG);
#undef REFUSED
    assert_int_equal(gsid_spread_mem_size(NULL), 0);
    assert_int_equal(gsid_spread_init(&s, NULL, memory.bytes, sizeof memory.bytes), GSID_E_NULL);
    assert_int_equal(gsid_spread_init(&s, &good, NULL, 1 << 20), GSID_E_NULL);
    assert_int_equal(gsid_spread_init(NULL, &good, memory.bytes, sizeof memory.bytes), GSID_E_NULL);
    assert_memory_equal(&s, &untouched, sizeof s);
    assert_int_equal(gsid_spread_init(&s, &good, memory.bytes, sizeof memory.bytes), GSID_OK);
    assert_int_equal(gsid_spread_reset(NULL), GSID_E_NULL);
    assert_int_equal(gsid_spread_step(NULL, &one), GSID_E_NULL);
    assert_int_equal(gsid_spread_step(&s, NULL), GSID_E_NULL);
    assert_int_equal(gsid_spread_skip(NULL, 1), GSID_E_NULL);
    assert_int_equal(gsid_spread_finish(NULL), GSID_E_NULL);
    assert_int_equal(gsid_spread_line(NULL, 0, 0, &x), GSID_E_NULL);
    assert_int_equal(gsid_spread_line(&s, 0, 0, NULL), GSID_E_NULL);
    for (uint32_t n = 0; n < 90; n++) {
        step(&s, n);
    }
    gsid_spread_finish(&s);
    assert_int_equal(gsid_spread_line(&s, 46, 0, &x), GSID_E_CONFIG);
    assert_int_equal(gsid_spread_line(&s, 0, 1, &x), GSID_E_CONFIG);
    const gsid_frf_cfg odd = frf_cfg_of(91, 0, 0);
    gsid_frf frf = {0};
    assert_int_equal(gsid_frf_spread_mem_size(&odd), 0);
    assert_int_equal(gsid_frf_init_spread(&frf, &odd, memory.bytes, sizeof memory.bytes), GSID_E_CONFIG);
    assert_int_equal(gsid_frf_finish(&frf), GSID_E_STATE);
    assert_int_equal(gsid_frf_finish(NULL), GSID_E_NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_smooth_period_is_transformed_during_the_next),
        cmocka_unit_test(a_gap_spoils_its_period_only_and_keeps_the_time),
        cmocka_unit_test(the_work_of_a_period_fits_its_ticks_for_every_length),
        cmocka_unit_test(refused_samples_change_nothing),
        cmocka_unit_test(the_engines_agree_to_rounding_through_losses_and_settling),
        cmocka_unit_test(no_tick_adds_more_lines_than_planned),
        cmocka_unit_test(a_million_periods_later_the_answer_is_the_same_to_the_bit),
        cmocka_unit_test(the_example_of_the_design_is_exact_to_rounding),
        cmocka_unit_test(memory_is_counted_and_checked),
        cmocka_unit_test(every_refusal),
    };
    return cmocka_run_group_tests_name("spread", tests, NULL, NULL);
}
