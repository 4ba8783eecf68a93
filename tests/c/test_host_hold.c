/* Response to a held input against closed forms, the sum of the images that sampling folds back, and a simulation. */
#include <complex.h>
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "gsid/host/fit.h"

#define PI 3.14159265358979323846

typedef double complex cplx;

static const double sample_s = 1.0 / 3000;
enum { N_FREQ = 12 };
static const double f_hz[N_FREQ] = {0.5, 1, 5, 20, 54, 100, 165, 179, 250, 700, 1200, 1499};

static gsid_rational new_model(uint32_t n_poles, uint32_t n_zeros, double scale) {
    gsid_rational m;
    assert_int_equal(gsid_rational_init(&m, GSID_DOMAIN_S, n_poles, n_zeros, scale), GSID_OK);
    return m;
}

/* num, and den multiplied from first and second order factors c0 + c1 v + c2 v^2 */
static gsid_rational from_factors(uint32_t n_zeros, const double *num, uint32_t n_factors, double (*factor)[3],
                                  double scale) {
    double den[GSID_ORDER_MAX + 3] = {1};
    uint32_t degree = 0;
    for (uint32_t i = 0; i < n_factors; i++) {
        const uint32_t order = factor[i][2] != 0 ? 2 : 1;
        for (uint32_t k = degree + order + 1; k-- > 0;) {
            den[k] = factor[i][0] * den[k] + (k >= 1 ? factor[i][1] * den[k - 1] : 0) +
                     (k >= 2 ? factor[i][2] * den[k - 2] : 0);
        }
        degree += order;
    }
    gsid_rational m = new_model(degree, n_zeros, scale);
    memcpy(m.den, den, (degree + 1) * sizeof den[0]);
    memcpy(m.num, num, (n_zeros + 1) * sizeof num[0]);
    return m;
}

/* lag pair at 13 rad/s, mode at 179 Hz with damping 0.015: the axis of the source */
static gsid_rational axis(void) {
    const double scale = 2 * PI * 250, w = 179.0 / 250;
    double factors[2][3] = {{170 / scale / scale, 11 / scale, 1}, {w * w, 0.03 * w, 1}};
    const double num[4] = {11 / scale * 0.02, 0.02, 5e-4, 0.045};
    return from_factors(3, num, 2, factors, scale);
}

static void held(const gsid_rational *m, cplx *g) {
    gsid_cplx response[N_FREQ];
    assert_int_equal(gsid_hold_response(m, sample_s, N_FREQ, f_hz, response), GSID_OK);
    for (int k = 0; k < N_FREQ; k++) {
        g[k] = response[k].re + I * response[k].im;
    }
}

static void assert_near(cplx got, cplx want, double tolerance, const char *what, double f) {
    if (!(cabs(got - want) <= tolerance)) {
        fail_msg("%s, %g Hz: got (%.9g, %.9g), want (%.9g, %.9g), off by %.3g, allowed %.3g", what, f, creal(got),
                 cimag(got), creal(want), cimag(want), cabs(got - want), tolerance);
    }
}

static cplx at(const gsid_rational *m, double w) {
    const cplx v = I * w / m->scale_rad_s;
    cplx a = 0, b = 0;
    for (uint32_t i = m->n_poles + 1; i-- > 0;) {
        a = a * v + m->den[i];
    }
    for (uint32_t i = m->n_zeros + 1; i-- > 0;) {
        b = b * v + m->num[i];
    }
    return cexp(-I * w * m->delay_s) * b / a;
}

/* sum over images m of G(j w_m) (1 - exp(-j w_m T)) / (j w_m T), w_m = w + 2 pi m / T; *tail is a bound on what is left out */
static cplx images(const gsid_rational *m, double f, double *tail) {
    enum { TERMS = 4000 };
    const double w = 2 * PI * f, step = 2 * PI / sample_s;
    const cplx fall = 1 - cexp(-I * w * sample_s);
    cplx sum = at(m, w) * fall / (I * w * sample_s), last = 0;
    for (int i = 1; i <= TERMS; i++) {
        const cplx up = at(m, w + i * step) / (I * (w + i * step)), down = at(m, w - i * step) / (I * (w - i * step));
        last = (up + down) * fall / sample_s;
        sum += last;
        *tail = (cabs(up) + cabs(down)) * cabs(fall) / sample_s;
    }
    /* the terms fall as i^-2 at the slowest: the rest is below TERMS times the last one */
    *tail *= TERMS;
    return sum;
}

