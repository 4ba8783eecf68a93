/* A user of the host library: the lines of two periods of a cosine. */
#include <gsid/host.h>
#include <math.h>
#include <stdio.h>

enum { N_PERIOD = 60 };

int main(void) {
    double x[2 * N_PERIOD];
    for (int i = 0; i < 2 * N_PERIOD; i++) {
        x[i] = 3 * cos(0.1 * 3.14159265358979323846 * i); /* line 3 */
    }
    const uint32_t line[] = {2, 3};
    gsid_cplx lines[4];
    const gsid_status status = gsid_batch_spectra(2, N_PERIOD, x, 2, line, lines);
    printf("fftw %s: %.4f %.4f\n", gsid_build_library_version("fftw"), lines[2].re, lines[3].re);
    return status != GSID_OK || fabs(lines[2].re) > 1e-12 || fabs(lines[3].re - 3) > 1e-12;
}
