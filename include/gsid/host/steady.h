/* The periodic steady state of a plant behind a sampled input, again and again with other values. */
#ifndef GSID_HOST_STEADY_H
#define GSID_HOST_STEADY_H

#include "gsid/plant.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Numbers of gsid_plant_periodic. */
#define GSID_STEADY_SETTLE 2         /* periods before the first Newton step, from the linear orbit */
#define GSID_STEADY_SETTLE_LONGER 10 /* periods, where the steady state was not reached */
#define GSID_STEADY_NEWTON 8         /* corrections */
#define GSID_STEADY_RESIDUAL 1.0e-7    /* settled: largest change in a period, relative to the output's rms */

/* All pointers stay the caller's and must outlive the object. */
typedef struct {
    gsid_plant_cfg plant;  /* fs_hz: steps of the input per second; the values of the items are copied */
    uint32_t n_period;     /* samples of the output in a period, >= 1 */
    uint32_t oversampling; /* steps of the input in a sample of the output, >= 1 */
    const double *u;       /* [n_period oversampling] one period, held over each step or linear between them (first_order_hold) */
    int is_placed;         /* 1: the first search begins at this angle and rate, without settling; 0: on the linear orbit */
    double angle, rate;
    double tolerance; /* settled: change in a period, unit of y, if that is more than GSID_STEADY_RESIDUAL allows; >= 0 */
} gsid_steady_cfg;

typedef struct {
    double *y, *angle, *rate; /* [n_period] output, angle and rate of the axis at each sample */
    double *dy;               /* [n_free][n_period] sensitivities of y; or NULL */
    double residual;          /* bound on how much y changes in one more period, unit of y */
    int is_settled;
} gsid_steady_answer;

typedef struct gsid_steady gsid_steady;

/** Create.
 *  @param[out] steady  to be freed with gsid_steady_destroy
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE; GSID_E_NO_MEMORY */
gsid_status gsid_steady_create(const gsid_steady_cfg *cfg, gsid_steady **steady);

/** Free; NULL is allowed. */
void gsid_steady_destroy(gsid_steady *steady);

/** Find the periodic steady state, from the state that was kept; else from where the axis is placed (gsid_plant_place), or
 *  from the linear orbit. Behind impacts, periods to settle would lead from a placed axis to another orbit.  Eq: PLT-2
 *  @param[in]     value       [n_free] values of the free parameters; NULL: as in the last run, or those of the items
 *  @param[in]     is_patient  1: simulate GSID_STEADY_SETTLE_LONGER periods and try again where Newton's method has not converged
 *  @param[in,out] answer      the caller's arrays
 *  @return GSID_OK, also where it has not settled: see is_settled; GSID_E_NULL; otherwise as gsid_plant_init and
 *          gsid_plant_start_linear, gsid_plant_place and gsid_plant_periodic: the outputs are undefined, and what was kept stays
 *  Context: background; different objects in different threads. */
gsid_status gsid_steady_run(gsid_steady *steady, const double *value, int is_patient, gsid_steady_answer *answer);

/** The same without sensitivities, at less cost where the plant settles within a period from what was kept. */
gsid_status gsid_steady_run_near(gsid_steady *steady, const double *value, gsid_steady_answer *answer);

/** Begin the next searches at the result of the last one, so that rejected steps have no influence.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE the last search failed, or there was none; GSID_E_NO_MEMORY */
gsid_status gsid_steady_keep(gsid_steady *steady);

#ifdef __cplusplus
}
#endif

#endif
