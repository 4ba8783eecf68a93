#include "gsid/host/pool.h"

#include <math.h>
#include <stddef.h>

uint32_t gsid_pool_neighbours(uint32_t n_lines, double dof, double wanted) {
    if (n_lines == 0 || !(dof < wanted)) {
        return 0;
    }
    return (uint32_t)fmin(ceil((wanted / dof - 1) / 2), (n_lines - 1) / 2);
}

/* The line that stands for one beyond an edge, or n_lines: none does. */
static int64_t inside(int64_t at, int64_t n_lines, gsid_edges edges) {
    if (at >= 0 && at < n_lines) {
        return at;
    }
    if (edges == GSID_EDGES_SHORTENED) {
        return n_lines;
    }
    return at < 0 ? -1 - at : 2 * n_lines - 1 - at;
}

gsid_status gsid_pool_lines(uint32_t n_lines, uint32_t n_columns, uint32_t half, gsid_edges edges, const double *x,
                            double *pooled) {
    if (n_lines > 0 && n_columns > 0 && (x == NULL || pooled == NULL)) {
        return GSID_E_NULL;
    }
    if ((n_lines > 0 && half >= n_lines) || (edges != GSID_EDGES_REFLECTED && edges != GSID_EDGES_SHORTENED)) {
        return GSID_E_CONFIG;
    }
    for (int64_t k = 0; k < n_lines; k++) {
        for (uint32_t column = 0; column < n_columns; column++) {
            double sum = 0;
            uint32_t n = 0;
            for (int64_t at = k - half; at <= k + half; at++) {
                const int64_t line = inside(at, n_lines, edges);
                if (line < n_lines) {
                    sum += x[(size_t)line * n_columns + column];
                    n++;
                }
            }
            pooled[(size_t)k * n_columns + column] = sum / n;
        }
    }
    return GSID_OK;
}
