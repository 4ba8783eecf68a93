/* Parameters of a rational model from a frequency response: LS, IWLS, Gauss-Newton maximum likelihood. */
#ifndef GSID_ESTIMATE_H
#define GSID_ESTIMATE_H

#include "gsid/frd.h"
#include "gsid/lsq.h"
#include "gsid/rational.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Bytes of work memory for the calls below, aligned for gsid_real; 0 for orders above GSID_ORDER_MAX. */
size_t gsid_estimate_mem_size(uint32_t n_poles, uint32_t n_zeros);
#define GSID_ESTIMATE_MEM_SIZE(n_poles, n_zeros)                                                                       \
    (2 * GSID_LSQ_MEM_SIZE((n_poles) + (n_zeros) + 2) +                                                                 \
     ((GSID_LSQ_BLOCK + 3) * ((n_poles) + (n_zeros) + 2) + GSID_LSQ_BLOCK) * sizeof(gsid_real))

/** Weighted sum of squared errors V = sum |g - G(model)|^2 / sigma^2, or as gsid_frd states.  Eq: EST-3, EST-8, EST-9
 *  (thesis, eqs. 7.28, 7.23, 7.24 and 7.26).
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG a sigma that is not > 0, covariances that contradict each
 *          other, an order or a rate out of range; GSID_E_NONFINITE */
gsid_status gsid_estimate_cost(const gsid_frd *data, const gsid_rational *model, gsid_real *cost);

typedef struct {
    uint32_t n_iterations; /* reweightings after the first solution; 0: plain linear least squares, eq. 7.9 */
    gsid_real exponent;    /* r of eq. 7.16; 0: 1 */
    gsid_real tolerance;   /* >= 0. 0: the iterate with the least cost V, a start for gsid_estimate_ml. Above: the fixed point of
                              the reweighting, reached when a reweighting changes the response by less than this share of the
                              data, both root mean squares weighted by 1/sigma; n_iterations is then a limit */
    int from_model;        /* 1: the first solution is weighted by the denominator of the model given, too */
} gsid_iwls_cfg;

/** Linear least squares, reweighted by the last denominator; the delay of the model is taken as known.
 *  Eq: EST-1, EST-2 (thesis, eqs. 7.9 and 7.14 to 7.16). Errors are weighted by 1/sigma too. The highest denominator
 *  coefficient (domain z: the lowest) is 1. Where no fixed point is reached the iterate with the least cost V is kept.
 *  @param[in,out] model  in: domain, orders, scale, delay; out: coefficients
 *  @param[out]    cost   V of the model; may be NULL
 *  @return GSID_OK; GSID_RANK; GSID_MAX_ITER no fixed point within the limit; GSID_E_NULL; GSID_E_CONFIG; GSID_E_TOO_FEW;
 *          GSID_E_SINGULAR; GSID_E_NONFINITE; GSID_E_MEMORY
 *  Cost: per iteration 2 n_lines rows of gsid_lsq_add_block with n_poles + n_zeros + 1 columns.  Context: background. */
gsid_status gsid_estimate_iwls(const gsid_frd *data, const gsid_iwls_cfg *cfg, gsid_rational *model, gsid_real *cost,
                               void *mem, size_t mem_size);

typedef struct {
    uint32_t n_iterations; /* limit; 0: 50 */
    gsid_real tolerance;   /* >= 0: converged when the predicted decrease of V by the undamped step, or the best damped one, is less;
                              0: 0.005, a hundredth of what one parameter gains on noise. Where V is below one per line it
                              counts in proportion, so that the unit of unweighted data does not matter. */
    int free_delay;        /* 1: the delay is a parameter too */
    /* For data that are corrected by something that the model itself predicts, such as the images of a held input: `update`
     * sets data->g for a model and, if requested, drift, the [n_lines][n_poles + n_zeros + 2] derivatives of g by den without
     * its 1, num, delay. NULL: g is constant. After the call g is that of the last model evaluated. */
    gsid_status (*update)(void *user, const gsid_rational *model, int with_drift);
    void *user;
    const gsid_cplx *drift;
} gsid_ml_cfg;

/** Gauss-Newton on V, whichever gsid_frd makes it, with Levenberg-Marquardt damping and geodesic acceleration, from the model given.
 *  Eq: EST-3 (thesis, eq. 7.28).
 *  @param[in,out] model  in: start; out: the model of least cost found. The held coefficient (gsid_rational_held) stays
 *  @param[out]    cost   V; may be NULL
 *  @return GSID_OK; GSID_MAX_ITER; GSID_E_NULL; GSID_E_CONFIG; GSID_E_TOO_FEW; GSID_E_NONFINITE; GSID_E_MEMORY
 *  Cost: per iteration 2 n_lines rows of gsid_lsq_add_block, and for each damping two passes over the lines (four on
 *  average, 60 at most).  Context: background. */
gsid_status gsid_estimate_ml(const gsid_frd *data, const gsid_ml_cfg *cfg, gsid_rational *model, gsid_real *cost,
                             void *mem, size_t mem_size);

/** Covariance of the ML estimate at a model: the inverse of Fisher's information.  Eq: EST-5.
 *  @param[in]  free_delay  1: the delay was estimated too
 *  @param[out] cov  [n][n], n = n_poles + n_zeros + 1 + free_delay: of (den without its 1, num, delay), ascending powers
 *                   of the scaled variable, for errors of standard deviation sigma
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_TOO_FEW; GSID_E_SINGULAR the data do not determine a parameter;
 *          GSID_E_NONFINITE; GSID_E_MEMORY */
gsid_status gsid_estimate_covariance(const gsid_frd *data, const gsid_rational *model, int free_delay, gsid_real *cov,
                                     void *mem, size_t mem_size);

#ifdef __cplusplus
}
#endif

#endif
