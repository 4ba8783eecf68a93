/* Least-squares problem of a plant fit: weights, residuals and their derivatives, as a triangle. */
#ifndef GSID_PLANT_FIT_PROBLEM_PRIVATE_H
#define GSID_PLANT_FIT_PROBLEM_PRIVATE_H

#include "gsid/host/plant_fit.h"

/* One record at one point of the search. */
typedef struct {
    double *row;     /* as of gsid_plant_fit_at, with the present weights */
    double *signal;  /* [1 + n_free][n_period] y and its sensitivities */
    gsid_steady_answer answer;
} gsid_fit_state;

typedef struct {
    const gsid_plant_fit_record *cfg;
    gsid_steady *steady;
    double *of_noise, *weight; /* [n_lines] weight of the noise, present weight */
    double noise_rms;          /* of the mean over the periods, in time */
    double *value;             /* [n_free] of the present simulation */
    gsid_cplx *line;           /* [1 + n_free][n_lines] of signal */
    gsid_fit_state state[2];
    gsid_status status;
} gsid_fit_part;

typedef struct {
    const gsid_plant_fit_cfg *cfg;
    uint32_t n_free, n_own, n_shared, n;
    uint32_t *column;              /* [n_free] in a row of equations */
    double *least_size;            /* [n_free] */
    double *lower, *upper, *start; /* [n] */
    gsid_fit_part *part;           /* [n_records] */
    int has_backlash, keeps_orbit;
    const double *x; /* [n] of the present simulation */
    int kept;        /* state of the best point; the other one is of the point evaluated last */
    uint32_t *n_rows; /* [n_records] for gsid_arrow */
    const double **rows;
    double *triangle; /* [n + 1][n + 1] */
    gsid_status failure;
    void **memory; /* [n_memory] all that was allocated */
    size_t n_memory;
} gsid_fit_problem;

/** Lay out a problem whose configuration was checked.
 *  @return GSID_OK; GSID_E_NO_MEMORY; as gsid_steady_create: to be freed in any case */
gsid_status gsid_fit_problem_make(const gsid_plant_fit_cfg *cfg, gsid_fit_problem *problem);
void gsid_fit_problem_free(gsid_fit_problem *problem);

/** Simulate all records, and reduce their equations: for gsid_squares. */
gsid_status gsid_fit_problem_at(void *problem, const double *x, double *cost, double *r, double *q);
void gsid_fit_problem_keep(void *problem);

/** Triangle and cost of the kept point with its present weights, as gsid_fit_problem_at gives them. */
gsid_status gsid_fit_problem_kept(gsid_fit_problem *problem, const double *x, double *cost, double *r, double *q);

/** Weights noise^(1 - power) equal^power, those of the noise for power 0, for the kept point too. The unit of equal weights is the noise
 *  of the quietest line: no residual has a variance below 1, so that (J'J)^-1 is at most the covariance. */
void gsid_fit_problem_weigh(gsid_fit_problem *problem, int power);

/** Degrees of freedom of the variances: the fewest of all records. */
double gsid_fit_problem_dof(const gsid_fit_problem *problem);

#endif
