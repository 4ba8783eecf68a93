#include "../core/complex_math.h"
#include "fit_run.h"

/* exp(-j w tau) v^i / A / sigma for every i into the columns of two rows, and g / sigma into the right-hand side. */
static void put_line(const gsid_frd *data, uint32_t k, const gsid_rational *model, uint32_t row, double *block) {
    const double w_rad_s = GSID_TWO_PI * data->f_hz[k], weight = 1 / data->sigma[k];
    const gsid_cplx v = gsid_rational_variable(model, w_rad_s);
    const gsid_cplx a = gsid_cplx_polynomial(model->n_poles, model->den, v);
    gsid_cplx x = gsid_cplx_scale(weight, gsid_cplx_div(gsid_cplx_cis(-w_rad_s * model->delay_s), a));
    for (uint32_t i = 0; i <= model->n_zeros; i++, x = gsid_cplx_mul(x, v)) {
        block[i * GSID_LSQ_BLOCK + row] = x.re;
        block[i * GSID_LSQ_BLOCK + row + 1] = x.im;
    }
    block[(model->n_zeros + 1) * GSID_LSQ_BLOCK + row] = weight * data->g[k].re;
    block[(model->n_zeros + 1) * GSID_LSQ_BLOCK + row + 1] = weight * data->g[k].im;
}

/* Eq: EST-10 */
gsid_status gsid_fit_numerator(const gsid_frd *data, uint32_t stride, gsid_lsq *equations, gsid_rational *model,
                               double *cost) {
    double block[(GSID_ORDER_MAX + 2) * GSID_LSQ_BLOCK];
    uint32_t row = 0;
    gsid_lsq_reset(equations);
    gsid_status status = GSID_OK;
    for (uint32_t k = 0; k < data->n_lines && status >= 0; k += stride) {
        put_line(data, k, model, row, block);
        row = (row + 2) % GSID_LSQ_BLOCK;
        if (row == 0 || data->n_lines - k <= stride) {
            status = gsid_lsq_add_block(equations, row == 0 ? GSID_LSQ_BLOCK : row, block);
        }
    }
    return status < 0 ? status : gsid_lsq_solve(equations, 0, model->num, cost);
}
