/* Rational transfer functions with delay, in s or in z. */
#ifndef GSID_RATIONAL_H
#define GSID_RATIONAL_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GSID_ORDER_MAX 16

typedef enum { GSID_DOMAIN_S = 0, GSID_DOMAIN_Z = 1 } gsid_domain;

/* G = exp(-j w delay) num(v)/den(v); v = s / scale_rad_s in domain s, v = z^-1 in domain z. The scale keeps powers of s
 * near 1; a scale of 1 gives plain coefficients of s. */
typedef struct {
    gsid_domain domain;
    uint32_t n_poles;        /* degree of den, 0 .. GSID_ORDER_MAX */
    uint32_t n_zeros;        /* degree of num, 0 .. GSID_ORDER_MAX */
    gsid_real scale_rad_s;   /* domain s: > 0; domain z: not used */
    gsid_real sample_s;      /* domain z: sample time > 0; domain s: not used */
    gsid_real delay_s;       /* any finite number, a fraction of a sample included */
    gsid_real num[GSID_ORDER_MAX + 1]; /* num[i] multiplies v^i */
    gsid_real den[GSID_ORDER_MAX + 1]; /* den[i] multiplies v^i */
} gsid_rational;

/** Set orders, domain and scale; coefficients and delay to zero, den to 1.
 *  @param[in] rate  domain s: scale [rad/s]; domain z: sample time [s]; > 0
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG */
gsid_status gsid_rational_init(gsid_rational *model, gsid_domain domain, uint32_t n_poles, uint32_t n_zeros,
                               gsid_real rate);

/** The variable v at an angular frequency: j w / scale_rad_s, or exp(-j w sample_s). The model is not NULL.  Context: ISR-safe. */
gsid_cplx gsid_rational_variable(const gsid_rational *model, gsid_real w_rad_s);

/** Evaluate the frequency response.  Eq: MOD-1 (thesis, eqs. 6.4 and 6.5).
 *  @param[in]  n_freq, f_hz  [n_freq] Hz
 *  @param[out] g             [n_freq]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG an order; GSID_E_NONFINITE a frequency is not finite or falls on a pole:
 *          outputs untouched
 *  Cost: 2 (n_poles + n_zeros) complex multiply-adds and two sines and cosines per frequency; domain z: four. */
gsid_status gsid_rational_eval(const gsid_rational *model, uint32_t n_freq, const gsid_real *f_hz, gsid_cplx *g);

/* Parameters of a rational model: den without the coefficient held at 1, num, delay. */
#define GSID_RATIONAL_PARAMETERS_MAX (2 * GSID_ORDER_MAX + 2)

/** Index of the denominator coefficient that is held at 1: the highest in domain s, the lowest in domain z. The model is not
 *  NULL. */
uint32_t gsid_rational_held(const gsid_rational *model);

/** Response and its derivatives at one frequency.
 *  @param[in]  f_hz      Hz
 *  @param[out] g         response
 *  @param[out] gradient  [n_poles + n_zeros + 2] dG by den (ascending, without the held one), num (ascending), delay_s
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG an order; GSID_E_NONFINITE the frequency is not finite or falls on a pole:
 *          outputs untouched */
gsid_status gsid_rational_gradient(const gsid_rational *model, gsid_real f_hz, gsid_cplx *g, gsid_cplx *gradient);

/** Test for stability: all poles inside the left half plane (Routh's array) or the unit circle (Schur and Cohn's
 *  recursion). A model whose den[n_poles] (domain s) or den[0] (domain z) is zero is not stable: it has fewer poles, or
 *  is not causal.
 *  @param[out] is_stable  1 or 0
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE */
gsid_status gsid_rational_is_stable(const gsid_rational *model, int *is_stable);

#ifdef __cplusplus
}
#endif

#endif
