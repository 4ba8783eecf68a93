#include "gsid/spread.h"

#include "complex_math.h"
#include "streaming.h"

/* Instructions of a Cortex-M7 for a butterfly of each radix (the index), and for a tick that adds a line to a mean. Only their ratios
 * matter. */
static const uint16_t cost_of[8] = {0, 0, 36, 61, 71, 112, 0, 450};
enum { COST_LINE = 90 };

/* ---- the plan: which butterflies, and how many of them in a tick ---- */

/* Radices of a transform of n points, fours before anything else: per point they are the cheapest. 0 when a prime factor
 * above 7 is left. */
static uint32_t factorise(uint32_t n, uint8_t *radix) {
    static const uint8_t radices[5] = {4, 2, 3, 5, 7};
    uint32_t n_stages = 0;
    for (uint32_t i = 0; i < 5; i++) {
        for (; n % radices[i] == 0; n /= radices[i]) {
            radix[n_stages++] = radices[i];
        }
    }
    return n == 1 ? n_stages : 0;
}

static uint32_t times_in(uint32_t cost, uint32_t budget) {
    return (budget + cost / 2) / cost;
}

static uint32_t ticks_for(uint32_t n, uint32_t per_tick) {
    return (n + per_tick - 1) / per_tick;
}

/* Slices of about `budget` instructions each: sets per_tick, n_ticks, lines_per_tick. Returns the ticks of all. */
static uint32_t plan(gsid_spread *s, uint32_t budget) {
    const uint32_t n_points = s->cfg.n_channels * (s->cfg.n_period / 2);
    s->n_ticks = 0;
    for (uint32_t i = 0; i < s->n_stages; i++) {
        const uint32_t per_tick = times_in(cost_of[s->radix[i]], budget);
        s->per_tick[i] = (uint8_t)per_tick;
        s->n_ticks += ticks_for(n_points / s->radix[i], per_tick);
    }
    s->lines_per_tick = times_in(COST_LINE * s->cfg.n_channels, budget);
    s->n_ticks += s->n_stages; /* one from each stage to the next: see next_stage */
    return s->n_ticks + ticks_for(s->cfg.n_lines, s->lines_per_tick);
}

/* The smallest slices whose work is done in less than a period. A slice is no smaller than one butterfly or one line, plus half
 * of the cheapest butterfly, because whole numbers of the cheap ones fall short of the budget more often than they exceed it. */
static void make_plan(gsid_spread *s) {
    uint32_t budget = COST_LINE * s->cfg.n_channels;
    for (uint32_t i = 0; i < s->n_stages; i++) {
        const uint32_t cost = cost_of[s->radix[i]];
        budget = cost > budget ? cost : budget;
    }
    budget += cost_of[2] / 2;
    while (plan(s, budget) >= s->cfg.n_period) {
        budget += cost_of[2];
    }
}

/* Where the transform leaves line k of n_points: the digits of k in the radices of the stages, in reverse. */
static uint32_t place_of(const gsid_spread *s, uint32_t k) {
    uint32_t place = 0, span = s->cfg.n_period / 2;
    for (uint32_t i = 0; i < s->n_stages; i++) {
        const uint32_t radix = s->radix[i];
        span /= radix;
        place += k % radix * span;
        k /= radix;
    }
    return place;
}

/* ---- set-up ---- */

static gsid_status check_cfg(const gsid_spectrum_cfg *cfg) {
    if (cfg == NULL || cfg->line == NULL || cfg->twiddle == NULL) {
        return GSID_E_NULL;
    }
    uint8_t radix[GSID_SPREAD_STAGES_MAX];
    if (gsid_spectrum_mem_size(cfg) == 0 || cfg->n_period < 4 || cfg->n_period % 2 != 0 ||
        cfg->n_lines > cfg->n_period / 2 + 1 || factorise(cfg->n_period / 2, radix) == 0 ||
        cfg->n_period > SIZE_MAX / GSID_SPREAD_MEM_SIZE(1, 1, cfg->n_channels)) {
        return GSID_E_CONFIG;
    }
    return GSID_OK;
}

size_t gsid_spread_mem_size(const gsid_spectrum_cfg *cfg) {
    return check_cfg(cfg) == GSID_OK ? GSID_SPREAD_MEM_SIZE(cfg->n_period, cfg->n_lines, cfg->n_channels) : 0;
}

