/* What the files of the MIMO fit share. */
#ifndef GSID_MIMO_RUN_H
#define GSID_MIMO_RUN_H

#include "gsid/host/greybox.h"
#include "gsid/host/mimo.h"
#include "gsid/lsq.h"

/* The problem, and memory for its equations. */
typedef struct {
    gsid_mimo_cfg cfg;
    uint32_t n_channels;
    const gsid_frd *channel; /* [n_channels] with the method's weights */
    double scale_rad_s;
    uint32_t n_local, n_shared; /* numerators of a channel; poles and free delays */
    gsid_lsq *equations; /* [n_channels] the triangle of each channel's rows */
    uint32_t *n_rows;    /* [n_channels] of them */
    const double **row;  /* [n_channels] */
    void **mem;          /* [n_channels] */
    size_t mem_size;
    double *block;       /* [n_local + n_shared + 1][GSID_LSQ_BLOCK] rows that wait */
    uint32_t n_waiting;
    double *triangle;   /* [n + 1][n + 1], n = n_channels n_local + n_shared */
    double *shared;     /* [n_shared + 1][n_shared + 1] */
    double *num;        /* [n_channels][n_local] of the last candidate solved */
    void *lsq_mem;      /* for n_local or n_shared columns */
    size_t lsq_size;
} mimo_run;

/* Poles and delays; the numerators follow from them.  x as in fit_sections.h. */
typedef struct {
    double x[GSID_MIMO_POLES_MAX];
    double delay_s[GSID_MIMO_CHANNELS_MAX];
    double cost;
} mimo_candidate;

/* ---- mimo_channel.c: the response of one channel, at one line */

/* What the numerators multiply there, with the delay's turn; their sum; dG/dS of each section. */
typedef struct {
    gsid_cplx v, g, phi[GSID_MIMO_POLES_MAX + 1], by_section[GSID_MIMO_POLES_MAX / 2];
} mimo_terms;

gsid_cplx gsid_mimo_variable(const gsid_mimo_channel *c, double f_hz);

/* The n_local functions of v that the numerators multiply, without the delay. */
void gsid_mimo_basis(const gsid_mimo_channel *c, gsid_cplx v, gsid_cplx *phi);

void gsid_mimo_terms(const gsid_mimo_channel *c, double f_hz, mimo_terms *t);

/* ---- mimo_run.c */

/* A channel of the fit, with r->num for its numerators. */
gsid_mimo_channel gsid_mimo_channel_at(const mimo_run *r, uint32_t channel, const double *q, double delay_s);

/* q0 and q1 of each section. */
void gsid_mimo_sections(const mimo_run *r, const double *x, double *q);

/* Bounds of x[j]: those of stable sections, and no pole so far out that it does what d does. */
void gsid_mimo_bounds(const mimo_run *r, uint32_t j, double *lower, double *upper);

/* r->num <- the numerators of least V, c->cost <- V; HUGE_VAL when they cannot be found. */
void gsid_mimo_solve(mimo_run *r, mimo_candidate *c);

/* The same for one channel; returns its V. */
double gsid_mimo_solve_channel(mimo_run *r, uint32_t channel, const double *q, double delay_s);

/* Equations of one channel: start with so many shared unknowns, put both rows of a line column by column (the right-
 * hand side last), go on to the next line, end. */
gsid_status gsid_mimo_begin(mimo_run *r, uint32_t channel, uint32_t n_shared);
void gsid_mimo_put(mimo_run *r, uint32_t column, gsid_cplx value);
gsid_status gsid_mimo_next(mimo_run *r, gsid_lsq *equations);
gsid_status gsid_mimo_end(mimo_run *r, gsid_lsq *equations);

/* r->triangle and r->shared <- the equations of all channels. */
gsid_status gsid_mimo_reduce(mimo_run *r, uint32_t n_shared);

double gsid_mimo_highest_frequency(uint32_t n_channels, const gsid_frd *channel);

#define GSID_MIMO_SCAN_STEPS 8    /* of delays, in a period of the highest frequency */
#define GSID_MIMO_FINE_STEPS 32   /* the same, where each is searched separately */
#define GSID_MIMO_DELAYS_MAX 4096 /* of a scan */

/* Free delays are searched from 0 to here. */
double gsid_mimo_delay_limit(const mimo_run *r);

/* The free delay with that number. */
double gsid_mimo_group_delay(const mimo_run *r, uint32_t group, const mimo_candidate *c);
void gsid_mimo_set_group(const mimo_run *r, uint32_t group, double value, double *of_channel);

/* V of the channels that have it, at this delay. */
double gsid_mimo_group_cost(mimo_run *r, const double *q, uint32_t group, double delay_s);

/* ---- mimo_start.c: poles and delays that the search begins with */
gsid_status gsid_mimo_start(mimo_run *r, mimo_candidate *c);

/* ---- mimo_delays.c */

/* From one minimum to the lowest over each free delay; low .. high of each channel: those that are hardly higher. */
gsid_status gsid_mimo_settle_delays(mimo_run *r, mimo_candidate *c, double *low_s, double *high_s);

/* ---- mimo_relocate.c: iteratively reweighted linear fits */
void gsid_mimo_spread_poles(const mimo_run *r, mimo_candidate *c);
gsid_status gsid_mimo_relocate(mimo_run *r, uint32_t n_iterations, mimo_candidate *c);

/* ---- mimo_search.c: Gauss-Newton */
gsid_status gsid_mimo_search(mimo_run *r, mimo_candidate *c);
gsid_status gsid_mimo_covariance(mimo_run *r, const mimo_candidate *c, double *cov);

#endif
