/* Where the search of a MIMO fit starts: delays by a scan, poles by relocation, and pairs of poles that do nothing put
 * to use. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/residual.h"
#include "fit_sections.h"
#include "mimo_run.h"

#define STARTS 3
#define SCAN_RELOCATIONS 4
#define RELOCATIONS 20
#define SCAN_LINES_PER_POLE 16
#define DELAY_ROUNDS 3
#define SWAP_DAMPING 0.03
#define SWAP_PLACES_PER_PAIR 4
#define SWAP_GAIN 1e-3 /* of V: less is not worth another round */

/* Every few lines of each channel, enough for the scan. */
static gsid_status thin_out(const mimo_run *r, gsid_frd *thin) {
    for (uint32_t channel = 0; channel < r->n_channels; channel++) {
        const gsid_frd *data = &r->channel[channel];
        const uint32_t wanted = SCAN_LINES_PER_POLE * (r->cfg.n_poles + 1);
        const uint32_t stride = data->n_lines > wanted ? data->n_lines / wanted : 1;
        const uint32_t n = (data->n_lines + stride - 1) / stride;
        double *f_hz = malloc(n * sizeof *f_hz), *sigma = malloc(n * sizeof *sigma);
        gsid_cplx *g = malloc(n * sizeof *g);
        thin[channel] = (gsid_frd){.n_lines = n, .f_hz = f_hz, .g = g, .sigma = sigma};
        if (f_hz == NULL || sigma == NULL || g == NULL) {
            return GSID_E_NO_MEMORY;
        }
        for (uint32_t k = 0; k < n; k++) {
            f_hz[k] = data->f_hz[k * stride];
            g[k] = data->g[k * stride];
            sigma[k] = 1 / gsid_residual_weight(data, k * stride);
        }
    }
    return GSID_OK;
}

static void thin_free(const mimo_run *r, gsid_frd *thin) {
    for (uint32_t channel = 0; thin != NULL && channel < r->n_channels; channel++) {
        free((void *)(uintptr_t)thin[channel].f_hz);
        free((void *)(uintptr_t)thin[channel].sigma);
        free((void *)(uintptr_t)thin[channel].g);
    }
    free(thin);
}

static void keep(const mimo_candidate *c, uint32_t n_kept, mimo_candidate *kept) {
    if (!(c->cost < kept[n_kept - 1].cost)) {
        return;
    }
    uint32_t i = n_kept - 1;
    for (; i > 0 && c->cost < kept[i - 1].cost; i--) {
        kept[i] = kept[i - 1];
    }
    kept[i] = *c;
}

/* Poles at delays common to all channels, from 0 to the limit; best first. */
static gsid_status scan(mimo_run *r, const mimo_candidate *first, uint32_t n_kept, mimo_candidate *kept) {
    const double f_max_hz = gsid_mimo_highest_frequency(r->n_channels, r->channel), limit_s = gsid_mimo_delay_limit(r);
    const uint32_t n_steps = r->cfg.n_delays > 0 ? (uint32_t)ceil(GSID_MIMO_SCAN_STEPS * f_max_hz * limit_s) : 0;
    gsid_status last = GSID_E_SINGULAR;
    for (uint32_t i = 0; i < n_kept; i++) {
        kept[i].cost = HUGE_VAL;
    }
    for (uint32_t step = 0; step <= n_steps; step++) {
        mimo_candidate c = *first;
        for (uint32_t channel = 0; channel < r->n_channels && n_steps > 0; channel++) {
            c.delay_s[channel] = limit_s * step / n_steps;
        }
        gsid_mimo_spread_poles(r, &c);
        const gsid_status status = gsid_mimo_relocate(r, SCAN_RELOCATIONS, &c);
        if (status == GSID_E_NO_MEMORY) {
            return status;
        }
        last = status < 0 ? status : last;
        if (status >= 0) {
            keep(&c, n_kept, kept);
        }
    }
    return kept[0].cost < HUGE_VAL ? GSID_OK : last;
}

/* Each free delay separately over the whole range, the poles as they are. The numerators of a weak channel can do with
 * a wrong delay for a while: its minima are narrow. */
static void scan_each_delay(mimo_run *r, double steps_per_period, mimo_candidate *c) {
    double q[GSID_MIMO_POLES_MAX];
    const double f_max_hz = gsid_mimo_highest_frequency(r->n_channels, r->channel), limit_s = gsid_mimo_delay_limit(r);
    const uint32_t n_steps = (uint32_t)ceil(steps_per_period * f_max_hz * limit_s);
    gsid_mimo_sections(r, c->x, q);
    for (uint32_t group = 0; group < r->cfg.n_delays; group++) {
        double best_s = gsid_mimo_group_delay(r, group, c);
        double least = gsid_mimo_group_cost(r, q, group, best_s);
        for (uint32_t step = 0; step <= n_steps; step++) {
            const double delay_s = limit_s * step / n_steps;
            const double cost = gsid_mimo_group_cost(r, q, group, delay_s);
            best_s = cost < least ? delay_s : best_s;
            least = fmin(least, cost);
        }
        gsid_mimo_set_group(r, group, best_s, c->delay_s);
    }
}

