/* The lines of one period by a transform whose work is spread over the ticks of the next: about 1/60 of the direct sum.
 *
 * Two buffers are swapped at the end of each period: one receives the new samples, the other is transformed in place, one
 * slice of work per tick. Every slice costs about the same, and the last one ends before the buffers are swapped again.
 * gsid_spectrum gives the same lines, to rounding, for any N, at once, and without buffers. It is cheaper up to seven
 * lines. */
#ifndef GSID_SPREAD_H
#define GSID_SPREAD_H

#include "gsid/spectrum.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GSID_SPREAD_STAGES_MAX 20 /* of a period of 2^30 samples */

typedef struct gsid_spread {
    gsid_spectrum_cfg cfg;
    uint32_t next;        /* private: place of the next sample in its buffer, its number in the excitation's period */
    int has_gap;          /* private: a sample of this period was lost */
    gsid_real *filling;   /* private: [n_channels][n_period] */
    gsid_cplx *work;      /* private: [n_channels][n_period / 2] two neighbouring samples make one complex number */
    uint32_t (*place)[2]; /* private: [n_lines] where the transform leaves a line and its mirror image */
    gsid_real scale;      /* private: 1 / n_period */
    uint32_t n_stages;    /* private */
    uint32_t stage;       /* private: n_stages: none is under way */
    int has_lines;        /* private: work holds a complete transform */
    /* private: of the stage under way */
    void (*butterfly)(const struct gsid_spread *s, gsid_cplx *x, uint32_t step);
    uint32_t span;   /* distance of a butterfly's elements */
    uint32_t stride; /* of the twiddles */
    uint32_t left;   /* butterflies to do, */
    uint32_t most;   /* so many of them in a tick */
    gsid_cplx *at;   /* the next one begins here, */
    uint32_t offset; /* at this place in its block; */
    uint32_t gap;    /* the next block's first one is so much further */
    uint32_t n_ticks;        /* ticks from the end of a period to its lines: fewer than n_period - n_lines / lines_per_tick */
    uint32_t lines_per_tick; /* to read so many lines in a tick costs what a tick of the transform costs */
    uint8_t radix[GSID_SPREAD_STAGES_MAX];    /* private */
    uint8_t per_tick[GSID_SPREAD_STAGES_MAX]; /* private: butterflies of one slice */
} gsid_spread;

/* The same number as gsid_spread_mem_size, for static memory. */
#define GSID_SPREAD_MEM_SIZE(n_period, n_lines, n_channels)                                                            \
    (2 * (size_t)(n_period) * (n_channels) * sizeof(gsid_real) + (size_t)(n_lines) * 2 * sizeof(uint32_t))

/** Bytes that gsid_spread_init needs; 0 for a configuration that it refuses. Two buffers of n_period samples a channel,
 *  and 8 bytes a line. */
size_t gsid_spread_mem_size(const gsid_spectrum_cfg *cfg);

/** Lay a spread transform out in the caller's memory and reset it.
 *  @param[in] cfg  as for gsid_spectrum; besides n_period is even, at least 4, and half of it has no prime factor above 7
 *  @param[in,out] mem  mem_size bytes, aligned for gsid_cplx
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_MEMORY; GSID_E_BUILD.  Cost: some divisions per line.  Context: background. */
gsid_status gsid_spread_init(gsid_spread *s, const gsid_spectrum_cfg *cfg, void *mem, size_t mem_size);

/** Discard all samples and lines and restart at the sample number cfg.n_first.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE */
gsid_status gsid_spread_reset(gsid_spread *s);

/** Take one sample of each channel, and do one slice of the last period's transform.
 *  Eq: FRF-3 (the lines of FRF-1).
 *  @param[in] x  [n_channels] finite
 *  @return GSID_OK; GSID_DONE the lines of the period before are ready, and stay until the period of now ends;
 *          GSID_SPOILED a period ended of which samples were lost: it is not transformed; GSID_E_NULL; GSID_E_STATE;
 *          GSID_E_NONFINITE sample refused, nothing changed, no slice done: call gsid_spread_skip
 *  Cost: one slice: the costliest butterfly of the period, or cheaper ones to that amount; less when the transform is
 *  complete. No division, no sine, no cosine.  Context: ISR-safe, one writer. */
gsid_status gsid_spread_step(gsid_spread *s, const gsid_real *x);

/** Account for n_samples lost samples: time advances, and the periods they fall in will not be transformed.
 *  @return GSID_OK; GSID_DONE as above; GSID_SPOILED the end of a period was passed: no lines are ready; GSID_E_NULL;
 *          GSID_E_STATE
 *  Cost: one slice for each sample, until the transform is complete.  Context: as gsid_spread_step. */
gsid_status gsid_spread_skip(gsid_spread *s, uint32_t n_samples);

/** Complete the transform at once, so that the lines of the last whole period are ready.
 *  @return GSID_OK there was nothing left; GSID_DONE; GSID_E_NULL; GSID_E_STATE
 *  Cost: all slices left.  Context: background, not concurrently with gsid_spread_step. */
gsid_status gsid_spread_finish(gsid_spread *s);

/** Read one line of the last whole period, normalised as by gsid_spectrum_result.
 *  @param[in]  i        index into cfg.line
 *  @param[in]  channel  0 .. n_channels - 1
 *  @param[out] line
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG no such line; GSID_E_STATE not ready
 *  Cost: as a butterfly of radix 3.  Context: ISR-safe. */
gsid_status gsid_spread_line(const gsid_spread *s, uint32_t i, uint32_t channel, gsid_cplx *line);

#ifdef __cplusplus
}
#endif

#endif
