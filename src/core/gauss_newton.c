#include "gsid/estimate.h"

#include <string.h>

#include "equations.h"
#include "residual.h"

#define DAMPING_FIRST GSID_R(1e-3)
#define DAMPING_LEAST GSID_R(1e-13)
#define DAMPING_MOST GSID_R(1e8)
#define DAMPING_FACTOR 4
#define BEND_MOST GSID_R(0.75) /* of the step's length: a larger bend is outside the range of the expansion */

/* The cost of a model that cannot be evaluated: more than any that can. */
#define UNUSABLE ((gsid_real)INFINITY)

/* The response at one line and its derivatives, in the order of the columns, and the error. */
typedef struct {
    gsid_cplx g, by[GSID_RATIONAL_PARAMETERS_MAX];
    gsid_residual error;
} linearised;

static gsid_status linearise(const gsid_frd *data, const gsid_rational *model, uint32_t k, linearised *l) {
    const gsid_status status = gsid_rational_gradient(model, data->f_hz[k], &l->g, l->by);
    if (status == GSID_OK) {
        l->error = gsid_residual_at(data, k, l->g);
    }
    return status;
}

/* How the data of line k move with the parameters; NULL: they do not. */
static const gsid_cplx *drift_at(const gsid_cplx *drift, const gsid_rational *model, uint32_t k) {
    return drift == NULL ? NULL : drift + (size_t)k * (model->n_poles + model->n_zeros + 2);
}

static gsid_status linearise_all(gsid_equations *q, const gsid_frd *data, const gsid_cplx *drift,
                                 const gsid_rational *model) {
    linearised l;
    gsid_lsq_reset(&q->normal);
    for (uint32_t k = 0; k < data->n_lines; k++) {
        gsid_status status = linearise(data, model, k, &l);
        if (status != GSID_OK) {
            return status;
        }
        const gsid_cplx *moves = drift_at(drift, model, k);
        for (uint32_t i = 0; i < q->n; i++) {
            gsid_cplx slope = gsid_residual_slope(&l.error, l.by[i]);
            if (moves != NULL) {
                slope = gsid_cplx_add(slope, gsid_cplx_mul(l.error.by_data, moves[i]));
            }
            gsid_equations_put(q, i, slope);
        }
        gsid_equations_put(q, q->n, gsid_cplx_scale(GSID_R(-1.0), l.error.value));
        status = gsid_equations_next(q);
        if (status != GSID_OK) {
            return status;
        }
    }
    return gsid_equations_end(q);
}

/* q->length <- the lengths of J's columns; a column of zeros counts as 1, which holds its parameter where it is.
 * Returns by how much the undamped step lowers the linearised V. */
static gsid_real measure(const gsid_equations *q) {
    const uint32_t n = q->n;
    gsid_real promised = 0;
    memset(q->length, 0, n * sizeof(*q->length));
    for (uint32_t i = 0; i < n; i++) {
        const gsid_real *r = q->normal.r + (size_t)i * (n + 1);
        for (uint32_t j = i; j < n; j++) {
            q->length[j] = gsid_hypot(q->length[j], r[j]);
        }
        promised += r[n] * r[n];
    }
    for (uint32_t j = 0; j < n; j++) {
        if (q->length[j] == 0) {
            q->length[j] = 1;
        }
    }
    return promised;
}

/* q->step <- the minimiser of |J step - error|^2 + damping |D step|^2, D the lengths of J's columns. */
static gsid_status solve_damped(gsid_equations *q, gsid_real damping) {
    const uint32_t n = q->n;
    memcpy(q->damped.r, q->normal.r, ((size_t)n + 1) * ((size_t)n + 1) * sizeof(gsid_real));
    q->damped.n_rows = q->normal.n_rows;
    q->damped.n_pinned = 0;
    const gsid_real weight = gsid_sqrt(damping);
    for (uint32_t first = 0; first < n; first += GSID_LSQ_BLOCK) {
        const uint32_t n_rows = n - first < GSID_LSQ_BLOCK ? n - first : GSID_LSQ_BLOCK;
        memset(q->block, 0, ((size_t)n + 1) * GSID_LSQ_BLOCK * sizeof(*q->block));
        for (uint32_t t = 0; t < n_rows; t++) {
            q->block[(size_t)(first + t) * GSID_LSQ_BLOCK + t] = weight * q->length[first + t];
        }
        const gsid_status status = gsid_lsq_add_block(&q->damped, n_rows, q->block);
        if (status != GSID_OK) {
            return status;
        }
    }
    return gsid_lsq_solve(&q->damped, 0, q->step, NULL);
}

/* The step times the derivatives of columns first to end - 1. */
static gsid_cplx along_step(const gsid_equations *q, const linearised *l, uint32_t first, uint32_t end) {
    gsid_cplx sum = {0, 0};
    for (uint32_t i = first; i < end; i++) {
        sum = gsid_cplx_add(sum, gsid_cplx_scale(q->step[i], l->by[i]));
    }
    return sum;
}

