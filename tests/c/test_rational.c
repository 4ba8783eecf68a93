/* Rational models against complex long double, their derivatives against differences, stability against known roots. */
#include <complex.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "gsid/rational.h"
#include "reference.h"

#ifdef GSID_SINGLE
#define SMALLEST FLT_MIN
#else
#define SMALLEST DBL_MIN
#endif

typedef long double complex wide;

/* uniform in lo .. hi, the same on every machine */
static double draw(double lo, double hi) {
    static uint32_t seed = 2;
    seed = 1664525u * seed + 1013904223u;
    return lo + (hi - lo) * (double)seed / 4294967296.0;
}

static gsid_rational new_model(gsid_domain domain, uint32_t n_poles, uint32_t n_zeros, double rate) {
    gsid_rational m;
    memset(&m, 0, sizeof m); /* the padding too: whole objects are compared */
    assert_int_equal(gsid_rational_init(&m, domain, n_poles, n_zeros, (gsid_real)rate), GSID_OK);
    return m;
}

/* Coefficients of one sign in s and small ones in z keep the denominator away from zero on every line. */
static gsid_rational random_model(gsid_domain domain, uint32_t n_poles, uint32_t n_zeros) {
    gsid_rational m = new_model(domain, n_poles, n_zeros, domain == GSID_DOMAIN_S ? 300.0 : 1.0 / 3000.0);
    for (uint32_t i = 0; i <= n_poles; i++) {
        m.den[i] = (gsid_real)(domain == GSID_DOMAIN_S ? draw(0.5, 2) : draw(-0.9, 0.9) / n_poles);
    }
    for (uint32_t i = 0; i <= n_zeros; i++) {
        m.num[i] = (gsid_real)draw(-1, 1);
    }
    m.den[gsid_rational_held(&m)] = 1;
    m.delay_s = (gsid_real)draw(0, 0.01);
    return m;
}

/* The parameters in the order of the gradient, one of them moved. */
static wide reference(const gsid_rational *m, long double f_hz, int moved, long double by) {
    const long double w = 2 * PI_L * f_hz;
    const wide v = m->domain == GSID_DOMAIN_S ? I * w / m->scale_rad_s : cexpl(-I * w * m->sample_s);
    wide a = 0, b = 0, power = 1;
    int parameter = 0;
    for (uint32_t i = 0; i <= m->n_poles; i++, power *= v) {
        a += power * (m->den[i] + (i != gsid_rational_held(m) && parameter++ == moved ? by : 0));
    }
    power = 1;
    for (uint32_t i = 0; i <= m->n_zeros; i++, power *= v) {
        b += power * (m->num[i] + (parameter++ == moved ? by : 0));
    }
    return cexpl(-I * w * (m->delay_s + (parameter == moved ? by : 0))) * b / a;
}

static void assert_cplx_near(gsid_cplx got, wide want, long double tolerance) {
    const long double off = cabsl(got.re + I * (wide)got.im - want);
    if (!(off <= tolerance)) {
        fail_msg("got (%.9g, %.9g), want (%.9Lg, %.9Lg), off by %.3Lg, allowed %.3Lg", (double)got.re, (double)got.im,
                 creall(want), cimagl(want), off, tolerance);
    }
}

static const uint32_t orders[5][2] = {{0, 0}, {1, 0}, {4, 3}, {2, 5}, {9, 8}};

/* Angles up to 2 pi 250 0.01 = 16 rad are off by 16 epsilon; |G| and its derivatives stay below 100 on these models, of
 * which n terms are summed: 100 x 16 epsilon covers both. */
#define TOLERANCE (1600 * (long double)EPSILON)

static void response_is_that_of_the_definition(void **state) {
    (void)state;
    for (int o = 0; o < 5; o++) {
        for (int domain = GSID_DOMAIN_S; domain <= GSID_DOMAIN_Z; domain++) {
            const gsid_rational m = random_model((gsid_domain)domain, orders[o][0], orders[o][1]);
            gsid_real f[20];
            gsid_cplx g[20];
            for (int k = 0; k < 20; k++) {
                f[k] = (gsid_real)(12.5 * k);
            }
            assert_int_equal(gsid_rational_eval(&m, 20, f, g), GSID_OK);
            for (int k = 0; k < 20; k++) {
                assert_cplx_near(g[k], reference(&m, f[k], -1, 0), TOLERANCE);
            }
        }
    }
}

