#include "singular.h"

#include <float.h>
#include <math.h>
#include <stddef.h>

#define SWEEPS_MAX 60 /* 6 to 10 are needed */

double gsid_dot(uint32_t n, const double *x, const double *y) {
    double sum = 0;
    for (uint32_t i = 0; i < n; i++) {
        sum += x[i] * y[i];
    }
    return sum;
}

static void rotate(uint32_t n, double c, double s, double *x, double *y) {
    for (uint32_t i = 0; i < n; i++) {
        const double old = x[i];
        x[i] = c * old - s * y[i];
        y[i] = s * old + c * y[i];
    }
}

int gsid_singular_values(uint32_t n, uint32_t length, double *a, double *v) {
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++) {
            v[(size_t)i * n + j] = i == j;
        }
    }
    for (int sweep = 0, is_done = 0; sweep < SWEEPS_MAX; sweep++) {
        is_done = 1;
        for (uint32_t i = 0; i + 1 < n; i++) {
            for (uint32_t j = i + 1; j < n; j++) {
                double *x = a + (size_t)i * length, *y = a + (size_t)j * length;
                const double xx = gsid_dot(length, x, x), yy = gsid_dot(length, y, y), xy = gsid_dot(length, x, y);
                if (fabs(xy) <= DBL_EPSILON * sqrt(xx) * sqrt(yy)) {
                    continue;
                }
                is_done = 0;
                const double zeta = (yy - xx) / (2 * xy);
                const double t = copysign(1 / (fabs(zeta) + hypot(1, zeta)), zeta);
                const double c = 1 / hypot(1, t);
                rotate(length, c, c * t, x, y);
                rotate(n, c, c * t, v + (size_t)i * n, v + (size_t)j * n);
            }
        }
        if (is_done) {
            return 1;
        }
    }
    return 0;
}