/* Second derivative of G = e B / A along a step, from the first ones through A (a), B (b) and the delay in e (d):
 * ((a + d) (a + d + 2 b) + a^2) / G. Where G is 0 it is neglected. */
static gsid_cplx second_derivative(gsid_cplx g, gsid_cplx a, gsid_cplx b, gsid_cplx d) {
    if (gsid_cplx_abs2(g) == 0) {
        return (gsid_cplx){0, 0};
    }
    const gsid_cplx both = gsid_cplx_add(a, d);
    const gsid_cplx squares = gsid_cplx_add(gsid_cplx_mul(both, both), gsid_cplx_mul(a, a));
    return gsid_cplx_div(gsid_cplx_add(squares, gsid_cplx_scale(2, gsid_cplx_mul(both, b))), g);
}

/* Second derivative of the error: for ln G it is G''/G - (G'/G)^2; that of the weight is neglected. */
static gsid_cplx second_of_error(const gsid_frd *data, const linearised *l, gsid_cplx along, gsid_cplx second) {
    if (data->logarithmic) {
        second = gsid_cplx_sub(second, gsid_cplx_div(gsid_cplx_mul(along, along), l->g));
    }
    return gsid_cplx_mul(l->error.by_model, second);
}

/* q->bend <- J' times the second derivative of the errors along q->step. */
static gsid_status project_bend(gsid_equations *q, const gsid_frd *data, const gsid_cplx *drift,
                                const gsid_rational *model) {
    const uint32_t n_coefficients = q->n_den + q->n_num;
    linearised l;
    memset(q->bend, 0, q->n * sizeof(*q->bend));
    for (uint32_t k = 0; k < data->n_lines; k++) {
        const gsid_status status = linearise(data, model, k, &l);
        if (status != GSID_OK) {
            return status;
        }
        const gsid_cplx a = along_step(q, &l, 0, q->n_den);
        const gsid_cplx b = along_step(q, &l, q->n_den, n_coefficients);
        const gsid_cplx d = along_step(q, &l, n_coefficients, q->n);
        const gsid_cplx along = gsid_cplx_add(gsid_cplx_add(a, b), d);
        const gsid_cplx second = second_of_error(data, &l, along, second_derivative(l.g, a, b, d));
        const gsid_cplx p = gsid_residual_project(&l.error, second);
        const gsid_cplx p_data = gsid_cplx_mul(gsid_cplx_conj(second), l.error.by_data);
        const gsid_cplx *moves = drift_at(drift, model, k);
        for (uint32_t i = 0; i < q->n; i++) {
            q->bend[i] += l.by[i].re * p.re - l.by[i].im * p.im;
        }
        for (uint32_t i = 0; i < q->n && moves != NULL; i++) {
            q->bend[i] += moves[i].re * p_data.re - moves[i].im * p_data.im;
        }
    }
    return GSID_OK;
}

static gsid_real scaled_length(const gsid_equations *q, const gsid_real *x) {
    gsid_real length = 0;
    for (uint32_t i = 0; i < q->n; i++) {
        length = gsid_hypot(length, q->length[i] * x[i]);
    }
    return length;
}

/* Geodesic acceleration (Transtrum and Sethna): the straight step plus what the model's curvature along it requires. In the
 * curved valleys of over-parameterised models straight steps must be tiny, and there are hundreds of them. */
static gsid_status bend_step(gsid_equations *q, const gsid_frd *data, const gsid_cplx *drift,
                             const gsid_rational *model) {
    gsid_status status = project_bend(q, data, drift, model);
    if (status == GSID_OK) {
        status = gsid_lsq_solve_normal(&q->damped, q->bend, q->bend);
    }
    if (status == GSID_OK && !(scaled_length(q, q->bend) <= BEND_MOST * scaled_length(q, q->step))) {
        status = GSID_E_NONFINITE;
    }
    for (uint32_t i = 0; i < q->n && status == GSID_OK; i++) {
        q->step[i] -= q->bend[i] / 2;
    }
    return status;
}

static void add_step(const gsid_equations *q, const gsid_rational *from, gsid_rational *to) {
    *to = *from;
    for (uint32_t i = 0; i < q->n_den; i++) {
        to->den[i < q->held ? i : i + 1] += q->step[i];
    }
    for (uint32_t i = 0; i < q->n_num; i++) {
        to->num[i] += q->step[q->n_den + i];
    }
    if (q->n > q->n_den + q->n_num) {
        to->delay_s += q->step[q->n - 1];
    }
}

/* V that rounding leaves with exact data. */
static gsid_real rounding_cost(const gsid_frd *data) {
    gsid_real cost = 0;
    for (uint32_t k = 0; k < data->n_lines; k++) {
        cost += gsid_cplx_abs2(gsid_cplx_scale(4 * GSID_EPSILON * gsid_residual_weight(data, k), data->g[k]));
    }
    return cost;
}

/* The problem of one gsid_estimate_ml. */
typedef struct {
    const gsid_frd *data;
    const gsid_ml_cfg *cfg;
    gsid_equations q;
} search;

