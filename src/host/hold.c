#include <math.h>
#include <string.h>

#include "../core/complex_math.h"
#include "gsid/host/fit.h"

/* num/den in the controllable form, time in units of 1/scale, with the held input as one more state that does not change:
 *   x_i' = x_(i+1),   x_(n-1)' = u - sum den_i x_i,   u' = 0,   y = sum out_i x_i + direct u   (den_n = 1)
 * There is no condition on the poles, which may be equal, zero or unstable. */
#define N_MAX (GSID_ORDER_MAX + 1)

typedef struct {
    double m[N_MAX][N_MAX];
} matrix;

typedef struct {
    uint32_t n; /* states without the input */
    matrix a;
    double out[GSID_ORDER_MAX], direct;
} state_space;

static void make_state_space(const gsid_rational *model, state_space *s) {
    memset(s, 0, sizeof *s);
    const uint32_t n = s->n = model->n_poles;
    const double top = model->den[n];
    s->direct = model->n_zeros == n ? model->num[n] / top : 0;
    for (uint32_t i = 0; i < n; i++) {
        s->a.m[i][i + 1] = 1;
        s->out[i] = ((i <= model->n_zeros ? model->num[i] : 0) - s->direct * model->den[i]) / top;
    }
    for (uint32_t i = 0; i < n; i++) {
        s->a.m[n - 1][i] -= model->den[i] / top;
    }
}

static void multiply(uint32_t n, const matrix *a, const matrix *b, matrix *product) {
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++) {
            double sum = 0;
            for (uint32_t k = 0; k < n; k++) {
                sum += a->m[i][k] * b->m[k][j];
            }
            product->m[i][j] = sum;
        }
    }
}

#define TAYLOR_TERMS 18 /* of a matrix of norm 1/2: what is left out is 1e-23 */

/* e <- exp(t a): Taylor's series over a part of t that is short enough, then squared. */
static void exponentiate(uint32_t n, const matrix *a, double t, matrix *e) {
    double norm = 0;
    for (uint32_t i = 0; i < n; i++) {
        double row = 0;
        for (uint32_t j = 0; j < n; j++) {
            row += fabs(a->m[i][j]);
        }
        norm = fmax(norm, row);
    }
    int n_squarings = 0;
    frexp(norm * t, &n_squarings);
    n_squarings = n_squarings + 1 > 0 ? n_squarings + 1 : 0;
    const double part = ldexp(t, -n_squarings);
    matrix term = {{{0}}}, product;
    for (uint32_t i = 0; i < n; i++) {
        term.m[i][i] = 1;
    }
    *e = term;
    for (int order = 1; order <= TAYLOR_TERMS; order++) {
        multiply(n, &term, a, &product);
        for (uint32_t i = 0; i < n; i++) {
            for (uint32_t j = 0; j < n; j++) {
                term.m[i][j] = product.m[i][j] * part / order;
                e->m[i][j] += term.m[i][j];
            }
        }
    }
    for (int i = 0; i < n_squarings; i++) {
        multiply(n, e, e, &product);
        *e = product;
    }
}

/* What a sample does: x[n+1] = state x[n] + early u[n-q-1] + late u[n-q], for a delay of q + d samples, 0 <= d < 1. */
typedef struct {
    double q;
    matrix state;
    double early[GSID_ORDER_MAX], late[GSID_ORDER_MAX];
} sample_step;

static void make_step(const state_space *s, double samples, double scaled_sample, sample_step *step) {
    /* A delay that rounding left a hair below a whole number of samples counts as that number. */
    step->q = floor(samples + 1e-12);
    const double d = fmax(samples - step->q, 0);
    matrix first, second;
    exponentiate(s->n + 1, &s->a, d * scaled_sample, &first);
    exponentiate(s->n + 1, &s->a, (1 - d) * scaled_sample, &second);
    for (uint32_t i = 0; i < s->n; i++) {
        step->late[i] = second.m[i][s->n];
        second.m[i][s->n] = 0; /* the old input acts in the first part only */
    }
    multiply(s->n + 1, &second, &first, &step->state);
    for (uint32_t i = 0; i < s->n; i++) {
        step->early[i] = step->state.m[i][s->n];
    }
}

