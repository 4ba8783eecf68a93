/* What the response of a structure and its refinement share. */
#ifndef GSID_STRUCTURE_PRIVATE_H
#define GSID_STRUCTURE_PRIVATE_H

#include "gsid/host/structure.h"

uint32_t gsid_structure_n_columns(const gsid_structure *s);
uint32_t gsid_structure_n_theta(const gsid_structure *s);

/* GSID_OK; GSID_E_NULL; GSID_E_CONFIG */
gsid_status gsid_structure_check(const gsid_structure *s, const gsid_structure_lines *lines);

#endif
