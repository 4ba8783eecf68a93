#include "fit_sections.h"

#include <math.h>
#include <stdlib.h>

#include "../core/complex_math.h"

#define EDGE GSID_FIT_EDGE

void gsid_fit_section_coefficients(gsid_domain domain, uint32_t order, const double *x, double *coef) {
    const double r = 1 - EDGE;
    if (domain == GSID_DOMAIN_S) {
        coef[0] = order == 2 ? x[0] + (x[1] + EDGE) * EDGE : x[0] + EDGE;
        coef[1] = order == 2 ? x[1] + 2 * EDGE : 1;
        coef[2] = order == 2 ? 1 : 0;
    } else {
        coef[0] = 1;
        coef[1] = order == 2 ? x[0] * (1 + x[1]) * r : x[0] * r;
        coef[2] = order == 2 ? x[1] * r * r : 0;
    }
}

void gsid_fit_section_derivatives(gsid_domain domain, uint32_t order, const double *x, gsid_cplx v, gsid_cplx *by) {
    if (domain == GSID_DOMAIN_S) {
        by[0] = gsid_cplx_make(1, 0);
        if (order == 2) {
            by[1] = gsid_cplx_make(v.re + EDGE, v.im);
        }
        return;
    }
    const gsid_cplx p = gsid_cplx_scale(1 - EDGE, v);
    by[0] = p;
    if (order == 2) {
        by[0] = gsid_cplx_scale(1 + x[1], p);
        by[1] = gsid_cplx_add(gsid_cplx_scale(x[0], p), gsid_cplx_mul(p, p));
    }
}

uint32_t gsid_fit_section_order(uint32_t n_poles, uint32_t first) {
    return n_poles - first >= 2 ? 2 : 1;
}

void gsid_fit_section_bounds(gsid_domain domain, double *lower, double *upper) {
    *lower = domain == GSID_DOMAIN_S ? 0 : -1;
    *upper = domain == GSID_DOMAIN_S ? HUGE_VAL : 1;
}

/* A pole as a root of the sections' own variable. */
static gsid_cplx unscaled(gsid_domain domain, gsid_cplx p) {
    if (domain == GSID_DOMAIN_S) {
        return gsid_cplx_make(p.re + EDGE, p.im);
    }
    return gsid_cplx_scale(1 / (1 - EDGE), p);
}

/* Reflect a pole into the stable region, and off its edge; then take it as a root of the sections' own variable. */
static gsid_cplx stabilised(gsid_domain domain, gsid_cplx p) {
    if (domain == GSID_DOMAIN_S) {
        p.re = EDGE - fmax(fabs(p.re), 10 * EDGE);
        return p;
    }
    const double r = sqrt(gsid_cplx_abs2(p));
    const double inside = fmin(r > 1 ? 1 / r : r, 1 - 10 * EDGE);
    return r > 0 ? gsid_cplx_scale(inside / r / (1 - EDGE), p) : p;
}

static int by_magnitude(const void *a, const void *b) {
    const double x = gsid_cplx_abs2(*(const gsid_cplx *)a), y = gsid_cplx_abs2(*(const gsid_cplx *)b);
    return (x > y) - (x < y);
}

/* Write the section with roots p and q (p alone when the order is 1), the inverse of gsid_fit_section_coefficients. */
static void section_from_roots(gsid_domain domain, uint32_t order, gsid_cplx p, gsid_cplx q, double *x) {
    if (order == 1) {
        x[0] = -p.re;
        return;
    }
    const double sum = p.re + q.re, product = gsid_cplx_mul(p, q).re;
    if (domain == GSID_DOMAIN_S) {
        x[0] = product;
        x[1] = -sum;
    } else {
        x[1] = product;
        x[0] = -sum / (1 + product);
    }
}

void gsid_fit_sections_from_poles(gsid_domain domain, uint32_t n_poles, int unstable, gsid_cplx *pole, double *x) {
    gsid_cplx real[GSID_FIT_SECTIONS_POLES_MAX];
    uint32_t n_real = 0, first = 0;
    for (uint32_t i = 0; i < n_poles; i++) {
        pole[i] = unstable ? unscaled(domain, pole[i]) : stabilised(domain, pole[i]);
        if (pole[i].im > 0) {
            section_from_roots(domain, 2, pole[i], gsid_cplx_conj(pole[i]), x + first);
            first += 2;
        } else if (pole[i].im == 0) {
            real[n_real++] = pole[i];
        }
    }
    qsort(real, n_real, sizeof *real, by_magnitude);
    for (uint32_t i = 0; i + 1 < n_real; i += 2, first += 2) {
        section_from_roots(domain, 2, real[i], real[i + 1], x + first);
    }
    if (n_real % 2 == 1) {
        section_from_roots(domain, 1, real[n_real - 1], real[n_real - 1], x + first);
    }
}
