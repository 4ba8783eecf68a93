#include "gsid/host/transform.h"

#include <stddef.h>

#include "backend/backend.h"

static gsid_transform given;

gsid_status gsid_transform_use(const gsid_transform *transform) {
    static const gsid_transform none = {NULL, NULL};
    if (transform != NULL && (transform->to_lines == NULL || transform->to_samples == NULL)) {
        return GSID_E_NULL;
    }
    given = transform == NULL ? none : *transform;
    return GSID_OK;
}

const gsid_transform *gsid_transform_given(void) {
    return given.to_lines == NULL ? NULL : &given;
}

#ifdef GSID_WITH_FFTW

gsid_status gsid_transform_plan(uint32_t n, gsid_real_transform **plan) {
    *plan = given.to_lines == NULL ? gsid_fftw_real_transform(n) : NULL;
    return given.to_lines != NULL || *plan != NULL ? GSID_OK : GSID_E_NO_MEMORY;
}

void gsid_transform_forget(gsid_real_transform *plan) {
    gsid_fftw_real_destroy(plan);
}

void gsid_transform_to_samples(gsid_real_transform *plan, uint32_t n, const gsid_cplx *lines, double *x) {
    if (plan != NULL) {
        gsid_fftw_to_samples(plan, lines, x);
    } else {
        given.to_samples(n, lines, x);
    }
}

void gsid_transform_to_lines(gsid_real_transform *plan, uint32_t n, const double *x, gsid_cplx *lines) {
    if (plan != NULL) {
        gsid_fftw_to_lines(plan, x, lines);
    } else {
        given.to_lines(n, x, lines);
    }
}

#else

gsid_status gsid_transform_plan(uint32_t n, gsid_real_transform **plan) {
    (void)n;
    *plan = NULL;
    return given.to_lines != NULL ? GSID_OK : GSID_E_BACKEND;
}

void gsid_transform_forget(gsid_real_transform *plan) {
    (void)plan;
}

void gsid_transform_to_samples(gsid_real_transform *plan, uint32_t n, const gsid_cplx *lines, double *x) {
    (void)plan;
    given.to_samples(n, lines, x);
}

void gsid_transform_to_lines(gsid_real_transform *plan, uint32_t n, const double *x, gsid_cplx *lines) {
    (void)plan;
    given.to_lines(n, x, lines);
}

#endif
