/* Phases of a multisine with low peaks, of the command and of the travel it causes, by NLopt with gradients from FFTW. */
#ifndef GSID_HOST_OPTIMISE_EXCITATION_H
#define GSID_HOST_OPTIMISE_EXCITATION_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    uint32_t n_lines; /* F >= 1 */
    const uint32_t *line; /* [n_lines] >= 1, ascending */
    const double *amplitude; /* [n_lines] of the command, >= 0, not all zero */
    const gsid_cplx *travel; /* [n_lines] travel per command at each line; NULL: the command's peak alone counts */
    double limit_command; /* with travel: > 0, of |command|; the larger of both, each over its limit, is made small */
    double limit_travel; /* with travel: > 0, of |travel| around its mean */
    uint32_t n_per_stage; /* evaluations of each of the seven stages; 0: 150 */
} gsid_optimise_cfg;

/** Search phases whose largest sample is small.
 *  Eq: EXC-9, a norm of rising order in place of the largest sample (P. Guillaume et al., 1991), on a grid of 16 points at
 *  least per turn of the highest line, so that peaks between the samples count.
 *  @param[in,out] phase_rad  [n_lines] start; the best phases met
 *  @param[out]    peak       largest |command| on that grid; with travel, the larger of |command| and |travel|, each over
 *                            its limit
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE; GSID_E_NO_MEMORY; GSID_E_BACKEND built without NLopt, or without
 *          FFTW and no gsid_transform_use
 *  Cost: 7 n_per_stage evaluations of two transforms each (twice that with travel).
 *  Context: any thread; callers wait for each other only while FFTW plans. */
gsid_status gsid_optimise_phases(const gsid_optimise_cfg *cfg, double *phase_rad, double *peak);

#ifdef __cplusplus
}
#endif

#endif
