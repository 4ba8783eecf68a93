#include <math.h>
#include <nlopt.h>
#include <stdio.h>
#include <string.h>

#include "backend.h"

gsid_status gsid_nlopt_minimise(unsigned n, gsid_objective f, void *user, const double *lower, const double *upper,
                                double tolerance, int n_max, double *x, double *least) {
    nlopt_opt opt = nlopt_create(NLOPT_LD_SLSQP, n);
    if (opt == NULL)
        return GSID_E_NO_MEMORY;
    double best = INFINITY;
    nlopt_result result = nlopt_set_min_objective(opt, f, user);
    if (result == NLOPT_SUCCESS)
        result = nlopt_set_lower_bounds(opt, lower);
    if (result == NLOPT_SUCCESS)
        result = nlopt_set_upper_bounds(opt, upper);
    if (result == NLOPT_SUCCESS)
        result = nlopt_set_ftol_abs(opt, tolerance);
    if (result == NLOPT_SUCCESS)
        result = nlopt_set_maxeval(opt, n_max);
    if (result == NLOPT_SUCCESS)
        result = nlopt_optimize(opt, x, &best);
    nlopt_destroy(opt);
    *least = best;
    if (result == NLOPT_OUT_OF_MEMORY)
        return GSID_E_NO_MEMORY;
    if (result == NLOPT_MAXEVAL_REACHED)
        return GSID_MAX_ITER;
    /* Limited by rounding: the least point is as good as it gets. */
    if (result > 0 || result == NLOPT_ROUNDOFF_LIMITED)
        return GSID_OK;
    return GSID_E_SINGULAR;
}

const char *gsid_nlopt_version_str(void) {
    static char text[32];
    int major, minor, bugfix;
    nlopt_version(&major, &minor, &bugfix);
    snprintf(text, sizeof text, "%d.%d.%d", major, minor, bugfix);
    return text;
}
