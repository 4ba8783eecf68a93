/* Stable denominators as products of sections of first and second order, whose parameters have simple bounds.  Eq:
 * EST-4 */
#ifndef GSID_FIT_SECTIONS_H
#define GSID_FIT_SECTIONS_H

#include "gsid/rational.h"

/* Least distance of a pole from the edge of the stable region: from the axis in scaled s, from the unit circle in z. */
#define GSID_FIT_EDGE 1e-6

/* Most poles of the functions below. */
#define GSID_FIT_SECTIONS_POLES_MAX 64

/* One factor of the denominator, coef[0] + coef[1] v + coef[2] v^2, in a variable p that has the edge of the
 * region at EDGE inside that of v. Its parameters x:
 *   domain s, p = v + EDGE: order 2: x0 + x1 p + p^2; order 1: x0 + p: within the edge when all are >= 0.
 *   domain z, p = (1 - EDGE) v: order 2: 1 + x0 (1 + x1) p + x1 p^2; order 1: 1 + x0 p: when all are within +-1. */
void gsid_fit_section_coefficients(gsid_domain domain, uint32_t order, const double *x, double *coef);

/* Derivatives of the section by its parameters, at v. */
void gsid_fit_section_derivatives(gsid_domain domain, uint32_t order, const double *x, gsid_cplx v, gsid_cplx *by);

/* Order of the section that begins with pole `first`. */
uint32_t gsid_fit_section_order(uint32_t n_poles, uint32_t first);

/* Bounds of every parameter of a section. */
void gsid_fit_section_bounds(gsid_domain domain, double *lower, double *upper);

/* Parameters of the sections with these poles, in scaled s or in z: pairs first, then real poles two by two in order
 * of size. Poles beyond the edge are reflected, unless they may stay unstable.  `pole` is changed. */
void gsid_fit_sections_from_poles(gsid_domain domain, uint32_t n_poles, int unstable, gsid_cplx *pole, double *x);

#endif
