/* Frequency response and its uncertainty: mean and (co)variance of the lines over periods, in fixed memory.
 *
 * Two engines make the lines of a period; they agree to rounding, and only the one that is initialised is linked.
 * gsid_frf_init, direct: every line is summed at every sample; any N; the lines enter the mean with the period's last
 * sample. gsid_frf_init_spread: a transform spread over the ticks of the next period, for N even and N/2 without prime
 * factors above 7; the lines enter the mean one after the other during that period, the last one with GSID_DONE. On a
 * Cortex-M7 a tick takes 19 instructions a line or so with the direct engine (25 when the input is measured; in a period's
 * last tick 35 and 91), with the spread one 210 at most for any number of lines (300): that pays from eight lines on, and
 * costs two buffers of the period for each signal that is measured.
 *
 * On a target call either gsid_frf_step or gsid_frf_skip in each tick, and init and result in the background. */
#ifndef GSID_FRF_H
#define GSID_FRF_H

#include "gsid/spectrum.h"
#include "gsid/spread.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All pointers stay the caller's and must outlive the object. */
typedef struct {
    uint32_t n_period;        /* N, samples in a period, 2 .. 2^30 */
    uint32_t n_lines;         /* F >= 1 */
    uint32_t n_settle;        /* samples discarded at the start */
    const uint32_t *line;     /* [n_lines] 1 <= line < N/2, any order */
    const gsid_cplx *twiddle; /* [n_period] from gsid_twiddle_fill */
    const gsid_cplx *u_known; /* [n_lines] the input's lines when it is known exactly; NULL: the input is measured too */
} gsid_frf_cfg;

struct gsid_frf_engine;

typedef struct {
    gsid_frf_cfg cfg;
    const struct gsid_frf_engine *engine; /* private */
    gsid_spectrum spectrum;   /* private: of the direct engine */
    gsid_spread spread;       /* private: of the spread engine */
    uint32_t line_next;       /* private: spread engine: the next line of the transform that enters the mean */
    uint32_t settle_left;     /* private */
    uint32_t spoiled;         /* private: a sample of this period was lost */
    uint32_t n_periods;       /* good periods in the mean */
    uint32_t n_spoiled;       /* periods left out because samples of them were lost */
    uint32_t n_refused;       /* samples refused because they were not finite */
    gsid_cplx *mean;          /* private: [n_lines][n_channels] y, then u */
    gsid_real *m2;            /* private: [n_lines][n_channels] sums of squared deviations */
    gsid_cplx *cross;         /* private: [n_lines] sum of deviation products y conj(u); measured input only */
} gsid_frf;

/* The same number as gsid_frf_mem_size, for the direct and for the spread engine; measured: 1 with measured input, 0 with
 * known input. In float a line takes 24 bytes with the direct engine, 20 and the two buffers with the spread one (input
 * known; 52 and 40 bytes when it is measured). */
#define GSID_FRF_MEAN_SIZE(n_lines, measured)                                                                          \
    ((size_t)(n_lines) * ((1 + (measured)) * (sizeof(gsid_cplx) + sizeof(gsid_real)) + (measured) * sizeof(gsid_cplx)))
#define GSID_FRF_MEM_SIZE(n_lines, measured)                                                                           \
    (GSID_SPECTRUM_MEM_SIZE(n_lines, 1 + (measured)) + GSID_FRF_MEAN_SIZE(n_lines, measured))

#define GSID_FRF_SPREAD_MEM_SIZE(n_period, n_lines, measured)                                                          \
    (GSID_SPREAD_MEM_SIZE(n_period, n_lines, 1 + (measured)) + GSID_FRF_MEAN_SIZE(n_lines, measured))

/* Arrays to read into; any may be NULL. */
typedef struct {
    gsid_cplx *g;       /* [n_lines] mean(Y)/mean(U)                       eq. 4.10 */
    gsid_real *var_g;   /* [n_lines] variance of that quotient of means    eq. 7.29 over the number of periods */
    gsid_cplx *y, *u;   /* [n_lines] means over periods                    eq. 4.10 */
    gsid_real *var_y;   /* [n_lines] sample variance of one period's Y     eq. 4.11 */
    gsid_real *var_u;   /* [n_lines] sample variance of one period's U     eq. 4.11; 0 with known input */
    gsid_cplx *cov_yu;  /* [n_lines] sample covariance, mean of Y conj(U)  eq. 4.11; 0 with known input */
} gsid_frf_out;

/** Bytes that gsid_frf_init needs; 0 for a configuration that it refuses. */
size_t gsid_frf_mem_size(const gsid_frf_cfg *cfg);

/** Lay an FRF measurement with the direct engine out in the caller's memory.
 *  @param[in,out] mem  mem_size bytes, aligned for gsid_cplx
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE in u_known; GSID_E_MEMORY; GSID_E_BUILD.  Context: background. */
gsid_status gsid_frf_init(gsid_frf *frf, const gsid_frf_cfg *cfg, void *mem, size_t mem_size);

