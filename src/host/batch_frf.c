/* Means over periods of responses that were measured elsewhere, by the core's formulas.  Eq: FRF-2, FRF-4 */
#include "../core/frf_private.h"
#include "gsid/host/batch.h"

static int is_whole(const gsid_frf_out *l) {
    return l != NULL && l->g != NULL && l->var_g != NULL && l->y != NULL && l->u != NULL && l->var_y != NULL &&
           l->var_u != NULL && l->cov_yu != NULL;
}

static gsid_frf_line line_of(const gsid_frf_out *from, uint32_t i) {
    const gsid_frf_line line = {
        .y = from->y[i], .u = from->u[i], .cov_yu = from->cov_yu[i], .var_y = from->var_y[i], .var_u = from->var_u[i]};
    return line;
}

gsid_status gsid_batch_frf_divide(uint32_t n_lines, uint32_t n_periods, const gsid_frf_out *lines) {
    if (!is_whole(lines)) {
        return GSID_E_NULL;
    }
    if (n_periods < 1) {
        return GSID_E_CONFIG;
    }
    int is_in_range = 1;
    for (uint32_t i = 0; i < n_lines; i++) {
        gsid_frf_line line = line_of(lines, i);
        gsid_frf_divide(&line, n_periods);
        lines->g[i] = line.g;
        lines->var_g[i] = line.var_g;
        is_in_range &= line.is_in_range;
    }
    return is_in_range ? GSID_OK : GSID_RANGE;
}

gsid_status gsid_batch_frf_merge(uint32_t n_lines, uint32_t n_periods, const gsid_frf_out *lines, uint32_t n_other,
                                 const gsid_frf_out *other) {
    if (!is_whole(lines) || !is_whole(other)) {
        return GSID_E_NULL;
    }
    if (n_periods < 1 || n_other < 1 || n_periods > UINT32_MAX - n_other) {
        return GSID_E_CONFIG;
    }
    const double dof = n_periods - 1.0, dof_other = n_other - 1.0, per_dof = 1 / (dof + dof_other + 1);
    const gsid_frf_parts parts = gsid_frf_parts_of(n_periods, n_other);
    for (uint32_t i = 0; i < n_lines; i++) {
        gsid_frf_line a = line_of(lines, i);
        const gsid_frf_line b = line_of(other, i);
        double m2_y = dof * a.var_y, m2_u = dof * a.var_u;
        gsid_cplx cross = gsid_cplx_scale(dof, a.cov_yu);
        const gsid_cplx d_y = gsid_frf_merge_mean(parts, &a.y, &m2_y, b.y, dof_other * b.var_y);
        const gsid_cplx d_u = gsid_frf_merge_mean(parts, &a.u, &m2_u, b.u, dof_other * b.var_u);
        gsid_frf_merge_cross(parts, d_y, d_u, &cross, gsid_cplx_scale(dof_other, b.cov_yu));
        lines->y[i] = a.y;
        lines->u[i] = a.u;
        lines->var_y[i] = per_dof * m2_y;
        lines->var_u[i] = per_dof * m2_u;
        lines->cov_yu[i] = gsid_cplx_scale(per_dof, cross);
    }
    return gsid_batch_frf_divide(n_lines, n_periods + n_other, lines);
}

gsid_status gsid_batch_frf_error_variance(uint32_t n_lines, const gsid_frf_out *lines, const gsid_cplx *g,
                                          double *variance) {
    if (lines == NULL || lines->var_y == NULL || lines->var_u == NULL || lines->cov_yu == NULL || g == NULL ||
        variance == NULL) {
        return GSID_E_NULL;
    }
    for (uint32_t i = 0; i < n_lines; i++) {
        const gsid_frf_line line = {.cov_yu = lines->cov_yu[i], .var_y = lines->var_y[i], .var_u = lines->var_u[i]};
        variance[i] = gsid_frf_error_variance(&line, g[i]);
    }
    return GSID_OK;
}
