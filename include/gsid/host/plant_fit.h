/* Fit of a plant: free parameters of a stack of effects, from the lines of one or more records of the same plant. */
#ifndef GSID_HOST_PLANT_FIT_H
#define GSID_HOST_PLANT_FIT_H

#include "gsid/host/squares.h"
#include "gsid/host/steady.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One record: mean over its periods. All pointers stay the caller's. */
typedef struct {
    gsid_steady_cfg input; /* plant and one period of its mean input. The stack and its free parameters are the same in all
                              records; the values are the start. The fit sets the tolerance */
    uint32_t n_lines;      /* >= 1 */
    const uint32_t *line;  /* [n_lines] < n_period / 2; not only excited ones: nonlinear effects appear between them */
    const gsid_cplx *y;    /* [n_lines] of the mean output, as gsid_batch_spectra gives them; finite */
    const double *variance; /* [n_lines] E|y - mean|^2 of one period, >= 0 (with few periods: gsid_pool_lines) */
    double n_periods;      /* >= 1 */
    double dof;            /* degrees of freedom of the variance, > 2; inf: it is known */
} gsid_plant_fit_record;

typedef enum {
    GSID_PLANT_FIT_ML = 0,        /* maximum likelihood: each line is weighted by its noise (GBX-1) */
    GSID_PLANT_FIT_NLS_OUTPUT = 1 /* equal weights: least mean square of the output's error (GBX-4) */
} gsid_plant_fit_method;

typedef struct {
    gsid_squares_settings search;
    double settled;     /* change of a simulated steady state per period at which it stops, over the rms noise of the mean in time */
    double unsettled;   /* larger changes are reported, over the same noise */
    double noise_floor; /* least standard deviation of a line of one period, over the largest line */
    double silent;      /* a parameter is held if a change by its size changes all residuals together by less */
    double involved;    /* no standard deviation: a larger component of the parameter is in a held direction */
} gsid_plant_fit_settings;

/** The defaults, which gsid.greybox.settings gives reasons for.
 *  @return GSID_OK; GSID_E_NULL */
gsid_status gsid_plant_fit_defaults(gsid_plant_fit_settings *settings);

/* Calls work(of_work, i) for i = 0 .. n - 1, in any order and in as many threads as it likes, and returns when all are done:
 * not 0 to end the fit. */
typedef int (*gsid_each)(void *user, uint32_t n, void (*work)(void *of_work, uint32_t i), void *of_work);

/* The unknowns: those of record 0 (its own parameters in the order of the free ones, then its drift), of record 1, ..., then the
 * parameters that all records share, in the order of the free ones. */
typedef struct {
    uint32_t n_records;                  /* >= 1 */
    const gsid_plant_fit_record *record; /* [n_records] */
    const uint8_t *is_own; /* [n_free] 1: estimated for each record alone; NULL: none. One is shared at least */
    int has_drift;         /* 1: the output of each record drifts by an unknown amount over a period */
    const double *lower, *upper; /* [n_free] NULL: the bounds of the effects */
    gsid_plant_fit_method method;
    gsid_solver solver;
    uint32_t n_max; /* iterations at most, >= 1 */
    gsid_plant_fit_settings settings;
    gsid_each each; /* runs the records' simulations; NULL: one after the other */
    void *user;     /* of each */
} gsid_plant_fit_cfg;

/* What is known of a record after the fit, in the caller's arrays, each of which may be NULL. */
typedef struct {
    double *weight; /* [n_lines] of the noise: sqrt(2 P / s^2), corrected for the scatter of s^2 */
    double *row;    /* [2 n_lines][n_own + n_shared + 1] real parts, then imaginary parts: changes of the output by the
                       record's own unknowns and by the shared ones, and the residual; all times the weight. Imaginary parts of
                       line 0 are 0 */
    gsid_steady_answer answer; /* y, angle and rate NULL, or dy NULL: not wanted. residual and is_settled are set */
    int is_unsettled; /* its steady state changes by more than settings.unsettled allows */
} gsid_plant_fit_at;

typedef struct {
    double *x;             /* [n] unknowns */
    double *cov;           /* [n][n] their covariance, without directions that the data do not determine (GBX-5) */
    uint8_t *is_open;      /* [n] 1: such a direction has a relevant part of it: its variance is unknown */
    uint8_t *is_at_bound;  /* [n] 1: at a bound, and the criterion of the method falls beyond it */
    gsid_plant_fit_at *at; /* [n_records] or NULL */
    double cost;           /* squared length of the residuals, weighted by the noise: -2 log likelihood */
    double n_dof;          /* residuals less unknowns that were determined: the cost is so large if only noise is left */
    int converged;         /* of the method's criterion */
    uint32_t n_iterations;
} gsid_plant_fit_result;

/** Number of unknowns; 0 for a configuration without records or without a shared parameter. */
uint32_t gsid_plant_fit_n(const gsid_plant_fit_cfg *cfg);

/** Fit.  Eq: GBX-1, GBX-2, GBX-4, GBX-5
 *  @param[in,out] result  the caller's arrays
 *  @return GSID_OK, whether converged or not; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE; GSID_E_TOO_FEW no more lines than
 *          unknowns; GSID_E_STOPPED before the start was simulated; GSID_E_BACKEND; GSID_E_NO_MEMORY; otherwise why the start
 *          cannot be simulated, as gsid_steady_run; GSID_E_SINGULAR NLopt failed. The outputs are untouched then
 *  Memory: two copies of the rows and of the simulated outputs and sensitivities, freed at the end.
 *  Cost: of each iteration, one gsid_plant_periodic for each record, with sensitivities.  Context: any thread. */
gsid_status gsid_plant_fit(const gsid_plant_fit_cfg *cfg, gsid_plant_fit_result *result);

#ifdef __cplusplus
}
#endif

#endif
