/* A model against a measurement: the test over all lines, and the bands in which it fails. */
#include "gsid/host/compare.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Neighbouring cells are one band if their mean excess per line differs by no more than this factor. Chosen: it affects only the
 * list of bands, not the tests. */
#define ALIKE 10.0
#define LEAST_SQUARE 1e-300

/* Lines of one kind in one third octave. */
typedef struct {
    gsid_line_kind kind;
    double lo_hz, hi_hz; /* lo <= f < hi */
    uint32_t n_lines;
    double log_p, log_p_corrected;
    double excess, density; /* cost above that of noise: of the cell, and of one line */
} cell_of_lines;

/* Work space: the cells, and the lines of one of them. */
typedef struct {
    uint32_t n_cells, n_bands;
    cell_of_lines *cell;
    gsid_compare_band *band;
    gsid_cplx *error, *by_model;
    double *variance, *dof, *var_weight, *ratio;
    uint8_t *is_real;
    double total; /* excess of all cells */
} workspace;

static gsid_line_kind kind_of(const gsid_compare_data *data, uint32_t k) {
    return data->kind == NULL ? GSID_LINE_EXCITED : (gsid_line_kind)data->kind[k];
}

static int is_real(const gsid_misfit_lines *lines, uint32_t k) {
    return lines->is_real != NULL && lines->is_real[k];
}

static uint32_t lines_of_record(const gsid_compare_data *data, uint32_t record) {
    return data->n_of == NULL ? data->lines.n_lines : data->n_of[record];
}

static double square(gsid_cplx z) {
    return z.re * z.re + z.im * z.im;
}

static gsid_status check(const gsid_compare_data *data, double alpha, uint32_t n_max, const gsid_compare_band *band,
                         const gsid_comparison *result) {
    if (data == NULL || result == NULL || (n_max > 0 && band == NULL)) {
        return GSID_E_NULL;
    }
    const uint32_t n = data->lines.n_lines;
    if (data->f_hz == NULL || data->y == NULL || (data->n_of == NULL && data->n_records > 1)) {
        return GSID_E_NULL;
    }
    uint64_t sum = 0;
    for (uint32_t i = 0; i < data->n_records; i++) {
        if (lines_of_record(data, i) == 0) {
            return GSID_E_CONFIG;
        }
        sum += lines_of_record(data, i);
    }
    if (n == 0 || sum != n || !(alpha > 0 && alpha < 1) || !(data->n_fitted >= 0) ||
        (data->n_fitted > 0 && data->lines.n_directions > 0)) {
        return GSID_E_CONFIG;
    }
    for (uint32_t k = 0; k < n; k++) {
        if (!isfinite(data->f_hz[k]) || !isfinite(data->y[k].re) || !isfinite(data->y[k].im)) {
            return GSID_E_NONFINITE;
        }
        if (data->f_hz[k] < 0 || kind_of(data, k) >= GSID_LINE_KINDS) {
            return GSID_E_CONFIG;
        }
    }
    return GSID_OK;
}

/* ---- the whole band ---- */

/* Mean square of a line in time: half of the squared amplitude of a cosine, and that of a constant. */
static double power(const gsid_misfit_lines *lines, uint32_t k) {
    return is_real(lines, k) ? 1.0 : 0.5;
}

/* Mean of a ratio for noise alone; set to 1 for one degree of freedom, where it is infinite. */
static double expected_ratio(double dof) {
    return dof > 1 ? 1 + 1 / fmax(dof - 1, 1) : 1.0;
}

/* Mean over the records of the mean ratio over what noise leaves; with one degree of freedom, where a ratio has no mean,
 * variances are averaged. */
