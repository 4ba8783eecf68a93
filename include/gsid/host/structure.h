/* Response of a structure of physical elements (rigid body, modes, lags, delay), and its values of least cost (STR-1 to STR-3):
 *
 *   G = exp(-s T) hold(s) s^-q / prod(1 + tau_j s) [g_0 B + sum g_i s / (s^2 + 2 z_i w_i s + w_i^2) + g_R s]
 *
 * B is the body from torque to rate: 1/s, 1/(s + c) or s/(s^2 + c s + k). What is linear are the gains: one column each. */
#ifndef GSID_HOST_STRUCTURE_H
#define GSID_HOST_STRUCTURE_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GSID_STRUCTURE_MODES_MAX 10
#define GSID_STRUCTURE_LAGS_MAX 4
#define GSID_STRUCTURE_COLUMNS_MAX (GSID_STRUCTURE_MODES_MAX + 3)
#define GSID_STRUCTURE_THETA_MAX (2 + 2 * GSID_STRUCTURE_MODES_MAX + GSID_STRUCTURE_LAGS_MAX + 1)

/* theta, of which there are n_body + 2 n_modes + n_lags + 1: ln c [1/s], ln k [1/s^2] of the body; ln w [rad/s], ln z of each mode;
 * ln tau [s] of each lag; the delay [s]. */
typedef struct {
    int integrations; /* q: -1 the output is the acceleration, 0 the rate, 1 the angle */
    uint32_t n_body;  /* 0 free, 1 with viscous friction, 2 with a spring too */
    uint32_t n_modes, n_lags;
    int has_residual; /* g_R, of the modes above the band */
} gsid_structure;

/* Frequencies at which a structure is evaluated. */
typedef struct {
    uint32_t n;
    const double *w;       /* [n] rad/s, > 0, ascending */
    const gsid_cplx *hold; /* [n] response of the hold; 1 without one */
    double sample_s;       /* > 0 */
    int has_images;        /* whether the images of a held command are evaluated, exactly (STR-2) */
    uint32_t n_fractions;  /* of a sensor that is refreshed between samples; 0: none */
    const double *later;   /* [n_fractions] samples by which the delay is longer */
    const gsid_cplx *share; /* [n_fractions][n] */
    const gsid_cplx *torque; /* [n] torque along the measured motion over the command, at the output's time; NULL: none.
                                It adds a column: minus its response, of the body and the lags alone (STR-6) */
} gsid_structure_lines;

/** Response of each gain: body, modes, residual term, torque along the motion.
 *  @param[in]  theta   nonlinear values
 *  @param[out] column  [1 + n_modes + has_residual + (1 with a torque)][n]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG too many elements, no line, or a sample time that is not positive */
gsid_status gsid_structure_columns(const gsid_structure *structure, const gsid_structure_lines *lines,
                                   const double *theta, gsid_cplx *column);

/** Values of least cost, by variable projection: Gauss-Newton steps with the damping of Levenberg and Marquardt, and Kaufman's
 *  approximation of the slopes of the projected error (Golub and Pereyra 1973).
 *  @param[in]     g        [n] response to fit
 *  @param[in]     weight   [n] 1 / standard deviation
 *  @param[in]     n_steps  at most; 0: only the gains are found
 *  @param[in,out] theta    start; values of least cost
 *  @param[out]    gain     [1 + n_modes + has_residual + (1 with a torque)]
 *  @param[out]    cost     sum of the squared weighted errors; INFINITY where the start has no finite response
 *  @return as gsid_structure_columns; GSID_E_NO_MEMORY */
gsid_status gsid_structure_refine(const gsid_structure *structure, const gsid_structure_lines *lines,
                                  const gsid_cplx *g, const double *weight, uint32_t n_steps, double *theta,
                                  double *gain, double *cost);

#ifdef __cplusplus
}
#endif

#endif
