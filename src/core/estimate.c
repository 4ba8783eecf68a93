#include "gsid/estimate.h"

#include <string.h>

#include "complex_math.h"

#define DAMPING_FIRST GSID_R(1e-3)
#define DAMPING_LEAST GSID_R(1e-13)
#define DAMPING_MOST GSID_R(1e8)
#define DAMPING_FACTOR 4
#define BEND_MOST GSID_R(0.75) /* of the step's length: beyond it the expansion that gave both is not to be trusted */

/* The cost of a model that cannot be evaluated: more than any that can. */
#define UNUSABLE INFINITY

/* The unknowns, in the order of the columns: den without the coefficient held at 1, num, delay when it is free. */
typedef struct {
    uint32_t n_den, n_num, n; /* n = n_den + n_num + free_delay */
    uint32_t held;            /* index of the denominator coefficient that is 1 */
    const gsid_cplx *drift; /* of data->g, or NULL */
    gsid_lsq normal, damped;
    gsid_real *row_re, *row_im, *step, *bend; /* [n] */
    gsid_real *length;                        /* [n] of the columns of J */
} workspace;

static uint32_t den_index(const workspace *w, uint32_t column) {
    return column < w->held ? column : column + 1;
}

size_t gsid_estimate_mem_size(uint32_t n_poles, uint32_t n_zeros) {
    if (n_poles > GSID_ORDER_MAX || n_zeros > GSID_ORDER_MAX)
        return 0;
    return GSID_ESTIMATE_MEM_SIZE(n_poles, n_zeros);
}

static gsid_status check_data(const gsid_frd *data) {
    if (data == NULL || data->f_hz == NULL || data->g == NULL)
        return GSID_E_NULL;
    for (uint32_t k = 0; k < data->n_lines; k++) {
        if (!gsid_is_finite(data->f_hz[k]) || !gsid_cplx_is_finite(data->g[k]))
            return GSID_E_NONFINITE;
        if (data->sigma != NULL && !(data->sigma[k] > 0 && gsid_is_finite(data->sigma[k])))
            return GSID_E_CONFIG;
    }
    return GSID_OK;
}

static gsid_status check_model(const gsid_rational *model) {
    if (model == NULL)
        return GSID_E_NULL;
    if (model->n_poles > GSID_ORDER_MAX || model->n_zeros > GSID_ORDER_MAX || !gsid_is_finite(model->delay_s))
        return GSID_E_CONFIG;
    const gsid_real rate = model->domain == GSID_DOMAIN_S ? model->scale_rad_s : model->sample_s;
    return rate > 0 && gsid_is_finite(rate) ? GSID_OK : GSID_E_CONFIG;
}

static gsid_status workspace_init(workspace *w, const gsid_frd *data, const gsid_rational *model, int free_delay,
                                  void *mem, size_t mem_size) {
    gsid_status status = check_data(data);
    if (status == GSID_OK)
        status = check_model(model);
    if (status != GSID_OK)
        return status;
    if (mem == NULL)
        return GSID_E_NULL;
    if (mem_size < GSID_ESTIMATE_MEM_SIZE(model->n_poles, model->n_zeros) || (uintptr_t)mem % sizeof(gsid_real) != 0)
        return GSID_E_MEMORY;
    w->drift = NULL;
    w->n_den = model->n_poles;
    w->n_num = model->n_zeros + 1;
    w->n = w->n_den + w->n_num + (free_delay ? 1u : 0u);
    w->held = gsid_rational_held(model);
    if (2 * data->n_lines < w->n)
        return GSID_E_TOO_FEW;
    const size_t lsq_size = GSID_LSQ_MEM_SIZE(w->n);
    unsigned char *bytes = mem;
    gsid_lsq_init(&w->normal, w->n, bytes, lsq_size);
    gsid_lsq_init(&w->damped, w->n, bytes + lsq_size, lsq_size);
    w->row_re = (gsid_real *)(void *)(bytes + 2 * lsq_size);
    w->row_im = w->row_re + w->n;
    w->step = w->row_im + w->n;
    w->bend = w->step + w->n;
    w->length = w->bend + w->n;
    return GSID_OK;
}

static gsid_real weight_of(const gsid_frd *data, uint32_t k) {
    return data->sigma == NULL ? GSID_R(1.0) : 1 / data->sigma[k];
}

