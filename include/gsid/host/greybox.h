/* Algebra of grey-box fits: least squares of many records that share parameters, and a general minimiser. */
#ifndef GSID_HOST_GREYBOX_H
#define GSID_HOST_GREYBOX_H

#include "gsid/lsq.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Every record has n_local unknowns of its own; n_shared unknowns are common to all: the matrix is a block arrow. */
typedef struct {
    uint32_t n_records;          /* >= 1 */
    uint32_t n_local, n_shared;  /* n_shared >= 1; both together < GSID_LSQ_COLUMNS_MAX */
    const uint32_t *n_rows;      /* [n_records] */
    const double *const *row;    /* [n_records] of [n_rows][n_local + n_shared + 1]: coefficients of the record's own
                                    unknowns, of the shared ones, right-hand side; all finite */
} gsid_arrow;

/** Triangle R of the QR factors of all records' rows, and what it leaves: (R | Q'b; 0 | |rest|).  Eq: GBX-2.
 *  Unknowns are those of record 0, of record 1, ..., then the shared ones, n in all; no pivoting, diagonal >= 0.
 *  By SuiteSparse's SPQR; by Givens rotations, record by record, in a build without it. The two agree to rounding.
 *  @param[out] triangle  [n + 1][n + 1]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_TOO_FEW fewer rows than n + 1; GSID_E_NONFINITE;
 *          GSID_E_NO_MEMORY */
gsid_status gsid_arrow_reduce(const gsid_arrow *arrow, double *triangle);

/** The same by Givens rotations, whatever the build. */
gsid_status gsid_arrow_reduce_dense(const gsid_arrow *arrow, double *triangle);

/** Covariance of a fit's unknowns from the triangle of its whitened equations, without the directions that the data do not
 *  determine: small singular values of R with its columns scaled to length 1 are left out.  Eq: GBX-5
 *  @param[in]  n         unknowns, 1 .. GSID_LSQ_COLUMNS_MAX
 *  @param[in]  stride    numbers in a row of r, >= n: n + 1 for that of gsid_arrow_reduce
 *  @param[in]  r         [n][stride] finite; only the first n numbers of a row are read
 *  @param[in]  singular  largest singular value left out, over the largest of all; 0 .. 1
 *  @param[out] cov       [n][n] units of the unknowns, for equations of unit variance
 *  @param[out] open      [n] share of each unknown, scaled by its column, in the directions left out, 0 .. 1: its variance is
 *                        known only where this is small
 *  @param[out] n_open    directions left out
 *  @return GSID_OK; GSID_MAX_ITER the singular values have not converged; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE;
 *          GSID_E_NO_MEMORY: the outputs are untouched
 *  Memory: 2 n (n + 1) numbers, freed at the end.  Cost: some 50 n^3 flops.  Context: any thread. */
gsid_status gsid_arrow_covariance(uint32_t n, uint32_t stride, const double *r, double singular, double *cov,
                                  double *open, uint32_t *n_open);

/** A function to minimise: its value at x, and its gradient too when gradient is not NULL. */
typedef double (*gsid_objective)(unsigned n, const double *x, double *gradient, void *user);

/** Minimise within bounds by sequential quadratic programming (NLopt's SLSQP).
 *  @param[in]     lower, upper  [n] bounds, infinite where there is none
 *  @param[in]     tolerance     stop when a step lowers the value by less
 *  @param[in]     n_max         evaluations at most
 *  @param[in,out] x             [n] start, within the bounds; least point found
 *  @param[out]    least         value there
 *  @return GSID_OK; GSID_MAX_ITER; GSID_E_NULL; GSID_E_CONFIG no unknowns, or a start out of the bounds; GSID_E_NONFINITE
 *          of the start, or of all that was met; GSID_E_NO_MEMORY; GSID_E_SINGULAR the search failed; GSID_E_BACKEND
 *          without NLopt. After a failure x and least are as they were. */
gsid_status gsid_minimise(uint32_t n, gsid_objective objective, void *user, const double *lower, const double *upper,
                          double tolerance, uint32_t n_max, double *x, double *least);

#ifdef __cplusplus
}
#endif

#endif