/* One pair of poles at this share of the band. */
static void place_pair(const mimo_run *r, double share, double *x) {
    const double w_max = r->cfg.domain == GSID_DOMAIN_S ? 1 : r->scale_rad_s * r->cfg.sample_s;
    const gsid_cplx s = {-SWAP_DAMPING * share * w_max, share * w_max};
    gsid_cplx pair[2] = {s, gsid_cplx_conj(s)};
    for (int i = 0; i < 2 && r->cfg.domain == GSID_DOMAIN_Z; i++) {
        pair[i] = gsid_cplx_scale(exp(s.re), gsid_cplx_cis(pair[i].im));
    }
    gsid_fit_sections_from_poles(r->cfg.domain, 2, 0, pair, x);
}

/* The pair of poles without which V is least: put in the place of another pair it adds nothing. */
static uint32_t weakest_pair(mimo_run *r, const mimo_candidate *c) {
    double least = HUGE_VAL;
    uint32_t weakest = 0;
    for (uint32_t first = 0; first + 1 < r->cfg.n_poles; first += 2) {
        mimo_candidate without = *c;
        memcpy(without.x + first, c->x + (first == 0 ? 2 : 0), 2 * sizeof *c->x);
        gsid_mimo_solve(r, &without);
        weakest = without.cost < least ? first : weakest;
        least = fmin(least, without.cost);
    }
    return weakest;
}

/* The best place of a pair, the other poles as they are. */
static void best_place(mimo_run *r, uint32_t first, mimo_candidate *c) {
    const uint32_t n_places = SWAP_PLACES_PER_PAIR * (r->cfg.n_poles / 2);
    mimo_candidate trial = *c, best = *c;
    best.cost = HUGE_VAL;
    for (uint32_t i = 0; i < n_places; i++) {
        place_pair(r, (i + 0.5) / n_places, trial.x + first);
        gsid_mimo_solve(r, &trial);
        if (trial.cost < best.cost) {
            best = trial;
        }
    }
    *c = best;
}

/* Pairs that cancel their own zeros are local minima of V: as long as it helps, the weakest pair is moved to where it
 * is of most use. */
static gsid_status put_to_use(mimo_run *r, mimo_candidate *c) {
    for (uint32_t round = 0; round < r->cfg.n_poles && r->cfg.n_poles >= 4; round++) {
        mimo_candidate moved = *c;
        best_place(r, weakest_pair(r, c), &moved);
        const gsid_status status = gsid_mimo_search(r, &moved);
        if (status < 0 || !(moved.cost < (1 - SWAP_GAIN) * c->cost)) {
            return status;
        }
        *c = moved;
    }
    return GSID_OK;
}

/* Give the channels their separate delays. */
static gsid_status part_delays(mimo_run *r, mimo_candidate *c) {
    for (int round = 0; round < DELAY_ROUNDS && r->cfg.n_delays > 1; round++) {
        mimo_candidate moved = *c;
        scan_each_delay(r, GSID_MIMO_FINE_STEPS, &moved);
        const gsid_status status = gsid_mimo_search(r, &moved);
        if (status < 0 || !(moved.cost < (1 - SWAP_GAIN) * c->cost)) {
            return status;
        }
        *c = moved;
    }
    return GSID_OK;
}

/* One start, with delays of its channels' own, refined. */
static gsid_status try_start(mimo_run *r, mimo_candidate *c) {
    if (r->cfg.n_delays > 1) {
        mimo_candidate moved = *c;
        scan_each_delay(r, GSID_MIMO_SCAN_STEPS, &moved);
        const gsid_status status = gsid_mimo_relocate(r, SCAN_RELOCATIONS, &moved);
        if (status == GSID_E_NO_MEMORY) {
            return status;
        }
        if (status >= 0 && moved.cost < c->cost) {
            *c = moved;
        }
    }
    return r->cfg.method != GSID_METHOD_IWLS ? gsid_mimo_search(r, c) : GSID_OK;
}

/* The best of the starts, on the lines of the scan. One that fails leaves it to the others; without memory all would. */
static gsid_status choose(mimo_run *r, const mimo_candidate *first, mimo_candidate *best) {
    mimo_candidate kept[STARTS];
    gsid_status status = scan(r, first, STARTS, kept), last = GSID_E_SINGULAR;
    best->cost = HUGE_VAL;
    for (int i = 0; i < STARTS && status != GSID_E_NO_MEMORY && kept[i].cost < HUGE_VAL; i++) {
        status = try_start(r, &kept[i]);
        last = status < 0 ? status : last;
        if (status >= 0) {
            keep(&kept[i], 1, best);
        }
    }
    if (status == GSID_E_NO_MEMORY) {
        return status;
    }
    if (!(best->cost < HUGE_VAL)) {
        return status < 0 ? status : last;
    }
    if (r->cfg.method != GSID_METHOD_IWLS) {
        status = put_to_use(r, best);
    }
    if (r->cfg.method != GSID_METHOD_IWLS && status != GSID_E_NO_MEMORY) {
        status = part_delays(r, best);
    }
    return status == GSID_E_NO_MEMORY ? status : GSID_OK; /* what these two could not better stays as it was */
}

gsid_status gsid_mimo_start(mimo_run *r, mimo_candidate *c) {
    const gsid_frd *all = r->channel;
    const mimo_candidate first = *c;
    gsid_frd *thin = calloc(r->n_channels, sizeof *thin);
    gsid_status status = thin == NULL ? GSID_E_NO_MEMORY : thin_out(r, thin);
    if (status == GSID_OK) {
        r->channel = thin;
        status = choose(r, &first, c);
    }
    thin_free(r, thin);
    r->channel = all;
    return status == GSID_OK && r->cfg.method == GSID_METHOD_IWLS ? gsid_mimo_relocate(r, RELOCATIONS, c) : status;
}