/* V, or UNUSABLE.  Eq: EST-3 */
static gsid_real cost_of(const gsid_frd *data, const gsid_rational *model) {
    gsid_real cost = 0;
    for (uint32_t k = 0; k < data->n_lines; k++) {
        gsid_cplx g;
        if (gsid_rational_eval(model, 1, &data->f_hz[k], &g) != GSID_OK)
            return UNUSABLE;
        cost += gsid_cplx_abs2(gsid_cplx_scale(weight_of(data, k), gsid_cplx_sub(data->g[k], g)));
    }
    return gsid_is_finite(cost) ? cost : UNUSABLE;
}

gsid_status gsid_estimate_cost(const gsid_frd *data, const gsid_rational *model, gsid_real *cost) {
    gsid_status status = check_data(data);
    if (status == GSID_OK)
        status = check_model(model);
    if (status != GSID_OK)
        return status;
    if (cost == NULL)
        return GSID_E_NULL;
    const gsid_real v = cost_of(data, model);
    if (v >= UNUSABLE)
        return GSID_E_NONFINITE;
    *cost = v;
    return GSID_OK;
}

/* Put one complex number into column `column` of the real and imaginary rows. */
static void put(const workspace *w, uint32_t column, gsid_cplx value) {
    w->row_re[column] = value.re;
    w->row_im[column] = value.im;
}

/* One line of the equation error e = A G' - B, G' the response without the delay, weighted by `weight`.  Eq: EST-1 */
static gsid_status add_equation_error(workspace *w, const gsid_rational *model, gsid_cplx v, gsid_cplx g,
                                      gsid_real weight) {
    gsid_cplx power = {weight, 0};
    gsid_cplx rhs = {0, 0};
    for (uint32_t i = 0, column = 0; i <= model->n_poles; i++, power = gsid_cplx_mul(power, v)) {
        const gsid_cplx value = gsid_cplx_mul(power, g);
        if (i == w->held)
            rhs = gsid_cplx_scale(GSID_R(-1.0), value);
        else
            put(w, column++, value);
    }
    power.re = weight;
    power.im = 0;
    for (uint32_t i = 0; i <= model->n_zeros; i++, power = gsid_cplx_mul(power, v))
        put(w, w->n_den + i, gsid_cplx_scale(GSID_R(-1.0), power));
    const gsid_status status = gsid_lsq_add(&w->normal, w->row_re, rhs.re);
    return status != GSID_OK ? status : gsid_lsq_add(&w->normal, w->row_im, rhs.im);
}

/* Write x, in the order of the columns, into a model. */
static void set_parameters(const workspace *w, const gsid_real *x, gsid_real held, gsid_rational *model) {
    model->den[w->held] = held;
    for (uint32_t i = 0; i < w->n_den; i++)
        model->den[den_index(w, i)] = x[i];
    for (uint32_t i = 0; i < w->n_num; i++)
        model->num[i] = x[w->n_den + i];
    if (w->n > w->n_den + w->n_num)
        model->delay_s = x[w->n - 1];
}

/* One linear solution, weighted by 1/(sigma |A_last|^r).  Eq: EST-2 */
static gsid_status solve_reweighted(workspace *w, const gsid_frd *data, gsid_real exponent, int reweight,
                                    gsid_rational *model) {
    gsid_lsq_reset(&w->normal);
    for (uint32_t k = 0; k < data->n_lines; k++) {
        const gsid_real w_rad_s = GSID_TWO_PI * data->f_hz[k];
        const gsid_cplx v = gsid_rational_variable(model, w_rad_s);
        const gsid_cplx g = gsid_cplx_mul(data->g[k], gsid_cplx_cis(w_rad_s * model->delay_s));
        gsid_real weight = weight_of(data, k);
        if (reweight) {
            const gsid_real a2 = gsid_cplx_abs2(gsid_cplx_polynomial(model->n_poles, model->den, v));
            weight /= gsid_pow(a2, exponent / 2);
        }
        const gsid_status status = add_equation_error(w, model, v, g, weight);
        if (status != GSID_OK)
            return status;
    }
    const gsid_status status = gsid_lsq_solve(&w->normal, 0, w->step, NULL);
    if (status >= 0)
        set_parameters(w, w->step, 1, model);
    return status;
}