static void assert_images(const gsid_rational *m, double tolerance, const char *what) {
    cplx g[N_FREQ];
    held(m, g);
    for (int k = 0; k < N_FREQ; k++) {
        double tail;
        const cplx want = images(m, f_hz[k], &tail);
        assert_near(g[k], want, tail + tolerance * cabs(want), what, f_hz[k]);
    }
}

static void images_of_the_axis_at_any_delay(void **state) {
    (void)state;
    const double samples[8] = {0, 1, 16.2, 0.5, 1e-6, 3 - 1e-6, 2.75, -1.3};
    for (int i = 0; i < 8; i++) {
        gsid_rational m = axis();
        m.delay_s = samples[i] * sample_s;
        assert_images(&m, 1e-10, "axis");
        m.n_zeros = 1; /* two powers more: next to nothing is left out */
        assert_images(&m, 1e-10, "axis of relative degree 3");
    }
}

/* Partial fractions do not exist, and those of the rounded roots cancel: nothing may be asked of the poles. */
static void images_of_repeated_poles(void **state) {
    (void)state;
    const double one[1] = {1};
    double lags[8][3], modes[4][3];
    for (uint32_t i = 0; i < 8; i++) {
        lags[i][0] = lags[i][1] = 1, lags[i][2] = 0;
    }
    for (uint32_t i = 0; i < 4; i++) {
        modes[i][0] = modes[i][2] = 1, modes[i][1] = 0.1;
    }
    for (uint32_t n = 2; n <= 8; n++) {
        gsid_rational m = from_factors(0, one, n, lags, 2 * PI * 100);
        m.delay_s = 1.4 * sample_s;
        assert_images(&m, 1e-9, "equal lags");
        if (n <= 4) {
            m = from_factors(0, one, n, modes, 2 * PI * 179);
            m.delay_s = 1.4 * sample_s;
            assert_images(&m, 1e-9, "equal modes");
        }
    }
    const double near[1] = {1};
    double almost[3][3] = {{1, 1, 0}, {1.0001, 1, 0}, {1 + 1e-9, 1, 0}};
    const gsid_rational m = from_factors(0, near, 3, almost, 2 * PI * 100);
    assert_images(&m, 1e-9, "nearly equal lags");
}

static void closed_forms(void **state) {
    (void)state;
    cplx g[N_FREQ];
    const double a = 2 * PI * 100, e = exp(-a * sample_s);
    for (int k = 0; k < N_FREQ; k++) {
        const cplx z = cexp(2 * I * PI * f_hz[k] * sample_s);
        gsid_rational m = new_model(1, 0, a);
        m.num[0] = m.den[0] = m.den[1] = 1; /* a / (s + a) */
        held(&m, g);
        assert_near(g[k], (1 - e) / (z - e), 1e-13, "lag", f_hz[k]);
        m.den[0] = 0; /* a / s */
        held(&m, g);
        assert_near(g[k], a * sample_s / (z - 1), 1e-12 * cabs(g[k]), "integrator", f_hz[k]);
        m.delay_s = 0.25 * sample_s; /* a quarter of the sample still has the old command */
        held(&m, g);
        assert_near(g[k], a * sample_s * (0.75 + 0.25 / z) / (z - 1), 1e-12 * cabs(g[k]), "late integrator", f_hz[k]);
        m = new_model(2, 0, a);
        m.num[0] = m.den[2] = 1; /* (a / s)^2 */
        m.den[0] = 0;
        held(&m, g);
        /* z - 1 is good to epsilon / |z - 1|, twice: 1e-16 / 1e-3 each at the lowest line */
        const cplx want = pow(a * sample_s, 2) / 2 * (z + 1) / (z - 1) / (z - 1);
        assert_near(g[k], want, 1e-11 * cabs(want), "double integrator", f_hz[k]);
        m = new_model(2, 0, a);
        m.num[0] = m.den[1] = m.den[2] = 1; /* a^2 / (s (s + a)) */
        m.den[0] = 0;
        held(&m, g);
        const cplx lagging = a * sample_s / (z - 1) - (1 - e) / (z - e);
        assert_near(g[k], lagging, 1e-11 * cabs(lagging), "integrator and lag", f_hz[k]);
        m = new_model(0, 0, 1);
        m.num[0] = 2; /* a gain sees the command before the one of this instant */
        held(&m, g);
        assert_near(g[k], 2 / z, 1e-14, "gain", f_hz[k]);
    }
}

