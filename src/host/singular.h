/* Singular values of a matrix by one-sided Jacobi rotations. */
#ifndef GSID_SINGULAR_PRIVATE_H
#define GSID_SINGULAR_PRIVATE_H

#include <stdint.h>

/** Rotate the rows of `a` until they are orthogonal: their lengths are the singular values, row k over its length is the left singular
 *  vector of the transposed matrix, and row k of v the right one.
 *  @param[in]     n       rows
 *  @param[in]     length  numbers in a row
 *  @param[in,out] a       [n][length] finite
 *  @param[out]    v       [n][n]
 *  @return whether they are orthogonal to rounding */
int gsid_singular_values(uint32_t n, uint32_t length, double *a, double *v);

double gsid_dot(uint32_t n, const double *x, const double *y);

#endif
