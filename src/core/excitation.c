#include "gsid/excitation.h"

#include "complex_math.h"
#include "real.h"
#include "splitmix.h"

/* cos and sin of (pi/4) r / n_period, 0 <= r <= n_period. The angle is carried as a rounded value and its rounding
 * error, which enters to first order: a float angle alone would cost the table two more units in the last place. */
static gsid_cplx unit_at_eighth(uint32_t r, uint32_t n_period) {
#ifdef GSID_SINGLE
    const gsid_real quarter_pi = GSID_R(0.785398185), quarter_pi_rest = GSID_R(-2.18556941e-8);
#else
    const gsid_real quarter_pi = GSID_R(0.78539816339744831), quarter_pi_rest = GSID_R(3.0616169978683830e-17);
#endif
    if (r == n_period) { /* both exactly equal, or conjugate entries of the table would not be */
        return gsid_cplx_make(GSID_R(0.70710678118654752440), GSID_R(0.70710678118654752440));
    }
    const gsid_real over = (gsid_real)r, under = (gsid_real)n_period;
    const gsid_real ratio = over / under;
    /* Rounding errors of r, n_period and their quotient; the first two only in float, beyond 24 bits. */
    const gsid_real over_rest = (gsid_real)((int32_t)r - (int32_t)over);
    const gsid_real under_rest = (gsid_real)((int32_t)n_period - (int32_t)under);
    const gsid_real ratio_rest = (gsid_fma(-ratio, under, over) + (over_rest - ratio * under_rest)) / under;

    const gsid_real angle = quarter_pi * ratio;
    const gsid_real angle_rest =
        gsid_fma(quarter_pi, ratio, -angle) + quarter_pi * ratio_rest + quarter_pi_rest * ratio;

    return gsid_cplx_cis_octant(angle, angle_rest);
}

gsid_status gsid_twiddle_fill(uint32_t n_period, gsid_cplx *table) {
    if (table == NULL) {
        return GSID_E_NULL;
    }
    if (n_period < 2 || n_period > GSID_N_PERIOD_MAX) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < n_period; i++) {
        uint64_t eighths = (uint64_t)8 * i;
        uint32_t octant = (uint32_t)(eighths / n_period);
        uint32_t r = (uint32_t)(eighths % n_period);
        gsid_cplx z = unit_at_eighth(octant % 2 == 0 ? r : n_period - r, n_period);
        /* Octants 1, 2, 5, 6 lie nearer the imaginary axis, 2 to 5 left of it, 4 to 7 below the real one. */
        const int is_steep = ((octant + 1) & 2) != 0;
        const gsid_real re = is_steep ? z.im : z.re, im = is_steep ? z.re : z.im;
        table[i] = gsid_cplx_make(((octant + 2) & 4) != 0 ? -re : re, (octant & 4) != 0 ? -im : im);
    }
    return GSID_OK;
}

gsid_status gsid_lines_fill(gsid_grid grid, uint32_t line_lo, uint32_t line_hi, uint32_t capacity, uint32_t *line,
                            uint32_t *n_lines) {
    if (n_lines == NULL) {
        return GSID_E_NULL;
    }
    if ((grid != GSID_GRID_FULL && grid != GSID_GRID_ODD) || line_lo < 1 || line_hi < line_lo) {
        return GSID_E_CONFIG;
    }
    uint32_t step = grid == GSID_GRID_ODD ? 2 : 1;
    uint32_t first = grid == GSID_GRID_ODD ? line_lo | 1u : line_lo;
    if (first > line_hi) {
        return GSID_E_CONFIG;
    }
    uint32_t n = (line_hi - first) / step + 1;
    if (line != NULL) {
        if (capacity < n) {
            return GSID_E_MEMORY;
        }
        for (uint32_t i = 0; i < n; i++) {
            line[i] = first + i * step;
        }
    }
    *n_lines = n;
    return GSID_OK;
}

static int is_ascending(uint32_t n_lines, const uint32_t *line) {
    for (uint32_t i = 1; i < n_lines; i++) {
        if (line[i] <= line[i - 1]) {
            return 0;
        }
    }
    return line[0] >= 1;
}

