/* Roots of polynomials whose roots are known, and of random ones by what is left when they are put in. */
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

typedef long double complex wide;

static uint32_t seed;

static double draw(double lo, double hi) {
    seed = 1664525u * seed + 1013904223u;
    return lo + (hi - lo) * seed / 4294967296.0;
}

/* Coefficients, ascending, of the monic polynomial with these roots. */
static void expand(uint32_t n, const wide *root, wide *coef) {
    memset(coef, 0, (GSID_ORDER_MAX + 1) * sizeof *coef);
    coef[0] = 1;
    for (uint32_t r = 0; r < n; r++) {
        for (uint32_t i = r + 2; i-- > 0;) {
            coef[i] = (i > 0 ? coef[i - 1] : 0) - (i <= r ? root[r] * coef[i] : 0);
        }
    }
}

static wide of(gsid_cplx z) {
    return z.re + I * (wide)z.im;
}

/* Real roots are exactly real, and the others come in exact pairs. */
static void assert_conjugate(uint32_t n, const gsid_cplx *root) {
    for (uint32_t i = 0; i < n; i++) {
        int above = 0, below = 0;
        for (uint32_t j = 0; j < n; j++) {
            above += root[j].re == root[i].re && root[j].im == root[i].im;
            below += root[j].re == root[i].re && root[j].im == -root[i].im;
        }
        if (above != below) {
            fail_msg("%.17g %+.17g j has no partner", root[i].re, root[i].im);
        }
    }
}

/* The polynomial of the computed roots is the polynomial given, but for changes of rounding size: `epsilons` of them, relative
 * to what the coefficient would be if all terms of it had one sign. This is what any method can promise. */
static void assert_backward_stable(uint32_t n, const double *coef, double epsilons) {
    gsid_cplx root[GSID_ORDER_MAX];
    wide wides[GSID_ORDER_MAX], sizes[GSID_ORDER_MAX], product[GSID_ORDER_MAX + 1], all_positive[GSID_ORDER_MAX + 1];
    uint32_t n_found;
    assert_int_equal(gsid_poly_roots(n, coef, root, &n_found), GSID_OK);
    assert_int_equal(n_found, n);
    assert_conjugate(n, root);
    for (uint32_t i = 0; i < n; i++) {
        wides[i] = of(root[i]);
        sizes[i] = -cabsl(wides[i]);
    }
    expand(n, wides, product);
    expand(n, sizes, all_positive);
    for (uint32_t i = 0; i <= n; i++) {
        const long double off = cabsl(coef[n] * product[i] - coef[i]);
        const long double allowed = epsilons * DBL_EPSILON * fabsl(coef[n]) * creall(all_positive[i]);
        if (!(off <= allowed)) {
            fail_msg("seed %u, degree %u, power %u: off by %.3Lg, allowed %.3Lg", seed, n, i, off, allowed);
        }
    }
}

/* Each known root has a computed one within `tolerance` of its size, and no two share it. */
static void assert_roots(uint32_t n, const wide *known, double tolerance) {
    wide coef[GSID_ORDER_MAX + 1];
    double rounded[GSID_ORDER_MAX + 1];
    gsid_cplx root[GSID_ORDER_MAX];
    int taken[GSID_ORDER_MAX] = {0};
    uint32_t n_found;
    expand(n, known, coef);
    for (uint32_t i = 0; i <= n; i++) {
        rounded[i] = (double)creall(coef[i]);
    }
    assert_int_equal(gsid_poly_roots(n, rounded, root, &n_found), GSID_OK);
    assert_int_equal(n_found, n);
    assert_conjugate(n, root);
    for (uint32_t k = 0; k < n; k++) {
        uint32_t nearest = n;
        for (uint32_t i = 0; i < n; i++) {
            if (!taken[i] && (nearest == n || cabsl(of(root[i]) - known[k]) < cabsl(of(root[nearest]) - known[k]))) {
                nearest = i;
            }
        }
        const long double off = cabsl(of(root[nearest]) - known[k]);
        if (!(off <= tolerance * cabsl(known[k]))) {
            fail_msg("root %u (%.17Lg %+.17Lg j): off by %.3Lg of it", k, creall(known[k]), cimagl(known[k]),
                     off / cabsl(known[k]));
        }
        taken[nearest] = 1;
    }
}

