/* Response of a structure of physical elements, with the images of a held command (STR-1, STR-2). */
#include "structure.h"

#include <math.h>
#include <string.h>

#include "../core/complex_math.h"

/* Least distance of two poles over their size, or over the lowest frequency: equal ones are moved apart. The closed form of
 * the images needs distinct poles, and only its ratio to the sum's first term is used. */
#define APART 1e-4

enum { POLES_MAX = GSID_STRUCTURE_LAGS_MAX + 3 + 2 * GSID_STRUCTURE_MODES_MAX };

/* Columns of the command: the only ones with hold, delay and images. */
static uint32_t n_driven(const gsid_structure *s) {
    return 1 + s->n_modes + (s->has_residual ? 1 : 0);
}

uint32_t gsid_structure_n_columns(const gsid_structure *s, const gsid_structure_lines *lines) {
    return n_driven(s) + (lines->torque != NULL ? 1 : 0);
}

uint32_t gsid_structure_n_theta(const gsid_structure *s) {
    return s->n_body + 2 * s->n_modes + s->n_lags + 1;
}

gsid_status gsid_structure_check(const gsid_structure *s, const gsid_structure_lines *lines) {
    if (s == NULL || lines == NULL || lines->w == NULL || lines->hold == NULL ||
        (lines->n_fractions > 0 && (lines->later == NULL || lines->share == NULL))) {
        return GSID_E_NULL;
    }
    if (s->n_body > 2 || s->n_modes > GSID_STRUCTURE_MODES_MAX || s->n_lags > GSID_STRUCTURE_LAGS_MAX ||
        s->integrations < -1 || s->integrations > 1 || lines->n == 0 || !(lines->sample_s > 0)) {
        return GSID_E_CONFIG;
    }
    return GSID_OK;
}

/* ---- values ---- */

typedef struct {
    double rate, stiffness, delay_s;
    double w[GSID_STRUCTURE_MODES_MAX], z[GSID_STRUCTURE_MODES_MAX], tau[GSID_STRUCTURE_LAGS_MAX];
} values;

static values values_of(const gsid_structure *s, const double *theta) {
    values v = {0};
    v.rate = s->n_body > 0 ? exp(theta[0]) : 0;
    v.stiffness = s->n_body > 1 ? exp(theta[1]) : 0;
    theta += s->n_body;
    for (uint32_t i = 0; i < s->n_modes; i++, theta += 2) {
        v.w[i] = exp(theta[0]);
        v.z[i] = exp(theta[1]);
    }
    for (uint32_t i = 0; i < s->n_lags; i++) {
        v.tau[i] = exp(*theta++);
    }
    v.delay_s = *theta;
    return v;
}

static const gsid_cplx ONE = {1, 0};

static gsid_cplx times_s(double factor, double w, gsid_cplx a) {
    return gsid_cplx_make(-factor * w * a.im, factor * w * a.re);
}

static gsid_cplx body_at(const values *v, double w) {
    return gsid_cplx_div(ONE, gsid_cplx_make(v->rate, w - v->stiffness / w));
}

static gsid_cplx mode_below(const values *v, uint32_t i, double w) {
    return gsid_cplx_make(v->w[i] * v->w[i] - w * w, 2 * v->z[i] * v->w[i] * w);
}

static gsid_cplx turned(double angle) {
    return gsid_cplx_make(cos(angle), sin(angle));
}

/* x / prod(1 + tau s), integrated q times. */
static gsid_cplx sensed_at(const gsid_structure *s, const values *v, double w, gsid_cplx x) {
    gsid_cplx common = x;
    if (s->integrations != 0) {
        common = s->integrations > 0 ? times_s(-1 / (w * w), w, common) : times_s(1, w, common);
    }
    for (uint32_t i = 0; i < s->n_lags; i++) {
        common = gsid_cplx_div(common, gsid_cplx_make(1, v->tau[i] * w));
    }
    return common;
}

/* ---- images of the hold: b_old, b_new of each pole, see STR-2 ---- */

typedef struct {
    gsid_cplx p, old, new, per_sample;
} pole;

typedef struct {
    uint32_t n, n_shared;                        /* the lags' come first */
    uint32_t end[GSID_STRUCTURE_COLUMNS_MAX];    /* of each column's own poles */
    int n_zeros[GSID_STRUCTURE_COLUMNS_MAX];     /* of each column, at s = 0 */
    pole at[POLES_MAX];
    gsid_cplx residue[GSID_STRUCTURE_COLUMNS_MAX][POLES_MAX]; /* the shared ones first, then its own */
} expansion;

