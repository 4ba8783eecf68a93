/* What the third-party libraries do for the host library. Their own headers are included nowhere but in this folder.
 * fftw.c is compiled only with GSID_WITH_FFTW, nlopt.c only with GSID_WITH_NLOPT. */
#ifndef GSID_HOST_BACKEND_H
#define GSID_HOST_BACKEND_H

#include "gsid/types.h"

/* Version of the library as linked. */
const char *gsid_fftw_version_str(void);
const char *gsid_nlopt_version_str(void);

/* Plain sums x[n] exp(-j 2 pi k n / N) of each period at the lines asked; arguments as gsid_batch_spectra, checked there.
 * GSID_OK; GSID_E_NO_MEMORY. */
gsid_status gsid_fftw_sums(uint32_t n_periods, uint32_t n_period, const double *x, uint32_t n_lines,
                           const uint32_t *line, gsid_cplx *sums);

#endif