static double mean_cost(const gsid_compare_data *data, const gsid_cplx *left, const double *ratio) {
    const gsid_misfit_lines *lines = &data->lines;
    double total = 0;
    for (uint32_t i = 0, k = 0; i < data->n_records; i++) {
        const uint32_t end = k + lines_of_record(data, i);
        const int has_mean = lines->dof[k] > 1;
        double above = 0, below = 0;
        for (; k < end; k++) {
            above += has_mean ? ratio[k] / expected_ratio(lines->dof[k]) : square(left[k]);
            below += has_mean ? 1 : lines->variance[k];
        }
        total += above / fmax(below, DBL_MIN);
    }
    return total / data->n_records;
}

static gsid_status compare_all(const gsid_compare_data *data, gsid_cplx *left, double *ratio, gsid_comparison *out) {
    const gsid_misfit_lines *lines = &data->lines;
    const uint32_t n = lines->n_lines, p = lines->n_directions;
    gsid_tail tail;
    gsid_status status = gsid_misfit_test(lines, left, ratio, &out->misfit);
    if (status == GSID_OK) {
        status = gsid_misfit_tail(&out->misfit, data->n_fitted * gsid_misfit_taken(n, lines->dof), &tail);
    }
    if (status != GSID_OK) {
        return status;
    }
    double error = 0, noise = 0, model = 0;
    for (uint32_t k = 0; k < n; k++) {
        double by_model = 0;
        for (uint32_t j = 0; j < p; j++) {
            by_model += square(lines->by_model[(size_t)k * p + j]);
        }
        error += power(lines, k) * square(lines->error[k]);
        noise += power(lines, k) * lines->variance[k];
        model += power(lines, k) * by_model;
    }
    if (!isfinite(error + noise + model)) {
        return GSID_E_NONFINITE; /* squares beyond the range of numbers */
    }
    const double cost = mean_cost(data, left, ratio), moved = out->misfit.moved;
    out->p_value = tail.upper;
    out->log_p_value = tail.log_upper;
    out->cost_per_dof = (cost + moved / (2.0 * n)) * 2 * n / fmax(2.0 * n - data->n_fitted, 1);
    out->deviance = cost * 2 * n + moved;
    out->rms_error = sqrt(error / data->n_records);
    out->noise_floor_rms = sqrt(noise / data->n_records);
    out->model_uncertainty_rms = sqrt(model / data->n_records);
    return GSID_OK;
}

/* ---- bands ---- */

/* Test the lines of a cell alone, with the full uncertainty of the model. No line: n_lines is 0. */
static gsid_status test_cell(const gsid_compare_data *data, workspace *w, cell_of_lines *cell) {
    const gsid_misfit_lines *of = &data->lines;
    const uint32_t p = of->n_directions;
    uint32_t n = 0;
    for (uint32_t k = 0; k < of->n_lines; k++) {
        if (kind_of(data, k) != cell->kind || data->f_hz[k] < cell->lo_hz || data->f_hz[k] >= cell->hi_hz) {
            continue;
        }
        w->error[n] = of->error[k];
        w->variance[n] = of->variance[k];
        w->dof[n] = of->dof[k];
        w->var_weight[n] = (of->var_weight != NULL ? of->var_weight : of->variance)[k];
        w->is_real[n] = (uint8_t)is_real(of, k);
        if (p > 0) {
            memcpy(w->by_model + (size_t)n * p, of->by_model + (size_t)k * p, p * sizeof *w->by_model);
        }
        n++;
    }
    const gsid_misfit_lines lines = {n, w->error, w->variance, w->dof, w->var_weight, w->is_real, p, w->by_model};
    gsid_misfit found;
    gsid_tail tail;
    gsid_status status = gsid_misfit_test(&lines, NULL, w->ratio, &found);
    if (status == GSID_OK) {
        status = gsid_misfit_tail(&found, 0, &tail);
    }
    cell->n_lines = n;
    if (status == GSID_OK && n > 0) {
        cell->log_p = tail.log_upper;
        cell->excess = found.moved / 2;
        for (uint32_t k = 0; k < n; k++) {
            cell->excess += w->ratio[k] - expected_ratio(w->dof[k]);
        }
        cell->density = fmax(cell->excess / n, DBL_MIN);
    }
    return status;
}