static gsid_cplx exponential(gsid_cplx a) {
    return gsid_cplx_scale(exp(a.re), turned(a.im));
}

/* (exp(p t) - 1) / p, and its limit t at p = 0. */
static gsid_cplx expm1_over(gsid_cplx p, double t) {
    if (sqrt(gsid_cplx_abs2(p)) * t < 1e-9) {
        return gsid_cplx_make(t * (1 + p.re * t / 2), t * p.im * t / 2);
    }
    const double a = p.re * t, b = p.im * t, half = sin(b / 2);
    return gsid_cplx_div(gsid_cplx_make(expm1(a) * cos(b) - 2 * half * half, exp(a) * sin(b)), p);
}

static void add_pole(expansion *e, double re, double im) {
    e->at[e->n++].p = gsid_cplx_make(re, im);
}

/* Roots of s^2 + rate s + stiffness. The difference of near numbers would lose the small one. */
static void add_pair(expansion *e, double rate, double stiffness) {
    const double d = rate * rate / 4 - stiffness;
    const gsid_cplx large = d < 0 ? gsid_cplx_make(-rate / 2, -sqrt(-d)) : gsid_cplx_make(-rate / 2 - sqrt(d), 0);
    const gsid_cplx small = gsid_cplx_div(gsid_cplx_make(stiffness, 0), large);
    add_pole(e, large.re, large.im);
    add_pole(e, small.re, small.im);
}

static void end_column(expansion *e, uint32_t column, int zeros, int integrations) {
    for (int i = zeros; i < integrations; i++) {
        add_pole(e, 0, 0);
    }
    e->n_zeros[column] = zeros > integrations ? zeros - integrations : 0;
    e->end[column] = e->n;
}

static void collect_poles(const gsid_structure *s, const values *v, expansion *e) {
    for (uint32_t i = 0; i < s->n_lags; i++) {
        add_pole(e, -1 / v->tau[i], 0);
    }
    e->n_shared = e->n;
    if (s->n_body == 2) {
        add_pair(e, v->rate, v->stiffness);
    } else {
        add_pole(e, s->n_body == 1 ? -v->rate : 0, 0);
    }
    end_column(e, 0, s->n_body == 2, s->integrations);
    for (uint32_t i = 0; i < s->n_modes; i++) {
        add_pair(e, 2 * v->z[i] * v->w[i], v->w[i] * v->w[i]);
        end_column(e, 1 + i, 1, s->integrations);
    }
    if (s->has_residual) {
        end_column(e, 1 + s->n_modes, 1, s->integrations);
    }
}

static double distance(gsid_cplx a, gsid_cplx b) {
    return sqrt(gsid_cplx_abs2(gsid_cplx_sub(a, b)));
}

static int is_near_another(const expansion *e, uint32_t i, double limit) {
    for (uint32_t k = 0; k < i; k++) {
        if (distance(e->at[k].p, e->at[i].p) < limit) {
            return 1;
        }
    }
    return 0;
}

static double separation(gsid_cplx p, double w_lo) {
    return APART * fmax(sqrt(gsid_cplx_abs2(p)), w_lo);
}

static void move_apart(expansion *e, double w_lo) {
    for (uint32_t i = 1; i < e->n; i++) {
        while (is_near_another(e, i, separation(e->at[i].p, w_lo))) {
            e->at[i].p.re -= 1.5 * separation(e->at[i].p, w_lo);
        }
    }
}

/* Number of the k-th pole of a column. */
static uint32_t pole_of(const expansion *e, uint32_t column, uint32_t k) {
    const uint32_t first = column == 0 ? e->n_shared : e->end[column - 1];
    return k < e->n_shared ? k : first + k - e->n_shared;
}

static uint32_t n_poles_of(const expansion *e, uint32_t column) {
    return e->n_shared + e->end[column] - (column == 0 ? e->n_shared : e->end[column - 1]);
}

/* Of s^n_zeros / prod(s - p) at its distinct poles. */
static void find_residues(expansion *e, uint32_t column) {
    const uint32_t n = n_poles_of(e, column);
    for (uint32_t i = 0; i < n; i++) {
        const gsid_cplx p = e->at[pole_of(e, column, i)].p;
        gsid_cplx top = ONE, below = ONE;
        for (int k = 0; k < e->n_zeros[column]; k++) {
            top = gsid_cplx_mul(top, p);
        }
        for (uint32_t k = 0; k < n; k++) {
            below = k == i ? below : gsid_cplx_mul(below, gsid_cplx_sub(p, e->at[pole_of(e, column, k)].p));
        }
        e->residue[column][i] = gsid_cplx_div(top, below);
    }
}

