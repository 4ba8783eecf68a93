#include <math.h>
#include <nlopt.h>
#include <stdio.h>
#include <string.h>

#include "backend.h"

static nlopt_opt create(const gsid_nlopt_search *how) {
    static const nlopt_algorithm ALGORITHM[] = {NLOPT_LD_SLSQP, NLOPT_GN_ESCH, NLOPT_GN_CRS2_LM, NLOPT_GN_ISRES};
    return nlopt_create(ALGORITHM[how->algorithm], how->n);
}

static gsid_status status_of(nlopt_result result) {
    if (result == NLOPT_OUT_OF_MEMORY) {
        return GSID_E_NO_MEMORY;
    }
    if (result == NLOPT_MAXEVAL_REACHED) {
        return GSID_MAX_ITER;
    }
    /* Limited by rounding: the least point is as good as it gets. */
    if (result > 0 || result == NLOPT_ROUNDOFF_LIMITED) {
        return GSID_OK;
    }
    return GSID_E_SINGULAR;
}

gsid_status gsid_nlopt_minimise(const gsid_nlopt_search *how, gsid_objective f, void *user, double *x, double *least) {
    nlopt_opt opt = create(how);
    if (opt == NULL) {
        return GSID_E_NO_MEMORY;
    }
    double best = INFINITY;
    if (how->algorithm != GSID_NLOPT_SLSQP) {
        nlopt_srand(how->seed);
    }
    nlopt_result result = nlopt_set_min_objective(opt, f, user);
    if (result == NLOPT_SUCCESS) {
        result = nlopt_set_lower_bounds(opt, how->lower);
    }
    if (result == NLOPT_SUCCESS) {
        result = nlopt_set_upper_bounds(opt, how->upper);
    }
    if (result == NLOPT_SUCCESS) {
        result = nlopt_set_ftol_abs(opt, how->tolerance);
    }
    if (result == NLOPT_SUCCESS) {
        result = nlopt_set_maxeval(opt, how->n_max);
    }
    if (result == NLOPT_SUCCESS && how->population > 0) {
        result = nlopt_set_population(opt, how->population);
    }
    if (result == NLOPT_SUCCESS) {
        result = nlopt_optimize(opt, x, &best);
    }
    nlopt_destroy(opt);
    *least = best;
    return status_of(result);
}

gsid_status gsid_nlopt_minimise_scalar(gsid_objective f, void *user, double tolerance, int n_max, double *x,
                                       double *least) {
    nlopt_opt opt = nlopt_create(NLOPT_LN_BOBYQA, 1);
    if (opt == NULL) {
        return GSID_E_NO_MEMORY;
    }
    nlopt_result result = nlopt_set_min_objective(opt, f, user);
    if (result == NLOPT_SUCCESS) {
        result = nlopt_set_lower_bounds1(opt, 0);
    }
    if (result == NLOPT_SUCCESS) {
        result = nlopt_set_upper_bounds1(opt, 1);
    }
    if (result == NLOPT_SUCCESS) {
        result = nlopt_set_xtol_abs1(opt, tolerance);
    }
    if (result == NLOPT_SUCCESS) {
        result = nlopt_set_maxeval(opt, n_max);
    }
    if (result == NLOPT_SUCCESS) {
        result = nlopt_optimize(opt, x, least);
    }
    nlopt_destroy(opt);
    return status_of(result);
}

enum { N_STORED = 12 }; /* earlier steps from which the curvature is built */

gsid_status gsid_nlopt_descend(unsigned n, gsid_objective f, void *user, int n_max, double *x) {
    nlopt_opt opt = nlopt_create(NLOPT_LD_LBFGS, n);
    if (opt == NULL) {
        return GSID_E_NO_MEMORY;
    }
    double least;
    nlopt_result result = nlopt_set_min_objective(opt, f, user);
    if (result == NLOPT_SUCCESS) {
        result = nlopt_set_maxeval(opt, n_max);
    }
    if (result == NLOPT_SUCCESS) { /* NLopt's own choice fills megabytes, and costs more than the transforms */
        result = nlopt_set_vector_storage(opt, N_STORED);
    }
    if (result == NLOPT_SUCCESS) {
        result = nlopt_optimize(opt, x, &least);
    }
    nlopt_destroy(opt);
    return result == NLOPT_OUT_OF_MEMORY ? GSID_E_NO_MEMORY : GSID_OK;
}

const char *gsid_nlopt_version_str(void) {
    static char text[32];
    int major, minor, bugfix;
    nlopt_version(&major, &minor, &bugfix);
    snprintf(text, sizeof text, "%d.%d.%d", major, minor, bugfix);
    return text;
}