/* Solve a x = b in place by Gauss's elimination with the largest pivot of each column; x is left in b. */
static void solve(uint32_t n, gsid_cplx a[][GSID_ORDER_MAX], gsid_cplx *b) {
    for (uint32_t p = 0; p < n; p++) {
        uint32_t largest = p;
        for (uint32_t i = p + 1; i < n; i++) {
            if (gsid_cplx_abs2(a[i][p]) > gsid_cplx_abs2(a[largest][p])) {
                largest = i;
            }
        }
        for (uint32_t j = p; j < n; j++) {
            const gsid_cplx kept = a[p][j];
            a[p][j] = a[largest][j];
            a[largest][j] = kept;
        }
        const gsid_cplx kept = b[p];
        b[p] = b[largest];
        b[largest] = kept;
        for (uint32_t i = p + 1; i < n; i++) {
            const gsid_cplx factor = gsid_cplx_div(a[i][p], a[p][p]);
            for (uint32_t j = p + 1; j < n; j++) {
                a[i][j] = gsid_cplx_sub(a[i][j], gsid_cplx_mul(factor, a[p][j]));
            }
            b[i] = gsid_cplx_sub(b[i], gsid_cplx_mul(factor, b[p]));
        }
    }
    for (uint32_t i = n; i-- > 0;) {
        for (uint32_t j = i + 1; j < n; j++) {
            b[i] = gsid_cplx_sub(b[i], gsid_cplx_mul(a[i][j], b[j]));
        }
        b[i] = gsid_cplx_div(b[i], a[i][i]);
    }
}

/* Eq: MOD-2. (z - state) x = late + early / z, y = out x + direct / z: the sample is taken just before the new command, so what
 * passes directly is one late. All of it q samples later. */
static gsid_cplx held_response(const state_space *s, const sample_step *step, double angle) {
    const gsid_cplx z = gsid_cplx_cis(angle), back = gsid_cplx_cis(-angle);
    gsid_cplx a[GSID_ORDER_MAX][GSID_ORDER_MAX], x[GSID_ORDER_MAX], y = gsid_cplx_scale(s->direct, back);
    for (uint32_t i = 0; i < s->n; i++) {
        for (uint32_t j = 0; j < s->n; j++) {
            a[i][j] = gsid_cplx_make(-step->state.m[i][j], 0);
        }
        a[i][i] = gsid_cplx_add(a[i][i], z);
        x[i] = gsid_cplx_add(gsid_cplx_make(step->late[i], 0), gsid_cplx_scale(step->early[i], back));
    }
    solve(s->n, a, x);
    for (uint32_t i = 0; i < s->n; i++) {
        y = gsid_cplx_add(y, gsid_cplx_scale(s->out[i], x[i]));
    }
    return gsid_cplx_mul(y, gsid_cplx_cis(-angle * step->q));
}

static gsid_status check(const gsid_rational *model, double sample_s) {
    if (model->domain != GSID_DOMAIN_S || model->n_zeros > model->n_poles || model->n_poles > GSID_ORDER_MAX ||
        !(sample_s > 0) || !isfinite(sample_s) || !isfinite(model->delay_s)) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i <= model->n_poles; i++) {
        if (!isfinite(model->den[i]) || (i <= model->n_zeros && !isfinite(model->num[i]))) {
            return GSID_E_NONFINITE;
        }
    }
    return model->den[model->n_poles] == 0 ? GSID_E_CONFIG : GSID_OK;
}

gsid_status gsid_hold_response(const gsid_rational *model, double sample_s, uint32_t n_freq, const double *f_hz,
                               gsid_cplx *g) {
    if (model == NULL || (n_freq > 0 && (f_hz == NULL || g == NULL))) {
        return GSID_E_NULL;
    }
    const gsid_status status = check(model, sample_s);
    if (status != GSID_OK) {
        return status;
    }
    state_space s;
    sample_step step;
    make_state_space(model, &s);
    make_step(&s, model->delay_s / sample_s, model->scale_rad_s * sample_s, &step);
    for (uint32_t k = 0; k < n_freq; k++) {
        if (!gsid_cplx_is_finite(held_response(&s, &step, GSID_TWO_PI * f_hz[k] * sample_s))) {
            return GSID_E_NONFINITE;
        }
    }
    for (uint32_t k = 0; k < n_freq; k++) {
        g[k] = held_response(&s, &step, GSID_TWO_PI * f_hz[k] * sample_s);
    }
    return GSID_OK;
}

gsid_status gsid_hold_factor(double sample_s, uint32_t n_freq, const double *f_hz, gsid_cplx *hold) {
    if (n_freq > 0 && (f_hz == NULL || hold == NULL)) {
        return GSID_E_NULL;
    }
    for (uint32_t k = 0; k < n_freq; k++) {
        const double x = GSID_TWO_PI * f_hz[k] * sample_s / 2;
        hold[k] = gsid_cplx_scale(x == 0 ? 1 : sin(x) / x, gsid_cplx_cis(-x));
    }
    return GSID_OK;
}
