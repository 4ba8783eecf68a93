/* Periodic excitations besides the multisine: binary sequences, swept sines, a sine stepped from line to line. */
#ifndef GSID_SIGNALS_H
#define GSID_SIGNALS_H

#include "gsid/excitation.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- pseudorandom binary sequence ---- */

typedef enum { GSID_PRBS_QUADRATIC_RESIDUE = 0, GSID_PRBS_MAXIMUM_LENGTH = 1 } gsid_prbs_kind;

typedef struct {
    gsid_prbs_kind kind;
    uint32_t n_chips;    /* quadratic residue: an odd prime below 2^24; maximum length: 2^m - 1, m = 2 .. 20 */
    uint32_t n_hold;     /* samples that a chip lasts, >= 1; n_chips n_hold <= 2^30 */
    gsid_real amplitude; /* unit of the command */
} gsid_prbs_cfg;

typedef struct {
    gsid_prbs_cfg cfg;
    uint32_t chip, held; /* private: chip of the period, samples of it already given */
    uint32_t state;      /* private: shift register */
    int is_high;         /* private */
} gsid_prbs;

/** The length nearest to n_chips that this kind has, for gsid_prbs_cfg.
 *  @return a length; 0 for an unknown kind.  Cost: a few thousand divisions.  Context: background. */
uint32_t gsid_prbs_nearest(gsid_prbs_kind kind, uint32_t n_chips);

/** Check a sequence and set it to its first sample.
 *  Eq: EXC-4 (thesis, definition 3.6.1 and its program), EXC-5.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE.  Context: background. */
gsid_status gsid_prbs_init(gsid_prbs *prbs, const gsid_prbs_cfg *cfg);

/** Give the next sample, +-amplitude; the period is n_chips n_hold.
 *  @return GSID_OK; GSID_DONE that was the last sample of a period; GSID_E_NULL; GSID_E_STATE
 *  Cost: at the start of a chip 24 squarings with 64-bit remainders (quadratic residue) or 20 shifts (maximum length), else
 *  none.  Context: ISR-safe. */
gsid_status gsid_prbs_step(gsid_prbs *prbs, gsid_real *u);

/* ---- swept sine ---- */

typedef enum { GSID_SWEEP_LINEAR = 0, GSID_SWEEP_LOGARITHMIC = 1 } gsid_sweep_kind;

typedef struct {
    gsid_sweep_kind kind;
    uint32_t n_period;    /* N, samples, 2 .. 2^30 */
    gsid_real line_start; /* frequency at the start and the end of a period, as (fractions of) lines: f N / fs; */
    gsid_real line_stop;  /*   > 0, < N/2, not the same; may fall. Logarithmic: 126 octaves apart at most (double: 1022) */
    gsid_real amplitude;  /* unit of the command */
    gsid_real phase_rad;  /* of the sine at the start of a period */
} gsid_sweep_cfg;

typedef struct {
    gsid_sweep_cfg cfg;
    gsid_real log_ratio; /* private */
    uint32_t n;          /* private: sample within the period */
} gsid_sweep;

/** Check a sweep and set it to its first sample.
 *  Eq: EXC-6 linear, EXC-7 logarithmic (thesis, eqs. 3.5 to 3.7): the phase is the integral of the frequency.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE.  Context: background. */
gsid_status gsid_sweep_init(gsid_sweep *sweep, const gsid_sweep_cfg *cfg);

/** Turns of the sine in a period: a whole number goes on without a jump of the phase over the end of the period.
 *  @return turns, not finite for a configuration that gsid_sweep_init refuses */
gsid_real gsid_sweep_turns(const gsid_sweep_cfg *cfg);

/** Give the next sample, a function of the sample number: every period is the same to the bit.
 *  @return GSID_OK; GSID_DONE that was the last sample of a period; GSID_E_NULL; GSID_E_STATE
 *  Cost: one sine, logarithmic one exponential besides.  Limits: the phase is good to 1 unit in the last place of the turns so
 *  far: 5e-5 rad in float after 80 turns.  Context: ISR-safe. */
gsid_status gsid_sweep_step(gsid_sweep *sweep, gsid_real *u);

/* ---- stepped sine ---- */

typedef struct {
    uint32_t n_period;          /* N, samples */
    uint32_t n_lines;           /* >= 1 */
    uint32_t n_settle;          /* samples before each line's estimation, so that the change of frequency dies out */
    uint32_t n_periods;         /* periods of N for which each line is then held, >= 1 */
    const uint32_t *line;       /* [n_lines] 1 <= line < N/2, in any order */
    const gsid_real *amplitude; /* [n_lines] */
    const gsid_cplx *twiddle;   /* [n_period] from gsid_twiddle_fill */
} gsid_stepped_cfg;

typedef struct {
    gsid_stepped_cfg cfg;
    gsid_sine sine;  /* private */
    uint32_t i;      /* line under way, n_lines: all are done */
    uint32_t settle; /* private: samples of settling left */
    uint32_t n;      /* private: samples given after it */
} gsid_stepped;

/** Check a stepped sine and set it to the first sample of its first line.
 *  Eq: EXC-1, line by line (thesis, figure 3.2). All pointers stay the caller's.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE.  Context: background. */
gsid_status gsid_stepped_init(gsid_stepped *stepped, const gsid_stepped_cfg *cfg);

/** Give the next sample. Each line starts anew with phase 0 of a cosine, so that its estimation starts n_settle samples
 *  later: that is gsid_frf_cfg.n_settle of a measurement of this one line.
 *  @return GSID_SETTLING; GSID_OK; GSID_DONE that was the last sample of a line; GSID_E_NULL; GSID_E_STATE all lines are done
 *  Cost: two multiplications; a sine and a cosine when a line begins.  Context: ISR-safe. */
gsid_status gsid_stepped_step(gsid_stepped *stepped, gsid_real *u);

/* ---- lines of a multisine ---- */

/** List the odd lines of a range without one, drawn at random, of each group of neighbours: those detect odd distortion.
 *  Eq: EXC-8.
 *  @param[in]  line_lo, line_hi  first and last line allowed, 1 <= line_lo <= line_hi
 *  @param[in]  n_group   neighbours of which one is left out, >= 2; a last group that is not whole is kept
 *  @param[in]  seed      any value
 *  @param[in]  capacity  entries in line
 *  @param[out] line      [capacity] ascending; NULL: only count
 *  @param[out] n_lines   number of lines
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG no odd line in the range; GSID_E_MEMORY capacity too small */
gsid_status gsid_lines_odd_random(uint32_t line_lo, uint32_t line_hi, uint32_t n_group, uint64_t seed,
                                  uint32_t capacity, uint32_t *line, uint32_t *n_lines);

/** List odd lines that are spread evenly over the logarithm of frequency, as nearly as odd lines can be.
 *  @param[in]  n_per_decade  requested lines per decade, >= 1; fewer where there are no more odd lines
 *  @return as gsid_lines_odd_random; further arguments, too
 *  Cost: twice line_hi / 2 + min(n_per_decade, 2 line_hi) log10(line_hi / line_lo) steps.  Context: background. */
gsid_status gsid_lines_quasi_log(uint32_t line_lo, uint32_t line_hi, uint32_t n_per_decade, uint32_t capacity,
                                 uint32_t *line, uint32_t *n_lines);

#ifdef __cplusplus
}
#endif

#endif