static void expand(const gsid_structure *s, const values *v, double w_lo, expansion *e) {
    memset(e, 0, sizeof *e);
    collect_poles(s, v, e);
    move_apart(e, w_lo);
    for (uint32_t c = 0; c < n_driven(s); c++) {
        find_residues(e, c);
    }
}

/* The steps of each pole for a delay, within its last sample. */
static void delay_poles(expansion *e, double late_s, double early_s, double sample_s) {
    for (uint32_t i = 0; i < e->n; i++) {
        pole *one = &e->at[i];
        one->new = expm1_over(one->p, early_s);
        one->old = gsid_cplx_mul(exponential(gsid_cplx_scale(early_s, one->p)), expm1_over(one->p, late_s));
        one->per_sample = exponential(gsid_cplx_scale(sample_s, one->p));
    }
}

/* Sampled response over its first term, of each column at one line; 1 where the column is not strictly proper: a step that
 * passes through has no unique value at the sample. */
static void image_factors(const expansion *e, uint32_t n_columns, double w, gsid_cplx z, gsid_cplx turn,
                          gsid_cplx *factor) {
    gsid_cplx exact[POLES_MAX], first[POLES_MAX];
    const gsid_cplx late = gsid_cplx_conj(z);
    for (uint32_t i = 0; i < e->n; i++) {
        const pole *one = &e->at[i];
        const gsid_cplx step = gsid_cplx_add(gsid_cplx_mul(one->old, late), one->new);
        exact[i] = gsid_cplx_div(step, gsid_cplx_sub(z, one->per_sample));
        first[i] = gsid_cplx_div(ONE, gsid_cplx_make(-one->p.re, w - one->p.im));
    }
    for (uint32_t c = 0; c < n_columns; c++) {
        const uint32_t n = n_poles_of(e, c);
        gsid_cplx whole = {0, 0}, part = {0, 0};
        for (uint32_t k = 0; k < n; k++) {
            const uint32_t i = pole_of(e, c, k);
            whole = gsid_cplx_add(whole, gsid_cplx_mul(exact[i], e->residue[c][k]));
            part = gsid_cplx_add(part, gsid_cplx_mul(first[i], e->residue[c][k]));
        }
        const int is_proper = e->n_zeros[c] < (int)n;
        factor[c] = is_proper ? gsid_cplx_mul(turn, gsid_cplx_div(whole, part)) : ONE;
    }
}

/* Add share times the factors for a delay to sum [n_columns][n]; share NULL: 1. */
static void add_images(expansion *e, uint32_t n_columns, const gsid_structure_lines *lines, double delay_s,
                       const gsid_cplx *share, gsid_cplx *sum) {
    const double samples = delay_s / lines->sample_s, n_whole = floor(samples);
    delay_poles(e, (samples - n_whole) * lines->sample_s, (1 - samples + n_whole) * lines->sample_s, lines->sample_s);
    for (uint32_t l = 0; l < lines->n; l++) {
        const double w = lines->w[l];
        gsid_cplx factor[GSID_STRUCTURE_COLUMNS_MAX];
        const gsid_cplx turn = gsid_cplx_div(turned(w * (delay_s - n_whole * lines->sample_s)), lines->hold[l]);
        image_factors(e, n_columns, w, turned(w * lines->sample_s), turn, factor);
        for (uint32_t c = 0; c < n_columns; c++) {
            gsid_cplx *to = sum + (size_t)c * lines->n + l;
            *to = gsid_cplx_add(*to, share == NULL ? factor[c] : gsid_cplx_mul(share[l], factor[c]));
        }
    }
}

/* Factors of all columns, [n_columns][n]. */
static void fill_factors(const gsid_structure *s, const values *v, const gsid_structure_lines *lines,
                         gsid_cplx *factor) {
    const uint32_t n_columns = n_driven(s);
    expansion e;
    expand(s, v, lines->w[0], &e);
    memset(factor, 0, (size_t)n_columns * lines->n * sizeof *factor);
    if (lines->n_fractions == 0) {
        add_images(&e, n_columns, lines, v->delay_s, NULL, factor);
    }
    for (uint32_t f = 0; f < lines->n_fractions; f++) {
        const double delay_s = v->delay_s + lines->later[f] * lines->sample_s;
        add_images(&e, n_columns, lines, delay_s, lines->share + (size_t)f * lines->n, factor);
    }
}

/* ---- the two calls ---- */

