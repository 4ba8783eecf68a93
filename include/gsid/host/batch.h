/* Spectra of many periods at once, by FFTW where it was built in, by the streaming core where not. */
#ifndef GSID_HOST_BATCH_H
#define GSID_HOST_BATCH_H

#include "gsid/types.h"

/** Lines of each period of a record, as gsid_spectrum_result gives them.  Eq: FRF-1.
 *  @param[in]  n_periods, n_period, x  [n_periods * n_period] samples, finite
 *  @param[in]  n_lines, line           [n_lines] 0 <= line <= n_period / 2
 *  @param[out] lines                   [n_periods][n_lines]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE; GSID_E_NO_MEMORY */
gsid_status gsid_batch_spectra(uint32_t n_periods, uint32_t n_period, const double *x, uint32_t n_lines,
                               const uint32_t *line, gsid_cplx *lines);

#endif