static void wilkinson(void **state) {
    (void)state;
    /* roots 1 .. n: the worst root's condition number is 2e2, 3e7 and 5e11 for 5, 10 and 15 */
    const struct {
        uint32_t n;
        double tolerance;
    } cases[3] = {{5, 2e2 * 20 * DBL_EPSILON}, {10, 3e7 * 20 * DBL_EPSILON}, {15, 5e11 * 20 * DBL_EPSILON}};
    for (int c = 0; c < 3; c++) {
        wide known[GSID_ORDER_MAX];
        for (uint32_t i = 0; i < cases[c].n; i++) {
            known[i] = i + 1;
        }
        assert_roots(cases[c].n, known, cases[c].tolerance);
    }
}

static void real_roots_are_not_taken_for_pairs(void **state) {
    (void)state;
    /* ill conditioned, so that rounding gives roots an imaginary part; at worst 1e-3, and their distance is 1 */
    double coef[GSID_ORDER_MAX + 1];
    wide known[GSID_ORDER_MAX], wides[GSID_ORDER_MAX + 1];
    gsid_cplx root[GSID_ORDER_MAX];
    uint32_t n_found;
    for (uint32_t i = 0; i < 14; i++) {
        known[i] = i + 1;
    }
    expand(14, known, wides);
    for (uint32_t i = 0; i <= 14; i++) {
        coef[i] = (double)creall(wides[i]);
    }
    assert_int_equal(gsid_poly_roots(14, coef, root, &n_found), GSID_OK);
    for (uint32_t i = 0; i < 14; i++) {
        assert_true(root[i].im == 0);
        assert_true(fabs(root[i].re - round(root[i].re)) < 1e-2);
    }
}

static void repeated_and_clustered_roots(void **state) {
    (void)state;
    /* a root of multiplicity m moves by epsilon^(1/m), times a small factor */
    const wide twice[3] = {-1, -1, 2}, pairs[4] = {-1 + 2 * I, -1 - 2 * I, -1 + 2 * I, -1 - 2 * I};
    const wide thrice[3] = {3, 3, 3}, fourfold[5] = {-2, -2, -2, -2, 1};
    assert_roots(3, twice, 1e-7);
    assert_roots(4, pairs, 1e-7);
    assert_roots(3, thrice, 1e-4);
    assert_roots(5, fourfold, 2e-3);
    /* distances of 1e-3: condition numbers of 1e3 and 1e6 */
    const wide near_two[3] = {1, 1.001L, -2}, near_three[3] = {1, 1.001L, 0.999L};
    assert_roots(3, near_two, 1e3 * 20 * DBL_EPSILON);
    assert_roots(3, near_three, 1e6 * 20 * DBL_EPSILON);
}

static void pairs_of_little_damping(void **state) {
    (void)state;
    for (double damping = 1; damping > 1e-8; damping *= 0.1) {
        const wide up = cexpl(I * (PI / 2 + damping)), far = 3 * up;
        const wide known[5] = {up, conjl(up), -0.01L, far, conjl(far)};
        assert_roots(5, known, 100 * DBL_EPSILON); /* well apart, whatever the damping */
    }
    const wide undamped[2] = {5 * I, -5 * I};
    assert_roots(2, undamped, 4 * DBL_EPSILON);
}

static void roots_of_very_different_size(void **state) {
    (void)state;
    wide known[9];
    for (int i = 0; i < 9; i++) {
        known[i] = (i % 2 == 0 ? -1 : 1) * powl(10, 1.5L * (i - 4)); /* 1e-6 .. 1e6 */
    }
    assert_roots(9, known, 200 * DBL_EPSILON);
    const wide lag_and_mode[4] = {-5.5L + 11.8L * I, -5.5L - 11.8L * I, -17 + 1124.6L * I, -17 - 1124.6L * I};
    assert_roots(4, lag_and_mode, 200 * DBL_EPSILON);
}