gsid_status gsid_estimate_iwls(const gsid_frd *data, const gsid_iwls_cfg *cfg, gsid_rational *model, gsid_real *cost,
                               void *mem, size_t mem_size) {
    if (cfg == NULL)
        return GSID_E_NULL;
    if (!(cfg->exponent >= 0) || !gsid_is_finite(cfg->exponent))
        return GSID_E_CONFIG;
    const gsid_real exponent = cfg->exponent > 0 ? cfg->exponent : GSID_R(1.0);
    workspace w;
    gsid_status status = workspace_init(&w, data, model, 0, mem, mem_size);
    if (status != GSID_OK)
        return status;

    gsid_rational trial = *model, best = *model;
    gsid_real best_cost = UNUSABLE;
    gsid_status best_status = GSID_E_SINGULAR;
    for (uint32_t i = 0; i <= cfg->n_iterations; i++) {
        status = solve_reweighted(&w, data, exponent, i > 0, &trial);
        if (status < 0 && i == 0)
            return status;
        if (status < 0)
            break; /* a denominator that vanishes on a line: what was found before stands */
        const gsid_real v = cost_of(data, &trial);
        if (v < best_cost) {
            best = trial;
            best_cost = v;
            best_status = status;
        }
    }
    if (best_cost >= UNUSABLE)
        return GSID_E_SINGULAR;
    *model = best;
    if (cost != NULL)
        *cost = best_cost;
    return best_status;
}

/* Derivatives of G - g at one line, in the order of the columns. */
static gsid_status slopes(const workspace *w, const gsid_frd *data, const gsid_rational *model, uint32_t k,
                          gsid_cplx *g, gsid_cplx *slope) {
    const gsid_status status = gsid_rational_gradient(model, data->f_hz[k], g, slope);
    if (status != GSID_OK || w->drift == NULL)
        return status;
    const gsid_cplx *drift = w->drift + (size_t)k * (model->n_poles + model->n_zeros + 2);
    for (uint32_t i = 0; i < w->n; i++)
        slope[i] = gsid_cplx_sub(slope[i], drift[i]);
    return GSID_OK;
}

/* Append the rows of one line: derivatives over sigma, error over sigma on the right. */
static gsid_status linearise(workspace *w, const gsid_frd *data, uint32_t k, const gsid_rational *model) {
    const gsid_real weight = weight_of(data, k);
    gsid_cplx g, slope[GSID_RATIONAL_PARAMETERS_MAX];
    gsid_status status = slopes(w, data, model, k, &g, slope);
    if (status != GSID_OK)
        return status;
    for (uint32_t i = 0; i < w->n; i++)
        put(w, i, gsid_cplx_scale(weight, slope[i]));
    const gsid_cplx error = gsid_cplx_scale(weight, gsid_cplx_sub(data->g[k], g));
    status = gsid_lsq_add(&w->normal, w->row_re, error.re);
    return status != GSID_OK ? status : gsid_lsq_add(&w->normal, w->row_im, error.im);
}

static gsid_status linearise_all(workspace *w, const gsid_frd *data, const gsid_rational *model) {
    gsid_lsq_reset(&w->normal);
    gsid_status status = GSID_OK;
    for (uint32_t k = 0; k < data->n_lines && status == GSID_OK; k++)
        status = linearise(w, data, k, model);
    return status;
}

/* w->length <- the lengths of J's columns; a column of zeros counts as 1, which holds its parameter where it is.
 * Returns by how much the undamped step lowers the linearised V. */
static gsid_real measure(const workspace *w) {
    const uint32_t n = w->n;
    gsid_real promised = 0;
    memset(w->length, 0, n * sizeof(*w->length));
    for (uint32_t i = 0; i < n; i++) {
        const gsid_real *r = w->normal.r + (size_t)i * (n + 1);
        for (uint32_t j = i; j < n; j++)
            w->length[j] = gsid_hypot(w->length[j], r[j]);
        promised += r[n] * r[n];
    }
    for (uint32_t j = 0; j < n; j++)
        if (w->length[j] == 0)
            w->length[j] = 1;
    return promised;
}