enum { STEPS = 64, ORDER = 4, PERIOD = 60, PERIODS = 24 };

/* State of num/den in the controllable form, input held for one step of length h in units of 1/scale: Runge and Kutta's four. */
static void advance(const gsid_rational *m, double h, double u, double *x) {
    double k[4][ORDER], at_x[ORDER];
    const double part[4] = {0, 0.5, 0.5, 1};
    for (int stage = 0; stage < 4; stage++) {
        for (int i = 0; i < ORDER; i++) {
            at_x[i] = x[i] + (stage == 0 ? 0 : part[stage] * h * k[stage - 1][i]);
        }
        double top = u;
        for (int i = 0; i < ORDER; i++) {
            top -= m->den[i] * at_x[i];
            k[stage][i] = i + 1 < ORDER ? at_x[i + 1] : 0;
        }
        k[stage][ORDER - 1] = top / m->den[ORDER];
    }
    for (int i = 0; i < ORDER; i++) {
        x[i] += h / 6 * (k[0][i] + 2 * k[1][i] + 2 * k[2][i] + k[3][i]);
    }
}

static int command(int n) {
    return (n % PERIOD * 37) % 23 - 11; /* one period of no special shape */
}

/* Simulate a held periodic command delayed by `delay` sixty-fourths of a sample, into the steady state; compare every line. */
static void assert_simulated(const gsid_rational *m, int delay) {
    double x[ORDER] = {0}, y[PERIOD];
    double f[PERIOD / 2 - 1];
    gsid_cplx got[PERIOD / 2 - 1];
    const double direct = m->n_zeros == ORDER ? m->num[ORDER] / m->den[ORDER] : 0;
    for (int n = 0; n < PERIODS * PERIOD; n++) {
        /* just before instant n: what the direct path passes is the command delayed, one step of the simulation ago */
        const int before = (n + 100 * PERIOD) * STEPS - delay - 1;
        y[n % PERIOD] = direct * command(before / STEPS);
        for (int i = 0; i < ORDER; i++) {
            y[n % PERIOD] += ((i <= (int)m->n_zeros ? m->num[i] : 0) - direct * m->den[i]) * x[i];
        }
        for (int i = 0; i < STEPS; i++) {
            advance(m, m->scale_rad_s * sample_s / STEPS, command(((n + 100 * PERIOD) * STEPS + i - delay) / STEPS), x);
        }
    }
    for (int k = 1; k < PERIOD / 2; k++) {
        f[k - 1] = k / sample_s / PERIOD;
    }
    assert_int_equal(gsid_hold_response(m, sample_s, PERIOD / 2 - 1, f, got), GSID_OK);
    for (int k = 1; k < PERIOD / 2; k++) {
        cplx u_line = 0, y_line = 0;
        for (int n = 0; n < PERIOD; n++) {
            u_line += command(n) * cexp(-2 * I * PI * k * n / PERIOD);
            y_line += y[n] * cexp(-2 * I * PI * k * n / PERIOD);
        }
        /* The mode turns h = 0.013 rad per step, of which Runge and Kutta's method misses h^4 / 120 of it: over the
         * damping 0.05 and |G| = 5 on its peak that is 2.4e-8. What is left of the start-up after 24 periods is e^-60. */
        assert_near(got[k - 1].re + I * got[k - 1].im, y_line / u_line, 3e-8, "simulation", f[k - 1]);
    }
}

static void simulation_with_fractional_and_whole_delays(void **state) {
    (void)state;
    /* poles at 300 rad/s and damping 0.05 at 400 Hz, and a lag */
    const double scale = 2 * PI * 400;
    double factors[3][3] = {{300 / scale, 1, 0}, {0.5, 1, 0}, {1, 0.1, 1}};
    const double num[5] = {0.2, 0.5, 0.3, 0.7, 0.4};
    for (uint32_t n_zeros = 0; n_zeros <= 4; n_zeros++) {
        gsid_rational m = from_factors(n_zeros, num, 3, factors, scale);
        const int delays[6] = {0, 64, 5 * 64, 1, 63, 3 * 64 + 20};
        for (int i = 0; i < 6; i++) {
            m.delay_s = delays[i] * sample_s / STEPS;
            assert_simulated(&m, delays[i]);
        }
    }
}

