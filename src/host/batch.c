#include "gsid/host/batch.h"

#include <math.h>
#include <stdlib.h>

#include "backend/backend.h"
#include "gsid/excitation.h"

/* 0 times a number that is not finite is not 0. Four sums at a time: one waits for itself, a branch a sample costs more. */
static int is_all_finite(size_t n, const double *x) {
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    size_t i = 0;
    for (; i + 4 <= n; i += 4) {
        for (size_t j = 0; j < 4; j++) {
            sum[j] += 0.0 * x[i + j];
        }
    }
    for (; i < n; i++) {
        sum[0] += 0.0 * x[i];
    }
    return isfinite(sum[0] + sum[1] + sum[2] + sum[3]);
}

static gsid_status check(uint32_t n_periods, uint32_t n_period, const double *x, uint32_t n_lines, const uint32_t *line,
                         const gsid_cplx *lines) {
    if (x == NULL || line == NULL || lines == NULL) {
        return GSID_E_NULL;
    }
    if (n_periods < 1 || n_lines < 1 || n_period < 2 || n_period > UINT32_C(1) << 30) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < n_lines; i++) {
        if (line[i] > n_period / 2) {
            return GSID_E_CONFIG;
        }
    }
    return is_all_finite((size_t)n_periods * n_period, x) ? GSID_OK : GSID_E_NONFINITE;
}

static gsid_status by_given(const gsid_transform *given, uint32_t n_periods, uint32_t n_period, const double *x,
                            uint32_t n_lines, const uint32_t *line, gsid_cplx *lines) {
    gsid_cplx *all = malloc(((size_t)n_period / 2 + 1) * sizeof *all);
    if (all == NULL) {
        return GSID_E_NO_MEMORY;
    }
    for (uint32_t p = 0; p < n_periods; p++) {
        given->to_lines(n_period, x + (size_t)p * n_period, all);
        gsid_cplx *of_period = lines + (size_t)p * n_lines;
        for (uint32_t i = 0; i < n_lines; i++) {
            const uint32_t k = line[i];
            const double scale = k == 0 || 2 * k == n_period ? 1.0 / n_period : 2.0 / n_period;
            of_period[i] = (gsid_cplx){scale * all[k].re, scale * all[k].im};
        }
    }
    free(all);
    return GSID_OK;
}

#ifdef GSID_WITH_FFTW

static gsid_status by_build(uint32_t n_periods, uint32_t n_period, const double *x, uint32_t n_lines,
                            const uint32_t *line, gsid_cplx *lines) {
    return gsid_fftw_lines(n_periods, n_period, x, n_lines, line, lines);
}

#else

static gsid_status by_build(uint32_t n_periods, uint32_t n_period, const double *x, uint32_t n_lines,
                            const uint32_t *line, gsid_cplx *lines) {
    gsid_status status = GSID_OK;
    gsid_cplx *twiddle = malloc(n_period * sizeof *twiddle);
    size_t mem_size = GSID_SPECTRUM_MEM_SIZE(n_lines, 1);
    void *mem = malloc(mem_size);
    if (twiddle != NULL && mem != NULL) {
        gsid_twiddle_fill(n_period, twiddle);
        gsid_spectrum_cfg cfg = {
            .n_period = n_period, .n_lines = n_lines, .n_channels = 1, .line = line, .twiddle = twiddle};
        gsid_spectrum s;
        gsid_spectrum_init(&s, &cfg, mem, mem_size);
        for (uint32_t p = 0; p < n_periods; p++) {
            for (uint32_t n = 0; n < n_period; n++) {
                gsid_spectrum_step(&s, x + (size_t)p * n_period + n);
            }
            gsid_spectrum_result(&s, lines + (size_t)p * n_lines);
        }
    } else {
        status = GSID_E_NO_MEMORY;
    }
    free(mem);
    free(twiddle);
    return status;
}

#endif

gsid_status gsid_batch_spectra(uint32_t n_periods, uint32_t n_period, const double *x, uint32_t n_lines,
                               const uint32_t *line, gsid_cplx *lines) {
    gsid_status status = check(n_periods, n_period, x, n_lines, line, lines);
    if (status != GSID_OK) {
        return status;
    }
    const gsid_transform *given = gsid_transform_given();
    return given != NULL ? by_given(given, n_periods, n_period, x, n_lines, line, lines)
                         : by_build(n_periods, n_period, x, n_lines, line, lines);
}

/* Non-finite samples are found before the first one is taken, so that a refused block leaves the object as it was. */
static int is_block_finite(const gsid_frf *frf, size_t n, const double *u, const double *y, const uint8_t *valid) {
    for (size_t i = 0; i < n; i++) {
        int counts = valid == NULL || valid[i];
        if (counts && (!isfinite(y[i]) || (frf->cfg.u_known == NULL && !isfinite(u[i])))) {
            return 0;
        }
    }
    return 1;
}

gsid_status gsid_batch_frf_step(gsid_frf *frf, size_t n, const double *u, const double *y, const uint8_t *valid) {
    if (frf == NULL || u == NULL || y == NULL) {
        return GSID_E_NULL;
    }
    if (frf->mean == NULL) {
        return GSID_E_STATE;
    }
    if (!is_block_finite(frf, n, u, y, valid)) {
        return GSID_E_NONFINITE;
    }
    for (size_t i = 0; i < n; i++) {
        if (valid == NULL || valid[i]) {
            gsid_frf_step(frf, u[i], y[i]);
        } else {
            gsid_frf_skip(frf, 1);
        }
    }
    return GSID_OK;
}

gsid_status gsid_batch_rational_gradient(const gsid_rational *model, uint32_t n_freq, const double *f_hz, gsid_cplx *g,
                                         gsid_cplx *gradient) {
    if (model == NULL || (n_freq > 0 && (f_hz == NULL || g == NULL || gradient == NULL))) {
        return GSID_E_NULL;
    }
    gsid_status status = GSID_OK;
    for (uint32_t k = 0; k < n_freq && status == GSID_OK; k++) {
        const size_t row = (size_t)k * (model->n_poles + model->n_zeros + 2);
        status = gsid_rational_gradient(model, f_hz[k], g + k, gradient + row);
    }
    return status;
}
