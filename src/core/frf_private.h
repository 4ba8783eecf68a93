/* One line of a frequency response. In a header, so that gsid_frf_result alone has its copy without the call. */
#ifndef GSID_FRF_PRIVATE_H
#define GSID_FRF_PRIVATE_H

#include "complex_math.h"
#include "streaming.h"

/* The least size of a line whose rounding error squared does not underflow. */
#ifdef GSID_SINGLE
#define GSID_FRF_LEAST 1e-12f
#else
#define GSID_FRF_LEAST 1e-138
#endif

static inline gsid_real gsid_frf_size(gsid_cplx z) {
    return gsid_fabs(z.re) + gsid_fabs(z.im);
}

/* Whether a variance of a line of some size is free of underflow. The squares of small deviations underflow; beside a large line
 * only those of deviations below its own rounding. */
static inline int gsid_frf_is_kept(gsid_real variance, gsid_real size) {
    return variance >= GSID_SMALLEST || size >= GSID_FRF_LEAST;
}

typedef struct {
    gsid_cplx g, y, u, cov_yu;
    gsid_real var_g, var_y, var_u; /* var_g of the mean, the others of one period */
    int is_in_range;               /* 0: their squares are beyond the range of numbers; var_g is infinite */
} gsid_frf_line;

/* FRF-2: variance of Y - g U of one period, 7.29 with mean lines, multiplied out so that no line of Y stands in a denominator,
 * because Y may be 0 at an antiresonance. Rounding can make it negative when the noise of u and y is the same noise; then it is 0.
 * Not a number where it is a difference of infinite terms. */
static inline gsid_real gsid_frf_error_variance(const gsid_frf_line *line, gsid_cplx g) {
    gsid_real v =
        line->var_y + gsid_cplx_abs2(g) * line->var_u - GSID_R(2.0) * gsid_cplx_mul(line->cov_yu, gsid_cplx_conj(g)).re;
    return v < GSID_R(0.0) ? GSID_R(0.0) : v;
}

/* FRF-2: g and its variance from means over p periods; g 0 and var_g infinite where the input is 0. Squares that underflow
 * or overflow are detected by the comparisons below. A variance of exactly 0 is accepted: there are no deviations. */
static inline void gsid_frf_divide(gsid_frf_line *line, gsid_real p) {
    line->g = gsid_cplx_make(GSID_R(0.0), GSID_R(0.0));
    line->var_g = (gsid_real)INFINITY;
    line->is_in_range = 1;
    const gsid_real u2 = gsid_cplx_abs2(line->u), size_y = gsid_frf_size(line->y);
    if (gsid_frf_size(line->u) > GSID_R(0.0)) {
        line->g = gsid_cplx_div(line->y, line->u); /* 4.10 */
        const gsid_real v = gsid_frf_error_variance(line, line->g), var_g = v / u2 / p, g2 = gsid_cplx_abs2(line->g);
        line->is_in_range = 0;
        if (u2 >= GSID_FRF_LEAST * GSID_FRF_LEAST && gsid_is_finite(var_g) && (var_g >= GSID_SMALLEST || v == 0) &&
            (size_y == 0 || (g2 >= GSID_SMALLEST && gsid_frf_is_kept(v, size_y)))) {
            line->is_in_range = 1;
            line->var_g = var_g;
        }
    }
}

/* Line i of the means so far. One good period at least. */
static inline gsid_frf_line gsid_frf_line_at(const gsid_frf *frf, uint32_t i) {
    const size_t at = (size_t)i * gsid_frf_channels(&frf->cfg);
    const int measured = frf->cross != NULL;
    const gsid_real p = (gsid_real)frf->n_periods;
    const gsid_real per_dof = p > GSID_R(1.0) ? GSID_R(1.0) / (p - GSID_R(1.0)) : GSID_R(0.0); /* 4.11 */
    const gsid_cplx zero = gsid_cplx_make(GSID_R(0.0), GSID_R(0.0));

    gsid_frf_line line;
    line.y = frf->mean[at];
    line.u = measured ? frf->mean[at + 1] : frf->cfg.u_known[i];
    line.var_y = per_dof * frf->m2[at];
    line.var_u = measured ? per_dof * frf->m2[at + 1] : GSID_R(0.0);
    line.cov_yu = measured ? gsid_cplx_scale(per_dof, frf->cross[i]) : zero;
    gsid_frf_divide(&line, p);
    return line;
}

/* ---- FRF-4 */

/* The second of two parts: its share of the periods, and Pa Pb / P. */
typedef struct {
    gsid_real share, weight;
} gsid_frf_parts;

static inline gsid_frf_parts gsid_frf_parts_of(gsid_real n_first, gsid_real n_second) {
    const gsid_real share = n_second / (n_first + n_second);
    const gsid_frf_parts parts = {share, n_first * share};
    return parts;
}

/* One channel of one line; returns the distance of the two means. */
static inline gsid_cplx gsid_frf_merge_mean(gsid_frf_parts parts, gsid_cplx *mean, gsid_real *m2, gsid_cplx mean_other,
                                            gsid_real m2_other) {
    const gsid_cplx d = gsid_cplx_sub(mean_other, *mean);
    *mean = gsid_cplx_add(*mean, gsid_cplx_scale(parts.share, d));
    *m2 += m2_other + parts.weight * gsid_cplx_abs2(d);
    return d;
}

/* The sum of products of one line, d_y and d_u as above. */
static inline void gsid_frf_merge_cross(gsid_frf_parts parts, gsid_cplx d_y, gsid_cplx d_u, gsid_cplx *cross,
                                        gsid_cplx cross_other) {
    const gsid_cplx product = gsid_cplx_scale(parts.weight, gsid_cplx_mul(d_y, gsid_cplx_conj(d_u)));
    *cross = gsid_cplx_add(*cross, gsid_cplx_add(cross_other, product));
}

#endif
