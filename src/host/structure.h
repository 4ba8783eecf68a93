/* What the response of a structure and its refinement share. */
#ifndef GSID_STRUCTURE_PRIVATE_H
#define GSID_STRUCTURE_PRIVATE_H

#include "gsid/host/structure.h"

uint32_t gsid_structure_n_columns(const gsid_structure *s, const gsid_structure_lines *lines);
uint32_t gsid_structure_n_theta(const gsid_structure *s);

/* GSID_OK; GSID_E_NULL; GSID_E_CONFIG */
gsid_status gsid_structure_check(const gsid_structure *s, const gsid_structure_lines *lines);

/** Derivatives of the response by theta, with the images as constant factors.
 *  @param[in]  column  of gsid_structure_columns at theta
 *  @param[in]  gain    of each column
 *  @param[out] slope   [n_theta][n]
 *  @return as gsid_structure_columns */
gsid_status gsid_structure_slopes(const gsid_structure *structure, const gsid_structure_lines *lines,
                                  const double *theta, const gsid_cplx *column, const double *gain, gsid_cplx *slope);

#endif
