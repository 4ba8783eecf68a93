/* The periodic steady state: Newton's method on the state at the period's start (shooting), with the sensitivities of that
 * fixed point. An axis whose angle has no influence may turn: its angle, and the sensor that follows it, then end each period
 * further on by the same turn. */
#include <string.h>

#include "gsid/lsq.h"
#include "plant_laws.h"
#include "plant_sample.h"
#include "plant_sensor.h"

/* The answer is settled when one more period changes it by less than this part of its peak. */
#ifdef GSID_SINGLE
#define SETTLED 1e-5f
#define SETTLED_SLOPE 1e-3f
#define RANK_TOL 1e-5f
#define CLOSE 1e-3f
#else
#define SETTLED 1e-11
#define SETTLED_SLOPE 1e-8
#define RANK_TOL 1e-10
#define CLOSE 1e-5 /* from here Newton's next step ends at rounding */
#endif

typedef struct {
    gsid_plant *plant;
    gsid_plant_layout *l;
    uint32_t n_period;
    const gsid_real *u;
    gsid_real *y, *dy, *angle, *rate;
    uint32_t first_shoot; /* column */
    int closed_loop;
    gsid_real angle_start; /* where the angle stays when nothing determines it */
    gsid_real drift; /* change over the last period that no correction was predicted to remove */
} shooting;

/* The command that is given in a sample: with a first-order hold the one at its end. */
static gsid_real command_of(const shooting *s, uint32_t sample) {
    return s->u[(sample + (s->l->command.ramp != 0 ? 1 : 0)) % s->n_period];
}

/* The delayed commands at the start are the last ones of the period; in closed loop, those of the period before. */
static void fill_delay(shooting *s) {
    gsid_plant_layout *l = s->l;
    if (s->closed_loop) {
        return;
    }
    for (uint32_t k = l->command.delay_samples + 2; k > 0; k--) {
        gsid_plant_give(s->plant, command_of(s, s->n_period - k % s->n_period));
    }
    gsid_plant_take_command(l, l->motion.piece[1].step.length_s * (gsid_real)l->motion.piece[1].n_steps);
}

static void keep_largest(gsid_plant_layout *l) {
    for (uint32_t c = 0; c < l->shape.n_active; c++) {
        const gsid_real size = gsid_fabs(l->sensor.y[c]);
        if (size > l->shooting.largest_dy[c]) {
            l->shooting.largest_dy[c] = size;
        }
    }
}

static int is_stopped(const shooting *s) {
    const gsid_plant_cfg *cfg = &s->plant->cfg;
    return (cfg->stop != NULL && *cfg->stop != 0) || (cfg->moves_left != NULL && *cfg->moves_left == 0);
}

static void count_moves(const shooting *s) {
    uint64_t *left = s->plant->cfg.moves_left;
    if (left != NULL) {
        const uint64_t moves = (uint64_t)s->l->motion.n_moves * s->l->shape.n_active;
        *left -= moves < *left ? moves : *left;
    }
}

static gsid_status health(const shooting *s) {
    return is_stopped(s) ? GSID_E_STOPPED : gsid_plant_health(s->l);
}

static void run_period(shooting *s) {
    gsid_plant_layout *l = s->l;
    memset(l->shooting.largest_dy, 0, l->shape.n_active * sizeof *l->shooting.largest_dy);
    fill_delay(s);
    gsid_plant_start_refresh(l);
    for (uint32_t n = 0; n < s->n_period && !l->steep.is_given_up && !is_stopped(s); n++) {
        gsid_plant_output(l, l->sensor.y);
        keep_largest(l);
        if (s->y != NULL) {
            s->y[n] = l->sensor.y[VALUE];
        }
        for (uint32_t p = 0; p < l->shape.n_free; p++) {
            s->dy[(size_t)p * s->n_period + n] = l->sensor.y[FIRST_FREE + p];
        }
        if (s->angle != NULL) {
            s->angle[n] = l->z[GSID_Z_ANGLE * l->shape.n_columns];
        }
        if (s->rate != NULL) {
            s->rate[n] = l->z[GSID_Z_RATE * l->shape.n_columns];
        }
        gsid_plant_sample(s->plant, command_of(s, n));
        count_moves(s);
    }
}