static void gradient_is_the_slope(void **state) {
    (void)state;
    for (int o = 0; o < 5; o++) {
        for (int domain = GSID_DOMAIN_S; domain <= GSID_DOMAIN_Z; domain++) {
            const gsid_rational m = random_model((gsid_domain)domain, orders[o][0], orders[o][1]);
            const int n = (int)(m.n_poles + m.n_zeros) + 2;
            for (int k = 0; k < 10; k++) {
                const gsid_real f = (gsid_real)(25 * k);
                gsid_cplx g, slope[GSID_RATIONAL_PARAMETERS_MAX];
                assert_int_equal(gsid_rational_gradient(&m, f, &g, slope), GSID_OK);
                assert_cplx_near(g, reference(&m, f, -1, 0), TOLERANCE);
                for (int i = 0; i < n; i++) {
                    /* central differences in long double: h^2 = 1e-12 of the third derivative, 1e-19 / h of rounding;
                     * by the delay everything is 2 pi f times as much */
                    const long double h = i == n - 1 ? 1e-9L : 1e-6L, size = i == n - 1 ? 2000 : 1;
                    const wide want = (reference(&m, f, i, h) - reference(&m, f, i, -h)) / (2 * h);
                    assert_cplx_near(slope[i], want, size * (TOLERANCE + 1e-8L));
                }
            }
        }
    }
}

/* Closed forms that need no reference at all. */
static void delay_turns_the_phase_back(void **state) {
    (void)state;
    const gsid_real f = 100;
    gsid_cplx g;
    gsid_rational m = new_model(GSID_DOMAIN_S, 0, 0, 1);
    m.num[0] = 2;
    m.delay_s = (gsid_real)0.0025; /* a quarter turn at 100 Hz */
    assert_int_equal(gsid_rational_eval(&m, 1, &f, &g), GSID_OK);
    assert_cplx_near(g, -2 * I, 10 * EPSILON);
    m = new_model(GSID_DOMAIN_Z, 0, 1, 0.001);
    m.num[1] = 2; /* z^-1 */
    m.delay_s = (gsid_real)0.0015; /* and a fraction of a sample */
    assert_int_equal(gsid_rational_eval(&m, 1, &f, &g), GSID_OK);
    assert_cplx_near(g, -2 * I, 10 * EPSILON);
    m = new_model(GSID_DOMAIN_S, 1, 0, 2 * 3.14159265358979 * 100);
    m.num[0] = 1;
    m.den[1] = 1; /* 1 / (1 + j) */
    assert_int_equal(gsid_rational_eval(&m, 1, &f, &g), GSID_OK);
    assert_cplx_near(g, (1 - I) / 2, 10 * EPSILON);
}

static void init_sets_a_model_of_zero(void **state) {
    (void)state;
    gsid_rational m = new_model(GSID_DOMAIN_S, 3, 2, 10);
    assert_int_equal(gsid_rational_held(&m), 3);
    assert_true(m.scale_rad_s == 10 && m.delay_s == 0 && m.den[0] == 1);
    for (int i = 0; i <= GSID_ORDER_MAX; i++) {
        assert_true(m.num[i] == 0 && (i == 0 || m.den[i] == 0));
    }
    m = new_model(GSID_DOMAIN_Z, GSID_ORDER_MAX, GSID_ORDER_MAX, 0.5);
    assert_int_equal(gsid_rational_held(&m), 0);
    assert_true(m.sample_s == (gsid_real)0.5);
    const gsid_cplx v = gsid_rational_variable(&m, (gsid_real)PI_L); /* exp(-j pi / 2) */
    assert_cplx_near(v, -I, 4 * EPSILON);
}

/* A denominator from its roots. In domain s, margin is the distance from the axis as a part of the root's size. */
static gsid_rational from_roots(gsid_domain domain, uint32_t n, const wide *root) {
    wide c[GSID_ORDER_MAX + 1] = {1};
    for (uint32_t r = 0; r < n; r++) {
        for (uint32_t i = r + 2; i-- > 0;) {
            c[i] = (i > 0 ? c[i - 1] : 0) - (i <= r ? root[r] * c[i] : 0);
        }
    }
    gsid_rational m = new_model(domain, n, 0, 1);
    for (uint32_t i = 0; i <= n; i++) {
        m.den[i] = (gsid_real)creall(c[domain == GSID_DOMAIN_S ? i : n - i]);
    }
    return m;
}

static int stable(const gsid_rational *m) {
    int is_stable = -1;
    assert_int_equal(gsid_rational_is_stable(m, &is_stable), GSID_OK);
    assert_in_range(is_stable, 0, 1);
    return is_stable;
}

