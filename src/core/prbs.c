#include "gsid/signals.h"
#include "real.h"

enum { ORDER_MIN = 2, ORDER_MAX = 20 };
#define PRIME_MAX UINT32_C(16777213) /* the largest below 2^24 */

/* EXC-5: taps of primitive polynomials, bit i - 1 for the power x^i; one of many choices for each order. */
static uint32_t taps_of(unsigned order) {
    static const uint32_t taps[ORDER_MAX + 1] = {0,      0,      0x3,    0x6,     0xc,     0x14,    0x30,
                                                 0x60,   0xb8,   0x110,  0x240,   0x500,   0x829,   0x100d,
                                                 0x2015, 0x6000, 0xd008, 0x12000, 0x20400, 0x40023, 0x90000};
    return taps[order];
}

static unsigned order_of(uint32_t n_chips) {
    for (unsigned order = ORDER_MIN; order <= ORDER_MAX; order++) {
        if (n_chips == (UINT32_C(1) << order) - 1) {
            return order;
        }
    }
    return 0;
}

static int is_odd_prime(uint32_t n) {
    if (n < 3 || n % 2 == 0 || n > PRIME_MAX) {
        return 0;
    }
    for (uint32_t d = 3; d * d <= n; d += 2) {
        if (n % d == 0) {
            return 0;
        }
    }
    return 1;
}

static uint32_t nearest_prime(uint32_t n) {
    if (n <= 3 || n >= PRIME_MAX) {
        return n <= 3 ? 3 : PRIME_MAX;
    }
    for (uint32_t away = 0;; away++) { /* ends: 3 and PRIME_MAX are on the way */
        if (is_odd_prime(n - away)) {
            return n - away;
        }
        if (is_odd_prime(n + away)) {
            return n + away;
        }
    }
}

uint32_t gsid_prbs_nearest(gsid_prbs_kind kind, uint32_t n_chips) {
    if (kind == GSID_PRBS_QUADRATIC_RESIDUE) {
        return nearest_prime(n_chips);
    }
    if (kind != GSID_PRBS_MAXIMUM_LENGTH) {
        return 0;
    }
    uint32_t nearest = 0, away = UINT32_MAX;
    for (unsigned order = ORDER_MIN; order <= ORDER_MAX; order++) {
        const uint32_t n = (UINT32_C(1) << order) - 1, d = n > n_chips ? n - n_chips : n_chips - n;
        if (d < away) {
            away = d;
            nearest = n;
        }
    }
    return nearest;
}

/* EXC-4 by Euler's criterion: chip i of N is high when i^((N - 1)/2) is 1 modulo N, and the first one is. */
static int is_residue(uint32_t i, uint32_t n) {
    if (i == 0) {
        return 1;
    }
    uint64_t power = 1, square = i;
    for (uint32_t e = (n - 1) / 2; e > 0; e /= 2) {
        power = e % 2 ? power * square % n : power;
        square = square * square % n;
    }
    return power == 1;
}

static void begin_chip(gsid_prbs *prbs) {
    if (prbs->cfg.kind == GSID_PRBS_QUADRATIC_RESIDUE) {
        prbs->is_high = is_residue(prbs->chip, prbs->cfg.n_chips);
        return;
    }
    const unsigned order = order_of(prbs->cfg.n_chips);
    uint32_t tapped = prbs->state & taps_of(order), parity = 0;
    for (; tapped > 0; tapped /= 2) {
        parity ^= tapped % 2;
    }
    prbs->is_high = (int)(prbs->state % 2);
    prbs->state = ((prbs->state << 1) | parity) & prbs->cfg.n_chips;
}

gsid_status gsid_prbs_init(gsid_prbs *prbs, const gsid_prbs_cfg *cfg) {
    if (prbs == NULL || cfg == NULL) {
        return GSID_E_NULL;
    }
    const int has_length = cfg->kind == GSID_PRBS_QUADRATIC_RESIDUE ? is_odd_prime(cfg->n_chips)
                           : cfg->kind == GSID_PRBS_MAXIMUM_LENGTH  ? order_of(cfg->n_chips) > 0
                                                                    : 0;
    if (!has_length || cfg->n_hold < 1 || cfg->n_hold > GSID_N_PERIOD_MAX / cfg->n_chips) {
        return GSID_E_CONFIG;
    }
    if (!gsid_is_finite(cfg->amplitude)) {
        return GSID_E_NONFINITE;
    }
    prbs->cfg = *cfg;
    prbs->chip = 0;
    prbs->held = 0;
    prbs->state = 1;
    prbs->is_high = 0;
    return GSID_OK;
}

gsid_status gsid_prbs_step(gsid_prbs *prbs, gsid_real *u) {
    if (prbs == NULL || u == NULL) {
        return GSID_E_NULL;
    }
    if (prbs->cfg.n_hold == 0) {
        return GSID_E_STATE;
    }
    if (prbs->held == 0) {
        begin_chip(prbs);
    }
    *u = prbs->is_high ? prbs->cfg.amplitude : -prbs->cfg.amplitude;
    prbs->held++;
    if (prbs->held < prbs->cfg.n_hold) {
        return GSID_OK;
    }
    prbs->held = 0;
    prbs->chip++;
    if (prbs->chip < prbs->cfg.n_chips) {
        return GSID_OK;
    }
    prbs->chip = 0; /* the register has returned to its start */
    return GSID_DONE;
}