/* How far the axis has turned in the period, in a column; 0 where its angle is one of the states that are searched. */
static gsid_real turn(const shooting *s, uint32_t column) {
    if (!s->l->stack.turns) {
        return 0;
    }
    return s->l->z[GSID_Z_ANGLE * s->l->shape.n_columns + column] - (column == VALUE ? s->angle_start : GSID_R(0.0));
}

/* Leave the turn out of the output and its sensitivities: what remains repeats. */
static void remove_turn(const shooting *s) {
    for (uint32_t n = 0; n < s->n_period; n++) {
        const gsid_real part = (gsid_real)n / (gsid_real)s->n_period;
        s->y[n] -= part * turn(s, VALUE);
        for (uint32_t p = 0; p < s->l->shape.n_free; p++) {
            s->dy[(size_t)p * s->n_period + n] -= part * turn(s, FIRST_FREE + p);
        }
    }
}

/* ---- the state at the start ---- */

static gsid_real *state(const shooting *s, uint32_t j) {
    return s->l->z + (size_t)s->l->shooting.row[j] * s->l->shape.n_columns;
}

static gsid_real *start(const shooting *s, uint32_t j) {
    return s->l->shooting.start + (size_t)j * s->l->shape.n_columns;
}

/* State j at the end of the period, without the turn. */
static gsid_real end(const shooting *s, uint32_t j, uint32_t column) {
    const uint32_t row = s->l->shooting.row[j];
    const int follows = row >= s->l->linear.a.sensor && row < s->l->linear.a.n;
    return state(s, j)[column] - (follows ? turn(s, column) : GSID_R(0.0));
}

/* Value and free columns come from the start that was found; each further column is the derivative by one state alone. */
static void enter_start(shooting *s) {
    gsid_plant_layout *l = s->l;
    l->steep.is_given_up = 0;
    l->steep.stride_s = l->motion.sample_s;
    for (uint32_t row = GSID_Z_STATES; row < l->shape.n_rows; row++) {
        memset(l->z + (size_t)row * l->shape.n_columns + 1, 0, (l->shape.n_active - 1) * sizeof *l->z);
    }
    for (uint32_t j = 0; j < l->shooting.n; j++) {
        memcpy(state(s, j), start(s, j), s->first_shoot * sizeof *l->z);
        state(s, j)[s->first_shoot + j] = 1;
    }
    if (!l->stack.looks_at_angle) {
        l->z[GSID_Z_ANGLE * l->shape.n_columns] = s->angle_start;
    }
    gsid_plant_choose_zones(l);
    gsid_plant_choose_regime(l);
    if (l->regime.sticks) {
        memset(l->z + GSID_Z_RATE * l->shape.n_columns + 1, 0, (l->shape.n_active - 1) * sizeof *l->z);
    }
    if (s->closed_loop) {
        gsid_plant_clear_ring(l, s->first_shoot);
    }
}

/* Where the last good period ended, in the columns that are searched in. */
static gsid_real *fallback(const shooting *s, uint32_t j) {
    return s->l->shooting.fallback + (size_t)j * s->l->shape.n_columns;
}

static void keep(const shooting *s) {
    for (uint32_t j = 0; j < s->l->shooting.n; j++) {
        memcpy(fallback(s, j), state(s, j), s->first_shoot * sizeof(gsid_real));
    }
}

static void go_back(const shooting *s) {
    for (uint32_t j = 0; j < s->l->shooting.n; j++) {
        memcpy(start(s, j), fallback(s, j), s->first_shoot * sizeof(gsid_real));
    }
}

/* Change of a column of y over one more period, to first order: sum |dy/dx_j| |change of x_j|. */
static gsid_real change_of(const shooting *s, uint32_t column) {
    gsid_real sum = 0;
    for (uint32_t j = 0; j < s->l->shooting.n; j++) {
        sum += s->l->shooting.largest_dy[s->first_shoot + j] * gsid_fabs(end(s, j, column) - start(s, j)[column]);
    }
    return sum;
}

