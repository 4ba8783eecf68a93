#include <SuiteSparseQR_C.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "backend.h"

/* SPQR_ORDERING_FIXED and SPQR_NO_TOL, whose header is C++. */
enum { ORDERING_FIXED = 0 };
static const double NO_TOLERANCE = -1;

/* Entries of one column of one record, from row `first` of the whole matrix on. */
static int64_t put(const gsid_arrow *arrow, uint32_t record, uint32_t column, int64_t first, int64_t at, int64_t *row,
                   double *value) {
    const uint32_t width = arrow->n_local + arrow->n_shared + 1;
    for (uint32_t i = 0; i < arrow->n_rows[record]; i++, at++) {
        row[at] = first + i;
        value[at] = arrow->row[record][(size_t)i * width + column];
    }
    return at;
}

/* (A | b) by columns. */
static void fill(const gsid_arrow *arrow, cholmod_sparse *a) {
    int64_t *start = a->p, *row = a->i, at = 0, column = 0, first = 0;
    double *value = a->x;
    for (uint32_t r = 0; r < arrow->n_records; first += arrow->n_rows[r], r++) {
        for (uint32_t j = 0; j < arrow->n_local; j++) {
            start[column++] = at;
            at = put(arrow, r, j, first, at, row, value);
        }
    }
    for (uint32_t j = arrow->n_local; j <= arrow->n_local + arrow->n_shared; j++) {
        start[column++] = at;
        first = 0;
        for (uint32_t r = 0; r < arrow->n_records; first += arrow->n_rows[r], r++) {
            at = put(arrow, r, j, first, at, row, value);
        }
    }
    start[column] = at;
}

static void copy_triangle(const cholmod_sparse *r, double *triangle) {
    const size_t n = r->ncol;
    const int64_t *start = r->p, *row = r->i;
    const double *value = r->x;
    memset(triangle, 0, n * n * sizeof(*triangle));
    for (size_t j = 0; j < n; j++) {
        for (int64_t k = start[j]; k < start[j + 1]; k++) {
            triangle[(size_t)row[k] * n + j] = value[k];
        }
    }
}

gsid_status gsid_suitesparse_reduce(const gsid_arrow *arrow, double *triangle) {
    size_t n_rows = 0;
    for (uint32_t r = 0; r < arrow->n_records; r++) {
        n_rows += arrow->n_rows[r];
    }
    const size_t n = (size_t)arrow->n_records * arrow->n_local + arrow->n_shared + 1;
    const size_t n_entries = n_rows * ((size_t)arrow->n_local + arrow->n_shared + 1);
    cholmod_common common;
    cholmod_l_start(&common);
    common.print = 0;
    cholmod_sparse *r = NULL;
    cholmod_sparse *a = cholmod_l_allocate_sparse(n_rows, n, n_entries, 1, 1, 0, CHOLMOD_REAL, &common);
    if (a != NULL) {
        fill(arrow, a);
        SuiteSparseQR_C(ORDERING_FIXED, NO_TOLERANCE, (int64_t)n, 0, a, NULL, NULL, NULL, NULL, &r, NULL, NULL, NULL,
                        NULL, &common);
    }
    if (r != NULL) {
        copy_triangle(r, triangle);
    }
    const gsid_status status = r != NULL ? GSID_OK : GSID_E_NO_MEMORY;
    cholmod_l_free_sparse(&a, &common);
    cholmod_l_free_sparse(&r, &common);
    cholmod_l_finish(&common);
    return status;
}

const char *gsid_suitesparse_version_str(void) {
    static char text[32];
    int version[3];
    SuiteSparse_version(version);
    snprintf(text, sizeof text, "%d.%d.%d", version[0], version[1], version[2]);
    return text;
}