gsid_status gsid_amplitude_shape(uint32_t n_lines, const uint32_t *line, gsid_real db_per_decade,
                                 gsid_real *amplitude) {
    if (line == NULL || amplitude == NULL) {
        return GSID_E_NULL;
    }
    if (n_lines < 1 || !is_ascending(n_lines, line)) {
        return GSID_E_CONFIG;
    }
    gsid_real first = (gsid_real)line[0], power = db_per_decade / GSID_R(20.0);
    /* The slope is monotonic, so the last line is the largest or the smallest of all. */
    if (!gsid_is_finite(gsid_pow((gsid_real)line[n_lines - 1] / first, power))) {
        return GSID_E_NONFINITE;
    }
    for (uint32_t i = 0; i < n_lines; i++) {
        amplitude[i] = gsid_pow((gsid_real)line[i] / first, power);
    }
    return GSID_OK;
}

static gsid_real phase_from_turns(gsid_real turns) {
    return turns < GSID_R(1.0) ? GSID_TWO_PI * turns : GSID_R(0.0);
}

gsid_status gsid_phase_schroeder(uint32_t n_lines, const gsid_real *amplitude, gsid_real *phase_rad) {
    if (amplitude == NULL || phase_rad == NULL) {
        return GSID_E_NULL;
    }
    if (n_lines < 1) {
        return GSID_E_CONFIG;
    }
    gsid_real largest = GSID_R(0.0);
    for (uint32_t i = 0; i < n_lines; i++) {
        if (!gsid_is_finite(amplitude[i])) {
            return GSID_E_NONFINITE;
        }
        if (amplitude[i] < GSID_R(0.0)) {
            return GSID_E_CONFIG;
        }
        largest = amplitude[i] > largest ? amplitude[i] : largest;
    }
    if (largest <= GSID_R(0.0)) {
        return GSID_E_CONFIG;
    }
    gsid_real total = GSID_R(0.0);
    for (uint32_t i = 0; i < n_lines; i++) {
        total += (amplitude[i] / largest) * (amplitude[i] / largest);
    }
    /* EXC-2. sum_{l<k} (k - l) p_l is the running sum of the running sum of p; whole turns are dropped on the way, so
     * that the fraction of a turn keeps its digits. */
    gsid_real power = GSID_R(0.0), turns = GSID_R(0.0);
    for (uint32_t i = 0; i < n_lines; i++) {
        gsid_real a = amplitude[i] / largest; /* read before the write: amplitude and phase_rad may be one array */
        phase_rad[i] = phase_from_turns(GSID_R(1.0) - turns);
        power += a * a;
        turns += power / total;
        turns -= gsid_floor(turns);
    }
    return GSID_OK;
}

gsid_status gsid_phase_random(uint32_t n_lines, uint64_t seed, gsid_real *phase_rad) {
    if (phase_rad == NULL) {
        return GSID_E_NULL;
    }
    if (n_lines < 1) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < n_lines; i++) {
        /* EXC-3. The leading bits only, as many as the precision holds: rounding could reach a whole turn. */
#ifdef GSID_SINGLE
        phase_rad[i] = phase_from_turns((gsid_real)(gsid_splitmix64(&seed) >> 40) * GSID_R(0x1p-24));
#else
        phase_rad[i] = phase_from_turns((gsid_real)(gsid_splitmix64(&seed) >> 11) * GSID_R(0x1p-53));
#endif
    }
    return GSID_OK;
}

gsid_status gsid_multisine_init(gsid_multisine *m, const gsid_multisine_cfg *cfg) {
    if (m == NULL || cfg == NULL || cfg->line == NULL || cfg->amplitude == NULL || cfg->phase_rad == NULL ||
        cfg->twiddle == NULL) {
        return GSID_E_NULL;
    }
    if (cfg->n_period < 2 || cfg->n_period > GSID_N_PERIOD_MAX || cfg->n_lines < 1 ||
        !is_ascending(cfg->n_lines, cfg->line) || cfg->line[cfg->n_lines - 1] >= (cfg->n_period + 1) / 2) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < cfg->n_lines; i++) {
        if (!gsid_is_finite(cfg->amplitude[i]) || !gsid_is_finite(cfg->phase_rad[i])) {
            return GSID_E_NONFINITE;
        }
    }
    m->cfg = *cfg;
    m->n = 0;
    return GSID_OK;
}

