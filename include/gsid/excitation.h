/* Periodic excitation: multisines on a grid of lines k f_s / N, with exact integer phase. */
#ifndef GSID_EXCITATION_H
#define GSID_EXCITATION_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum { GSID_GRID_FULL = 0, GSID_GRID_ODD = 1 } gsid_grid;

/** Fill the table of exp(+j 2 pi i / N) that excitation and spectrum share.
 *  The angle is reduced to an eighth of a turn with integers, so that every entry is good to one unit in the last place.
 *  @param[in]  n_period  N, samples in a period, 2 .. 2^30
 *  @param[out] table     [n_period]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG
 *  Cost: N sines and cosines.  Context: background. */
gsid_status gsid_twiddle_fill(uint32_t n_period, gsid_cplx *table);

/** List the lines of a grid between two line numbers.
 *  @param[in]  grid      GSID_GRID_FULL: every line; GSID_GRID_ODD: odd lines only
 *  @param[in]  line_lo   first line allowed, >= 1
 *  @param[in]  line_hi   last line allowed, >= line_lo
 *  @param[in]  capacity  entries in line
 *  @param[out] line      [capacity] line numbers, ascending; NULL: only count
 *  @param[out] n_lines   number of lines on the grid
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG no line in the range; GSID_E_MEMORY capacity too small */
gsid_status gsid_lines_fill(gsid_grid grid, uint32_t line_lo, uint32_t line_hi, uint32_t capacity, uint32_t *line,
                            uint32_t *n_lines);

/** Amplitudes that follow a slope in dB per decade, 1 at the first line.
 *  @param[in]  n_lines        >= 1
 *  @param[in]  line           [n_lines] ascending, >= 1
 *  @param[in]  db_per_decade  slope of amplitude over frequency [dB/decade]; 0 flat; -10 falls as 1/sqrt(f)
 *  @param[out] amplitude      [n_lines]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE */
gsid_status gsid_amplitude_shape(uint32_t n_lines, const uint32_t *line, gsid_real db_per_decade, gsid_real *amplitude);

/** Schroeder phases for any amplitude spectrum: phi_k = -2 pi sum_{l<k} (k - l) p_l, p_l the share of power in line l.
 *  Eq: EXC-2; for a flat spectrum it is phi_k = -k (k - 1) pi / F (thesis, definition 3.5.1).
 *  @param[in]  n_lines    F >= 1
 *  @param[in]  amplitude  [n_lines] >= 0, not all zero
 *  @param[out] phase_rad  [n_lines] in [0, 2 pi)
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE */
gsid_status gsid_phase_schroeder(uint32_t n_lines, const gsid_real *amplitude, gsid_real *phase_rad);

/** Independent phases, uniform on [0, 2 pi) (thesis, definition 5.3.1). The same seed gives the same phases in both
 *  precisions up to rounding. Eq: EXC-3.
 *  @param[in]  n_lines    >= 1
 *  @param[in]  seed       any value, 0 included
 *  @param[out] phase_rad  [n_lines]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG */
gsid_status gsid_phase_random(uint32_t n_lines, uint64_t seed, gsid_real *phase_rad);

/* u[n] = sum_k amplitude_k cos(2 pi line_k n / N + phase_k). All pointers stay the caller's and must outlive the object. */
typedef struct {
    uint32_t n_period;          /* N, samples */
    uint32_t n_lines;           /* F >= 1 */
    const uint32_t *line;       /* [n_lines] 1 <= line < N/2, ascending */
    const gsid_real *amplitude; /* [n_lines] unit of the command, finite */
    const gsid_real *phase_rad; /* [n_lines] finite */
    const gsid_cplx *twiddle;   /* [n_period] from gsid_twiddle_fill */
} gsid_multisine_cfg;

typedef struct {
    gsid_multisine_cfg cfg;
    uint32_t n; /* private: sample within the period */
} gsid_multisine;

/** Check a multisine and set it to its first sample.  Eq: EXC-1 (thesis, eqs. 3.4 and 3.8).
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG line at or above N/2, not ascending, or zero; GSID_E_NONFINITE
 *  Cost: one pass over the lines.  Context: background. */
gsid_status gsid_multisine_init(gsid_multisine *m, const gsid_multisine_cfg *cfg);

/** Compute the next sample. The phase index is an integer: the signal repeats to the bit after any number of periods.
 *  @param[out] u  next sample, unit of the amplitudes
 *  @return GSID_OK; GSID_DONE that was the last sample of a period; GSID_E_NULL; GSID_E_STATE
 *  Cost: per line one 64-bit remainder, one cosine, one sine and two multiply-adds; use a table for many lines.
 *  Context: ISR-safe for few lines. */
gsid_status gsid_multisine_step(gsid_multisine *m, gsid_real *u);

/** Write one period.
 *  @param[out] u  [cfg.n_period], sample i equal to the i-th of gsid_multisine_step
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE
 *  Cost: n_lines * n_period multiply-adds.  Context: background. */
gsid_status gsid_multisine_table(const gsid_multisine *m, gsid_real *u);

/** The lines of the signal as a spectrum, for gsid_frf_cfg.u_known.
 *  @param[out] spectrum  [cfg.n_lines] amplitude exp(j phase)
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE */
gsid_status gsid_multisine_spectrum(const gsid_multisine *m, gsid_cplx *spectrum);

/* One line, as of a stepped sine: u[n] = amplitude cos(2 pi line n / N + phase). */
typedef struct {
    uint32_t n_period;        /* private */
    uint32_t line;            /* private */
    uint32_t phase;           /* private: line * sample number mod N */
    gsid_cplx amplitude;      /* private: amplitude exp(j phase) */
    const gsid_cplx *twiddle; /* private */
} gsid_sine;

/** Set a sine to its first sample. Eq: EXC-1.
 *  @param[in] n_period   N, samples in a period, 2 .. 2^30
 *  @param[in] line       0 <= line <= N/2
 *  @param[in] amplitude  unit of the command, finite
 *  @param[in] phase_rad  finite
 *  @param[in] twiddle    [n_period] from gsid_twiddle_fill; stays the caller's and must outlive the object
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE
 *  Cost: one sine and one cosine.  Context: ISR-safe: the next line of a sweep may begin in the tick. */
gsid_status gsid_sine_init(gsid_sine *sine, uint32_t n_period, uint32_t line, gsid_real amplitude, gsid_real phase_rad,
                           const gsid_cplx *twiddle);

/** Give the next sample: the same as that of a multisine of this one line.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE
 *  Cost: two multiplications and an index.  Context: ISR-safe. */
gsid_status gsid_sine_step(gsid_sine *sine, gsid_real *u);

#ifdef __cplusplus
}
#endif

#endif