/* Size of a column of y, with the share that the start contributes. Changes are judged relative to it, so that a derivative
 * which is 0 apart from rounding counts as settled. */
static gsid_real reach_of(const shooting *s, uint32_t column) {
    gsid_real sum = s->l->shooting.largest_dy[column];
    for (uint32_t j = 0; j < s->l->shooting.n; j++) {
        sum += s->l->shooting.largest_dy[s->first_shoot + j] * gsid_fabs(start(s, j)[column]);
    }
    return sum;
}

static int is_at_rounding(const shooting *s, gsid_real change) {
    return change <= SETTLED * s->l->shooting.largest_dy[VALUE];
}

static int is_settled(const shooting *s, gsid_real change) {
    if (!is_at_rounding(s, change)) {
        return 0;
    }
    for (uint32_t c = FIRST_FREE; c < s->first_shoot; c++) {
        if (!(change_of(s, c) <= SETTLED_SLOPE * reach_of(s, c))) {
            return 0;
        }
    }
    return 1;
}

/* An angle that returns to where it began but for rounding is undetermined, as behind a spring too weak to turn the axis back:
 * else rounding of the mean torque, over nearly nothing, would be its mean. A rate counts by what it turns in a period. */
static void hold_undetermined_angle(shooting *s) {
    const gsid_plant_layout *l = s->l;
    const gsid_real period_s = (gsid_real)s->n_period / s->plant->cfg.fs_hz;
    uint32_t angle = 0;
    while (angle < l->shooting.n && l->shooting.row[angle] != GSID_Z_ANGLE) {
        angle++;
    }
    if (angle == l->shooting.n) {
        return;
    }
    const uint32_t column = s->first_shoot + angle;
    gsid_real moved = 0;
    for (uint32_t i = 0; i < l->shooting.n; i++) {
        const gsid_real left = end(s, i, column) - (i == angle ? GSID_R(1.0) : GSID_R(0.0));
        moved += (l->shooting.row[i] == GSID_Z_RATE ? period_s : GSID_R(1.0)) * gsid_fabs(left);
    }
    for (uint32_t i = 0; i < l->shooting.n && moved <= GSID_EPSILON; i++) {
        state(s, i)[column] -= end(s, i, column) - (i == angle ? GSID_R(1.0) : GSID_R(0.0));
    }
}

/* x0 += (I - Phi)^-1 (x(T) - x0), in the columns of the free parameters too: their fixed point obeys the same equation. A
 * direction with eigenvalue 1 is undetermined and stays as it is. After a failure only a part of the columns is corrected.
 * The last correction stays in l->shooting.correction. */
static gsid_status correct_start(shooting *s) {
    gsid_plant_layout *l = s->l;
    const uint32_t n = l->shooting.n;
    hold_undetermined_angle(s);
    gsid_lsq q;
    gsid_status status = gsid_lsq_init(&q, n, l->shooting.lsq_mem, GSID_LSQ_MEM_SIZE(l->shooting.n_max));
    for (uint32_t c = s->first_shoot; c > 0 && status >= 0; c--) {
        status = gsid_lsq_reset(&q);
        for (uint32_t i = 0; i < n && status == GSID_OK; i++) {
            for (uint32_t j = 0; j < n; j++) {
                l->shooting.correction[j] = (i == j ? GSID_R(1.0) : GSID_R(0.0)) - end(s, i, s->first_shoot + j);
            }
            status = gsid_lsq_add(&q, l->shooting.correction, end(s, i, c - 1) - start(s, i)[c - 1]);
        }
        if (status == GSID_OK) {
            status = gsid_lsq_solve(&q, RANK_TOL, l->shooting.correction, NULL);
        }
        for (uint32_t j = 0; j < n && status >= 0; j++) {
            start(s, j)[c - 1] += l->shooting.correction[j];
        }
    }
    return status < 0 ? status : GSID_OK;
}

/* The change that remains after the last correction, to first order. */
static gsid_real left_of_change(const shooting *s) {
    const gsid_plant_layout *l = s->l;
    gsid_real sum = 0;
    for (uint32_t i = 0; i < l->shooting.n; i++) {
        gsid_real left = end(s, i, VALUE) - start(s, i)[VALUE]; /* the start is corrected already */
        for (uint32_t j = 0; j < l->shooting.n; j++) {
            left += end(s, i, s->first_shoot + j) * l->shooting.correction[j];
        }
        sum += l->shooting.largest_dy[s->first_shoot + i] * gsid_fabs(left);
    }
    return sum;
}