gsid_status gsid_structure_columns(const gsid_structure *structure, const gsid_structure_lines *lines,
                                   const double *theta, gsid_cplx *column) {
    const gsid_status status = gsid_structure_check(structure, lines);
    if (status != GSID_OK || theta == NULL || column == NULL) {
        return status != GSID_OK ? status : GSID_E_NULL;
    }
    const values v = values_of(structure, theta);
    const size_t n = lines->n;
    if (lines->has_images) {
        fill_factors(structure, &v, lines, column);
    }
    for (uint32_t l = 0; l < n; l++) {
        const double w = lines->w[l];
        const gsid_cplx drive = gsid_cplx_mul(turned(-w * v.delay_s), lines->hold[l]);
        const gsid_cplx common = sensed_at(structure, &v, w, drive), by_s = times_s(1, w, common);
        gsid_cplx plain[GSID_STRUCTURE_COLUMNS_MAX];
        plain[0] = gsid_cplx_mul(common, body_at(&v, w));
        for (uint32_t i = 0; i < structure->n_modes; i++) {
            plain[1 + i] = gsid_cplx_div(by_s, mode_below(&v, i, w));
        }
        plain[structure->n_modes + 1] = by_s; /* the array has room for it in any case */
        for (uint32_t c = 0; c < n_driven(structure); c++) {
            gsid_cplx *to = column + c * n + l;
            *to = lines->has_images ? gsid_cplx_mul(plain[c], *to) : plain[c];
        }
        if (lines->torque != NULL) {
            const gsid_cplx torque = sensed_at(structure, &v, w, gsid_cplx_scale(-1, lines->torque[l]));
            column[n_driven(structure) * n + l] = gsid_cplx_mul(torque, body_at(&v, w));
        }
    }
    return GSID_OK;
}

/* The slopes at one line, [n_theta].
 * @param[in] each    columns of the command, times their gains
 * @param[in] torque  that of the torque, 0 without */
static void slopes_at(const gsid_structure *s, const values *v, double w, const gsid_cplx *each, gsid_cplx torque,
                      gsid_cplx *slope) {
    gsid_cplx driven = {0, 0};
    for (uint32_t c = 0; c < n_driven(s); c++) {
        driven = gsid_cplx_add(driven, each[c]);
    }
    const gsid_cplx response = gsid_cplx_add(driven, torque);
    const gsid_cplx body = gsid_cplx_mul(body_at(v, w), gsid_cplx_add(each[0], torque));
    if (s->n_body > 0) {
        *slope++ = gsid_cplx_scale(-v->rate, body);
    }
    if (s->n_body > 1) {
        *slope++ = times_s(v->stiffness / (w * w), w, body);
    }
    for (uint32_t i = 0; i < s->n_modes; i++) {
        const gsid_cplx mode = gsid_cplx_div(each[1 + i], mode_below(v, i, w));
        const gsid_cplx by_z = times_s(-2 * v->z[i] * v->w[i], w, mode);
        *slope++ = gsid_cplx_sub(by_z, gsid_cplx_scale(2 * v->w[i] * v->w[i], mode));
        *slope++ = by_z;
    }
    for (uint32_t i = 0; i < s->n_lags; i++) {
        *slope++ = gsid_cplx_div(times_s(-v->tau[i], w, response), gsid_cplx_make(1, v->tau[i] * w));
    }
    *slope = times_s(-1, w, driven);
}

gsid_status gsid_structure_slopes(const gsid_structure *structure, const gsid_structure_lines *lines,
                                  const double *theta, const gsid_cplx *column, const double *gain, gsid_cplx *slope) {
    const gsid_status status = gsid_structure_check(structure, lines);
    if (status != GSID_OK || theta == NULL || column == NULL || gain == NULL || slope == NULL) {
        return status != GSID_OK ? status : GSID_E_NULL;
    }
    const values v = values_of(structure, theta);
    const size_t n = lines->n;
    for (uint32_t l = 0; l < n; l++) {
        gsid_cplx each[GSID_STRUCTURE_COLUMNS_MAX], found[GSID_STRUCTURE_THETA_MAX];
        const uint32_t n_columns = gsid_structure_n_columns(structure, lines);
        for (uint32_t c = 0; c < n_columns; c++) {
            each[c] = gsid_cplx_scale(gain[c], column[c * n + l]);
        }
        const gsid_cplx none = {0, 0};
        slopes_at(structure, &v, lines->w[l], each, lines->torque != NULL ? each[n_columns - 1] : none, found);
        for (uint32_t i = 0; i < gsid_structure_n_theta(structure); i++) {
            slope[i * n + l] = found[i];
        }
    }
    return GSID_OK;
}
