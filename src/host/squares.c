#include "gsid/host/squares.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "gsid/host/greybox.h"
#include "gsid/lsq.h"
#include "singular.h"

/* One evaluated point. */
typedef struct {
    double *x, *r, *q;
    double cost;
    int is_settled;
} point;

/* Steps from one point for any damping, from the singular values of its triangle without the blocked columns. */
typedef struct {
    uint32_t n_moving, *moving; /* [n] columns that are not blocked */
    uint8_t *blocked;           /* [n] */
    double *a, *v; /* [n_moving][n], [n_moving][n_moving]: singular values times left vectors, right vectors */
    double *square,
        *along; /* [n_moving] squared singular value, 0 for a held direction; product of the row of a and q */
    double decrease; /* of the cost, for a full step without regard to the bounds */
} steps;

typedef struct {
    const gsid_squares *problem;
    const gsid_squares_settings *how;
    point at, trial;
    steps steps;
    double *scale; /* [n] */
    /* of NLopt */
    double *z_lower, *z_upper, *z;
    double start_cost;
    uint32_t n_calls;
    gsid_status failure;
} search;

/* ---- points ---- */

static double within(const gsid_squares *problem, uint32_t j, double x) {
    return fmin(fmax(x, problem->lower[j]), problem->upper[j]);
}

static gsid_status evaluate(const search *s, point *p) {
    const gsid_status status = s->problem->at(s->problem->user, p->x, &p->cost, p->r, p->q);
    p->is_settled = status != GSID_MAX_ITER;
    return status;
}

/* GSID_OK: the search may go on from the trial; GSID_MAX_ITER: not from there */
static gsid_status try(search *s) {
    const gsid_status status = evaluate(s, &s->trial);
    if (status == GSID_E_NO_MEMORY || status == GSID_E_STOPPED) {
        return status;
    }
    return status >= 0 && (s->trial.is_settled || !s->at.is_settled) ? GSID_OK : GSID_MAX_ITER;
}

static void take_trial(search *s) {
    const point kept = s->at;
    s->at = s->trial;
    s->trial = kept;
    if (s->problem->keep != NULL) {
        s->problem->keep(s->problem->user);
    }
}

/* Length of a column of the triangle; 1 for a column of zeros. */
static double length_of(const point *p, uint32_t n, uint32_t column) {
    double length = 0;
    for (uint32_t i = 0; i < n; i++) {
        length = hypot(length, p->r[(size_t)i * n + column]);
    }
    return length > 0 ? length : 1;
}

static void set_scale(search *s, int is_first) {
    for (uint32_t j = 0; j < s->problem->n; j++) {
        const double length = length_of(&s->at, s->problem->n, j);
        s->scale[j] = is_first ? length : fmax(s->scale[j], length);
    }
}

/* ---- steps ---- */

static void find_moving(search *s) {
    const uint32_t n = s->problem->n;
    const point *p = &s->at;
    s->steps.n_moving = 0;
    for (uint32_t j = 0; j < n; j++) {
        double downhill = 0;
        for (uint32_t i = 0; i < n; i++) {
            downhill += p->r[(size_t)i * n + j] * p->q[i];
        }
        const int at_lower = p->x[j] <= s->problem->lower[j], at_upper = p->x[j] >= s->problem->upper[j];
        s->steps.blocked[j] = (at_lower && downhill < 0) || (at_upper && downhill > 0);
        if (!s->steps.blocked[j]) {
            s->steps.moving[s->steps.n_moving++] = j;
        }
    }
}

static void set_steps(search *s) {
    const uint32_t n = s->problem->n;
    steps *t = &s->steps;
    find_moving(s);
    for (uint32_t k = 0; k < t->n_moving; k++) {
        for (uint32_t i = 0; i < n; i++) {
            t->a[(size_t)k * n + i] = s->at.r[(size_t)i * n + t->moving[k]] / s->scale[t->moving[k]];
        }
    }
    gsid_singular_values(t->n_moving, n, t->a, t->v);
    double largest = 0;
    for (uint32_t k = 0; k < t->n_moving; k++) {
        t->square[k] = gsid_dot(n, t->a + (size_t)k * n, t->a + (size_t)k * n);
        largest = fmax(largest, t->square[k]);
    }
    t->decrease = 0;
    for (uint32_t k = 0; k < t->n_moving; k++) {
        t->along[k] = gsid_dot(n, t->a + (size_t)k * n, s->at.q);
        if (!(sqrt(t->square[k]) > s->how->singular * sqrt(largest))) {
            t->square[k] = 0;
        } else {
            t->decrease += t->along[k] * t->along[k] / t->square[k];
        }
    }
}