gsid_status gsid_spread_init(gsid_spread *s, const gsid_spectrum_cfg *cfg, void *mem, size_t mem_size) {
    if (s == NULL || mem == NULL) {
        return GSID_E_NULL;
    }
    gsid_status status = check_cfg(cfg);
    if (status == GSID_OK) {
        status = gsid_check_build();
    }
    if (status != GSID_OK) {
        return status;
    }
    if (mem_size < GSID_SPREAD_MEM_SIZE(cfg->n_period, cfg->n_lines, cfg->n_channels) || !gsid_is_aligned(mem)) {
        return GSID_E_MEMORY;
    }
    const uint32_t n_points = cfg->n_period / 2;
    s->cfg = *cfg;
    s->work = (gsid_cplx *)mem;
    s->filling = &s->work[cfg->n_channels * n_points].re;
    s->place = (uint32_t (*)[2])(void *)(s->work + 2 * (size_t)cfg->n_channels * n_points);
    s->scale = GSID_R(1.0) / (gsid_real)cfg->n_period;
    s->n_stages = factorise(n_points, s->radix);
    make_plan(s);
    for (uint32_t i = 0; i < cfg->n_lines; i++) {
        const uint32_t line[2] = {cfg->line[i], n_points - cfg->line[i]};
        for (uint32_t mirrored = 0; mirrored < 2; mirrored++) {
            s->place[i][mirrored] = place_of(s, line[mirrored] % n_points);
        }
    }
    return gsid_spread_reset(s);
}

gsid_status gsid_spread_reset(gsid_spread *s) {
    if (s == NULL) {
        return GSID_E_NULL;
    }
    if (s->work == NULL) {
        return GSID_E_STATE;
    }
    s->next = s->cfg.n_first;
    s->has_gap = 0;
    s->has_lines = 0;
    s->stage = s->n_stages;
    return GSID_OK;
}

/* ---- butterflies: x[q span] <- sum over p of x[p span] exp(-j 2 pi p q / r), times conj(w[q step]) ---- */

static void butterfly_2(const gsid_spread *s, gsid_cplx *x, uint32_t step) {
    const gsid_cplx *w = s->cfg.twiddle;
    const uint32_t span = s->span;
    const gsid_cplx a = x[0], b = x[span];
    x[0] = gsid_cplx_add(a, b);
    x[span] = gsid_cplx_mul_conj(gsid_cplx_sub(a, b), w[step]);
}

static void butterfly_3(const gsid_spread *s, gsid_cplx *x, uint32_t step) {
    const gsid_real sin_1 = GSID_R(0.86602540378443864676);
    const gsid_cplx *w = s->cfg.twiddle;
    const uint32_t span = s->span;
    gsid_cplx *x1 = x + span, *x2 = x1 + span;
    const gsid_cplx sum = gsid_cplx_add(*x1, *x2), even = gsid_cplx_sub(*x, gsid_cplx_scale(GSID_R(0.5), sum));
    const gsid_cplx odd = gsid_cplx_scale(sin_1, gsid_cplx_sub(*x1, *x2));
    *x = gsid_cplx_add(*x, sum);
    *x1 = gsid_cplx_mul_conj(gsid_cplx_minus_j(even, odd), w[step]);
    *x2 = gsid_cplx_mul_conj(gsid_cplx_plus_j(even, odd), w[2 * step]);
}

static void butterfly_4(const gsid_spread *s, gsid_cplx *x, uint32_t step) {
    const gsid_cplx *w = s->cfg.twiddle;
    const uint32_t span = s->span;
    gsid_cplx *x1 = x + span, *x2 = x1 + span, *x3 = x2 + span;
    const gsid_cplx sum_02 = gsid_cplx_add(*x, *x2), sum_13 = gsid_cplx_add(*x1, *x3);
    const gsid_cplx diff_02 = gsid_cplx_sub(*x, *x2), diff_13 = gsid_cplx_sub(*x1, *x3);
    *x = gsid_cplx_add(sum_02, sum_13);
    *x1 = gsid_cplx_mul_conj(gsid_cplx_minus_j(diff_02, diff_13), w[step]);
    *x2 = gsid_cplx_mul_conj(gsid_cplx_sub(sum_02, sum_13), w[2 * step]);
    *x3 = gsid_cplx_mul_conj(gsid_cplx_plus_j(diff_02, diff_13), w[3 * step]);
}

/* c1 a + c2 b */
static gsid_cplx mix_2(gsid_real c1, gsid_cplx a, gsid_real c2, gsid_cplx b) {
    return gsid_cplx_make(c1 * a.re + c2 * b.re, c1 * a.im + c2 * b.im);
}

