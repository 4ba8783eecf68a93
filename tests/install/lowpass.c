/* A user of the core, in the precision of its headers: the response of a low-pass of 10 Hz at 10 Hz is (1 - j)/2. */
#include <gsid/gsid.h>
#include <math.h>
#include <stdio.h>

int main(void) {
    const gsid_real w0 = GSID_R(62.83185307179586), f_hz = 10;
    gsid_rational lowpass;
    gsid_cplx g;
    gsid_status status = gsid_rational_init(&lowpass, GSID_DOMAIN_S, 1, 0, w0);
    lowpass.num[0] = lowpass.den[0] = lowpass.den[1] = 1;
    status = status ? status : gsid_rational_eval(&lowpass, 1, &f_hz, &g);
    printf("gsid %s, %zu bytes: %.4f %+.4fj\n", GSID_VERSION, sizeof(gsid_real), (double)g.re, (double)g.im);
    return status != GSID_OK || fabs((double)g.re - 0.5) > 1e-6 || fabs((double)g.im + 0.5) > 1e-6;
}
