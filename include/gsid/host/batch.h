/* Whole records and lists of frequencies at once: spectra by the functions of gsid_transform_use, else by FFTW where it was built in,
 * else by the streaming core. */
#ifndef GSID_HOST_BATCH_H
#define GSID_HOST_BATCH_H

#include "gsid/frf.h"
#include "gsid/rational.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Lines of each period of a record, as gsid_spectrum_result gives them.  Eq: FRF-1.
 *  @param[in]  n_periods, n_period, x  [n_periods * n_period] samples, finite
 *  @param[in]  n_lines, line           [n_lines] 0 <= line <= n_period / 2
 *  @param[out] lines                   [n_periods][n_lines]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE; GSID_E_NO_MEMORY
 *  Context: any thread; callers wait for each other (plan and buffers of the last period are shared, kept up to 2^20
 *  samples). */
gsid_status gsid_batch_spectra(uint32_t n_periods, uint32_t n_period, const double *x, uint32_t n_lines,
                               const uint32_t *line, gsid_cplx *lines);

/** Take a block of samples: gsid_frf_step for each, gsid_frf_skip for those that were lost.
 *  @param[in] n, u, y  [n] input and output; u is not used if the input is known; finite where valid
 *  @param[in] valid    [n] 0: this sample was lost; NULL: all are valid
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE; GSID_E_NONFINITE the whole block is refused */
gsid_status gsid_batch_frf_step(gsid_frf *frf, size_t n, const double *u, const double *y, const uint8_t *valid);

/* Means over periods of responses that were measured elsewhere: all arrays of gsid_frf_out, none NULL. */

/** Response and its variance from means, variances and covariance over periods.  Eq: FRF-2 (eqs. 4.10 and 7.29)
 *  @param[in]     n_periods  in the means, >= 1
 *  @param[in,out] lines      in: y, u, var_y, var_u, cov_yu; out: g, var_g, as gsid_frf_result gives them
 *  @return GSID_OK; GSID_RANGE as gsid_frf_result; GSID_E_NULL; GSID_E_CONFIG */
gsid_status gsid_batch_frf_divide(uint32_t n_lines, uint32_t n_periods, const gsid_frf_out *lines);

/** Put the means of two parts of one measurement together, then as gsid_batch_frf_divide.  Eq: FRF-4
 *  @param[in,out] lines      of n_periods >= 1; out: of all periods
 *  @param[in]     other      of n_other >= 1; g and var_g are not used
 *  @return as gsid_batch_frf_divide; GSID_E_CONFIG also for more than 2^32 - 1 periods */
gsid_status gsid_batch_frf_merge(uint32_t n_lines, uint32_t n_periods, const gsid_frf_out *lines, uint32_t n_other,
                                 const gsid_frf_out *other);

/** Variance of Y - g U of one period, for any g.  Eq: FRF-2 (eq. 7.29)
 *  @param[in]  lines     var_y, var_u and cov_yu are used
 *  @param[in]  g         [n_lines]
 *  @param[out] variance  [n_lines] >= 0
 *  @return GSID_OK; GSID_E_NULL */
gsid_status gsid_batch_frf_error_variance(uint32_t n_lines, const gsid_frf_out *lines, const gsid_cplx *g,
                                          double *variance);

/** Response of a rational model and its derivatives at many frequencies: gsid_rational_gradient at each.
 *  @param[in]  n_freq, f_hz  [n_freq] Hz
 *  @param[out] g             [n_freq]
 *  @param[out] gradient      [n_freq][n_poles + n_zeros + 2], rows as in gsid_rational_gradient
 *  @return as gsid_rational_gradient; if it fails, the outputs of the frequencies before the one that failed are written */
gsid_status gsid_batch_rational_gradient(const gsid_rational *model, uint32_t n_freq, const double *f_hz, gsid_cplx *g,
                                         gsid_cplx *gradient);

#ifdef __cplusplus
}
#endif

#endif
