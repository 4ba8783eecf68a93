/* Incomplete gamma and beta functions.
 *
 * Both are a factor times a series or a continued fraction. The factor x^a exp(-x) / gamma(a + 1) and its like lose their
 * digits where a is large: written with ln(1 + u) - u and the remainder of Stirling's formula, they keep them. */
#include "gsid/host/tail.h"

#include <float.h>
#include <math.h>

#define LOG_SQRT_TWO_PI 0.91893853320467274178
#define TINY 1e-300
#define TERMS_MAX 10000000 /* near x = a a fraction takes some sqrt(a) terms */

/* ln(1 + u) - u, for 1 + u = ratio; near u = 0 without the difference of near numbers. */
static double log1p_less(double u, double ratio) {
    if (fabs(u) > 0.5) {
        return log(ratio) - u;
    }
    /* ln(1 + u) = 2 atanh(r) = 2 (r + r^3/3 + ...), and 2 r - u = -u r */
    const double r = u / (2 + u), square = r * r;
    double power = 1, sum = 0;
    for (int k = 3; power > DBL_EPSILON / 4; k += 2) {
        sum += power / k;
        power *= square;
    }
    return -u * r + 2 * r * square * sum;
}

/* ln gamma(a) - ((a - 1/2) ln a - a + ln sqrt(2 pi)), Stirling's remainder. */
static double stirling_rest(double a) {
    if (a < 16) {
        return log(tgamma(a)) - ((a - 0.5) * log(a) - a + LOG_SQRT_TWO_PI);
    }
    static const double c[] = {1.0 / 12,   -1.0 / 360,      1.0 / 1260, -1.0 / 1680,
                               1.0 / 1188, -691.0 / 360360, 1.0 / 156,  -3617.0 / 122400};
    const double square = 1 / (a * a);
    double sum = 0;
    for (int i = (int)(sizeof c / sizeof *c) - 1; i >= 0; i--) {
        sum = sum * square + c[i];
    }
    return sum / a;
}

/* One side of a distribution is found as exp(log_factor) value; the other is the rest. */
static void set_sides(double log_factor, double value, double *side, double *log_side, double *other,
                      double *log_other) {
    *side = fmin(exp(log_factor) * value, 1);
    *log_side = fmin(log_factor + log(value), 0);
    *other = 1 - *side;
    *log_other = log1p(-*side);
}

static void set_empty(double *side, double *log_side, double *other, double *log_other) {
    *side = 0;
    *log_side = -INFINITY;
    *other = 1;
    *log_other = 0;
}

static int is_shape(double a) {
    return a >= GSID_TAIL_SHAPE_MIN && a <= GSID_TAIL_SHAPE_MAX;
}

/* 1 + x/(a + 1) + x^2/((a + 1)(a + 2)) + ... */
static double gamma_series(double a, double x) {
    double term = 1, sum = 1;
    for (double k = 1; term > sum * DBL_EPSILON / 8 && k < TERMS_MAX; k++) {
        term *= x / (a + k);
        sum += term;
    }
    return sum;
}

/* A divisor of Lentz's method, which must not be 0. */
static double not_zero(double x) {
    return fabs(x) < TINY ? TINY : x;
}

/* gamma(a, x) exp(x) x^-a as a continued fraction (Legendre), by Lentz's method. */
static double gamma_fraction(double a, double x) {
    double b = x + 1 - a, c = 1 / TINY, d = 1 / not_zero(b), h = d;
    for (double k = 1; k < TERMS_MAX; k++) {
        const double factor = -k * (k - a);
        b += 2;
        d = 1 / not_zero(factor * d + b);
        c = not_zero(b + factor / c);
        h *= d * c;
        if (fabs(d * c - 1) < DBL_EPSILON) {
            break;
        }
    }
    return h;
}

