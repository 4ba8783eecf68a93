/* Variances of neighbouring lines averaged, where each line has few degrees of freedom. */
#ifndef GSID_HOST_POOL_H
#define GSID_HOST_POOL_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

/* At the first and last lines, where neighbours are missing on one side. */
typedef enum {
    GSID_EDGES_REFLECTED = 0, /* those of the other side count twice: every average is over 2 half + 1 lines */
    GSID_EDGES_SHORTENED = 1  /* the average is over fewer lines */
} gsid_edges;

/** Lines on each side over which variances are averaged until they have enough degrees of freedom.  Eq: GBX-3
 *  @param[in] dof     of each line's variance, > 0; inf: known
 *  @param[in] wanted  degrees of freedom of an average
 *  @return the least number that gives `wanted`, at most (n_lines - 1) / 2; 0 if dof >= wanted */
uint32_t gsid_pool_neighbours(uint32_t n_lines, double dof, double wanted);

/** Average over neighbouring lines, each by a sum of its own: a large value does not cost the lines behind it their digits.
 *  Eq: GBX-3
 *  @param[in]  n_columns  averaged separately
 *  @param[in]  half       lines on each side, < n_lines
 *  @param[in]  x          [n_lines][n_columns]
 *  @param[out] pooled     [n_lines][n_columns], another array
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG */
gsid_status gsid_pool_lines(uint32_t n_lines, uint32_t n_columns, uint32_t half, gsid_edges edges, const double *x,
                            double *pooled);

#ifdef __cplusplus
}
#endif

#endif
