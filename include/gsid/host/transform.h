/* Fourier transforms of the caller's own, for builds without FFTW and for those who prefer another library. */
#ifndef GSID_HOST_TRANSFORM_H
#define GSID_HOST_TRANSFORM_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Both functions may be called by several threads at a time. */
typedef struct {
    /* lines[k] = sum over i of x[i] exp(-j 2 pi k i / n) for k = 0 .. n/2.  n >= 2; x [n]; lines [n / 2 + 1] */
    void (*to_lines)(uint32_t n, const double *x, gsid_cplx *lines);
    /* x[i] = sum over k of lines[k] exp(j 2 pi k i / n), k from -n/2 on, lines[-k] = conj(lines[k]).  n even */
    void (*to_samples)(uint32_t n, const gsid_cplx *lines, double *x);
} gsid_transform;

/** Transform with these functions from now on, instead of FFTW or, in a build without it, the streaming core.
 *  @param[in] transform  copied; NULL: what the build has
 *  @return GSID_OK; GSID_E_NULL a function is missing
 *  Context: before other threads use the host library. */
gsid_status gsid_transform_use(const gsid_transform *transform);

#ifdef __cplusplus
}
#endif

#endif
