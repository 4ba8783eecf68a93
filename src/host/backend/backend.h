/* What the third-party libraries do for the host library. Their own headers are included nowhere but in this folder.
 * Each file is compiled only with its GSID_WITH_*. */
#ifndef GSID_HOST_BACKEND_H
#define GSID_HOST_BACKEND_H

#include "gsid/host/greybox.h"
#include "gsid/host/transform.h"
#include "gsid/types.h"

/* Version of the library as linked. */
const char *gsid_fftw_version_str(void);
const char *gsid_nlopt_version_str(void);
const char *gsid_suitesparse_version_str(void);

/* Transforms that the caller has given; NULL: none.  In transform.c. */
const gsid_transform *gsid_transform_given(void);

/* gsid_batch_spectra, its arguments checked already.
 * GSID_OK; GSID_E_NO_MEMORY. */
gsid_status gsid_fftw_lines(uint32_t n_periods, uint32_t n_period, const double *x, uint32_t n_lines,
                            const uint32_t *line, gsid_cplx *lines);

/* Transforms between n samples (n even) and their lines 0 .. n/2, with buffers that FFTW likes. NULL: out of memory. */
typedef struct gsid_real_transform gsid_real_transform;
gsid_real_transform *gsid_fftw_real_transform(uint32_t n);
void gsid_fftw_real_destroy(gsid_real_transform *transform);

/* x[i] = sum over k of lines[k] exp(j 2 pi k i / n), k from -n/2 on, lines[-k] = conj(lines[k]). */
void gsid_fftw_to_samples(gsid_real_transform *transform, const gsid_cplx *lines, double *x);

/* lines[k] = sum over i of x[i] exp(-j 2 pi k i / n). */
void gsid_fftw_to_lines(gsid_real_transform *transform, const double *x, gsid_cplx *lines);

/* The same by the functions that the caller has given, or else by FFTW. `plan` is NULL for those of the caller. In transform.c.
 * GSID_OK; GSID_E_NO_MEMORY; GSID_E_BACKEND neither is there */
gsid_status gsid_transform_plan(uint32_t n, gsid_real_transform **plan);
void gsid_transform_forget(gsid_real_transform *plan);
void gsid_transform_to_samples(gsid_real_transform *plan, uint32_t n, const gsid_cplx *lines, double *x);
void gsid_transform_to_lines(gsid_real_transform *plan, uint32_t n, const double *x, gsid_cplx *lines);

/* gsid_arrow_reduce, its arguments checked already; signs of rows as they come.
 * GSID_OK; GSID_E_NO_MEMORY. */
gsid_status gsid_suitesparse_reduce(const gsid_arrow *arrow, double *triangle);

#ifdef GSID_WITH_NLOPT

typedef enum {
    GSID_NLOPT_SLSQP, /* sequential quadratic programming, with derivatives */
    GSID_NLOPT_ESCH,  /* evolution */
    GSID_NLOPT_CRS,   /* controlled random search of a population, with local mutation */
    GSID_NLOPT_ISRES  /* evolution strategy with stochastic ranking */
} gsid_nlopt_algorithm;

typedef struct {
    gsid_nlopt_algorithm algorithm;
    unsigned n;                  /* unknowns */
    const double *lower, *upper; /* [n] bounds; infinite where there is none, which only SLSQP takes */
    double tolerance;    /* stop when a step lowers the value by less */
    int n_max;           /* evaluations at most */
    unsigned population; /* 0: the algorithm's own */
    unsigned seed;
} gsid_nlopt_search;

/** Minimise within bounds.
 *  @param[in,out] x      [n] start, within the bounds; least point found
 *  @param[out]    least  value there
 *  @return GSID_OK; GSID_MAX_ITER; GSID_E_NO_MEMORY; GSID_E_SINGULAR the search failed: x is the start */
gsid_status gsid_nlopt_minimise(const gsid_nlopt_search *how, gsid_objective f, void *user, double *x, double *least);

/** Minimise over one number from 0 to 1, without derivatives (NLopt's LN_BOBYQA).
 *  @param[in]     tolerance  stop when the number moves by less
 *  @param[in]     n_max      evaluations at most
 *  @param[in,out] x          start; least point found
 *  @param[out]    least      value there
 *  @return as gsid_nlopt_minimise */
gsid_status gsid_nlopt_minimise_scalar(gsid_objective f, void *user, double tolerance, int n_max, double *x,
                                       double *least);

/** Descend without bounds (NLopt's LD_LBFGS).
 *  @param[in]     n_max  evaluations at most
 *  @param[in,out] x      [n] start; where it stopped
 *  @return GSID_OK stopped, for whatever reason: f keeps the best point itself; GSID_E_NO_MEMORY */
gsid_status gsid_nlopt_descend(unsigned n, gsid_objective f, void *user, int n_max, double *x);

#endif

#endif
