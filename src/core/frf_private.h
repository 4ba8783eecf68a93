/* One line of a frequency response, for the rooms built on frf.c. */
#ifndef GSID_FRF_PRIVATE_H
#define GSID_FRF_PRIVATE_H

#include "gsid/frf.h"

#define gsid_frf_line_at GSID_NAME(gsid_frf_line_at)
#define gsid_frf_error_variance GSID_NAME(gsid_frf_error_variance)

typedef struct {
    gsid_cplx g, y, u, cov_yu;
    gsid_real var_g, var_y, var_u; /* var_g of the mean, the others of one period */
} gsid_frf_line;

/* Line i of the means so far; var_g infinite where the input is 0. One good period at least. */
gsid_frf_line gsid_frf_line_at(const gsid_frf *frf, uint32_t i);

/* Variance of Y - g U of one period. */
gsid_real gsid_frf_error_variance(const gsid_frf_line *line, gsid_cplx g);

#endif