/* After a good period: correct the start.
 * @param[out] before  the change, which the next period has to halve; INFINITY where no start removes the drift: the plant is
 *                     then simulated further
 * @return 1 when further simulation has not halved the drift either */
static int correct_or_drift(shooting *s, gsid_real change, gsid_real *before) {
    keep(s);
    *before = correct_start(s) == GSID_OK ? change : INFINITY;
    if (*before == INFINITY || is_at_rounding(s, change) || left_of_change(s) <= change / 2) {
        return 0;
    }
    const int goes_on = change > s->drift / 2;
    s->drift = change;
    *before = INFINITY;
    return goes_on;
}

/* ---- the search ---- */

static gsid_status pass(shooting *s, gsid_real *change) {
    enter_start(s);
    run_period(s);
    *change = change_of(s, VALUE);
    return health(s);
}

/* Newton's method can fail: an orbit with sticking can be one of many, one with impacts can be unstable. The search then goes on
 * from the end of the last good period, which is plain simulation. It ends when all columns repeat, or with `approach` when the
 * next step will end at rounding. */
static gsid_status shoot(shooting *s, uint32_t n_newton, int approach, gsid_real *change) {
    gsid_real before = INFINITY;
    s->drift = INFINITY;
    for (uint32_t i = 0; i <= n_newton; i++) {
        const gsid_status status = pass(s, change);
        const int helped = status == GSID_OK && (*change <= GSID_R(0.5) * before || is_at_rounding(s, *change));
        if (helped && approach && *change <= CLOSE * s->l->shooting.largest_dy[VALUE]) {
            return correct_start(s);
        }
        if (helped && !approach && is_settled(s, *change)) {
            return GSID_OK;
        }
        if (!helped && i == 0) {
            return status;
        }
        if (helped && i == n_newton) {
            return GSID_MAX_ITER;
        }
        before = INFINITY;
        const int goes_on = helped && correct_or_drift(s, *change, &before);
        if (before == INFINITY) {
            go_back(s);
        }
        if (goes_on) {
            return GSID_MAX_ITER;
        }
    }
    const gsid_status status = pass(s, change);
    return status == GSID_OK ? GSID_MAX_ITER : status;
}

/* First the values alone, without the columns of the free parameters, which are most of the work. Not so in closed loop, where
 * the delayed commands and their sensitivities have to settle too, nor for a plant that is linear between events, which takes
 * only one step. */
static gsid_status find_orbit(shooting *s, uint32_t n_newton, gsid_real *change) {
    gsid_plant_layout *l = s->l;
    const uint32_t n_free = l->shape.n_free;
    gsid_status status = GSID_OK;
    if (n_free > 0 && !l->laws.are_constant && !s->closed_loop) {
        l->shape.n_free = 0;
        l->shape.n_active = 1 + l->shooting.n;
        s->first_shoot = FIRST_FREE;
        status = shoot(s, n_newton, 1, change);
        l->shape.n_free = n_free;
        l->shape.n_active = 1 + n_free + l->shooting.n;
        s->first_shoot = FIRST_FREE + n_free;
    }
    return status < 0 ? status : shoot(s, status == GSID_OK ? n_newton : 1, 0, change);
}

/* One step of Newton's method from rest: exact where no law acts and no loop is closed behind a delay. A controller's
 * delayed commands and measured angles are not part of the corrected state: they stay those of the period from rest. */
static gsid_status find_linear_orbit(shooting *s) {
    gsid_plant_layout *l = s->l;
    l->shape.n_free = 0;
    l->shape.n_active = 1 + l->shooting.n;
    s->first_shoot = FIRST_FREE;
    memset(l->shooting.start, 0, (size_t)l->shooting.n * l->shape.n_columns * sizeof *l->shooting.start);
    enter_start(s);
    run_period(s);
    gsid_status status = health(s);
    if (status == GSID_OK) {
        status = correct_start(s);
    }
    for (uint32_t j = 0; j < l->shooting.n; j++) {
        state(s, j)[VALUE] = start(s, j)[VALUE];
    }
    l->shape.n_active = 1;
    return status;
}

