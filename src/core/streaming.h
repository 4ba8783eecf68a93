/* Internals of the streaming measurement: the work of a tick without the checks that gsid_frf_step has already made, and what
 * the engines of gsid_frf share. For spectrum.c, spread.c and frf*.c only. */
#ifndef GSID_STREAMING_H
#define GSID_STREAMING_H

#include "gsid/frf.h"

#include "complex_math.h"

#define gsid_spectrum_sum GSID_NAME(gsid_spectrum_sum)
#define gsid_spectrum_clear GSID_NAME(gsid_spectrum_clear)
#define gsid_spread_slice GSID_NAME(gsid_spread_slice)
#define gsid_spread_end GSID_NAME(gsid_spread_end)
#define gsid_spread_pass GSID_NAME(gsid_spread_pass)
#define gsid_frf_size_with GSID_NAME(gsid_frf_size_with)
#define gsid_frf_init_with GSID_NAME(gsid_frf_init_with)
#define gsid_frf_add_measured GSID_NAME(gsid_frf_add_measured)
#define gsid_frf_leave_out GSID_NAME(gsid_frf_leave_out)

/* As gsid_spectrum_step, without its checks: the arguments are valid and the period is not complete yet. y is the first
 * channel, u the second; with one channel u is ignored. */
gsid_status gsid_spectrum_sum(gsid_spectrum *s, gsid_real u, gsid_real y);
void gsid_spectrum_clear(gsid_spectrum *s);

/* FRF-1: one term of one line; and its exp(j 2 pi k n / N), after which the phase is advanced. */
static inline gsid_cplx gsid_spectrum_add(gsid_cplx sum, gsid_real x, gsid_cplx w) {
    return gsid_cplx_make(sum.re + x * w.re, sum.im - x * w.im);
}

static inline gsid_cplx gsid_spectrum_turn(uint32_t n_period, const gsid_cplx *twiddle, uint32_t line, uint32_t *at) {
    const gsid_cplx w = twiddle[*at];
    const uint32_t phase = *at + line;
    *at = phase >= n_period ? phase - n_period : phase;
    return w;
}

/* The parts of gsid_spread_step, for a valid object. First: one slice of the transform, if any is left. Always returns GSID_OK,
 * so that a tick can end by returning it. */
gsid_status gsid_spread_slice(gsid_spread *s);

/* Store one sample. Returns nonzero at the last sample of a period: call gsid_spread_end then. */
static inline int gsid_spread_put(gsid_spread *s, gsid_real u, gsid_real y) {
    const uint32_t n_period = s->cfg.n_period, next = s->next;
    gsid_real *place = s->filling + next;
    place[0] = y;
    if (s->cfg.n_channels == 2) {
        place[n_period] = u;
    }
    s->next = next + 1 < n_period ? next + 1 : 0;
    return s->next == s->cfg.n_first;
}

/* Samples of this period so far. */
static inline uint32_t gsid_spread_n(const gsid_spread *s) {
    return s->next >= s->cfg.n_first ? s->next - s->cfg.n_first : s->next + s->cfg.n_period - s->cfg.n_first;
}

/* Begin the transform of the period and return GSID_OK; or GSID_SPOILED if samples of it are missing. */
gsid_status gsid_spread_end(gsid_spread *s);

/* Account for lost samples. Returns GSID_SPOILED if the end of a period was passed. */
gsid_status gsid_spread_pass(gsid_spread *s, uint32_t n_samples);

/* FRF-3, real samples: a line, neither 0 nor N/2, of a complete transform Z of x[2m] + j x[2m+1]. With * the mirror image
 * conj(Z(N/2 - k)), N X(k) = (Z + Z*) - j exp(-j 2 pi k / N) (Z - Z*).
 *  work   the channel's transform
 *  place  of Z(k) and of Z(N/2 - k) there
 *  turn   exp(j 2 pi k / N) */
static inline gsid_cplx gsid_spread_read(const gsid_cplx *work, const uint32_t *place, gsid_cplx turn,
                                         gsid_real scale) {
    const gsid_cplx z = work[place[0]], mirror = gsid_cplx_conj(work[place[1]]);
    const gsid_cplx odd = gsid_cplx_mul_conj(gsid_cplx_sub(z, mirror), turn);
    return gsid_cplx_scale(scale, gsid_cplx_minus_j(gsid_cplx_add(z, mirror), odd));
}

/* An engine: it computes lines from samples. It is reached through a pointer, so that the linker leaves out the one that is not
 * used. */
struct gsid_frf_engine {
    size_t (*mem_size)(const gsid_spectrum_cfg *cfg); /* 0: refused */
    gsid_status (*init)(gsid_frf *frf, const gsid_spectrum_cfg *cfg, void *mem, size_t mem_size);
    gsid_status (*step)(gsid_frf *frf, gsid_real u, gsid_real y);
    gsid_status (*skip)(gsid_frf *frf, uint32_t n_samples);
    gsid_status (*finish)(gsid_frf *frf);
};

size_t gsid_frf_size_with(const struct gsid_frf_engine *engine, const gsid_frf_cfg *cfg);
gsid_status gsid_frf_init_with(const struct gsid_frf_engine *engine, gsid_frf *frf, const gsid_frf_cfg *cfg, void *mem,
                               size_t mem_size);

static inline uint32_t gsid_frf_channels(const gsid_frf_cfg *cfg) {
    return cfg->u_known == NULL ? 2 : 1;
}

/* The weight of one period in the mean of n_periods. */
static inline gsid_real gsid_frf_share(uint32_t n_periods) {
    return GSID_R(1.0) / (gsid_real)n_periods;
}

/* FRF-2, with d the distance of the new period from the old mean. No difference of two large sums is formed, as it would be
 * with sums of squares. */
static inline gsid_cplx gsid_frf_welford(gsid_real share, gsid_cplx x, gsid_cplx *mean, gsid_real *m2) {
    const gsid_cplx d = gsid_cplx_sub(x, *mean);
    *mean = gsid_cplx_add(*mean, gsid_cplx_scale(share, d));
    *m2 += gsid_cplx_abs2(d) * (GSID_R(1.0) - share);
    return d;
}

/* FRF-2, the covariance of line i where the input is measured: d of y and u, as gsid_frf_welford gives them. */
static inline void gsid_frf_add_product(gsid_real share, const gsid_cplx *d, gsid_cplx *cross) {
    *cross = gsid_cplx_add(*cross, gsid_cplx_scale(GSID_R(1.0) - share, gsid_cplx_mul_conj(d[0], d[1])));
}

/* The last sample of a period of which others are missing. Not static, so that it is not copied into the ticks that lead to it. */
gsid_status gsid_frf_leave_out(gsid_frf *frf, gsid_real u, gsid_real y);

/* Let line i enter the means where the input is measured. */
void gsid_frf_add_measured(gsid_frf *frf, gsid_real share, uint32_t i, gsid_cplx y, gsid_cplx u);

#endif
