/* Rational model with delay from a measured frequency response: global in the delay, stable, with covariance. */
#ifndef GSID_HOST_FIT_H
#define GSID_HOST_FIT_H

#include "gsid/estimate.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
    GSID_METHOD_LS = 0,              /* linear least squares, eq. 7.9 */
    GSID_METHOD_IWLS = 1,            /* iteratively reweighted, eqs. 7.14 to 7.16 */
    GSID_METHOD_NLS = 2,             /* nonlinear least squares on the response, eq. 7.21 */
    GSID_METHOD_ML = 3,              /* maximum likelihood on the response, eq. 7.28 */
    GSID_METHOD_GA = 4,              /* evolutionary search for the start of NLS, eq. 7.18 */
    GSID_METHOD_NLS_OUTPUT = 5,      /* nonlinear least squares on the output, eq. 7.20 */
    GSID_METHOD_LOG = 6,             /* logarithmic least squares, eq. 7.23 */
    GSID_METHOD_ML_INPUT_OUTPUT = 7, /* maximum likelihood with errors in input and output, eqs. 7.24 and 7.26 */
    GSID_METHOD_COUNT = 8
} gsid_method;
/* Both find the same minimum. NLopt respects bounds; Gauss-Newton is faster, and NLopt replaces it where it leaves the bounds. */
typedef enum { GSID_SOLVER_GAUSS_NEWTON = 0, GSID_SOLVER_NLOPT = 1 } gsid_solver;
typedef enum { GSID_DELAY_NONE = 0, GSID_DELAY_FIXED = 1, GSID_DELAY_FREE = 2 } gsid_delay_mode;

/* Zero means default unless stated otherwise. */
typedef struct {
    gsid_domain domain;
    gsid_method method;
    uint32_t n_poles;
    uint32_t n_zeros;
    double sample_s;         /* sample time [s]; needed in domain z and with hold */
    int hold;                /* 1: the input was held over each sample (zero-order hold), and the model is of what follows
                                the hold; 0: the response is fitted unchanged */
    gsid_delay_mode delay;
    double delay_s;          /* GSID_DELAY_FIXED: the delay [s] */
    double delay_max_s;      /* GSID_DELAY_FREE: scanned from 0 to here [s], at most 512 / f_max; default 0.012, or one over
                                the least distance of two lines, beyond which delays repeat. A bound of the scan and of the
                                search among stable models only: the estimate may be negative where the delay is small */
    int allow_unstable;      /* 1: the best model, stable or not */
    int bound_delay;         /* 1: a free delay is at least delay_min_s */
    double delay_min_s;
    double exponent;         /* IWLS: r of eq. 7.16; below 1 is the relaxation of the thesis; 0: 1 */
    const double *input;     /* NLS_OUTPUT: [n_lines] amplitude of the input, > 0 */
    gsid_solver solver;      /* of the nonlinear methods */
    const gsid_rational *start; /* nonlinear methods: search from this model only, of the same domain and orders; NULL: find one */
    uint32_t seed;           /* GA */
    double sigma_dof;        /* degrees of freedom of sigma^2, counted in complex numbers; 0: known exactly. Where V is more than
                                noise leaves of a right model, a free delay is searched for longer */
} gsid_fit_cfg;

typedef struct {
    gsid_rational model;
    double cost;             /* V of the fit, eq. 7.28, with the weights of the method */
    double cost_ml;          /* V weighted with the measured variance, whatever the method */
    uint32_t n_parameters;   /* free ones */
    int converged;           /* 1: the estimate has settled, and with hold the images too */
    int is_stable;
    double cov[GSID_RATIONAL_PARAMETERS_MAX * GSID_RATIONAL_PARAMETERS_MAX]; /* [n][n] of (den without its 1, num, delay) for the
                                scaled variable; row length n_parameters */
    double bias[GSID_RATIONAL_PARAMETERS_MAX]; /* [n_parameters] LS and IWLS: how far noise shifts the estimate on average, to
                                first order (EST-11). Compared with the square roots of the diagonal of cov, it shows
                                whether cov is valid. 0 for the others */
    gsid_cplx poles[GSID_ORDER_MAX]; /* [n_poles] rad/s in domain s, z in domain z */
    gsid_cplx zeros[GSID_ORDER_MAX]; /* [n_zeros_found] */
    uint32_t n_zeros_found;          /* fewer than n_zeros when leading coefficients are zero */
} gsid_fit_result;

/** Fit.  Eq: EST-1 to EST-6. A free delay is scanned in steps of at most 1/(8 f_max), the best starts are refined. Where a
 *  start of NLS or ML ends unstable, the search goes on among stable models; LS and IWLS take the best stable one of the
 *  minima over the delay. Without NLopt a free delay of LS and IWLS is one of the scan: GSID_MAX_ITER.
 *  @param[in]  data  sigma is the standard deviation of g (complex, of the mean), needed for every method's covariance
 *  @return GSID_OK; GSID_MAX_ITER; GSID_E_NULL; GSID_E_CONFIG; GSID_E_TOO_FEW; GSID_E_SINGULAR; GSID_E_UNSTABLE;
 *          GSID_E_NO_MEMORY; GSID_E_NONFINITE; GSID_E_BACKEND every start ends unstable, and the build has no NLopt
 *  Cost: some hundred linear fits of n_lines rows, a few of them over all lines. */
gsid_status gsid_fit_run(const gsid_frd *data, const gsid_fit_cfg *cfg, gsid_fit_result *result);

/** Response of the zero-order hold, (1 - exp(-j w T)) / (j w T), without images.  Eq: MOD-2
 *  @param[in]  sample_s      sample time T [s]
 *  @param[in]  n_freq, f_hz  [n_freq] Hz
 *  @param[out] hold          [n_freq]; not a number where a frequency or the sample time is not finite
 *  @return GSID_OK; GSID_E_NULL */
gsid_status gsid_hold_factor(double sample_s, uint32_t n_freq, const double *f_hz, gsid_cplx *hold);

/** Response of a model to a held input, sampled: exact for any delay, by the matrix exponential.  Eq: MOD-2.
 *  @param[in]  sample_s      sample time [s]
 *  @param[in]  n_freq, f_hz  [n_freq] Hz
 *  @param[out] g             [n_freq]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG domain z, or more zeros than poles; GSID_E_NONFINITE
 *          a frequency falls on a pole, or a number is not finite: outputs untouched */
gsid_status gsid_hold_response(const gsid_rational *model, double sample_s, uint32_t n_freq, const double *f_hz,
                               gsid_cplx *g);

/** Roots of a polynomial with real coefficients, by Aberth's simultaneous iteration.
 *  @param[in]  degree  0 .. GSID_ORDER_MAX
 *  @param[in]  coef    [degree + 1] ascending powers
 *  @param[out] roots   [degree]
 *  @param[out] n_roots fewer than degree when leading coefficients are zero
 *  @return GSID_OK; GSID_MAX_ITER; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE */
gsid_status gsid_poly_roots(uint32_t degree, const double *coef, gsid_cplx *roots, uint32_t *n_roots);

#ifdef __cplusplus
}
#endif

#endif
