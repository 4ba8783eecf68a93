/* Several responses with the same poles (a system of many inputs and outputs): common denominator, numerators and
 * delays of their own, stable, with covariance. */
#ifndef GSID_HOST_MIMO_H
#define GSID_HOST_MIMO_H

#include "gsid/host/fit.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GSID_MIMO_POLES_MAX 64
#define GSID_MIMO_CHANNELS_MAX 64

/* One channel's response is  G = exp(-j w delay) (sum over the sections N_k(v)/S_k(v) + d),  v = s / scale_rad_s in
 * domain s, v = z in domain z (here not its inverse), with S_k = v^2 + q1 v + q0 and N_k = b1 v + b0, or v + q0 and b0
 * when n_poles is odd, last. Together the sections are the common denominator.  Eq: MIM-1 */

/* Such a response. The caller keeps the arrays; n_local = n_poles + direct. */
typedef struct {
    gsid_domain domain;
    uint32_t n_poles;      /* 1 .. GSID_MIMO_POLES_MAX */
    int direct;            /* 1: with d */
    double rate;           /* domain s: scale of v [rad/s]; domain z: sample time [s]; > 0 */
    const double *section; /* [n_poles] q0 and q1 of each section */
    const double *num;     /* [n_local] b0 and b1 of each section, then d */
    double delay_s;
} gsid_mimo_channel;

/** Response of one channel.  Eq: MIM-1
 *  @param[in]  n_freq, f_hz  [n_freq] Hz
 *  @param[out] g             [n_freq]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE a number is not finite, or a frequency falls on a pole: the
 *          outputs of the frequencies before it are written */
gsid_status gsid_mimo_response(const gsid_mimo_channel *channel, uint32_t n_freq, const double *f_hz, gsid_cplx *g);

/** Derivatives of that response.  Eq: MIM-1
 *  @param[out] gradient  [n_freq][n_local + n_poles + 1] dG by num, section, delay_s
 *  @return as gsid_mimo_response */
gsid_status gsid_mimo_gradient(const gsid_mimo_channel *channel, uint32_t n_freq, const double *f_hz,
                               gsid_cplx *gradient);

/** Response of one channel to a held input, sampled: the sum of gsid_hold_response over its sections.  Eq: MIM-1, MOD-2
 *  @param[in]  sample_s  sample time [s]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG also in domain z and with d; GSID_E_NONFINITE; GSID_E_NO_MEMORY: outputs
 *          untouched when it fails */
gsid_status gsid_mimo_hold_response(const gsid_mimo_channel *channel, double sample_s, uint32_t n_freq,
                                    const double *f_hz, gsid_cplx *g);

/* Zero means default unless stated otherwise. */
typedef struct {
    gsid_domain domain;
    gsid_method method;       /* GSID_METHOD_IWLS, GSID_METHOD_NLS or GSID_METHOD_ML */
    uint32_t n_poles;         /* 1 .. GSID_MIMO_POLES_MAX */
    int direct;               /* 1: as many zeros as poles (with d); 0: one fewer */
    double sample_s;          /* domain z: sample time [s] */
    uint32_t n_delays;        /* free ones, 0 .. GSID_MIMO_CHANNELS_MAX; 0: those given stay */
    const uint32_t *delay_of; /* [n_channels] which free delay a channel has, each in use; NULL without free ones */
    double delay_max_s; /* free ones are from 0 to here [s]: all channels alike, then each alone; default 3 / f_max */
    int allow_unstable; /* 1: the best model, stable or not */
} gsid_mimo_cfg;

/* The caller's memory, n_local = n_poles + direct. */
typedef struct {
    double scale_rad_s; /* of v in domain s; 1 in domain z */
    double *section; /* [n_poles] q0 and q1 of each section */
    double *num; /* [n_channels][n_local] b0 and b1 of each section, then d */
    double *delay_s; /* [n_channels]; in: the delays, when none is free */
    double *delay_low_s, *delay_high_s; /* [n_channels] range of the minima of V over the delay that the data do not
                            refuse (MIM-5); both are delay_s where there is one only, after IWLS, and when none is
                            free; may be NULL */
    double *cov; /* [n][n] M^-1 / 2 of EST-6, with the weights of the method: the covariance of (num, section, free
                            delays) for ML and errors that are independent from channel to channel;
                            n = n_channels n_local + n_poles + n_delays, at most GSID_LSQ_COLUMNS_MAX (else
                            GSID_E_CONFIG, before any work); may be NULL */
    double cost; /* V with the weights of the method */
    double cost_ml; /* V weighted with the measured variance */
    uint32_t n_parameters;
    int converged;
} gsid_mimo_result;

/** Fit.  Eq: MIM-1, MIM-2, MIM-3, MIM-5. Delays are scanned with a relocation of poles at each; the best are refined
 *  by Gauss-Newton on poles and delays, the numerators solved for at each step (block-arrow least squares,
 *  gsid_arrow_reduce).
 *  @param[in]     n_channels  1 .. GSID_MIMO_CHANNELS_MAX
 *  @param[in]     channel     [n_channels] responses with sigma, not logarithmic, no var_u; their lines may differ
 *  @param[in,out] result
 *  @return GSID_OK; GSID_MAX_ITER; GSID_E_NULL; GSID_E_CONFIG; GSID_E_TOO_FEW; GSID_E_SINGULAR; GSID_E_NO_MEMORY;
 *          GSID_E_NONFINITE. Outputs are untouched when it fails.
 *  Cost: each of some dozen iterations 2 n_lines rows a channel, n_local + n_poles + n_delays columns. */
gsid_status gsid_mimo_run(uint32_t n_channels, const gsid_frd *channel, const gsid_mimo_cfg *cfg,
                          gsid_mimo_result *result);

#ifdef __cplusplus
}
#endif

#endif