/* The trial point after a step within the bounds.  @return the predicted decrease of the cost */
static double step(search *s, double damping) {
    const uint32_t n = s->problem->n;
    const steps *t = &s->steps;
    double *x = s->trial.x;
    memcpy(x, s->at.x, n * sizeof *x);
    for (uint32_t k = 0; k < t->n_moving; k++) {
        for (uint32_t m = 0; m < t->n_moving && t->square[k] > 0; m++) {
            const uint32_t j = t->moving[m];
            x[j] += t->v[(size_t)k * t->n_moving + m] * t->along[k] / (t->square[k] + damping) / s->scale[j];
        }
    }
    for (uint32_t j = 0; j < n; j++) {
        x[j] = within(s->problem, j, x[j]);
    }
    double promised = 0;
    for (uint32_t i = 0; i < n; i++) {
        double left = s->at.q[i];
        for (uint32_t j = 0; j < n; j++) {
            left -= s->at.r[(size_t)i * n + j] * (x[j] - s->at.x[j]);
        }
        promised += (s->at.q[i] - left) * (s->at.q[i] + left);
    }
    return promised;
}

/* ---- Levenberg and Marquardt ---- */

typedef struct {
    double value, growth;
} damping_rule;

/* Take a step that lowers the cost.  @return GSID_OK; GSID_MAX_ITER there is none; GSID_E_STOPPED; GSID_E_NO_MEMORY */
static gsid_status descend(search *s, damping_rule *d) {
    for (;;) {
        const double promised = step(s, d->value);
        const gsid_status status = promised > 0 ? try(s) : GSID_MAX_ITER;
        if (status < 0) {
            return status;
        }
        if (status == GSID_OK && s->trial.cost < s->at.cost) {
            const double gain = (s->at.cost - s->trial.cost) / promised;
            d->value *= fmax(s->how->damping_fall, 1 - pow(2 * gain - 1, 3));
            d->growth = s->how->damping_growth;
            take_trial(s);
            return GSID_OK;
        }
        d->value *= d->growth;
        d->growth *= 2;
        if (!(d->value <= s->how->damping_max)) {
            return GSID_MAX_ITER;
        }
    }
}

static gsid_status levenberg_marquardt(search *s, uint32_t n_max, gsid_squares_result *result) {
    damping_rule d = {s->how->damping_start, s->how->damping_growth};
    for (uint32_t i = 0;; i++) {
        set_scale(s, i == 0);
        set_steps(s);
        result->n_iterations = i;
        result->converged = s->steps.decrease < s->how->decrease;
        if (result->converged || i == n_max) {
            return GSID_OK;
        }
        const gsid_status status = descend(s, &d);
        if (status == GSID_MAX_ITER) { /* rounding errors and events prevent any further decrease */
            result->converged = s->steps.decrease < s->how->stalled * s->at.cost;
        }
        if (status != GSID_OK) {
            return status == GSID_E_NO_MEMORY ? status : GSID_OK;
        }
    }
}

/* ---- NLopt ---- */

static double objective(unsigned n, const double *z, double *gradient, void *user) {
    search *s = user;
    gsid_status status = s->failure;
    if (status == GSID_OK) {
        s->n_calls++;
        for (uint32_t j = 0; j < n; j++) {
            s->trial.x[j] = within(s->problem, j, z[j] / s->scale[j]);
        }
        status = try(s);
        s->failure = status < 0 ? status : GSID_OK;
    }
    for (uint32_t j = 0; j < n && gradient != NULL; j++) {
        gradient[j] = 0;
        for (uint32_t i = 0; i < n && status == GSID_OK; i++) {
            gradient[j] -= 2 * s->trial.r[(size_t)i * n + j] * s->trial.q[i] / s->scale[j];
        }
    }
    if (status != GSID_OK) {
        return s->how->failed_cost * s->start_cost;
    }
    const double cost = s->trial.cost;
    if (cost < s->at.cost) {
        take_trial(s);
    }
    return cost;
}

static gsid_status by_nlopt(search *s, uint32_t n_max, gsid_squares_result *result) {
    const uint32_t n = s->problem->n;
    double least;
    set_scale(s, 1);
    s->start_cost = s->at.cost;
    for (uint32_t j = 0; j < n; j++) {
        s->z_lower[j] = s->problem->lower[j] * s->scale[j];
        s->z_upper[j] = s->problem->upper[j] * s->scale[j];
        s->z[j] = fmin(fmax(s->at.x[j] * s->scale[j], s->z_lower[j]), s->z_upper[j]);
    }
    gsid_status status = gsid_minimise(n, objective, s, s->z_lower, s->z_upper, s->how->decrease, n_max, s->z, &least);
    if (s->failure != GSID_OK) {
        status = s->failure == GSID_E_STOPPED ? GSID_OK : s->failure;
    }
    set_scale(s, 1);
    set_steps(s);
    result->n_iterations = s->n_calls;
    result->converged = s->failure == GSID_OK && s->steps.decrease < s->how->decrease;
    return status == GSID_MAX_ITER ? GSID_OK : status;
}