static void delay_is_a_smooth_parameter(void **state) {
    (void)state;
    gsid_rational m = axis();
    for (int whole = 0; whole < 20; whole++) {
        cplx below[N_FREQ], above[N_FREQ];
        m.delay_s = (whole - 1e-9) * sample_s;
        held(&m, below);
        m.delay_s = (whole + 1e-9) * sample_s;
        held(&m, above);
        for (int k = 0; k < N_FREQ; k++) { /* 2e-9 of a sample turns the phase by less than 1e-8 */
            assert_near(above[k], below[k], 1e-8 * cabs(below[k]) + 1e-12, "across a whole delay", f_hz[k]);
        }
    }
    cplx rounded[N_FREQ], whole[N_FREQ];
    m.delay_s = 3 * sample_s * (1 - DBL_EPSILON);
    held(&m, rounded);
    m.delay_s = 3 * sample_s;
    held(&m, whole);
    for (int k = 0; k < N_FREQ; k++) {
        assert_near(rounded[k], whole[k], 1e-12 * cabs(whole[k]), "rounded", f_hz[k]);
    }
}

static void failures_leave_the_outputs(void **state) {
    (void)state;
    gsid_rational m = axis(), bad;
    gsid_cplx g[N_FREQ] = {{1, 2}}, untouched[N_FREQ] = {{1, 2}};
    double f[N_FREQ];
    memcpy(f, f_hz, sizeof f);
    assert_int_equal(gsid_hold_response(NULL, sample_s, N_FREQ, f, g), GSID_E_NULL);
    assert_int_equal(gsid_hold_response(&m, sample_s, N_FREQ, NULL, g), GSID_E_NULL);
    assert_int_equal(gsid_hold_response(&m, sample_s, N_FREQ, f, NULL), GSID_E_NULL);
    assert_int_equal(gsid_hold_response(&m, sample_s, 0, NULL, NULL), GSID_OK);
    const double bad_samples[4] = {0, -1, NAN, INFINITY};
    for (int i = 0; i < 4; i++) {
        assert_int_equal(gsid_hold_response(&m, bad_samples[i], N_FREQ, f, g), GSID_E_CONFIG);
    }
    bad = m;
    bad.domain = GSID_DOMAIN_Z;
    assert_int_equal(gsid_hold_response(&bad, sample_s, N_FREQ, f, g), GSID_E_CONFIG);
    bad = m;
    bad.n_zeros = 5;
    assert_int_equal(gsid_hold_response(&bad, sample_s, N_FREQ, f, g), GSID_E_CONFIG);
    bad = m;
    bad.den[4] = 0; /* more zeros than poles, again */
    assert_int_equal(gsid_hold_response(&bad, sample_s, N_FREQ, f, g), GSID_E_CONFIG);
    bad = m;
    bad.delay_s = NAN;
    assert_int_equal(gsid_hold_response(&bad, sample_s, N_FREQ, f, g), GSID_E_CONFIG);
    bad = m;
    bad.den[1] = NAN;
    assert_int_equal(gsid_hold_response(&bad, sample_s, N_FREQ, f, g), GSID_E_NONFINITE);
    bad = m;
    bad.num[0] = INFINITY;
    assert_int_equal(gsid_hold_response(&bad, sample_s, N_FREQ, f, g), GSID_E_NONFINITE);
    f[N_FREQ - 1] = NAN;
    assert_int_equal(gsid_hold_response(&m, sample_s, N_FREQ, f, g), GSID_E_NONFINITE);
    bad = m;
    bad.den[0] = 0; /* an integrator at 0 Hz */
    f[N_FREQ - 1] = 0;
    assert_int_equal(gsid_hold_response(&bad, sample_s, N_FREQ, f, g), GSID_E_NONFINITE);
    assert_memory_equal(g, untouched, sizeof g);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(images_of_the_axis_at_any_delay),
        cmocka_unit_test(images_of_repeated_poles),
        cmocka_unit_test(closed_forms),
        cmocka_unit_test(simulation_with_fractional_and_whole_delays),
        cmocka_unit_test(delay_is_a_smooth_parameter),
        cmocka_unit_test(failures_leave_the_outputs),
    };
    return cmocka_run_group_tests_name("hold", tests, NULL, NULL);
}
