/* Nonlinear least squares among stable models, by NLopt. */
#ifndef GSID_FIT_STABLE_H
#define GSID_FIT_STABLE_H

#include "gsid/frd.h"
#include "gsid/rational.h"

typedef struct {
    int free_delay; /* 0: the delay stays as it is */
    double delay_min_s, delay_max_s;
    int unstable; /* 1: poles may go anywhere */
    double delay_step_s; /* of the search for the delay that goes with reflected poles */
    uint32_t stride;     /* from one line of that search to the next */
} gsid_fit_bounds;

/** Minimise V within bounds: the denominator is a product of sections of first and second order whose coefficients NLopt
 *  keeps inside the stable region.  Eq: EST-4.
 *  @param[in,out] model  in: start, stable or not (its unstable poles are reflected, its numerator and delay follow); out: stable model
 *  @param[in,out] cost   V of the start; V of the stable model
 *  @return GSID_OK; GSID_MAX_ITER; GSID_E_BACKEND; GSID_E_NO_MEMORY; GSID_E_SINGULAR */
gsid_status gsid_fit_stable(const gsid_frd *data, const gsid_fit_bounds *bounds, gsid_rational *model, double *cost);

/** Denominator of the sections that x holds, n_poles numbers, x as the search keeps it.  Eq: EST-4 */
void gsid_fit_sections(const double *x, gsid_rational *model);

#endif