static void roots_at_zero_and_leading_zeros(void **state) {
    (void)state;
    gsid_cplx root[GSID_ORDER_MAX];
    uint32_t n;
    const double both[6] = {0, 0, 6, -5, 1, 0}; /* z^2 (z - 2) (z - 3) */
    assert_int_equal(gsid_poly_roots(5, both, root, &n), GSID_OK);
    assert_int_equal(n, 4);
    double sum = 0, product = 1;
    int n_zero = 0;
    for (uint32_t i = 0; i < n; i++) {
        assert_true(root[i].im == 0);
        n_zero += root[i].re == 0;
        sum += root[i].re;
        product *= root[i].re == 0 ? 1 : root[i].re;
    }
    assert_int_equal(n_zero, 2);
    assert_true(fabs(sum - 5) < 20 * DBL_EPSILON && fabs(product - 6) < 30 * DBL_EPSILON);
    const double nothing[4] = {0}, constant[3] = {7, 0, 0}, power[3] = {0, 0, 2};
    assert_int_equal(gsid_poly_roots(3, nothing, root, &n), GSID_OK);
    assert_int_equal(n, 0);
    assert_int_equal(gsid_poly_roots(2, constant, root, &n), GSID_OK);
    assert_int_equal(n, 0);
    assert_int_equal(gsid_poly_roots(0, constant, NULL, &n), GSID_OK);
    assert_int_equal(n, 0);
    assert_int_equal(gsid_poly_roots(2, power, root, &n), GSID_OK);
    assert_int_equal(n, 2);
    assert_true(root[0].re == 0 && root[1].re == 0 && root[0].im == 0 && root[1].im == 0);
}

static void random_polynomials(void **state) {
    (void)state;
    seed = 1;
    print_message("seed %u, 3000 polynomials\n", seed);
    for (int repeat = 0; repeat < 3000; repeat++) {
        double coef[GSID_ORDER_MAX + 1];
        const uint32_t n = 1 + (uint32_t)draw(0, GSID_ORDER_MAX);
        const double spread = draw(0, 6); /* decades between coefficients */
        for (uint32_t i = 0; i <= n; i++) {
            coef[i] = draw(-1, 1) * pow(10, draw(-spread, spread));
        }
        if (coef[n] == 0 || coef[0] == 0) {
            continue;
        }
        assert_backward_stable(n, coef, 100.0 * n);
    }
}

/* Coefficients whose ratio leaves the range of a double: their roots need not. */
static void coefficients_near_the_ends_of_the_range(void **state) {
    (void)state;
    gsid_cplx root[2];
    uint32_t n;
    const double coef[3] = {-1e200, 0, 1e-200}; /* +-1e200 */
    assert_int_equal(gsid_poly_roots(2, coef, root, &n), GSID_OK);
    assert_true(fabs(fabs(root[0].re) / 1e200 - 1) < 1e-13 && fabs(fabs(root[1].re) / 1e200 - 1) < 1e-13);
}

static void failures_leave_the_outputs(void **state) {
    (void)state;
    gsid_cplx root[GSID_ORDER_MAX + 1] = {{1, 2}, {3, 4}};
    uint32_t n = 7;
    double coef[GSID_ORDER_MAX + 2] = {1, 2, 3};
    assert_int_equal(gsid_poly_roots(GSID_ORDER_MAX + 1, coef, root, &n), GSID_E_CONFIG);
    assert_int_equal(gsid_poly_roots(2, NULL, root, &n), GSID_E_NULL);
    assert_int_equal(gsid_poly_roots(2, coef, NULL, &n), GSID_E_NULL);
    assert_int_equal(gsid_poly_roots(2, coef, root, NULL), GSID_E_NULL);
    coef[2] = NAN;
    assert_int_equal(gsid_poly_roots(2, coef, root, &n), GSID_E_NONFINITE);
    coef[2] = INFINITY;
    assert_int_equal(gsid_poly_roots(2, coef, root, &n), GSID_E_NONFINITE);
    assert_int_equal(n, 7);
    assert_true(root[0].re == 1 && root[0].im == 2 && root[1].re == 3 && root[1].im == 4);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(wilkinson),
        cmocka_unit_test(real_roots_are_not_taken_for_pairs),
        cmocka_unit_test(repeated_and_clustered_roots),
        cmocka_unit_test(pairs_of_little_damping),
        cmocka_unit_test(roots_of_very_different_size),
        cmocka_unit_test(roots_at_zero_and_leading_zeros),
        cmocka_unit_test(random_polynomials),
        cmocka_unit_test(coefficients_near_the_ends_of_the_range),
        cmocka_unit_test(failures_leave_the_outputs),
    };
    return cmocka_run_group_tests_name("roots", tests, NULL, NULL);
}