/* Third octaves that cover the lines above 0 Hz, in the geometric middle of which the lowest line lies; 0 Hz is a cell alone. */
static double edge(double lowest_hz, uint32_t i) {
    return i == 0 ? 0 : lowest_hz * exp2((i - 1) / 3.0) * exp2(-1.0 / 6);
}

static uint32_t count_edges(const gsid_compare_data *data, double *lowest_hz) {
    double lo = INFINITY, hi = 0;
    for (uint32_t k = 0; k < data->lines.n_lines; k++) {
        if (data->f_hz[k] > 0) {
            lo = fmin(lo, data->f_hz[k]);
            hi = fmax(hi, data->f_hz[k]);
        }
    }
    *lowest_hz = lo;
    return hi > 0 ? (uint32_t)ceil(3 * log2(hi / lo) + 1e-9) + 3 : 2;
}

static gsid_status test_cells(const gsid_compare_data *data, workspace *w, uint32_t n_edges, double lowest_hz) {
    gsid_status status = GSID_OK;
    for (int kind = 0; kind < GSID_LINE_KINDS; kind++) {
        for (uint32_t i = 0; i + 1 < n_edges && status == GSID_OK; i++) {
            cell_of_lines cell = {.kind = (gsid_line_kind)kind};
            cell.lo_hz = edge(lowest_hz, i);
            cell.hi_hz = edge(lowest_hz, i + 1);
            status = test_cell(data, w, &cell);
            if (status == GSID_OK && cell.n_lines > 0) {
                w->cell[w->n_cells++] = cell;
                w->total += fmax(cell.excess, 0);
            }
        }
    }
    return status;
}

/* Holm's step-down procedure: the p-value with rank r of m, from 0, times m - r, and no less than those before it. */
static void correct(workspace *w) {
    double corrected = -INFINITY;
    for (uint32_t i = 0; i < w->n_cells; i++) {
        w->cell[i].log_p_corrected = INFINITY; /* not yet ranked */
    }
    for (uint32_t rank = 0; rank < w->n_cells; rank++) {
        cell_of_lines *least = NULL;
        for (uint32_t i = 0; i < w->n_cells; i++) {
            cell_of_lines *cell = &w->cell[i];
            if (cell->log_p_corrected > 0 && (least == NULL || cell->log_p < least->log_p)) {
                least = cell;
            }
        }
        corrected = fmax(corrected, fmin(0, least->log_p + log(w->n_cells - rank)));
        least->log_p_corrected = corrected;
    }
}

/* One band from cells first .. last. */
static gsid_compare_band make_band(const gsid_compare_data *data, const workspace *w, uint32_t first, uint32_t last) {
    gsid_compare_band band = {.f_lo_hz = INFINITY, .kind = w->cell[first].kind, .log_p_value = 0};
    double error = 0, response = 0, lo_hz = w->cell[first].lo_hz, hi_hz = w->cell[last].hi_hz;
    for (uint32_t i = first; i <= last; i++) {
        band.share += w->total > 0 ? w->cell[i].excess / w->total : 0;
        band.log_p_value = fmin(band.log_p_value, w->cell[i].log_p_corrected);
        band.n_lines += w->cell[i].n_lines;
    }
    for (uint32_t k = 0; k < data->lines.n_lines; k++) {
        if (kind_of(data, k) == band.kind && data->f_hz[k] >= lo_hz && data->f_hz[k] < hi_hz) {
            band.f_lo_hz = fmin(band.f_lo_hz, data->f_hz[k]);
            band.f_hi_hz = fmax(band.f_hi_hz, data->f_hz[k]);
            error += square(data->lines.error[k]);
        }
    }
    for (uint32_t k = 0; k < data->lines.n_lines; k++) {
        if (data->f_hz[k] >= band.f_lo_hz && data->f_hz[k] <= band.f_hi_hz) {
            response += square(data->y[k]);
        }
    }
    band.p_value = exp(band.log_p_value);
    band.db = 10 * log10(fmax(error, LEAST_SQUARE) / fmax(response, LEAST_SQUARE));
    return band;
}

