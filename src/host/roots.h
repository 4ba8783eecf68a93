/* Roots of real polynomials, however they were found. */
#ifndef GSID_ROOTS_H
#define GSID_ROOTS_H

#include "gsid/types.h"

/* Real coefficients have real roots and conjugate pairs: make them exactly so.  n <= 64. */
void gsid_pair_conjugates(uint32_t n, gsid_cplx *z);

#endif