static void draw_stable_roots(gsid_domain domain, uint32_t n, wide *root) {
    for (uint32_t r = 0; r < n; r += 2) {
        const int is_pair = r + 1 < n && draw(0, 1) < 0.7;
        wide pair[2];
        for (int i = 0; i < 2; i++) {
            const long double size = domain == GSID_DOMAIN_S ? draw(0.3, 1) : draw(0, 0.9);
            const long double angle = domain == GSID_DOMAIN_S ? draw(1.7, PI_L) : draw(0, PI_L); /* 1.7: damping 0.13 */
            pair[i] = is_pair ? size * cexpl(I * angle) : (domain == GSID_DOMAIN_S ? -size : size * cosl(angle));
        }
        root[r] = pair[0];
        if (r + 1 < n) {
            root[r + 1] = is_pair ? conjl(pair[0]) : pair[1];
        }
    }
}

/* Mirror one root, and its partner, into the unstable region. */
static void upset(gsid_domain domain, uint32_t n, wide *root) {
    const uint32_t chosen = (uint32_t)draw(0, n);
    const wide old = root[chosen];
    for (uint32_t r = 0; r < n; r++) {
        if (r == chosen || (cimagl(old) != 0 && root[r] == conjl(old))) {
            root[r] = domain == GSID_DOMAIN_S ? -conjl(root[r]) : root[r] / cabsl(root[r]) / (cabsl(root[r]) + 0.05L);
        }
    }
}

static void stability_is_where_the_roots_are(void **state) {
    (void)state;
    const uint32_t n_max = sizeof(gsid_real) == 4 ? 6 : 12; /* rounded coefficients move the roots of more */
    for (int domain = GSID_DOMAIN_S; domain <= GSID_DOMAIN_Z; domain++) {
        for (int repeat = 0; repeat < 2000; repeat++) {
            const uint32_t n = 1 + (uint32_t)draw(0, n_max);
            wide root[GSID_ORDER_MAX];
            draw_stable_roots((gsid_domain)domain, n, root);
            gsid_rational m = from_roots((gsid_domain)domain, n, root);
            if (!stable(&m)) {
                fail_msg("domain %d, repeat %d, order %u: stable, said not to be", domain, repeat, n);
            }
            for (uint32_t i = 0; i <= n; i++) {
                m.den[i] *= -2;
            }
            assert_true(stable(&m)); /* a common factor means nothing */
            upset((gsid_domain)domain, n, root);
            m = from_roots((gsid_domain)domain, n, root);
            if (stable(&m)) {
                fail_msg("domain %d, repeat %d, order %u: unstable, said to be stable", domain, repeat, n);
            }
        }
    }
}

static void edges_of_stability(void **state) {
    (void)state;
    static const struct {
        gsid_domain domain;
        uint32_t n;
        double den[4];
        int stable;
    } cases[] = {
        {GSID_DOMAIN_S, 0, {1}, 1},
        {GSID_DOMAIN_S, 1, {0, 1}, 0}, /* an integrator */
        {GSID_DOMAIN_S, 2, {1, 0, 1}, 0}, /* an undamped pair */
        {GSID_DOMAIN_S, 3, {1, 1, 1, 1}, 0}, /* (s + 1)(s^2 + 1) */
        {GSID_DOMAIN_S, 3, {1, 2, 2, 1}, 1}, /* (s + 1)(s^2 + s + 1) */
        {GSID_DOMAIN_S, 2, {1, 1, 0}, 0}, /* no highest power */
        {GSID_DOMAIN_S, 2, {-1, 0, 1}, 0}, /* roots of both signs */
        {GSID_DOMAIN_Z, 0, {1}, 1},
        {GSID_DOMAIN_Z, 1, {1, -1}, 0}, /* a sum */
        {GSID_DOMAIN_Z, 1, {1, 0}, 1}, /* a pole at 0 */
        {GSID_DOMAIN_Z, 2, {1, 0, 1}, 0}, /* poles at +-j */
        {GSID_DOMAIN_Z, 2, {1, -1.9, 0.95}, 1},
        {GSID_DOMAIN_Z, 2, {1, -2.1, 1.05}, 0},
        {GSID_DOMAIN_Z, 1, {0, 1}, 0}, /* answers before it is asked */
        {GSID_DOMAIN_Z, 2, {0, 0, 0}, 0},
    };
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        gsid_rational m = new_model(cases[c].domain, cases[c].n, 0, 1);
        for (int i = 0; i < 4; i++) {
            m.den[i] = (gsid_real)cases[c].den[i];
        }
        if (stable(&m) != cases[c].stable) {
            fail_msg("case %u: want %d", (unsigned)c, cases[c].stable);
        }
    }
}

/* Products of such coefficients are below the least number there is. */
static void stability_of_tiny_coefficients(void **state) {
    (void)state;
    gsid_rational m = new_model(GSID_DOMAIN_S, 3, 0, 1);
    const gsid_real tiny = 8 * SMALLEST, den[4] = {1, 2, 2, 1};
    for (int i = 0; i < 4; i++) {
        m.den[i] = tiny * den[i];
    }
    assert_true(stable(&m));
    m.den[1] = -m.den[1];
    assert_false(stable(&m));
}