static void butterfly_5(const gsid_spread *s, gsid_cplx *x, uint32_t step) {
    const gsid_cplx *w = s->cfg.twiddle;
    const uint32_t span = s->span;
    const gsid_real cos_1 = GSID_R(0.30901699437494742410), cos_2 = GSID_R(-0.80901699437494742410);
    const gsid_real sin_1 = GSID_R(0.95105651629515357212), sin_2 = GSID_R(0.58778525229247312917);
    gsid_cplx *x1 = x + span, *x2 = x1 + span, *x3 = x2 + span, *x4 = x3 + span;
    const gsid_cplx sum_14 = gsid_cplx_add(*x1, *x4), sum_23 = gsid_cplx_add(*x2, *x3);
    const gsid_cplx diff_14 = gsid_cplx_sub(*x1, *x4), diff_23 = gsid_cplx_sub(*x2, *x3);
    const gsid_cplx even_1 = gsid_cplx_add(*x, mix_2(cos_1, sum_14, cos_2, sum_23));
    const gsid_cplx even_2 = gsid_cplx_add(*x, mix_2(cos_2, sum_14, cos_1, sum_23));
    const gsid_cplx odd_1 = mix_2(sin_1, diff_14, sin_2, diff_23);
    const gsid_cplx odd_2 = mix_2(sin_2, diff_14, -sin_1, diff_23);
    *x = gsid_cplx_add(*x, gsid_cplx_add(sum_14, sum_23));
    *x1 = gsid_cplx_mul_conj(gsid_cplx_minus_j(even_1, odd_1), w[step]);
    *x2 = gsid_cplx_mul_conj(gsid_cplx_minus_j(even_2, odd_2), w[2 * step]);
    *x3 = gsid_cplx_mul_conj(gsid_cplx_plus_j(even_2, odd_2), w[3 * step]);
    *x4 = gsid_cplx_mul_conj(gsid_cplx_plus_j(even_1, odd_1), w[4 * step]);
}

/* In loops, to keep its code small: this butterfly is the rarest and by far the costliest. */
static void butterfly_7(const gsid_spread *s, gsid_cplx *x, uint32_t step) {
    const gsid_cplx *w = s->cfg.twiddle;
    const uint32_t n_period = s->cfg.n_period, radix = 7, span = s->span;
    const uint32_t part = n_period / radix; /* of a turn */
    gsid_cplx sum[4], diff[4];
    const gsid_cplx first = x[0];
    for (uint32_t p = 1; 2 * p < radix; p++) {
        const gsid_cplx a = x[p * span], b = x[(radix - p) * span];
        sum[p] = gsid_cplx_add(a, b);
        diff[p] = gsid_cplx_sub(a, b);
        x[0] = gsid_cplx_add(x[0], sum[p]);
    }
    for (uint32_t q = 1; 2 * q < radix; q++) {
        gsid_cplx even = first, odd = gsid_cplx_make(GSID_R(0.0), GSID_R(0.0));
        for (uint32_t p = 1, at = q * part; 2 * p < radix; p++) {
            even = gsid_cplx_add(even, gsid_cplx_scale(w[at].re, sum[p]));
            odd = gsid_cplx_add(odd, gsid_cplx_scale(w[at].im, diff[p]));
            at += q * part;
            at -= at >= n_period ? n_period : 0;
        }
        x[q * span] = gsid_cplx_mul_conj(gsid_cplx_minus_j(even, odd), w[q * step]);
        x[(radix - q) * span] = gsid_cplx_mul_conj(gsid_cplx_plus_j(even, odd), w[(radix - q) * step]);
    }
}

static void (*const butterfly_of[8])(const gsid_spread *s, gsid_cplx *x, uint32_t step) = {
    NULL, NULL, butterfly_2, butterfly_3, butterfly_4, butterfly_5, NULL, butterfly_7};

/* ---- the slices ---- */

static void begin_stage(gsid_spread *s, uint32_t stage) {
    const uint32_t radix = s->radix[stage];
    s->stage = stage;
    s->butterfly = butterfly_of[radix];
    s->most = s->per_tick[stage];
    s->span /= radix;
    s->gap = s->span * (radix - 1);
    s->at = s->work;
    s->offset = 0;
    s->left = s->cfg.n_channels * (s->cfg.n_period / 2) / radix;
}

/* Takes a tick of its own, so that no tick has to do this and a slice. */
static void next_stage(gsid_spread *s) {
    if (s->stage + 1 < s->n_stages) {
        s->stride *= s->radix[s->stage];
        begin_stage(s, s->stage + 1);
    } else {
        s->stage = s->n_stages;
        s->has_lines = 1;
    }
}

