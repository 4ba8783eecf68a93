/* Shared by the files of the rational fit: the run, its data in the form that estimators take, and its steps. */
#ifndef GSID_FIT_RUN_H
#define GSID_FIT_RUN_H

#include "gsid/host/fit.h"
#include "gsid/lsq.h"

/* Data of one run. `work` is what the estimators take: without the hold, with the weights of the method. */
typedef struct {
    const gsid_frd *data;
    gsid_fit_cfg cfg;
    gsid_frd work;
    gsid_cplx *g; /* [n_lines] the response without the hold */
    gsid_cplx *hold; /* [n_lines] response of the hold itself; 1 without hold */
    gsid_cplx *moved; /* [n_lines] work: images of a model after a small step */
    gsid_cplx *images; /* [n_lines] images of the last model, which sampling aliases from a held input */
    gsid_cplx *drift; /* [n_lines][n_poles + n_zeros + 2] of g by the parameters, through the images */
    int follow_images; /* 1: Gauss-Newton subtracts its model's own images */
    double *sigma; /* [n_lines] of g, by the method */
    gsid_cplx *cov_yu; /* [n_lines] of the data, without the hold */
    gsid_frd thin; /* every few of the lines of work, for the scan of delays */
    double *thin_f, *thin_sigma; /* [n_lines] at most */
    gsid_cplx *thin_g; /* [n_lines] at most */
    uint32_t stride; /* from one line of thin to the next */
    double delay_limit_s;
    void *mem;
    size_t mem_size;
} fit_run;

typedef struct {
    gsid_rational model;
    double cost;
} fit_candidate;

double gsid_fit_highest_frequency(const gsid_frd *data);
uint32_t gsid_fit_n_parameters(const gsid_fit_cfg *cfg);
int gsid_fit_is_linear(const fit_run *r); /* LS or IWLS */
int gsid_fit_is_admissible(const fit_run *r, const gsid_rational *model); /* stable and late enough, if requested */

/* Equivalent weight of the output error: 1/sigma, times |A|^(1 - r) for linear methods, with r = 0 for LS. */
double gsid_fit_equivalent_weight(const fit_run *r, const gsid_rational *model, uint32_t k);

/* Put c into the n_kept best, in order. */
void gsid_fit_keep_best(const fit_candidate *c, uint32_t n_kept, fit_candidate *kept);

/* ---- fit_hold.c */
void gsid_fit_free_of_hold(fit_run *r);
gsid_status gsid_fit_take_images(void *user, const gsid_rational *model, int with_drift);

/* ---- fit_scan.c: delays and linear fits */
#define GSID_FIT_DELAYS_MAX 4096
double gsid_fit_delay_step(const fit_run *r);
double gsid_fit_rate(const fit_run *r); /* scale [rad/s] of the models of a run, or sample time */
void gsid_fit_thin_out(fit_run *r);
void gsid_fit_forget(uint32_t n, fit_candidate *kept);
void gsid_fit_plan_scan(fit_run *r);
gsid_status gsid_fit_starts(fit_run *r, uint32_t n_kept, fit_candidate *kept);
gsid_status gsid_fit_linear(fit_run *r, fit_candidate *best);
gsid_status gsid_fit_linear_again(fit_run *r, fit_candidate *best); /* from a fit to nearly the same data */

/* ---- fit_numerator.c: numerator of least |g - G|^2 / sigma^2 for the poles and the delay of a model, over every stride-th line.
 * `equations` is for n_zeros + 1 columns. */
gsid_status gsid_fit_numerator(const gsid_frd *data, uint32_t stride, gsid_lsq *equations, gsid_rational *model,
                               double *cost);

/* ---- fit_evolve.c: starts by an evolutionary search */
gsid_status gsid_fit_evolve(fit_run *r, uint32_t n_kept, fit_candidate *kept);

/* ---- fit_influence.c: covariance and bias of linear methods, whose free delay is that of least output error */
gsid_status gsid_fit_influence(const fit_run *r, const gsid_rational *model, gsid_fit_result *result);

/* ---- fit_answer.c: costs, roots, covariance */
double gsid_fit_cost_by_variance(const fit_run *r,
                                 const gsid_rational *model); /* by the measured one, whatever the method */
gsid_status gsid_fit_answer(fit_run *r, const fit_candidate *best, gsid_fit_result *result);

#endif