/* Set data->g for a model. */
static gsid_status update(const search *s, const gsid_rational *model, int with_drift) {
    return s->cfg->update == NULL ? GSID_OK : s->cfg->update(s->cfg->user, model, with_drift);
}

/* V after a step with this damping, or UNUSABLE. */
static gsid_real try_damping(search *s, const gsid_rational *from, gsid_real damping, gsid_rational *to) {
    if (solve_damped(&s->q, damping) < 0 || bend_step(&s->q, s->data, s->cfg->drift, from) < 0) {
        return UNUSABLE;
    }
    add_step(&s->q, from, to);
    if (!gsid_equations_is_finite(to) || update(s, to, 0) < 0) {
        return UNUSABLE;
    }
    return gsid_equations_cost(s->data, to);
}

/* The best step from where q.normal was linearised, with V = v: the damping is raised until V falls, or lowered as long as
 * V falls further. Returns the new V; not below v when no damping lowers it. */
static gsid_real best_step(search *s, const gsid_rational *from, gsid_real v, gsid_real *damping, gsid_rational *to) {
    gsid_real least = try_damping(s, from, *damping, to);
    if (!(least < v)) {
        while (!(least < v) && *damping < DAMPING_MOST) {
            *damping *= DAMPING_FACTOR;
            least = try_damping(s, from, *damping, to);
        }
        return least;
    }
    gsid_rational further;
    while (*damping > DAMPING_LEAST) {
        const gsid_real further_v = try_damping(s, from, *damping / DAMPING_FACTOR, &further);
        if (!(further_v < least)) {
            break;
        }
        *damping /= DAMPING_FACTOR;
        least = further_v;
        *to = further;
    }
    return least;
}

gsid_status gsid_estimate_ml(const gsid_frd *data, const gsid_ml_cfg *cfg, gsid_rational *model, gsid_real *cost,
                             void *mem, size_t mem_size) {
    if (cfg == NULL || (cfg->update != NULL && cfg->drift == NULL)) {
        return GSID_E_NULL;
    }
    if (!(cfg->tolerance >= 0)) {
        return GSID_E_CONFIG;
    }
    search s = {.data = data, .cfg = cfg};
    gsid_status status = gsid_equations_init(&s.q, data, model, cfg->free_delay, mem, mem_size);
    if (status == GSID_OK && !gsid_equations_is_finite(model)) {
        status = GSID_E_NONFINITE;
    }
    if (status == GSID_OK) {
        status = update(&s, model, 0);
    }
    if (status != GSID_OK) {
        return status;
    }
    const uint32_t n_iterations = cfg->n_iterations > 0 ? cfg->n_iterations : 50;
    const gsid_real tolerance = cfg->tolerance > 0 ? cfg->tolerance : GSID_R(0.005);

    gsid_rational best = *model, trial;
    gsid_real v = gsid_equations_cost(data, &best), damping = DAMPING_FIRST;
    if (v >= UNUSABLE) {
        return GSID_E_NONFINITE;
    }
    int settled = v <= rounding_cost(data);
    for (uint32_t i = 0; i < n_iterations && !settled; i++) {
        status = update(&s, &best, 1);
        if (status == GSID_OK) {
            status = linearise_all(&s.q, data, cfg->drift, &best);
        }
        if (status != GSID_OK) {
            return status;
        }
        const gsid_real v_per_line = v / (gsid_real)data->n_lines;
        const gsid_real little = tolerance * (v_per_line < 1 ? v_per_line : GSID_R(1.0));
        settled = measure(&s.q) <= little;
        const gsid_real trial_v = best_step(&s, &best, v, &damping, &trial);
        if (trial_v >= UNUSABLE) {
            return GSID_E_NONFINITE;
        }
        if (!(v - trial_v > little) || trial_v <= rounding_cost(data)) {
            settled = 1;
        }
        if (trial_v < v) {
            best = trial;
            v = trial_v;
        }
    }
    *model = best;
    if (cost != NULL) {
        *cost = v;
    }
    return settled ? GSID_OK : GSID_MAX_ITER;
}

gsid_status gsid_estimate_covariance(const gsid_frd *data, const gsid_rational *model, int free_delay, gsid_real *cov,
                                     void *mem, size_t mem_size) {
    if (cov == NULL) {
        return GSID_E_NULL;
    }
    gsid_equations q;
    gsid_status status = gsid_equations_init(&q, data, model, free_delay, mem, mem_size);
    if (status == GSID_OK && !gsid_equations_is_finite(model)) {
        status = GSID_E_NONFINITE;
    }
    if (status == GSID_OK) {
        status = linearise_all(&q, data, NULL, model);
    }
    if (status == GSID_OK) {
        status = gsid_lsq_covariance(&q.normal, cov);
    }
    /* sigma^2 is E|e|^2 of a complex error: its real and imaginary parts have half of it each.  Eq: EST-5 */
    for (uint32_t i = 0; status == GSID_OK && i < q.n * q.n; i++) {
        cov[i] /= 2;
    }
    return status;
}