/* w->step <- the minimiser of |J step - error|^2 + damping |D step|^2, D the lengths of J's columns. */
static gsid_status solve_damped(workspace *w, gsid_real damping) {
    const uint32_t n = w->n;
    memcpy(w->damped.r, w->normal.r, ((size_t)n + 1) * ((size_t)n + 1) * sizeof(gsid_real));
    w->damped.n_rows = w->normal.n_rows;
    w->damped.n_pinned = 0;
    const gsid_real weight = gsid_sqrt(damping);
    for (uint32_t j = 0; j < n; j++) {
        memset(w->row_re, 0, n * sizeof(*w->row_re));
        w->row_re[j] = weight * w->length[j];
        const gsid_status status = gsid_lsq_add(&w->damped, w->row_re, 0);
        if (status != GSID_OK)
            return status;
    }
    return gsid_lsq_solve(&w->damped, 0, w->step, NULL);
}

/* Second derivative of G = e B / A along a step (dA, dB, dtau): G (s^2 + (dA/A)^2) - 2 s e dB / A, s = dA/A + j w dtau. */
static gsid_cplx second_derivative(const gsid_rational *model, const gsid_rational *step, gsid_real f_hz) {
    const gsid_real w_rad_s = GSID_TWO_PI * f_hz;
    const gsid_cplx v = gsid_rational_variable(model, w_rad_s);
    const gsid_cplx a = gsid_cplx_polynomial(model->n_poles, model->den, v);
    const gsid_cplx by_num = gsid_cplx_div(gsid_cplx_cis(-w_rad_s * model->delay_s), a);
    const gsid_cplx g = gsid_cplx_mul(by_num, gsid_cplx_polynomial(model->n_zeros, model->num, v));
    const gsid_cplx db = gsid_cplx_mul(by_num, gsid_cplx_polynomial(model->n_zeros, step->num, v));
    const gsid_cplx da = gsid_cplx_div(gsid_cplx_polynomial(model->n_poles, step->den, v), a);
    const gsid_cplx s = gsid_cplx_add(da, gsid_cplx_make(0, w_rad_s * step->delay_s));
    const gsid_cplx squares = gsid_cplx_add(gsid_cplx_mul(s, s), gsid_cplx_mul(da, da));
    return gsid_cplx_sub(gsid_cplx_mul(g, squares), gsid_cplx_scale(2, gsid_cplx_mul(s, db)));
}

/* w->bend <- J' times the second derivative of G along w->step. */
static gsid_status project_bend(workspace *w, const gsid_frd *data, const gsid_rational *model) {
    gsid_rational step = {0};
    set_parameters(w, w->step, 0, &step);
    memset(w->bend, 0, w->n * sizeof(*w->bend));
    for (uint32_t k = 0; k < data->n_lines; k++) {
        const gsid_real weight = weight_of(data, k);
        gsid_cplx g, slope[GSID_RATIONAL_PARAMETERS_MAX];
        const gsid_status status = slopes(w, data, model, k, &g, slope);
        if (status != GSID_OK)
            return status;
        const gsid_cplx second = gsid_cplx_scale(weight * weight, second_derivative(model, &step, data->f_hz[k]));
        for (uint32_t i = 0; i < w->n; i++)
            w->bend[i] += slope[i].re * second.re + slope[i].im * second.im;
    }
    return GSID_OK;
}

static gsid_real scaled_length(const workspace *w, const gsid_real *x) {
    gsid_real length = 0;
    for (uint32_t i = 0; i < w->n; i++)
        length = gsid_hypot(length, w->length[i] * x[i]);
    return length;
}

/* Geodesic acceleration (Transtrum and Sethna): the straight step plus what the model's curvature along it asks for. In the
 * curved valleys of over-parameterised models straight steps must be tiny, and there are hundreds of them. */
static gsid_status bend_step(workspace *w, const gsid_frd *data, const gsid_rational *model) {
    gsid_status status = project_bend(w, data, model);
    if (status == GSID_OK)
        status = gsid_lsq_solve_normal(&w->damped, w->bend, w->bend);
    if (status == GSID_OK && !(scaled_length(w, w->bend) <= BEND_MOST * scaled_length(w, w->step)))
        status = GSID_E_NONFINITE;
    for (uint32_t i = 0; i < w->n && status == GSID_OK; i++)
        w->step[i] -= w->bend[i] / 2;
    return status;
}

static void add_step(const workspace *w, const gsid_rational *from, gsid_rational *to) {
    *to = *from;
    for (uint32_t i = 0; i < w->n_den; i++)
        to->den[den_index(w, i)] += w->step[i];
    for (uint32_t i = 0; i < w->n_num; i++)
        to->num[i] += w->step[w->n_den + i];
    if (w->n > w->n_den + w->n_num)
        to->delay_s += w->step[w->n - 1];
}