/* Join neighbouring cells that fail, of one kind and of similar excess. */
static void join_cells(const gsid_compare_data *data, workspace *w, double alpha) {
    for (uint32_t i = 0; i < w->n_cells; i++) {
        if (!(exp(w->cell[i].log_p_corrected) < alpha)) {
            continue;
        }
        const uint32_t first = i;
        double least = w->cell[i].density, most = least;
        while (i + 1 < w->n_cells && w->cell[i + 1].kind == w->cell[i].kind &&
               exp(w->cell[i + 1].log_p_corrected) < alpha) {
            const double low = fmin(least, w->cell[i + 1].density), high = fmax(most, w->cell[i + 1].density);
            if (high > ALIKE * low) {
                break;
            }
            least = low;
            most = high;
            i++;
        }
        w->band[w->n_bands++] = make_band(data, w, first, i);
    }
}

/* The largest shares first; equal ones in their order. */
static void sort_bands(workspace *w) {
    for (uint32_t i = 1; i < w->n_bands; i++) {
        const gsid_compare_band band = w->band[i];
        uint32_t at = i;
        for (; at > 0 && w->band[at - 1].share < band.share; at--) {
            w->band[at] = w->band[at - 1];
        }
        w->band[at] = band;
    }
}

static gsid_status find_bands(const gsid_compare_data *data, double alpha, workspace *w) {
    const size_t n = data->lines.n_lines, p = data->lines.n_directions;
    double lowest_hz;
    const uint32_t n_edges = count_edges(data, &lowest_hz);
    const size_t n_cells = (size_t)GSID_LINE_KINDS * n_edges;
    w->cell = malloc(n_cells * sizeof *w->cell);
    w->band = malloc(n_cells * sizeof *w->band);
    w->error = malloc(n * sizeof *w->error);
    w->by_model = malloc((n * p + 1) * sizeof *w->by_model);
    w->variance = malloc(4 * n * sizeof *w->variance);
    w->is_real = malloc(n);
    if (w->cell == NULL || w->band == NULL || w->error == NULL || w->by_model == NULL || w->variance == NULL ||
        w->is_real == NULL) {
        return GSID_E_NO_MEMORY;
    }
    w->dof = w->variance + n;
    w->var_weight = w->dof + n;
    w->ratio = w->var_weight + n;
    const gsid_status status = test_cells(data, w, n_edges, lowest_hz);
    if (status == GSID_OK) {
        correct(w);
        join_cells(data, w, alpha);
        sort_bands(w);
    }
    return status;
}

gsid_status gsid_compare(const gsid_compare_data *data, double alpha, uint32_t n_max, gsid_compare_band *band,
                         double *ratio, gsid_comparison *result) {
    gsid_status status = check(data, alpha, n_max, band, result);
    if (status != GSID_OK) {
        return status;
    }
    const uint32_t n = data->lines.n_lines;
    workspace w = {0};
    gsid_comparison found = {.n_bands = 0};
    gsid_cplx *left = malloc(n * sizeof *left);
    double *t = malloc(n * sizeof *t);
    status = left == NULL || t == NULL ? GSID_E_NO_MEMORY : compare_all(data, left, t, &found);
    if (status == GSID_OK) {
        status = find_bands(data, alpha, &w);
    }
    if (status == GSID_OK) {
        found.n_bands = w.n_bands;
        *result = found;
        if (n_max > 0) {
            memcpy(band, w.band, (w.n_bands < n_max ? w.n_bands : n_max) * sizeof *band);
        }
        if (ratio != NULL) {
            memcpy(ratio, t, n * sizeof *t);
        }
    }
    free(left);
    free(t);
    free(w.cell);
    free(w.band);
    free(w.error);
    free(w.by_model);
    free(w.variance);
    free(w.is_real);
    return status;
}
