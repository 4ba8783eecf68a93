/* Test whether the errors of a model exceed noise and the model's own uncertainty, from few periods too. */
#ifndef GSID_HOST_MISFIT_H
#define GSID_HOST_MISFIT_H

#include "gsid/host/tail.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Errors of a model at n lines, of one record after the other. All numbers are finite, except where stated. Pointers stay the
 * caller's. */
typedef struct {
    uint32_t n_lines;
    const gsid_cplx *error;    /* [n_lines] mean measured output less that of the model, or the same of a response */
    const double *variance;    /* [n_lines] sample variance of that mean error, E|error|^2, >= 0 */
    const double *dof;         /* [n_lines] degrees of freedom of the variance, periods less 1, > 0; inf: it is known */
    const double *var_weight;  /* [n_lines] the variance with less scatter (gsid_pool_lines), for weights; NULL: variance */
    const uint8_t *is_real;    /* [n_lines] 1: a line without imaginary part, that at 0 Hz; NULL: none */
    uint32_t n_directions;     /* p <= GSID_LSQ_COLUMNS_MAX; 0: the model is known exactly, or fitted to these errors */
    const gsid_cplx *by_model; /* [n_lines][p] change of the model's output by one standard deviation along each of p
                                  independent directions: A = J C^(1/2). NULL with p = 0 */
} gsid_misfit_lines;

typedef struct {
    double moved; /* squared change of the model that explains most of the errors, in units of its covariance */
    double n_dof; /* mean of chi2 for a correct model */
    double chi2;  /* twice the sum of the scores of the error left, plus moved; at most 1.7e308 */
} gsid_misfit;

/** Scores of lines, exponential with mean 1 for noise alone.  Eq: CMP-1
 *  @param[in]  n_lines
 *  @param[in]  ratio    [n_lines] |error|^2 over its sample variance, >= 0
 *  @param[in]  dof      [n_lines] as in gsid_misfit_lines
 *  @param[in]  is_real  [n_lines] or NULL
 *  @param[out] score    [n_lines]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG a ratio or a dof out of its range: the outputs are undefined
 *  Memory: none.  Cost: one logarithm for each line.  Context: any thread. */
gsid_status gsid_misfit_scores(uint32_t n_lines, const double *ratio, const double *dof, const uint8_t *is_real,
                               double *score);

/** Test errors against noise and the uncertainty of the model.  Eq: CMP-1
 *  @param[out] left    [n_lines] error left by the best change of the model within its uncertainty; or NULL
 *  @param[out] ratio   [n_lines] its square over the sample variance; or NULL
 *  @param[out] result  of all lines; gsid_misfit_tail gives the p-value
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG a variance, a dof or p is out of its range; GSID_E_NONFINITE; GSID_E_NO_MEMORY:
 *          the outputs are untouched
 *  Memory: p^2 + 4 n_lines numbers, freed at the end.  Cost: 6 n_lines p^2 flops.  Context: any thread. */
gsid_status gsid_misfit_test(const gsid_misfit_lines *lines, gsid_cplx *left, double *ratio, gsid_misfit *result);

/** Degrees of freedom that a parameter takes if it was fitted to these errors.  Eq: CMP-1
 *  @param[in]  n_lines
 *  @param[in]  dof      [n_lines] as in gsid_misfit_lines
 *  @return mean of dof / (dof + 1): 1 if all variances are known, or without a line
 *  Memory: none.  Cost: one division for each line.  Context: any thread. */
double gsid_misfit_taken(uint32_t n_lines, const double *dof);

/** Probability of a misfit this large or larger if the model is correct.  Eq: CMP-1
 *  @param[in]  n_fitted  degrees of freedom that fitted parameters take: their number times gsid_misfit_taken; 0: none
 *  @param[out] tail      upper: the p-value; log_upper: its logarithm, which does not underflow
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG
 *  Memory: none.  Cost: as gsid_tail_gamma.  Context: any thread. */
gsid_status gsid_misfit_tail(const gsid_misfit *misfit, double n_fitted, gsid_tail *tail);

#ifdef __cplusplus
}
#endif

#endif