/* V that rounding leaves of exact data. */
static gsid_real rounding_cost(const gsid_frd *data) {
    gsid_real cost = 0;
    for (uint32_t k = 0; k < data->n_lines; k++)
        cost += gsid_cplx_abs2(gsid_cplx_scale(4 * GSID_EPSILON * weight_of(data, k), data->g[k]));
    return cost;
}

/* The problem of one gsid_estimate_ml. */
typedef struct {
    const gsid_frd *data;
    const gsid_ml_cfg *cfg;
    workspace w;
} search;

/* Set data->g for a model. */
static gsid_status update(const search *s, const gsid_rational *model, int with_drift) {
    return s->cfg->update == NULL ? GSID_OK : s->cfg->update(s->cfg->user, model, with_drift);
}

/* V after a step with this damping, or UNUSABLE. */
static gsid_real try_damping(search *s, const gsid_rational *from, gsid_real damping, gsid_rational *to) {
    if (solve_damped(&s->w, damping) < 0 || bend_step(&s->w, s->data, from) < 0)
        return UNUSABLE;
    add_step(&s->w, from, to);
    return update(s, to, 0) < 0 ? UNUSABLE : cost_of(s->data, to);
}

/* The best step from where w.normal was linearised, with V = v: the damping is raised until V falls, or lowered as long as
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
        if (!(further_v < least))
            break;
        *damping /= DAMPING_FACTOR;
        least = further_v;
        *to = further;
    }
    return least;
}

gsid_status gsid_estimate_ml(const gsid_frd *data, const gsid_ml_cfg *cfg, gsid_rational *model, gsid_real *cost,
                             void *mem, size_t mem_size) {
    if (cfg == NULL || (cfg->update != NULL && cfg->drift == NULL))
        return GSID_E_NULL;
    if (!(cfg->tolerance >= 0))
        return GSID_E_CONFIG;
    search s = {.data = data, .cfg = cfg};
    gsid_status status = workspace_init(&s.w, data, model, cfg->free_delay, mem, mem_size);
    if (status == GSID_OK)
        status = update(&s, model, 0);
    if (status != GSID_OK)
        return status;
    s.w.drift = cfg->drift;
    const uint32_t n_iterations = cfg->n_iterations > 0 ? cfg->n_iterations : 50;
    const gsid_real tolerance = cfg->tolerance > 0 ? cfg->tolerance : GSID_R(0.005);

    gsid_rational best = *model, trial;
    gsid_real v = cost_of(data, &best), damping = DAMPING_FIRST;
    if (v >= UNUSABLE)
        return GSID_E_NONFINITE;
    int settled = v <= rounding_cost(data);
    for (uint32_t i = 0; i < n_iterations && !settled; i++) {
        status = update(&s, &best, 1);
        if (status == GSID_OK)
            status = linearise_all(&s.w, data, &best);
        if (status != GSID_OK)
            return status;
        const gsid_real v_per_line = v / (gsid_real)data->n_lines;
        const gsid_real little = tolerance * (v_per_line < 1 ? v_per_line : GSID_R(1.0));
        settled = measure(&s.w) <= little;
        const gsid_real trial_v = best_step(&s, &best, v, &damping, &trial);
        if (trial_v >= UNUSABLE)
            return GSID_E_NONFINITE;
        if (!(v - trial_v > little) || trial_v <= rounding_cost(data))
            settled = 1;
        if (trial_v < v) {
            best = trial;
            v = trial_v;
        }
    }
    *model = best;
    if (cost != NULL)
        *cost = v;
    return settled ? GSID_OK : GSID_MAX_ITER;
}

gsid_status gsid_estimate_covariance(const gsid_frd *data, const gsid_rational *model, int free_delay, gsid_real *cov,
                                     void *mem, size_t mem_size) {
    if (cov == NULL)
        return GSID_E_NULL;
    workspace w;
    gsid_status status = workspace_init(&w, data, model, free_delay, mem, mem_size);
    if (status == GSID_OK)
        status = linearise_all(&w, data, model);
    if (status == GSID_OK)
        status = gsid_lsq_covariance(&w.normal, cov);
    /* sigma^2 is E|e|^2 of a complex error: its real and imaginary parts have half of it each.  Eq: EST-5 */
    for (uint32_t i = 0; status == GSID_OK && i < w.n * w.n; i++)
        cov[i] /= 2;
    return status;
}
