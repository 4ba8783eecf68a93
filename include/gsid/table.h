/* A torque law as a table: a measured curve, or the residual torque curve of a diagnosis. */
#ifndef GSID_TABLE_H
#define GSID_TABLE_H

#include "gsid/effect.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GSID_TABLE_POINTS_MIN 3
#define GSID_TABLE_POINTS_MAX 1024

typedef enum { GSID_TABLE_RATE = 0, GSID_TABLE_ANGLE = 1, GSID_TABLE_COMMAND = 2 } gsid_table_variable;

/* A cubic between the points, with the slopes below; beyond them it continues as a straight line. */
typedef struct {
    gsid_table_variable variable;
    uint32_t n_points;
    const gsid_real *at;     /* [n_points] ascending */
    const gsid_real *torque; /* [n_points] */
    const gsid_real *slope;  /* [n_points] from gsid_table_slopes */
} gsid_table;

/** Slopes of a monotone cubic without overshoot between the points (TAB-1).
 *  @param[in]  at, torque  [n_points], at ascending
 *  @param[out] slope       [n_points]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_NONFINITE; GSID_E_CONFIG too few or too many points, or not ascending */
gsid_status gsid_table_slopes(uint32_t n_points, const gsid_real *at, const gsid_real *torque, gsid_real *slope);

/** Make a table an effect: stage, torque, what it looks at, and one parameter, the scale. Items of it carry the table as
 *  their data.
 *  @param[out] effect  id and sentence stay the caller's
 *  @return GSID_OK; as gsid_table_slopes.  Context: background. */
gsid_status gsid_table_effect(const gsid_table *table, gsid_effect *effect);

#ifdef __cplusplus
}
#endif

#endif