static gsid_cplx line_of(const gsid_multisine_cfg *cfg, uint32_t i) {
    return gsid_cplx_scale(cfg->amplitude[i], gsid_cplx_cis(cfg->phase_rad[i]));
}

/* Re(a w) = amplitude cos(2 pi k n / N + phase): the one expression behind both the stream and the table. */
static gsid_real real_product(gsid_cplx a, gsid_cplx w) {
    return a.re * w.re - a.im * w.im;
}

gsid_status gsid_multisine_step(gsid_multisine *m, gsid_real *u) {
    if (m == NULL || u == NULL) {
        return GSID_E_NULL;
    }
    const gsid_multisine_cfg *cfg = &m->cfg;
    if (cfg->line == NULL) {
        return GSID_E_STATE;
    }
    gsid_real sum = GSID_R(0.0); /* EXC-1 */
    for (uint32_t i = 0; i < cfg->n_lines; i++) {
        uint32_t phase = (uint32_t)((uint64_t)cfg->line[i] * m->n % cfg->n_period);
        sum += real_product(line_of(cfg, i), cfg->twiddle[phase]);
    }
    *u = sum;
    m->n++;
    if (m->n < cfg->n_period) {
        return GSID_OK;
    }
    m->n = 0;
    return GSID_DONE;
}

gsid_status gsid_multisine_table(const gsid_multisine *m, gsid_real *u) {
    if (m == NULL || u == NULL) {
        return GSID_E_NULL;
    }
    const gsid_multisine_cfg *cfg = &m->cfg;
    if (cfg->line == NULL) {
        return GSID_E_STATE;
    }
    for (uint32_t n = 0; n < cfg->n_period; n++) {
        u[n] = GSID_R(0.0);
    }
    /* Line by line, in the order in which gsid_multisine_step adds them: the same sums to the bit. */
    for (uint32_t i = 0; i < cfg->n_lines; i++) {
        gsid_cplx a = line_of(cfg, i);
        uint32_t phase = 0;
        for (uint32_t n = 0; n < cfg->n_period; n++) {
            u[n] += real_product(a, cfg->twiddle[phase]);
            phase += cfg->line[i];
            phase -= phase >= cfg->n_period ? cfg->n_period : 0;
        }
    }
    return GSID_OK;
}

gsid_status gsid_multisine_spectrum(const gsid_multisine *m, gsid_cplx *spectrum) {
    if (m == NULL || spectrum == NULL) {
        return GSID_E_NULL;
    }
    if (m->cfg.line == NULL) {
        return GSID_E_STATE;
    }
    for (uint32_t i = 0; i < m->cfg.n_lines; i++) {
        spectrum[i] = line_of(&m->cfg, i);
    }
    return GSID_OK;
}

gsid_status gsid_sine_init(gsid_sine *sine, uint32_t n_period, uint32_t line, gsid_real amplitude, gsid_real phase_rad,
                           const gsid_cplx *twiddle) {
    if (sine == NULL || twiddle == NULL) {
        return GSID_E_NULL;
    }
    if (n_period < 2 || n_period > GSID_N_PERIOD_MAX || line > n_period / 2) {
        return GSID_E_CONFIG;
    }
    if (!gsid_is_finite(amplitude) || !gsid_is_finite(phase_rad)) {
        return GSID_E_NONFINITE;
    }
    sine->n_period = n_period;
    sine->line = line;
    sine->phase = 0;
    sine->amplitude = gsid_cplx_scale(amplitude, gsid_cplx_cis(phase_rad));
    sine->twiddle = twiddle;
    return GSID_OK;
}

gsid_status gsid_sine_step(gsid_sine *sine, gsid_real *u) {
    if (sine == NULL || u == NULL) {
        return GSID_E_NULL;
    }
    if (sine->twiddle == NULL) {
        return GSID_E_STATE;
    }
    *u = real_product(sine->amplitude, sine->twiddle[sine->phase]); /* EXC-1 */
    const uint32_t phase = sine->phase + sine->line;
    sine->phase = phase >= sine->n_period ? phase - sine->n_period : phase;
    return GSID_OK;
}
