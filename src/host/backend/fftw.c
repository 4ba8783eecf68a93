#include <fftw3.h>
#include <string.h>

#include "backend.h"

const char *gsid_fftw_version_str(void) {
    return fftw_version;
}

static void transform_periods(fftw_plan plan, double *in, const fftw_complex *out, uint32_t n_periods,
                              uint32_t n_period, const double *x, uint32_t n_lines, const uint32_t *line,
                              gsid_cplx *sums) {
    for (uint32_t p = 0; p < n_periods; p++) {
        memcpy(in, x + (size_t)p * n_period, n_period * sizeof *in);
        fftw_execute(plan);
        gsid_cplx *of_period = sums + (size_t)p * n_lines;
        for (uint32_t i = 0; i < n_lines; i++) {
            of_period[i].re = out[line[i]][0];
            of_period[i].im = out[line[i]][1];
        }
    }
}

gsid_status gsid_fftw_sums(uint32_t n_periods, uint32_t n_period, const double *x, uint32_t n_lines,
                           const uint32_t *line, gsid_cplx *sums) {
    /* One period's buffers stay in the cache, and the caller's samples, which the planner might overwrite, stay whole. */
    double *in = fftw_alloc_real(n_period);
    fftw_complex *out = fftw_alloc_complex(n_period / 2 + 1);
    fftw_plan plan = in && out ? fftw_plan_dft_r2c_1d((int)n_period, in, out, FFTW_ESTIMATE) : NULL;
    if (plan != NULL) {
        transform_periods(plan, in, (const fftw_complex *)out, n_periods, n_period, x, n_lines, line, sums);
        fftw_destroy_plan(plan);
    }
    fftw_free(out);
    fftw_free(in);
    return plan != NULL ? GSID_OK : GSID_E_NO_MEMORY;
}
