/* The lines of one period, summed sample by sample: a streaming DFT at chosen lines, with exact integer phase. */
#ifndef GSID_SPECTRUM_H
#define GSID_SPECTRUM_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All pointers stay the caller's and must outlive the object. */
typedef struct {
    uint32_t n_period;        /* N, samples in a period, 2 .. 2^30 */
    uint32_t n_lines;         /* F >= 1 */
    uint32_t n_channels;      /* signals that share the lines, 1 or 2 */
    uint32_t n_first;         /* sample number, in the period of the excitation, of the first sample given; 0 .. N-1 */
    const uint32_t *line;     /* [n_lines] 0 <= line <= N/2 */
    const gsid_cplx *twiddle; /* [n_period] from gsid_twiddle_fill */
} gsid_spectrum_cfg;

typedef struct {
    gsid_spectrum_cfg cfg;
    uint32_t n;      /* private: samples summed in this period */
    uint32_t *phase; /* private: [n_lines] line * sample number mod N */
    gsid_cplx *sum;  /* private: [n_lines][n_channels] */
    gsid_real scale; /* private: 2 / n_period */
} gsid_spectrum;

/* The same number as gsid_spectrum_mem_size, for static memory. */
#define GSID_SPECTRUM_MEM_SIZE(n_lines, n_channels)                                                                    \
    ((size_t)(n_lines) * ((n_channels) * sizeof(gsid_cplx) + sizeof(uint32_t)))

/** Bytes that gsid_spectrum_init needs; 0 for a configuration that it refuses. */
size_t gsid_spectrum_mem_size(const gsid_spectrum_cfg *cfg);

/** Lay a spectrum out in the caller's memory and reset it.
 *  @param[in,out] mem  mem_size bytes, aligned for gsid_cplx
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_MEMORY; GSID_E_BUILD.  Context: background. */
gsid_status gsid_spectrum_init(gsid_spectrum *s, const gsid_spectrum_cfg *cfg, void *mem, size_t mem_size);

/** Forget the sums and start again at the sample number cfg.n_first.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE */
gsid_status gsid_spectrum_reset(gsid_spectrum *s);

/** Sum one sample of each channel.
 *  Eq: FRF-1  X(k) += x[n] exp(-j 2 pi k n / N)  (thesis, eq. 3.2).
 *  @param[in] x  [n_channels] finite
 *  @return GSID_OK; GSID_DONE that was the N-th sample: read the result before the next step, which starts a new period;
 *          GSID_E_NULL; GSID_E_STATE; GSID_E_NONFINITE sample refused, nothing changed
 *  Cost: per line one index update and 2 n_channels multiply-adds, the same for every sample. There is no drift, because the phase
 *  is an integer.  Context: ISR-safe, one writer. */
gsid_status gsid_spectrum_step(gsid_spectrum *s, const gsid_real *x);

/** Account for n_samples missing samples: time advances, the sums do not, and the period they fall in is incomplete.
 *  Passing the last sample of a period clears the sums.
 *  @return GSID_OK; GSID_DONE at least one period end was passed; GSID_E_NULL; GSID_E_STATE
 *  Cost: one 64-bit remainder per line. */
gsid_status gsid_spectrum_skip(gsid_spectrum *s, uint32_t n_samples);

/** Read the lines of the period just completed: one-sided, |X(k)| is the amplitude of the sine.
 *  X(k) = 2/N sum (1/N for k = 0 and k = N/2).
 *  @param[out] lines  [n_lines][n_channels]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE the period is not complete */
gsid_status gsid_spectrum_result(const gsid_spectrum *s, gsid_cplx *lines);

#ifdef __cplusplus
}
#endif

#endif
