/* The catalogue: every effect the library knows. */
#ifndef GSID_CATALOGUE_H
#define GSID_CATALOGUE_H

#include "gsid/effect.h"

#ifdef __cplusplus
extern "C" {
#endif

extern const gsid_effect *const gsid_catalogue[]; /* [gsid_n_catalogue] */
extern const uint32_t gsid_n_catalogue;

/** Look an effect up.  @return the effect; NULL when there is none of that id */
const gsid_effect *gsid_catalogue_find(const char *id);

#ifdef __cplusplus
}
#endif

#endif
