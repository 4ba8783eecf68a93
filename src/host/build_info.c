/* What this build of the host library contains. */
#include "gsid/host/build_info.h"

#include <stddef.h>
#include <string.h>

#include "backend/backend.h"

const char *gsid_build_library_version(const char *library) {
    if (library == NULL) {
        return NULL;
    }
    if (strcmp(library, "fftw") == 0) {
#ifdef GSID_WITH_FFTW
        return gsid_fftw_version_str();
#else
        return "";
#endif
    }
    if (strcmp(library, "nlopt") == 0) {
#ifdef GSID_WITH_NLOPT
        return gsid_nlopt_version_str();
#else
        return "";
#endif
    }
    if (strcmp(library, "suitesparse") == 0) {
#ifdef GSID_WITH_SUITESPARSE
        return gsid_suitesparse_version_str();
#else
        return "";
#endif
    }
    return NULL;
}
