/* Values of least cost of a structure, by variable projection (STR-3): for any theta the best gains are a linear least-squares
 * solution, and steps of theta are those of the error that no gains remove. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/complex_math.h"
#include "structure.h"

/* Decrease of the cost in a step below which the values have converged; scores are compared at 7. */
#define SETTLED 1e-3
#define STEP_MAX 0.7 /* largest change of a logarithm in one step: a factor of 2 */
#define TINY 1e-12
#define DAMPING_START 1e-3
#define DAMPING_MIN 1e-9
#define DAMPING_MAX 1e8
#define DELAY_STEP 0.2 /* a delay is scaled by this over the highest frequency */

enum { C_MAX = GSID_STRUCTURE_COLUMNS_MAX, T_MAX = GSID_STRUCTURE_THETA_MAX };

/* A whitened signal has 2 n rows: real parts, then imaginary parts. */
typedef struct {
    double theta[T_MAX], gain[C_MAX], cost;
    gsid_cplx *column; /* [n_columns][n] */
    double *q; /* [n_columns][rows] orthonormal basis of the whitened columns */
    double *rest; /* [rows] error with the best gains */
} point;

typedef struct {
    const gsid_structure *structure;
    const gsid_structure_lines *lines;
    const double *weight;
    uint32_t n_columns, n_theta;
    size_t rows;
    double *target; /* [rows] */
    gsid_cplx *slope; /* [n_theta][n] */
    double *white; /* [n_theta][rows] of the slopes, scaled, without what gains remove */
    double scale[T_MAX];
    point at, trial;
} search;