/* FRF-3, decimation in frequency: some butterflies of the stage under way. Both channels are blocks of one array. */
gsid_status gsid_spread_slice(gsid_spread *s) {
    if (s->left == 0) {
        next_stage(s);
        return GSID_OK;
    }
    const uint32_t span = s->span, stride = s->stride;
    uint32_t n = s->most < s->left ? s->most : s->left, offset = s->offset;
    gsid_cplx *x = s->at;
    s->left -= n;
    do {
        s->butterfly(s, x++, offset * stride);
        if (++offset == span) {
            offset = 0;
            x += s->gap;
        }
    } while (--n > 0);
    s->at = x;
    s->offset = offset;
    return GSID_OK;
}

/* ---- the samples ---- */

/* Swap the buffers, unless samples are missing from the one that was filled. */
gsid_status gsid_spread_end(gsid_spread *s) {
    s->has_lines = 0;
    if (s->has_gap) {
        s->has_gap = 0;
        return GSID_SPOILED;
    }
    gsid_real *filled = s->filling;
    s->filling = &s->work->re;
    s->work = (gsid_cplx *)(void *)filled;
    s->stride = 2;
    s->span = s->cfg.n_period / 2;
    begin_stage(s, 0);
    return GSID_OK;
}

gsid_status gsid_spread_pass(gsid_spread *s, uint32_t n_samples) {
    const uint32_t n_period = s->cfg.n_period, rest = n_samples % n_period; /* no sum passes 2^31 */
    const uint32_t n = gsid_spread_n(s) + rest;
    gsid_status status = GSID_OK;
    s->has_gap = s->has_gap || n_samples > 0;
    if (n_samples >= n_period || n >= n_period) {
        status = gsid_spread_end(s);
        s->has_gap = n % n_period > 0;
    }
    s->next = (s->next + rest) % n_period;
    return status;
}

/* n slices, or as many as are left; GSID_DONE when that completes the transform. */
static gsid_status slices(gsid_spread *s, uint32_t n) {
    gsid_status status = GSID_OK;
    for (; n > 0 && s->stage < s->n_stages; n--) {
        gsid_spread_slice(s);
        status = s->has_lines ? GSID_DONE : GSID_OK;
    }
    return status;
}

gsid_status gsid_spread_step(gsid_spread *s, const gsid_real *x) {
    if (s == NULL || x == NULL) {
        return GSID_E_NULL;
    }
    if (s->work == NULL) {
        return GSID_E_STATE;
    }
    const gsid_real x1 = s->cfg.n_channels == 2 ? x[1] : GSID_R(0.0);
    if (!gsid_is_finite(x[0]) || !gsid_is_finite(x1)) {
        return GSID_E_NONFINITE;
    }
    const gsid_status sliced = slices(s, 1);
    return gsid_spread_put(s, x1, x[0]) && gsid_spread_end(s) == GSID_SPOILED ? GSID_SPOILED : sliced;
}

gsid_status gsid_spread_skip(gsid_spread *s, uint32_t n_samples) {
    if (s == NULL) {
        return GSID_E_NULL;
    }
    if (s->work == NULL) {
        return GSID_E_STATE;
    }
    const gsid_status sliced = slices(s, n_samples);
    return gsid_spread_pass(s, n_samples) == GSID_SPOILED ? GSID_SPOILED : sliced;
}

gsid_status gsid_spread_finish(gsid_spread *s) {
    if (s == NULL) {
        return GSID_E_NULL;
    }
    if (s->work == NULL) {
        return GSID_E_STATE;
    }
    return slices(s, s->cfg.n_period);
}

gsid_status gsid_spread_line(const gsid_spread *s, uint32_t i, uint32_t channel, gsid_cplx *line) {
    if (s == NULL || line == NULL) {
        return GSID_E_NULL;
    }
    if (s->work == NULL || !s->has_lines) {
        return GSID_E_STATE;
    }
    if (i >= s->cfg.n_lines || channel >= s->cfg.n_channels) {
        return GSID_E_CONFIG;
    }
    const uint32_t k = s->cfg.line[i];
    const int is_single = k == 0 || 2 * k == s->cfg.n_period;
    const gsid_cplx *work = s->work + channel * (s->cfg.n_period / 2);
    *line = gsid_spread_read(work, s->place[i], s->cfg.twiddle[k], is_single ? s->scale / 2 : s->scale);
    return GSID_OK;
}
