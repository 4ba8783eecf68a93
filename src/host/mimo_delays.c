/* The other minima of a MIMO fit: if a response exceeds the noise only near its resonances, V has several minima over its
 * delay.  Eq: MIM-5 */
#include <math.h>
#include <string.h>

#include "mimo_run.h"

#define OTHERS_MAX 3 /* minima of one delay that are refined */
#define ROUNDS 16
/* Half the chi-square of one degree of freedom at 0.999: a wrong minimum is wrong by many standard deviations and not
 * by two, so that it must be surer than a 95 % interval. */
#define REFUSED 5.414
#define POLES_HELD 2 /* the scan's limit, in thresholds: what the parameters that it holds may be worth */
#define LOWER 0.01 /* in thresholds: by less, one minimum is not lower than another */

typedef struct {
    double delay_s, cost;
} delay_minimum;

/* Search for the delay of a group: the poles are held, the numerators are solved for at each step. */
typedef struct {
    uint32_t group, n_steps;
    double q[GSID_MIMO_POLES_MAX];
    double step_s, now_s;
    double threshold; /* rise of V from the best minimum to one that the data refuse */
    double limit; /* of the group's V */
} delay_scan;

/* The unit of V is the residual that the group's channels have: that is the measured variance, and with other weights
 * or errors of the model what there is. */
static void scan_init(mimo_run *r, uint32_t group, const mimo_candidate *c, delay_scan *scan) {
    const double limit_s = gsid_mimo_delay_limit(r);
    double n_free = 0;
    for (uint32_t channel = 0; channel < r->n_channels; channel++) {
        n_free += r->cfg.delay_of[channel] == group ? r->channel[channel].n_lines - r->n_local / 2.0 : 0;
    }
    scan->group = group;
    const double f_max_hz = gsid_mimo_highest_frequency(r->n_channels, r->channel);
    scan->n_steps = (uint32_t)ceil(GSID_MIMO_FINE_STEPS * limit_s * f_max_hz);
    scan->step_s = limit_s / scan->n_steps;
    scan->now_s = gsid_mimo_group_delay(r, group, c);
    gsid_mimo_sections(r, c->x, scan->q);
    const double cost = gsid_mimo_group_cost(r, scan->q, group, scan->now_s);
    scan->threshold = REFUSED * cost / fmax(n_free, 1);
    scan->limit = cost + POLES_HELD * scan->threshold;
}

static uint32_t insert(delay_minimum found, uint32_t n, delay_minimum *other) {
    uint32_t i = n < OTHERS_MAX ? n : OTHERS_MAX;
    for (; i > 0 && found.cost < other[i - 1].cost; i--) {
        if (i < OTHERS_MAX) {
            other[i] = other[i - 1];
        }
    }
    if (i < OTHERS_MAX) {
        other[i] = found;
    }
    return n < OTHERS_MAX ? n + 1 : n;
}

/* Minima away from the one at hand, lowest first. */
static uint32_t other_minima(mimo_run *r, const delay_scan *scan, delay_minimum *other) {
    double before = HUGE_VAL, cost = gsid_mimo_group_cost(r, scan->q, scan->group, 0);
    uint32_t n = 0;
    for (uint32_t step = 0; step <= scan->n_steps; step++) {
        const int is_last = step == scan->n_steps;
        const double delay_s = scan->step_s * step, next_s = delay_s + scan->step_s;
        const double after = is_last ? HUGE_VAL : gsid_mimo_group_cost(r, scan->q, scan->group, next_s);
        if (cost < before && cost <= after && fabs(delay_s - scan->now_s) > scan->step_s) {
            const double slope = after - before, bend = before - 2 * cost + after;
            const double between = isfinite(bend) ? slope * slope / (4 * bend) : 0; /* twice the parabola's drop */
            const delay_minimum found = {delay_s, cost - between};
            n = found.cost < scan->limit ? insert(found, n, other) : n;
        }
        before = cost;
        cost = after;
    }
    return n;
}

/* The minima of one delay, all parameters refined: the lowest goes to *c, those that are not refused widen low .. high.
 * Returns 1 when *c is another. */
static int compare_minima(mimo_run *r, uint32_t group, mimo_candidate *c, double *low_s, double *high_s) {
    delay_minimum other[OTHERS_MAX];
    delay_scan scan;
    const mimo_candidate from = *c;
    scan_init(r, group, &from, &scan);
    const uint32_t n = other_minima(r, &scan, other);
    *low_s = *high_s = scan.now_s;
    for (uint32_t i = 0; i < n; i++) {
        mimo_candidate moved = from;
        gsid_mimo_set_group(r, group, other[i].delay_s, moved.delay_s);
        if (gsid_mimo_search(r, &moved) < 0 || !(moved.cost < from.cost + scan.threshold)) {
            continue;
        }
        const double delay_s = gsid_mimo_group_delay(r, group, &moved);
        *low_s = fabs(delay_s - scan.now_s) > scan.step_s ? fmin(*low_s, delay_s) : *low_s;
        *high_s = fabs(delay_s - scan.now_s) > scan.step_s ? fmax(*high_s, delay_s) : *high_s;
        if (moved.cost < c->cost - LOWER * scan.threshold) {
            *c = moved;
        }
    }
    return c->cost < from.cost;
}

gsid_status gsid_mimo_settle_delays(mimo_run *r, mimo_candidate *c, double *low_s, double *high_s) {
    int moved = 1;
    for (int round = 0; round < ROUNDS && moved; round++) {
        moved = 0;
        for (uint32_t group = 0; group < r->cfg.n_delays; group++) {
            double low, high;
            moved |= compare_minima(r, group, c, &low, &high);
            gsid_mimo_set_group(r, group, low, low_s);
            gsid_mimo_set_group(r, group, high, high_s);
        }
    }
    const gsid_status status = gsid_mimo_search(r, c);
    for (uint32_t channel = 0; channel < r->n_channels; channel++) {
        const int is_alone = low_s[channel] == high_s[channel];
        low_s[channel] = is_alone ? c->delay_s[channel] : fmin(low_s[channel], c->delay_s[channel]);
        high_s[channel] = is_alone ? c->delay_s[channel] : fmax(high_s[channel], c->delay_s[channel]);
    }
    return moved && status == GSID_OK ? GSID_MAX_ITER : status;
}