/** Bytes that gsid_frf_init_spread needs; 0 for a configuration that it refuses. */
size_t gsid_frf_spread_mem_size(const gsid_frf_cfg *cfg);

/** As gsid_frf_init, with the spread engine.
 *  @param[in] cfg  as for gsid_frf_init; besides n_period as for gsid_spread_init
 *  @return as gsid_frf_init */
gsid_status gsid_frf_init_spread(gsid_frf *frf, const gsid_frf_cfg *cfg, void *mem, size_t mem_size);

/** Take one sample of input and output, from the first sample of the excitation on.
 *  Eq: FRF-1, FRF-2 (Welford's update of eqs. 4.10 and 4.11, once a period).
 *  @param[in] u  input, finite; not used if the input is known
 *  @param[in] y  output at the same instant, finite
 *  @return GSID_OK; GSID_SETTLING; GSID_DONE a good period was added; GSID_SPOILED a period was left out;
 *          GSID_E_NULL; GSID_E_STATE; GSID_E_NONFINITE refused and counted, nothing else changed: call gsid_frf_skip
 *  Cost: direct: gsid_spectrum_step, and at the last sample of a period one Welford update per line besides. Spread: a
 *  slice of the transform or the updates of a few lines, at every sample about the same; no work of a period is left over.
 *  Context: ISR-safe, one writer.
 *  Limits: the float build stays within 2e-6 (direct) or 2e-7 (spread) of the largest line (500 lines, 75 periods of 6000;
 *  printed by tests/python/test_float_build.py); an offset of y far above the lines costs digits: subtract it first. In float a
 *  mean no longer changes after some 2^24 r periods, r the noise of one period over the line: 160 000 at 1 %. Its error bars
 *  would still shrink: start a new measurement before. */
gsid_status gsid_frf_step(gsid_frf *frf, gsid_real u, gsid_real y);

/** Account for n_samples lost samples. The periods they fall in are left out of the mean and counted in n_spoiled.
 *  @return GSID_OK; GSID_SETTLING every one fell in the settling; GSID_SPOILED the end of a period was passed, even
 *          when the lines of the one before were added on the way: n_periods tells; GSID_DONE these were added and no end was
 *          passed; GSID_E_NULL; GSID_E_STATE
 *  Cost: direct: one 64-bit remainder per line. Spread: as n_samples steps, until there is no work left.
 *  Context: as gsid_frf_step. */
gsid_status gsid_frf_skip(gsid_frf *frf, uint32_t n_samples);

/** Add the last whole period at once, when no more samples will come, instead of over the ticks that the spread engine
 *  would need. The result is the same to the bit. Direct engine: there is nothing to do.
 *  @return GSID_OK there was nothing to add; GSID_DONE; GSID_E_NULL; GSID_E_STATE
 *  Cost: at most that of n_period steps.  Context: background, not concurrently with gsid_frf_step. */
gsid_status gsid_frf_finish(gsid_frf *frf);

/** Add a period whose lines were computed elsewhere, from a transform of a whole record. The caller handles settling.
 *  Eq: FRF-2.
 *  @param[in] lines  [n_lines][n_channels] as gsid_spectrum_result gives them: of y, then of u unless that is known
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE also while the spread engine adds lines; GSID_E_NONFINITE nothing changed
 *  Cost: one Welford update per line.  Context: background, between periods. */
gsid_status gsid_frf_add_period(gsid_frf *frf, const gsid_cplx *lines);

/** Add the good periods of another measurement of the same lines, as if they had been measured one after the other.
 *  Eq: FRF-4.  A period under way in `other` is not added. The same parts merged in the same order give the same bits, wherever
 *  they were measured; another order differs by rounding.
 *  @param[in] other  same n_period, lines and kind of input (the same one, where it is known); any engine
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE also while the spread engine of either adds lines (gsid_frf_finish ends that);
 *          GSID_E_CONFIG not the same lines or input: nothing changed
 *  Cost: one pass over the lines.  Context: background, between periods. */
gsid_status gsid_frf_merge(gsid_frf *frf, const gsid_frf *other);

/** Read the result so far. A line whose mean input is 0 has g = 0 with an infinite var_g: g is unknown. If the
 *  variance needs squares beyond the range of numbers, var_g is infinite too, and the other variances are undefined. In
 *  float this is the case for |U| below 1e-12, for |Y| below 1e-12 with deviations below 1e-19, for lines above 1e19, |g| below 1e-19
 *  and var_g below 1e-38 or above 1e38.
 *  @return GSID_OK; GSID_RANGE a line's squares are beyond the range of numbers: scale u and y; GSID_E_NULL; GSID_E_STATE; GSID_E_TOO_FEW fewer than 2 good periods (1 if no
 *          variance is requested)
 *  Cost: one pass over the lines, with the division of eq. 4.10.  Context: background. Beside a running interrupt: within
 *  n_period - 1 ticks (direct) or spread.n_ticks ticks (spread) after a GSID_DONE; the next period begins to enter the
 *  mean after that. */
gsid_status gsid_frf_result(const gsid_frf *frf, const gsid_frf_out *out);

#ifdef __cplusplus
}
#endif

#endif
