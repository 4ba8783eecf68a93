#include "gsid/signals.h"
#include "real.h"
#include "splitmix.h"

static gsid_status check_range(uint32_t line_lo, uint32_t line_hi, uint32_t n, const uint32_t *n_lines) {
    if (n_lines == NULL) {
        return GSID_E_NULL;
    }
    return line_lo >= 1 && (line_lo | 1u) <= line_hi && line_hi < UINT32_MAX && n >= 1 ? GSID_OK : GSID_E_CONFIG;
}

/* EXC-8 */
gsid_status gsid_lines_odd_random(uint32_t line_lo, uint32_t line_hi, uint32_t n_group, uint64_t seed,
                                  uint32_t capacity, uint32_t *line, uint32_t *n_lines) {
    gsid_status status = check_range(line_lo, line_hi, n_group, n_lines);
    if (status != GSID_OK || n_group < 2) {
        return status != GSID_OK ? status : GSID_E_CONFIG;
    }
    const uint32_t first = line_lo | 1u, n_odd = (line_hi - first) / 2 + 1, n = n_odd - n_odd / n_group;
    if (line != NULL && capacity < n) {
        return GSID_E_MEMORY;
    }
    uint32_t left_out = 0, at = 0;
    for (uint32_t i = 0; line != NULL && i < n_odd; i++) {
        if (i % n_group == 0) {
            left_out = i + (uint32_t)(gsid_splitmix64(&seed) % n_group);
        }
        const int is_whole_group = i - i % n_group + n_group <= n_odd;
        if (i != left_out || !is_whole_group) {
            line[at++] = first + 2 * i;
        }
    }
    *n_lines = n;
    return GSID_OK;
}

/* Counts the lines, and writes them where `line` is given. */
static uint32_t put_quasi_log(uint32_t first, uint32_t last, gsid_real ratio, uint32_t *line) {
    uint32_t n = 0;
    gsid_real wanted = (gsid_real)first;
    for (uint32_t k = first; k <= last; k += 2) {
        /* the odd line nearest to the wanted one is less than 1 away; then continue beyond it */
        const gsid_real beyond = (gsid_real)k + GSID_R(1.0);
        if (beyond <= wanted) {
            continue;
        }
        if (line != NULL) {
            line[n] = k;
        }
        n++;
        while (wanted < beyond) {
            const gsid_real next = wanted * ratio;
            wanted = next > wanted ? next : beyond; /* a ratio may round to 1 */
        }
    }
    return n;
}

gsid_status gsid_lines_quasi_log(uint32_t line_lo, uint32_t line_hi, uint32_t n_per_decade, uint32_t capacity,
                                 uint32_t *line, uint32_t *n_lines) {
    gsid_status status = check_range(line_lo, line_hi, n_per_decade, n_lines);
    if (status != GSID_OK) {
        return status;
    }
    /* Wanted lines closer together than odd ones take every odd line; still more of them would only take time. */
    const uint32_t n_most = line_hi > UINT32_MAX / 2 ? UINT32_MAX : 2 * line_hi;
    const uint32_t n_steps = n_per_decade < n_most ? n_per_decade : n_most;
    const gsid_real ratio = gsid_pow(GSID_R(10.0), GSID_R(1.0) / (gsid_real)n_steps);
    const uint32_t first = line_lo | 1u, last = line_hi % 2 == 1 ? line_hi : line_hi - 1;
    const uint32_t n = put_quasi_log(first, last, ratio, NULL);
    if (line != NULL && capacity < n) {
        return GSID_E_MEMORY;
    }
    if (line != NULL) {
        put_quasi_log(first, last, ratio, line);
    }
    *n_lines = n;
    return GSID_OK;
}
