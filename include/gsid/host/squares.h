/* Nonlinear least squares within bounds, of a problem that gives its residuals as the triangle of their QR factors. */
#ifndef GSID_HOST_SQUARES_H
#define GSID_HOST_SQUARES_H

#include "gsid/host/fit.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Near x, the residuals are those of q - R (change of x), and a part that does not change. */
typedef struct {
    uint32_t n;                  /* unknowns, 1 .. GSID_LSQ_COLUMNS_MAX */
    const double *lower, *upper; /* [n] infinite where there is none */
    /** Evaluate the problem.
     *  @param[out] cost  squared length of all residuals, finite
     *  @param[out] r, q  [n][n] and [n]
     *  @return GSID_OK; GSID_MAX_ITER: evaluated, but a search may not come here from a point with GSID_OK; GSID_E_STOPPED: the
     *          search ends; GSID_E_NO_MEMORY: it fails; other errors: this point cannot be evaluated, and others may */
    gsid_status (*at)(void *user, const double *x, double *cost, double *r, double *q);
    /** The point evaluated last is the best so far; NULL: not wanted. */
    void (*keep)(void *user);
    void *user;
} gsid_squares;

typedef struct {
    double decrease;       /* converged where a full step is predicted to lower the cost by less; >= 0 */
    double singular;       /* directions with smaller singular values, over the largest, are held; 0 .. 1 */
    double damping_start;  /* first damping, over the squared length of a column; > 0 */
    double damping_max;    /* the search ends where a step with this damping does not lower the cost; finite */
    double damping_fall;   /* least factor of the damping after a step that lowers the cost; above 0, at most 1 */
    double damping_growth; /* first factor after one that does not, > 1; it doubles each time (Nielsen 1999) */
    double stalled;        /* converged at damping_max where the predicted decrease, over the cost, is below this */
    double failed_cost;    /* for GSID_SOLVER_NLOPT: cost, over that of the start, of points that cannot be evaluated */
} gsid_squares_settings;

typedef struct {
    double cost;
    int converged;
    uint32_t n_iterations; /* steps; evaluations after the start with GSID_SOLVER_NLOPT */
} gsid_squares_result;

/** The defaults, which gsid.greybox.settings gives reasons for.
 *  @return GSID_OK; GSID_E_NULL */
gsid_status gsid_squares_defaults(gsid_squares_settings *settings);

/** Search for the least cost from x: steps of Levenberg and Marquardt with Marquardt's scaling and Nielsen's rule for the damping, or
 *  NLopt's sequential quadratic programming in scaled unknowns.  Eq: GBX-2
 *  @param[in]     n_max    steps, or evaluations, at most; 1 .. INT_MAX
 *  @param[in,out] x        [n] start; the best point. Steps end within the bounds, also from a start that is not
 *  @param[out]    blocked  [n] 1: at a bound, and the cost falls beyond it; or NULL
 *  @return GSID_OK, whether converged or not; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE a start; GSID_E_NO_MEMORY; GSID_E_BACKEND
 *          without NLopt; GSID_E_SINGULAR NLopt failed; what the start's evaluation returned: outputs untouched
 *  Memory: some 4 n^2 numbers, freed at the end.  Context: any thread. */
gsid_status gsid_squares_search(const gsid_squares *problem, const gsid_squares_settings *settings, gsid_solver solver,
                                uint32_t n_max, double *x, uint8_t *blocked, gsid_squares_result *result);

#ifdef __cplusplus
}
#endif

#endif