/* ---- the call ---- */

static double *take(double **next, size_t n) {
    double *taken = *next;
    *next += n;
    return taken;
}

static double *lay_out(search *s) {
    const size_t n = s->problem->n;
    double *memory = malloc((4 * n * n + 10 * n) * sizeof *memory), *next = memory;
    uint32_t *moving = malloc(n * sizeof *moving);
    uint8_t *blocked = malloc(n);
    if (memory == NULL || moving == NULL || blocked == NULL) {
        free(memory);
        free(moving);
        free(blocked);
        return NULL;
    }
    s->steps.moving = moving, s->steps.blocked = blocked;
    point *both[] = {&s->at, &s->trial};
    for (int i = 0; i < 2; i++) {
        both[i]->x = take(&next, n);
        both[i]->q = take(&next, n);
        both[i]->r = take(&next, n * n);
    }
    s->steps.a = take(&next, n * n), s->steps.v = take(&next, n * n);
    s->steps.square = take(&next, n), s->steps.along = take(&next, n);
    s->scale = take(&next, n);
    s->z_lower = take(&next, n), s->z_upper = take(&next, n), s->z = take(&next, n);
    return memory;
}

/* With others the search could go on for ever. */
static int are_usable(const gsid_squares_settings *s) {
    return s->decrease >= 0 && s->singular >= 0 && s->singular <= 1 && s->damping_start > 0 &&
           s->damping_max >= s->damping_start && isfinite(s->damping_max) && s->damping_fall > 0 &&
           s->damping_fall <= 1 && s->damping_growth > 1 && isfinite(s->damping_growth) && s->stalled >= 0 &&
           s->failed_cost > 0;
}

static gsid_status check(const gsid_squares *problem, const gsid_squares_settings *settings, const double *x) {
    if (problem == NULL || settings == NULL || x == NULL || problem->lower == NULL || problem->upper == NULL ||
        problem->at == NULL) {
        return GSID_E_NULL;
    }
    if (problem->n == 0 || problem->n > GSID_LSQ_COLUMNS_MAX || !are_usable(settings)) {
        return GSID_E_CONFIG;
    }
    for (uint32_t j = 0; j < problem->n; j++) {
        if (!isfinite(x[j])) {
            return GSID_E_NONFINITE;
        }
        if (!(problem->lower[j] <= problem->upper[j])) {
            return GSID_E_CONFIG;
        }
    }
    return GSID_OK;
}

static gsid_status run(search *s, gsid_solver solver, uint32_t n_max, gsid_squares_result *result) {
    const gsid_status status = evaluate(s, &s->at);
    if (status < 0) {
        return status;
    }
    if (s->problem->keep != NULL) {
        s->problem->keep(s->problem->user);
    }
    return solver == GSID_SOLVER_NLOPT ? by_nlopt(s, n_max, result) : levenberg_marquardt(s, n_max, result);
}

gsid_status gsid_squares_search(const gsid_squares *problem, const gsid_squares_settings *settings, gsid_solver solver,
                                uint32_t n_max, double *x, uint8_t *blocked, gsid_squares_result *result) {
    gsid_status status = result == NULL ? GSID_E_NULL : check(problem, settings, x);
    if (status == GSID_OK &&
        (n_max == 0 || n_max > INT_MAX || (solver != GSID_SOLVER_GAUSS_NEWTON && solver != GSID_SOLVER_NLOPT))) {
        status = GSID_E_CONFIG;
    }
    if (status != GSID_OK) {
        return status;
    }
    const uint32_t n = problem->n;
    search s = {.problem = problem, .how = settings, .failure = GSID_OK};
    gsid_squares_result found = {0};
    double *memory = lay_out(&s);
    if (memory == NULL) {
        return GSID_E_NO_MEMORY;
    }
    memcpy(s.at.x, x, n * sizeof *x);
    status = run(&s, solver, n_max, &found);
    if (status == GSID_OK) {
        memcpy(x, s.at.x, n * sizeof *x);
        found.cost = s.at.cost;
        *result = found;
        if (blocked != NULL) {
            memcpy(blocked, s.steps.blocked, n);
        }
    }
    free(memory);
    free(s.steps.moving);
    free(s.steps.blocked);
    return status;
}

gsid_status gsid_squares_defaults(gsid_squares_settings *settings) {
    if (settings == NULL) {
        return GSID_E_NULL;
    }
    *settings = (gsid_squares_settings){.decrease = 0.01,
                                        .singular = 1e-6,
                                        .damping_start = 1e-3,
                                        .damping_max = 1e10,
                                        .damping_fall = 1.0 / 3,
                                        .damping_growth = 2,
                                        .stalled = 1e-6,
                                        .failed_cost = 10};
    return GSID_OK;
}