static double product(size_t n, const double *a, const double *b) {
    double sum = 0;
    for (size_t i = 0; i < n; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

static void subtract(size_t n, double factor, const double *b, double *a) {
    for (size_t i = 0; i < n; i++) {
        a[i] -= factor * b[i];
    }
}

static void whiten(const search *s, const gsid_cplx *x, double factor, double *rows) {
    const uint32_t n = s->lines->n;
    for (uint32_t l = 0; l < n; l++) {
        rows[l] = x[l].re * s->weight[l] * factor;
        rows[n + l] = x[l].im * s->weight[l] * factor;
    }
}

/* ---- gains ---- */

/* Orthogonalise column c against those before it, twice: to rounding.  A column that is alike to others gets no direction.
 * @param[out] r  [C_MAX][C_MAX] triangle */
static void orthogonalise(const search *s, uint32_t c, double *q, double r[C_MAX][C_MAX]) {
    double *own = q + c * s->rows;
    for (int pass = 0; pass < 2; pass++) {
        for (uint32_t k = 0; k < c; k++) {
            const double along = product(s->rows, q + k * s->rows, own);
            subtract(s->rows, along, q + k * s->rows, own);
            r[k][c] += along;
        }
    }
    const double length = sqrt(product(s->rows, own, own));
    r[c][c] = length < TINY ? length + TINY : length;
    for (size_t i = 0; i < s->rows; i++) {
        own[i] = length < TINY ? 0 : own[i] / length;
    }
}

static double size_of(const search *s, const double *rows) {
    const double size = sqrt(product(s->rows, rows, rows));
    return isfinite(size) && size > 0 ? size : 1;
}

/* Columns, gains and cost at p->theta. */
static void evaluate(const search *s, point *p) {
    double r[C_MAX][C_MAX] = {{0}}, size[C_MAX], along[C_MAX];
    gsid_structure_columns(s->structure, s->lines, p->theta, p->column);
    memcpy(p->rest, s->target, s->rows * sizeof *p->rest);
    for (uint32_t c = 0; c < s->n_columns; c++) {
        double *own = p->q + c * s->rows;
        whiten(s, p->column + (size_t)c * s->lines->n, 1, own);
        size[c] = size_of(s, own);
        for (size_t i = 0; i < s->rows; i++) {
            own[i] /= size[c];
        }
        orthogonalise(s, c, p->q, r);
        along[c] = product(s->rows, own, p->rest);
        subtract(s->rows, along[c], own, p->rest);
    }
    for (uint32_t c = s->n_columns; c-- > 0;) {
        double sum = along[c];
        for (uint32_t k = c + 1; k < s->n_columns; k++) {
            sum -= r[c][k] * p->gain[k];
        }
        p->gain[c] = sum / r[c][c];
    }
    for (uint32_t c = 0; c < s->n_columns; c++) {
        p->gain[c] /= size[c];
    }
    p->cost = product(s->rows, p->rest, p->rest);
}

/* ---- steps ---- */

/* Solve a x = b by Cholesky, scaled to a unit diagonal.  @return 0 where a is not positive definite */
static int solve(uint32_t n, const double a[T_MAX][T_MAX], const double *b, double *x) {
    double l[T_MAX][T_MAX], scale[T_MAX];
    for (uint32_t i = 0; i < n; i++) {
        scale[i] = 1 / sqrt(a[i][i]);
        for (uint32_t j = 0; j <= i; j++) {
            double sum = a[i][j] * scale[i] * scale[j];
            for (uint32_t k = 0; k < j; k++) {
                sum -= l[i][k] * l[j][k];
            }
            if (i == j && !(sum > 0 && isfinite(sum))) {
                return 0;
            }
            l[i][j] = i == j ? sqrt(sum) : sum / l[j][j];
        }
    }
    for (uint32_t i = 0; i < n; i++) {
        double sum = b[i] * scale[i];
        for (uint32_t k = 0; k < i; k++) {
            sum -= l[i][k] * x[k];
        }
        x[i] = sum / l[i][i];
    }
    for (uint32_t i = n; i-- > 0;) {
        for (uint32_t k = i + 1; k < n; k++) {
            x[i] -= l[k][i] * x[k];
        }
        x[i] /= l[i][i];
    }
    for (uint32_t i = 0; i < n; i++) {
        x[i] *= scale[i];
    }
    return 1;
}

/* Normal equations of a step. */
static void linearise(const search *s, double curvature[T_MAX][T_MAX], double *gradient) {
    const point *p = &s->at;
    gsid_structure_slopes(s->structure, s->lines, p->theta, p->column, p->gain, s->slope);
    for (uint32_t i = 0; i < s->n_theta; i++) {
        double *own = s->white + i * s->rows;
        whiten(s, s->slope + (size_t)i * s->lines->n, s->scale[i], own);
        for (uint32_t c = 0; c < s->n_columns; c++) {
            const double *q = p->q + c * s->rows;
            subtract(s->rows, product(s->rows, q, own), q, own);
        }
        gradient[i] = product(s->rows, own, p->rest);
        for (uint32_t j = 0; j <= i; j++) {
            curvature[i][j] = curvature[j][i] = product(s->rows, own, s->white + j * s->rows);
        }
    }
}

static void swap(search *s) {
    const point kept = s->at;
    s->at = s->trial;
    s->trial = kept;
}

/* A step that lowers the cost; the damping grows until there is one.  @return its decrease, 0 without */
static double step(search *s, double *damping) {
    double curvature[T_MAX][T_MAX] = {{0}}, damped[T_MAX][T_MAX], gradient[T_MAX], move[T_MAX], trace = 0;
    linearise(s, curvature, gradient);
    for (uint32_t i = 0; i < s->n_theta; i++) {
        trace += curvature[i][i];
    }
    for (; *damping < DAMPING_MAX; *damping *= 8) {
        memcpy(damped, curvature, sizeof damped);
        for (uint32_t i = 0; i < s->n_theta; i++) {
            damped[i][i] += *damping * fmax(curvature[i][i], TINY * trace);
        }
        if (!solve(s->n_theta, (const double (*)[T_MAX])damped, gradient, move)) {
            continue;
        }
        for (uint32_t i = 0; i < s->n_theta; i++) {
            s->trial.theta[i] = s->at.theta[i] + fmax(-STEP_MAX, fmin(STEP_MAX, move[i])) * s->scale[i];
        }
        evaluate(s, &s->trial);
        if (isfinite(s->trial.cost) && s->trial.cost < s->at.cost) {
            const double decrease = s->at.cost - s->trial.cost;
            swap(s);
            return decrease;
        }
    }
    return 0;
}

static void refine(search *s, uint32_t n_steps) {
    double damping = DAMPING_START;
    evaluate(s, &s->at);
    if (!isfinite(s->at.cost)) {
        s->at.cost = INFINITY;
        return;
    }
    for (uint32_t i = 0; i < n_steps; i++) {
        if (step(s, &damping) < SETTLED) {
            return;
        }
        damping = fmax(damping / 10, DAMPING_MIN);
    }
}

/* ---- the call ---- */

static double *take(double **free_memory, size_t n) {
    double *taken = *free_memory;
    *free_memory += n;
    return taken;
}

static void lay_out(search *s, double *memory) {
    const size_t n = s->lines->n, complex_size = 2 * n; /* a complex number is two */
    double *next = memory;
    point *both[] = {&s->at, &s->trial};
    for (int i = 0; i < 2; i++) {
        both[i]->column = (gsid_cplx *)(void *)take(&next, s->n_columns * complex_size);
        both[i]->q = take(&next, s->n_columns * s->rows);
        both[i]->rest = take(&next, s->rows);
    }
    s->target = take(&next, s->rows);
    s->slope = (gsid_cplx *)(void *)take(&next, s->n_theta * complex_size);
    s->white = take(&next, s->n_theta * s->rows);
}

gsid_status gsid_structure_refine(const gsid_structure *structure, const gsid_structure_lines *lines,
                                  const gsid_cplx *g, const double *weight, uint32_t n_steps, double *theta,
                                  double *gain, double *cost) {
    const gsid_status status = gsid_structure_check(structure, lines);
    if (status != GSID_OK || g == NULL || weight == NULL || theta == NULL || gain == NULL || cost == NULL) {
        return status != GSID_OK ? status : GSID_E_NULL;
    }
    search s = {.structure = structure, .lines = lines, .weight = weight};
    s.n_columns = gsid_structure_n_columns(structure, lines);
    s.n_theta = gsid_structure_n_theta(structure);
    s.rows = 2 * (size_t)lines->n;
    const size_t n = s.rows * (2 * (2 * (size_t)s.n_columns + 1) + 1 + 2 * (size_t)s.n_theta);
    double *memory = malloc(n * sizeof *memory);
    if (memory == NULL) {
        return GSID_E_NO_MEMORY;
    }
    lay_out(&s, memory);
    whiten(&s, g, 1, s.target);
    for (uint32_t i = 0; i < s.n_theta; i++) {
        s.scale[i] = i + 1 < s.n_theta ? 1 : DELAY_STEP / lines->w[lines->n - 1];
    }
    memcpy(s.at.theta, theta, s.n_theta * sizeof *theta);
    refine(&s, n_steps);
    memcpy(theta, s.at.theta, s.n_theta * sizeof *theta);
    memcpy(gain, s.at.gain, s.n_columns * sizeof *gain);
    *cost = s.at.cost;
    free(memory);
    return GSID_OK;
}
