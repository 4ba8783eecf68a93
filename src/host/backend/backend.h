/* What the third-party libraries do for the host library. Their own headers are included nowhere but in this folder.
 * fftw.c is compiled only with GSID_WITH_FFTW, nlopt.c only with GSID_WITH_NLOPT. */
#ifndef GSID_HOST_BACKEND_H
#define GSID_HOST_BACKEND_H

/* Version of the library as linked. */
const char *gsid_fftw_version_str(void);
const char *gsid_nlopt_version_str(void);

#endif
