#include <fftw3.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "backend.h"

const char *gsid_fftw_version_str(void) {
    return fftw_version;
}

/* Only one thread at a time may make or destroy plans of FFTW, and the plan that is kept has one set of buffers.
 * A fork waits until the lock is free: in the child no thread would ever release it. */
static pthread_mutex_t planner = PTHREAD_MUTEX_INITIALIZER;
static pthread_once_t watched = PTHREAD_ONCE_INIT;

static void leave_planner(void) {
    pthread_mutex_unlock(&planner);
}

static void wait_for_planner(void) {
    pthread_mutex_lock(&planner);
}

static void watch_forks(void) {
    pthread_atfork(wait_for_planner, leave_planner, leave_planner);
}

static void enter_planner(void) {
    pthread_once(&watched, watch_forks);
    wait_for_planner();
}

#define KEPT_MAX (UINT32_C(1) << 20) /* samples of a plan that is kept: its buffers are 16 MB */

/* The last plan is kept: planning takes as long as ten transforms, and realisations have the same period. One period's
 * buffers stay in the cache, and the caller's samples, which the planner might overwrite, stay whole. Those of a long period
 * would take up to 16 GB as long as the process lives: they are freed. */
static struct {
    uint32_t n_period;
    double *in;
    fftw_complex *out;
    fftw_plan plan;
} kept;

static void forget_plan(void) {
    fftw_destroy_plan(kept.plan);
    fftw_free(kept.out);
    fftw_free(kept.in);
    memset(&kept, 0, sizeof kept);
}

static gsid_status plan_for(uint32_t n_period) {
    if (kept.plan != NULL && kept.n_period == n_period) {
        return GSID_OK;
    }
    forget_plan();
    kept.n_period = n_period;
    kept.in = fftw_alloc_real(n_period);
    kept.out = fftw_alloc_complex(n_period / 2 + 1);
    kept.plan = kept.in && kept.out ? fftw_plan_dft_r2c_1d((int)n_period, kept.in, kept.out, FFTW_ESTIMATE) : NULL;
    return kept.plan != NULL ? GSID_OK : GSID_E_NO_MEMORY;
}

gsid_status gsid_fftw_lines(uint32_t n_periods, uint32_t n_period, const double *x, uint32_t n_lines,
                            const uint32_t *line, gsid_cplx *lines) {
    enter_planner();
    gsid_status status = plan_for(n_period);
    for (uint32_t p = 0; status == GSID_OK && p < n_periods; p++) {
        memcpy(kept.in, x + (size_t)p * n_period, n_period * sizeof *x);
        fftw_execute(kept.plan);
        gsid_cplx *of_period = lines + (size_t)p * n_lines;
        for (uint32_t i = 0; i < n_lines; i++) {
            const uint32_t k = line[i];
            const double scale = k == 0 || 2 * k == n_period ? 1.0 / n_period : 2.0 / n_period;
            of_period[i].re = scale * kept.out[k][0];
            of_period[i].im = scale * kept.out[k][1];
        }
    }
    if (status != GSID_OK || n_period > KEPT_MAX) {
        forget_plan();
    }
    leave_planner();
    return status;
}

struct gsid_real_transform {
    uint32_t n;
    double *x;
    fftw_complex *lines;
    fftw_plan to_samples, to_lines;
};

gsid_real_transform *gsid_fftw_real_transform(uint32_t n) {
    gsid_real_transform *t = calloc(1, sizeof *t);
    if (t == NULL) {
        return NULL;
    }
    t->n = n;
    t->x = fftw_alloc_real(n);
    t->lines = fftw_alloc_complex(n / 2 + 1);
    if (t->x != NULL && t->lines != NULL) {
        enter_planner();
        t->to_samples = fftw_plan_dft_c2r_1d((int)n, t->lines, t->x, FFTW_ESTIMATE);
        t->to_lines = fftw_plan_dft_r2c_1d((int)n, t->x, t->lines, FFTW_ESTIMATE);
        leave_planner();
    }
    if (t->to_samples == NULL || t->to_lines == NULL) {
        gsid_fftw_real_destroy(t);
        return NULL;
    }
    return t;
}

void gsid_fftw_real_destroy(gsid_real_transform *t) {
    if (t != NULL) {
        enter_planner();
        fftw_destroy_plan(t->to_samples);
        fftw_destroy_plan(t->to_lines);
        leave_planner();
        fftw_free(t->lines);
        fftw_free(t->x);
        free(t);
    }
}

void gsid_fftw_to_samples(gsid_real_transform *t, const gsid_cplx *lines, double *x) {
    memcpy(t->lines, lines, (t->n / 2 + 1) * sizeof *lines);
    fftw_execute(t->to_samples);
    memcpy(x, t->x, t->n * sizeof *x);
}

void gsid_fftw_to_lines(gsid_real_transform *t, const double *x, gsid_cplx *lines) {
    memcpy(t->x, x, t->n * sizeof *x);
    fftw_execute(t->to_lines);
    memcpy(lines, t->lines, (t->n / 2 + 1) * sizeof *lines);
}