gsid_status gsid_tail_gamma(double a, double x, gsid_tail *tail) {
    if (tail == NULL) {
        return GSID_E_NULL;
    }
    if (!is_shape(a) || !(x >= 0)) {
        return GSID_E_CONFIG;
    }
    if (x == 0) {
        set_empty(&tail->lower, &tail->log_lower, &tail->upper, &tail->log_upper);
        return GSID_OK;
    }
    if (isinf(x)) {
        set_empty(&tail->upper, &tail->log_upper, &tail->lower, &tail->log_lower);
        return GSID_OK;
    }
    /* ln of x^a exp(-x) / gamma(a) */
    const double log_density = a * log1p_less((x - a) / a, x / a) + 0.5 * log(a) - LOG_SQRT_TWO_PI - stirling_rest(a);
    if (x <= a || x < 1.5) {
        set_sides(log_density, gamma_series(a, x) / a, &tail->lower, &tail->log_lower, &tail->upper, &tail->log_upper);
    } else {
        set_sides(log_density, gamma_fraction(a, x), &tail->upper, &tail->log_upper, &tail->lower, &tail->log_lower);
    }
    return GSID_OK;
}

/* I_x(a, b) / (x^a y^b / B(a, b)) as a continued fraction by Lentz's method; below the mode its parts do not cancel.
 * Didonato and Morris, ACM TOMS 18 (1992) 360, eq. 9. */
static double beta_fraction(double a, double b, double x, double y) {
    const double below = a * y - b * x; /* a - (a + b) x */
    double h = not_zero(a * (below + 1) / (a + 1)), c = h, d = 0;
    for (double k = 1; k < TERMS_MAX; k++) {
        const double odd = a + 2 * k - 1, share = k * (b - k) * x / odd;
        const double factor = (a + k - 1) * (a + b + k - 1) / odd * x * share;
        const double term = k + share + (a + k) * (below + 1 + k * (1 + y)) / (odd + 2);
        d = 1 / not_zero(term + factor * d);
        c = not_zero(term + factor / c);
        h *= c * d;
        if (fabs(c * d - 1) < DBL_EPSILON) {
            break;
        }
    }
    return 1 / h;
}

/* ln of x^a y^b / B(a, b): the exponents are 0 at the mode x = a/(a + b), and of second order beside it. */
static double log_beta_factor(double a, double b, double x, double y) {
    const double beyond = x * b - y * a, sum = a + b;
    const double exponents = a * log1p_less(beyond / a, x * (sum / a)) + b * log1p_less(-beyond / b, y * (sum / b));
    const double rests = stirling_rest(sum) - stirling_rest(a) - stirling_rest(b);
    return exponents + rests + 0.5 * (log(a) + log(b / sum)) - LOG_SQRT_TWO_PI;
}

gsid_status gsid_tail_beta(double a, double b, double x, double y, gsid_tail *tail) {
    if (tail == NULL) {
        return GSID_E_NULL;
    }
    if (!is_shape(a) || !is_shape(b) || !(x >= 0 && y >= 0 && fabs(x + y - 1) <= 1e-8)) {
        return GSID_E_CONFIG;
    }
    if (x == 0) {
        set_empty(&tail->lower, &tail->log_lower, &tail->upper, &tail->log_upper);
        return GSID_OK;
    }
    if (y == 0) {
        set_empty(&tail->upper, &tail->log_upper, &tail->lower, &tail->log_lower);
        return GSID_OK;
    }
    const double log_factor = log_beta_factor(a, b, x, y);
    if (x * (b + 1) < (a + 1) * y) { /* below (a + 1)/(a + b + 2) the fraction converges */
        set_sides(log_factor, beta_fraction(a, b, x, y), &tail->lower, &tail->log_lower, &tail->upper,
                  &tail->log_upper);
    } else {
        set_sides(log_factor, beta_fraction(b, a, y, x), &tail->upper, &tail->log_upper, &tail->lower,
                  &tail->log_lower);
    }
    return GSID_OK;
}

gsid_status gsid_tail_chi2(double dof, double x, gsid_tail *tail) {
    return gsid_tail_gamma(dof / 2, x / 2, tail);
}

gsid_status gsid_tail_f(double dof_1, double dof_2, double t, gsid_tail *tail) {
    if (dof_2 == INFINITY) {
        return gsid_tail_chi2(dof_1, dof_1 * t, tail);
    }
    if (!(t >= 0)) {
        return tail == NULL ? GSID_E_NULL : GSID_E_CONFIG;
    }
    const double ratio = isinf(t) ? INFINITY : dof_1 * t / dof_2;
    return gsid_tail_beta(dof_1 / 2, dof_2 / 2, isinf(ratio) ? 1 : ratio / (1 + ratio), 1 / (1 + ratio), tail);
}