static gsid_status check_period(const gsid_plant *plant, uint32_t n_period, const gsid_real *u) {
    if (plant == NULL || u == NULL) {
        return GSID_E_NULL;
    }
    if (plant->layout == NULL) {
        return GSID_E_STATE;
    }
    if (n_period == 0) {
        return GSID_E_CONFIG;
    }
    for (uint32_t n = 0; n < n_period; n++) {
        if (!gsid_is_finite(u[n])) {
            return GSID_E_NONFINITE;
        }
    }
    return GSID_OK;
}

gsid_status gsid_plant_start_linear(gsid_plant *plant, uint32_t n_period, const gsid_real *u) {
    gsid_status status = check_period(plant, n_period, u);
    if (status != GSID_OK) {
        return status;
    }
    gsid_plant_reset(plant);
    gsid_plant_layout *l = plant->layout;
    const uint32_t n_laws = l->laws.n;
    const int has_side = l->laws.have_side;
    shooting s = {.plant = plant, .l = l, .n_period = n_period, .u = u, .closed_loop = l->stack.has_controller};
    l->laws.n = 0;
    l->laws.have_side = l->regime.sticks = l->regime.is_loose = 0;
    status = find_linear_orbit(&s);
    l->laws.n = n_laws;
    l->laws.have_side = has_side;
    if (status != GSID_OK) {
        gsid_plant_reset(plant);
        return status;
    }
    gsid_plant_choose_zones(l);
    gsid_plant_choose_regime(l);
    return GSID_OK;
}

static gsid_status settle(shooting *s, uint32_t n_periods) {
    gsid_plant_layout *l = s->l;
    l->shape.n_active = 1;
    l->shape.n_free = 0;
    gsid_plant_choose_zones(l);
    gsid_plant_choose_regime(l);
    for (uint32_t p = 0; p < n_periods; p++) {
        run_period(s);
        const gsid_status status = health(s);
        if (status != GSID_OK) {
            return status;
        }
    }
    return GSID_OK;
}

gsid_status gsid_plant_periodic(gsid_plant *plant, uint32_t n_period, const gsid_real *u, uint32_t n_settle_periods,
                                uint32_t n_newton, gsid_real *y, gsid_real *dy, gsid_real *angle, gsid_real *rate,
                                gsid_real *residual) {
    if (y == NULL) {
        return GSID_E_NULL;
    }
    gsid_status status = check_period(plant, n_period, u);
    if (status != GSID_OK) {
        return status;
    }
    gsid_plant_layout *l = plant->layout;
    shooting s = {plant,
                  l,
                  n_period,
                  u,
                  y,
                  dy,
                  angle,
                  rate,
                  0,
                  l->stack.has_controller,
                  l->z[GSID_Z_ANGLE * l->shape.n_columns],
                  INFINITY};
    gsid_real change = INFINITY;
    status = settle(&s, n_settle_periods);
    if (status == GSID_OK) {
        l->shape.n_free = dy != NULL ? plant->cfg.n_free : 0;
        l->shape.n_active = 1 + l->shape.n_free + l->shooting.n;
        s.first_shoot = FIRST_FREE + l->shape.n_free;
        memset(l->shooting.start, 0, (size_t)l->shooting.n * l->shape.n_columns * sizeof *l->shooting.start);
        for (uint32_t j = 0; j < l->shooting.n; j++) {
            start(&s, j)[VALUE] = state(&s, j)[VALUE];
        }
        if (s.closed_loop) {
            gsid_plant_clear_ring(l, FIRST_FREE);
        }
        status = find_orbit(&s, n_newton, &change);
    }
    if (status >= 0 && l->stack.turns) {
        remove_turn(&s);
    }
    l->shape.n_free = 0;
    l->shape.n_active = 1;
    if (status < 0) {
        gsid_plant_reset(plant);
    } else if (residual != NULL) {
        *residual = change;
    }
    return status;
}
