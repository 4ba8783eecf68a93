/* Separation of noise and nonlinear distortion: the robust method over realisations, and levels at detection lines. */
#ifndef GSID_DISTORTION_H
#define GSID_DISTORTION_H

#include "gsid/frf.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All pointers stay the caller's and must outlive the object. */
typedef struct {
    uint32_t n_period;        /* N, samples in a period, 2 .. 2^30 */
    uint32_t n_lines;         /* all lines that are evaluated */
    uint32_t n_excited;       /* F >= 1, the first of them, which every realisation excites; the rest detect */
    uint32_t n_settle;        /* samples discarded at the start of each realisation */
    const uint32_t *line;     /* [n_lines] 1 <= line < N/2; ascending among the excited, and among the others */
    const gsid_cplx *twiddle; /* [n_period] from gsid_twiddle_fill */
    uint32_t input_is_known;  /* 1: exactly, gsid_distortion_start is given its lines; 0: the input is measured */
} gsid_distortion_cfg;

typedef struct {
    gsid_distortion_cfg cfg;
    gsid_frf frf;            /* private: the realisation under way */
    gsid_status (*frf_init)(gsid_frf *, const gsid_frf_cfg *, void *, size_t); /* private: that of the engine */
    void *frf_mem;           /* private */
    size_t frf_size;         /* private */
    uint32_t n_realisations; /* M so far */
    uint32_t n_periods;      /* good periods of all of them */
    gsid_cplx *mean;         /* private: [n_excited] of the realisations' responses */
    gsid_real *m2;           /* private: [n_excited] sum of squared deviations */
    gsid_real *noise;        /* private: [n_excited] sum of the realisations' noise variances */
    gsid_real *power;        /* private: [n_lines - n_excited] mean of |Y|^2 over realisations */
    gsid_real *power_noise;  /* private: [n_lines - n_excited] mean of what noise leaves of it */
} gsid_distortion;

/* The same number as gsid_distortion_mem_size with the direct engine (with the spread one, GSID_FRF_SPREAD_MEM_SIZE
 * stands in for GSID_FRF_MEM_SIZE); measured: 1 with measured input, 0 with known input. */
#define GSID_DISTORTION_MEAN_SIZE(n_lines, n_excited)                                                                  \
    ((size_t)(n_excited) * (sizeof(gsid_cplx) + 2 * sizeof(gsid_real)) +                                               \
     (size_t)((n_lines) - (n_excited)) * 2 * sizeof(gsid_real))
#define GSID_DISTORTION_MEM_SIZE(n_lines, n_excited, measured)                                                         \
    (GSID_DISTORTION_MEAN_SIZE(n_lines, n_excited) + GSID_FRF_MEM_SIZE(n_lines, measured))

/* Arrays to read into; any may be NULL. */
typedef struct {
    gsid_cplx *bla;           /* [n_excited] best linear approximation                        eq. 5.14 */
    gsid_real *var_noise;     /* [n_excited] its variance by noise                             eq. 5.14 */
    gsid_real *var_total;     /* [n_excited] its variance by noise and distortion, M >= 2      eq. 5.14 */
    gsid_real *std_nonlinear; /* [n_excited] distortion of one realisation's response, M >= 2  eq. 5.16 */
    gsid_real *level;         /* [n_lines - n_excited] rms over realisations of the output's amplitude there */
    gsid_real *level_noise;   /* [n_lines - n_excited] what noise alone would leave of that, rms */
} gsid_distortion_out;

/** Bytes that gsid_distortion_init needs; 0 for an invalid configuration. */
size_t gsid_distortion_mem_size(const gsid_distortion_cfg *cfg);

/** Bytes that gsid_distortion_init_spread needs; 0 for an invalid configuration. */
size_t gsid_distortion_spread_mem_size(const gsid_distortion_cfg *cfg);

/** Lay a measurement with the direct engine (see gsid_frf) out in the caller's memory; the first realisation begins with gsid_distortion_start.
 *  @param[in,out] mem  mem_size bytes, aligned for gsid_cplx
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_MEMORY.  Context: background. */
gsid_status gsid_distortion_init(gsid_distortion *d, const gsid_distortion_cfg *cfg, void *mem, size_t mem_size);

/** As gsid_distortion_init, with the spread engine.
 *  @param[in] cfg  as for gsid_distortion_init; besides n_period as for gsid_spread_init
 *  @return as gsid_distortion_init */
gsid_status gsid_distortion_init_spread(gsid_distortion *d, const gsid_distortion_cfg *cfg, void *mem, size_t mem_size);

/** Begin a realisation: other random phases, the same amplitudes. One that was under way is given up.
 *  @param[in] u_known  [n_lines] the input's lines when it is known, 0 where not excited; otherwise not used
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE; GSID_E_NONFINITE
 *  Cost: one pass over the lines.  Context: background. */
gsid_status gsid_distortion_start(gsid_distortion *d, const gsid_cplx *u_known);

/** Take one sample, from the first one of the realisation's excitation on.
 *  @return, cost and context as gsid_frf_step; GSID_E_STATE before gsid_distortion_start */
gsid_status gsid_distortion_step(gsid_distortion *d, gsid_real u, gsid_real y);

/** Account for lost samples: as gsid_frf_skip. */
gsid_status gsid_distortion_skip(gsid_distortion *d, uint32_t n_samples);

/** Add a period whose lines were computed elsewhere: as gsid_frf_add_period. */
gsid_status gsid_distortion_add_period(gsid_distortion *d, const gsid_cplx *lines);

/** End the realisation and add it to the means.
 *  Eq: DIS-1, DIS-2 (thesis, eqs. 5.12 to 5.14), DIS-3 at the lines not excited: there the distortion of
 *  a measured input, times the response interpolated between the excited lines, is subtracted from the output.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE none is under way; GSID_E_TOO_FEW fewer than 2 good periods, or an excited
 *          line without input; GSID_E_NONFINITE a line, its variance or the square of its size is beyond the range of numbers
 *          (see gsid_frf_result): the realisation continues, nothing was added
 *  Cost: one pass over the lines.  Context: background. */
gsid_status gsid_distortion_finish(gsid_distortion *d);

/** Read the result of the realisations finished.
 *  Eq: DIS-2 (thesis, eqs. 5.14 to 5.16). With one realisation only results that need no second may be requested.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE; GSID_E_TOO_FEW; GSID_E_NONFINITE a sum over realisations is beyond the range of
 *          numbers: outputs untouched
 *  Cost: one pass over the lines.  Context: background. */
gsid_status gsid_distortion_result(const gsid_distortion *d, const gsid_distortion_out *out);

#ifdef __cplusplus
}
#endif

#endif
