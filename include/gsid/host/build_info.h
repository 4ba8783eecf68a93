/* What this build of the host library contains. */
#ifndef GSID_HOST_BUILD_INFO_H
#define GSID_HOST_BUILD_INFO_H

/** Version of a third-party library in this build.
 *  @param[in] library  "fftw", "nlopt", "suitesparse"
 *  @return its version; "" when it was left out of the build; NULL for another name */
const char *gsid_build_library_version(const char *library);

#endif
