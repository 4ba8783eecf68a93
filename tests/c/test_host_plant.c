/* Plants against what shares no code with them: the analytic response to a held command, and the simulated axis, which finds
 * its own events in closed form. */
#include "plant_bench.h"

#include "gsid/host/axis.h"
#include "gsid/host/fit.h"

enum { N = 600, PERIODS = 60 };
static bench b;
static double u[PERIODS * N], y[PERIODS * N], truth[PERIODS * N];

static void fill_command(double size) {
    for (uint32_t n = 0; n < PERIODS * N; n++) {
        u[n] = bench_command(N, n, size);
    }
}

/* ---- linear ---- */

/* to += factor a b, ascending powers of s / scale */
static void add_product(double factor, const double a[3], const double c[3], double *to) {
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            if (i + j < 5) {
                to[i + j] += factor * a[i] * c[j];
            }
        }
    }
}

/* gain s / (s^2 + viscous s + spring) + residue gain s / (s^2 + 2 zeta w s + w^2), with delay and lag */
static gsid_rational source_response(double delay_s) {
    const double c = 100.0, w0 = 2.0 * PI * 179.0, gain = 7.4, residue = 0.15;
    const double axis[3] = {170.0, 11.0 * c, c * c}, mode[3] = {w0 * w0, 2.0 * 0.015 * w0 * c, c * c};
    const double drive[3] = {0.0, gain * c, 0.0};
    double both[5] = {0};
    gsid_rational g;
    assert_int_equal(gsid_rational_init(&g, GSID_DOMAIN_S, 5, 3, c), GSID_OK);
    add_product(1.0, axis, mode, both);
    memset(g.num, 0, sizeof g.num);
    memset(g.den, 0, sizeof g.den);
    add_product(1.0, drive, mode, g.num);
    add_product(residue, drive, axis, g.num);
    for (int i = 0; i < 5; i++) {
        g.den[i] += both[i];
        g.den[i + 1] += 1e-3 * c * both[i];
    }
    g.delay_s = delay_s;
    return g;
}

static gsid_cplx line_of(const double *x, uint32_t line) {
    gsid_cplx sum = {0, 0};
    for (uint32_t n = 0; n < N; n++) {
        const double angle = 2.0 * PI * (double)(line * n % N) / N;
        sum.re += 2.0 / N * x[n] * cos(angle);
        sum.im -= 2.0 / N * x[n] * sin(angle);
    }
    return sum;
}

static void linear_stack_has_the_analytic_response(void **state) {
    (void)state;
    const double samples[] = {0.0, 1e-9, 0.3, 1.0, 1.0 + 1e-9, 16.2, 63.0, 63.99, 200.5};
    fill_command(30.0);
    for (size_t k = 0; k < sizeof samples / sizeof samples[0]; k++) {
        double residual;
        bench_clear(&b);
        bench_add_source(&b);
        b.item[0].value[0] = samples[k] / FS;
        bench_init(&b);
        assert_int_equal(gsid_plant_periodic(&b.plant, N, u, 1, 3, y, NULL, NULL, NULL, &residual), GSID_OK);
        const gsid_rational model = source_response(samples[k] / FS);
        for (uint32_t line = 1; line < 40; line += 2) {
            gsid_cplx g;
            const double f_hz = line * FS / N;
            const gsid_cplx in = line_of(u, line), out = line_of(y, line);
            assert_int_equal(gsid_hold_response(&model, 1.0 / FS, 1, &f_hz, &g), GSID_OK);
            /* rounding of 600 samples, and of the partial fractions */
            assert_near(out.re, g.re * in.re - g.im * in.im, 1e-11);
            assert_near(out.im, g.re * in.im + g.im * in.re, 1e-11);
        }
    }
}

/* ---- stick and slip ---- */

static void run_axis(double level, double delay_s) {
    gsid_axis_cfg cfg;
    gsid_axis *axis;
    gsid_axis_cfg_init(&cfg);
    cfg.command_limit = cfg.noise_rms = cfg.noise_low_rms = cfg.fan_amplitude = 0.0;
    cfg.coulomb_level = level;
    cfg.delay_s = delay_s;
    assert_int_equal(gsid_axis_create(&axis, &cfg), GSID_OK);
    assert_int_equal(gsid_axis_step(axis, PERIODS * N, u, NULL, truth, NULL), GSID_OK);
    gsid_axis_destroy(axis);
}

static void start_source_with_friction(double level, double delay_s) {
    bench_clear(&b);
    bench_add_source(&b);
    bench_add_with(&b, "coulomb_friction", level, 0, 0);
    b.item[0].value[0] = delay_s;
    bench_init(&b);
}

static void coulomb_friction_follows_the_axis(void **state) {
    (void)state;
    const double levels[] = {0.5, 15.0, 60.0, 120.0, 400.0};
    fill_command(30.0);
    for (size_t k = 0; k < sizeof levels / sizeof levels[0]; k++) {
        const double delay_s = k % 2 == 0 ? 5.4e-3 : 5.0e-3;
        run_axis(levels[k], delay_s);
        start_source_with_friction(levels[k], delay_s);
        for (uint32_t n = 0; n < 5 * N; n++) {
            assert_int_equal(gsid_plant_step(&b.plant, u[n], &y[n], NULL), GSID_OK);
            assert_near(y[n], truth[n], 1e-11); /* a few dozen events, each located to rounding */
        }
    }
}

static void shooting_finds_where_the_axis_settles(void **state) {
    (void)state;
    const double levels[] = {0.5, 15.0, 60.0, 120.0};
    fill_command(30.0);
    for (size_t k = 0; k < sizeof levels / sizeof levels[0]; k++) {
        double residual;
        run_axis(levels[k], 5.4e-3);
        start_source_with_friction(levels[k], 5.4e-3);
        assert_int_equal(gsid_plant_periodic(&b.plant, N, u, 2, 8, y, NULL, NULL, NULL, &residual), GSID_OK);
        for (uint32_t n = 0; n < N; n++) {
            assert_near(y[n], truth[(PERIODS - 1) * N + n], 1e-9); /* the axis' own transient after 12 s */
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(linear_stack_has_the_analytic_response),
        cmocka_unit_test(coulomb_friction_follows_the_axis),
        cmocka_unit_test(shooting_finds_where_the_axis_settles),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
