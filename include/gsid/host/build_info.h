/* What this build of the host library contains. */
#ifndef GSID_HOST_BUILD_INFO_H
#define GSID_HOST_BUILD_INFO_H

#ifdef __cplusplus
extern "C" {
#endif

/** Version of a third-party library in this build.
 *  @param[in] library  "fftw", "nlopt", "suitesparse"
 *  @return its version; "" when it was left out of the build; NULL for another name */
const char *gsid_build_library_version(const char *library);

#ifdef __cplusplus
}
#endif

#endif