static void failures_leave_the_outputs(void **state) {
    (void)state;
    gsid_rational m = new_model(GSID_DOMAIN_S, 2, 0, 1), untouched;
    memcpy(&untouched, &m, sizeof m);
    const gsid_real bad[4] = {0, -1, (gsid_real)NAN, (gsid_real)INFINITY};
    for (int i = 0; i < 4; i++) {
        assert_int_equal(gsid_rational_init(&m, GSID_DOMAIN_S, 1, 1, bad[i]), GSID_E_CONFIG);
    }
    assert_int_equal(gsid_rational_init(&m, GSID_DOMAIN_S, GSID_ORDER_MAX + 1, 1, 1), GSID_E_CONFIG);
    assert_int_equal(gsid_rational_init(&m, GSID_DOMAIN_S, 1, GSID_ORDER_MAX + 1, 1), GSID_E_CONFIG);
    assert_int_equal(gsid_rational_init(&m, (gsid_domain)2, 1, 1, 1), GSID_E_CONFIG);
    assert_int_equal(gsid_rational_init(NULL, GSID_DOMAIN_S, 1, 1, 1), GSID_E_NULL);
    assert_memory_equal(&m, &untouched, sizeof m);

    gsid_cplx g[3] = {{1, 2}, {3, 4}, {5, 6}}, slope[4] = {{7, 8}}, g_before[3];
    memcpy(g_before, g, sizeof g);
    gsid_real f[3] = {1, (gsid_real)NAN, 2};
    m.den[2] = 1;
    assert_int_equal(gsid_rational_eval(&m, 3, f, g), GSID_E_NONFINITE);
    assert_int_equal(gsid_rational_gradient(&m, f[1], g, slope), GSID_E_NONFINITE);
    m.den[0] = 0; /* a double pole at 0 */
    f[1] = 0;
    assert_int_equal(gsid_rational_eval(&m, 3, f, g), GSID_E_NONFINITE);
    assert_int_equal(gsid_rational_gradient(&m, f[1], g, slope), GSID_E_NONFINITE);
    assert_int_equal(gsid_rational_eval(NULL, 3, f, g), GSID_E_NULL);
    assert_int_equal(gsid_rational_eval(&m, 3, NULL, g), GSID_E_NULL);
    assert_int_equal(gsid_rational_eval(&m, 3, f, NULL), GSID_E_NULL);
    assert_int_equal(gsid_rational_eval(&m, 0, NULL, NULL), GSID_OK);
    assert_int_equal(gsid_rational_gradient(NULL, 1, g, slope), GSID_E_NULL);
    assert_int_equal(gsid_rational_gradient(&m, 1, NULL, slope), GSID_E_NULL);
    assert_int_equal(gsid_rational_gradient(&m, 1, g, NULL), GSID_E_NULL);
    /* Bug: orders beyond the arrays, which only gsid_rational_init looked at, read past them. */
    gsid_rational high = m;
    high.n_poles = GSID_ORDER_MAX + 1;
    assert_int_equal(gsid_rational_eval(&high, 3, f, g), GSID_E_CONFIG);
    assert_int_equal(gsid_rational_gradient(&high, 1, g, slope), GSID_E_CONFIG);
    high.n_poles = 2;
    high.n_zeros = UINT32_MAX;
    assert_int_equal(gsid_rational_eval(&high, 1, f, g), GSID_E_CONFIG);
    assert_memory_equal(g, g_before, sizeof g);
    assert_true(slope[0].re == 7 && slope[0].im == 8);

    int is_stable = 7;
    assert_int_equal(gsid_rational_is_stable(NULL, &is_stable), GSID_E_NULL);
    assert_int_equal(gsid_rational_is_stable(&m, NULL), GSID_E_NULL);
    m.den[1] = (gsid_real)NAN;
    assert_int_equal(gsid_rational_is_stable(&m, &is_stable), GSID_E_NONFINITE);
    m.n_poles = GSID_ORDER_MAX + 1;
    assert_int_equal(gsid_rational_is_stable(&m, &is_stable), GSID_E_CONFIG);
    assert_int_equal(is_stable, 7);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(response_is_that_of_the_definition), cmocka_unit_test(gradient_is_the_slope),
        cmocka_unit_test(delay_turns_the_phase_back),         cmocka_unit_test(init_sets_a_model_of_zero),
        cmocka_unit_test(stability_is_where_the_roots_are),   cmocka_unit_test(edges_of_stability),
        cmocka_unit_test(stability_of_tiny_coefficients),     cmocka_unit_test(failures_leave_the_outputs),
    };
    return cmocka_run_group_tests_name("rational", tests, NULL, NULL);
}
