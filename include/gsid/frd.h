/* Frequency response data: what estimators, fits and comparisons take. */
#ifndef GSID_FRD_H
#define GSID_FRD_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Pointers stay the caller's. */
typedef struct {
    uint32_t n_lines;
    const gsid_real *f_hz;  /* [n_lines] Hz, finite */
    const gsid_cplx *g;     /* [n_lines] finite */
    const gsid_real *sigma; /* [n_lines] standard deviation of g (complex), > 0, as sqrt(gsid_frf_out.var_g); NULL: all 1 */
    /* Errors of the input too, NULL without: variance of its error and covariance of output and input error, E{N_Y conj(N_U)},
     * both over |U|^2, >= 0 and complex. sigma is then that of g as measured, and V takes what it is at the model's G.
     * |cov_yu - g var_u|^2 is at most sigma^2 var_u: above, the variance would be negative at some G (GSID_E_CONFIG). */
    const gsid_real *var_u;  /* [n_lines] */
    const gsid_cplx *cov_yu; /* [n_lines] */
    int logarithmic; /* 1: errors are |g|/sigma (without sigma: 1) times ln(G/g), phase to the nearest turn; g is not 0 */
} gsid_frd;

#ifdef __cplusplus
}
#endif

#endif
