/* Tail probabilities of chi-square, F, gamma and beta distributions, and their logarithms where they underflow. */
#ifndef GSID_HOST_TAIL_H
#define GSID_HOST_TAIL_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Probabilities on both sides of a point; lower + upper = 1. The logarithms remain finite where a side is below 1e-308. */
typedef struct {
    double lower, upper;         /* 0 .. 1 */
    double log_lower, log_upper; /* natural logarithms, <= 0; -inf: the side is empty */
} gsid_tail;

#define GSID_TAIL_SHAPE_MIN 0.1
#define GSID_TAIL_SHAPE_MAX 1.0e10

/** Regularised incomplete gamma functions P(a, x) and Q(a, x).  Eq: TLS-1
 *  @param[in]  a     shape, GSID_TAIL_SHAPE_MIN .. GSID_TAIL_SHAPE_MAX
 *  @param[in]  x     >= 0; inf is allowed
 *  @param[out] tail  lower P, upper Q
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG a or x out of its range or not a number: output untouched
 *  Limits: 1e-12 of each side while it is above 1e-300, 1e-12 of each logarithm below -1 (tests/python/test_tail.py).
 *  Memory: none.  Cost: 20 to 100 terms, and 10 sqrt(a) near x = a.  Context: any thread. */
gsid_status gsid_tail_gamma(double a, double x, gsid_tail *tail);

/** Regularised incomplete beta functions I_x(a, b) and I_y(b, a).  Eq: TLS-2
 *  @param[in]  a, b  shapes, GSID_TAIL_SHAPE_MIN .. GSID_TAIL_SHAPE_MAX
 *  @param[in]  x     0 .. 1
 *  @param[in]  y     1 - x, given separately because the difference loses its digits; within 1e-8 of it
 *  @param[out] tail  lower I_x(a, b), upper I_y(b, a)
 *  @return as gsid_tail_gamma
 *  Limits, memory, cost, context: as gsid_tail_gamma, with the larger shape in place of a. */
gsid_status gsid_tail_beta(double a, double b, double x, double y, gsid_tail *tail);

/** Chi-square distribution.
 *  @param[in]  dof   degrees of freedom, > 0; half of it in the range of a shape
 *  @param[in]  x     >= 0
 *  @param[out] tail  upper: probability of a larger value
 *  @return, limits, cost: as gsid_tail_gamma */
gsid_status gsid_tail_chi2(double dof, double x, gsid_tail *tail);

/** F distribution.
 *  @param[in]  dof_1, dof_2  degrees of freedom of numerator and denominator, halves in the range of a shape; dof_2 may be inf:
 *                            the variance in the denominator is known
 *  @param[in]  t             >= 0
 *  @param[out] tail          upper: probability of a larger ratio
 *  @return, limits, cost: as gsid_tail_beta */
gsid_status gsid_tail_f(double dof_1, double dof_2, double t, gsid_tail *tail);

#ifdef __cplusplus
}
#endif

#endif
