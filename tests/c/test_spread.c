/* The spread transform against a slow long double transform and against the direct engine; its plan of work. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "gsid/excitation.h"
#include "gsid/frf.h"
#include "gsid/spread.h"

#ifdef GSID_SINGLE
#define EPSILON FLT_EPSILON
#else
#define EPSILON DBL_EPSILON
#endif

#define PI_L 3.14159265358979323846264338327950288L

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

/* any signal that is not periodic: sample n of channel c, within +-1 */
static gsid_real sample(uint64_t n, uint32_t c) {
    return (gsid_real)sin(0.7 * (double)(n % 1000003u) + 0.3 * (double)c + 1e-4 * (double)(n % 1009u) * (double)n);
}

static long double slow_line(uint32_t n_period, uint32_t k, uint64_t n_start, uint32_t c, int imaginary) {
    long double sum = 0;
    for (uint64_t n = n_start; n < n_start + n_period; n++) {
        const long double angle = 2 * PI_L * (long double)(k * n % n_period) / n_period;
        sum += (long double)sample(n, c) * (imaginary ? -sinl(angle) : cosl(angle));
    }
    return sum * (k == 0 || 2 * k == n_period ? 1 : 2) / n_period;
}

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
    const uint32_t n_period = s->cfg.n_period;
    for (uint32_t i = 0; i < s->cfg.n_lines; i++) {
        for (uint32_t c = 0; c < s->cfg.n_channels; c++) {
            gsid_cplx x;
            assert_int_equal(gsid_spread_line(s, i, c, &x), GSID_OK);
            /* Each of at most ten stages and the split rounds a value below N a few times: 2/N of that, with room. */
            assert_true(fabsl((long double)x.re - slow_line(n_period, lines[i], n_start, c, 0)) < 20 * EPSILON);
            assert_true(fabsl((long double)x.im - slow_line(n_period, lines[i], n_start, c, 1)) < 20 * EPSILON);
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_smooth_period_is_transformed_during_the_next),
    };
    return cmocka_run_group_tests_name("spread", tests, NULL, NULL);
}
