/* Maximum likelihood among stable models only. */
#ifndef GSID_FIT_STABLE_H
#define GSID_FIT_STABLE_H

#include "gsid/estimate.h"

/** Minimise V over stable models: the denominator is a product of sections of first and second order whose coefficients
 *  NLopt keeps inside the stable region.  Eq: EST-4.
 *  @param[in]     delay_max_s  bound of a free delay; <= 0: the delay stays as it is
 *  @param[in,out] model        in: start, stable or not (its unstable poles are reflected); out: stable model
 *  @param[in,out] cost         V of the start; V of the stable model
 *  @return GSID_OK; GSID_MAX_ITER; GSID_E_BACKEND; GSID_E_NO_MEMORY; GSID_E_SINGULAR */
gsid_status gsid_fit_stable(const gsid_frd *data, double delay_max_s, gsid_rational *model, double *cost);

#endif
