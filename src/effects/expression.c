/* Torque laws of the user's own, as expressions: evaluated with their derivatives, forward. */
#include "gsid/expression.h"

#include <string.h>

#include "../core/real.h"

/* What a number depends on: the motion, then the item's values. */
enum { BY_ANGLE = 0, BY_RATE = 1, BY_COMMAND = 2, BY_VALUE = 3, N_BY = BY_VALUE + GSID_EFFECT_PARAMETERS_MAX };

typedef struct {
    gsid_real value, by[N_BY];
} dual;

#define N_TAKEN(name, n_taken) n_taken,
static const uint32_t taken[] = {GSID_EXPRESSION_LIST(N_TAKEN)};

/* 0 times an infinite slope is 0: what stands still does not move what depends on it. */
static gsid_real along(gsid_real slope, gsid_real by) {
    return by != 0 ? slope * by : 0;
}

/* x becomes a function of x. */
static void chain(dual *x, gsid_real value, gsid_real slope) {
    x->value = value;
    for (int i = 0; i < N_BY; i++) {
        x->by[i] = along(slope, x->by[i]);
    }
}

/* x becomes a function of x and y. */
static void chain2(dual *x, const dual *y, gsid_real value, gsid_real by_x, gsid_real by_y) {
    x->value = value;
    for (int i = 0; i < N_BY; i++) {
        x->by[i] = along(by_x, x->by[i]) + along(by_y, y->by[i]);
    }
}

static void start(dual *x, gsid_real value, int by) {
    memset(x, 0, sizeof *x);
    x->value = value;
    if (by >= 0) {
        x->by[by] = 1;
    }
}

static void push(const gsid_expression_step *step, const gsid_plant_item *item, const gsid_motion *motion, dual *x) {
    switch (step->kind) {
    case GSID_EXPRESSION_PARAMETER:
        start(x, item->value[step->index], BY_VALUE + (int)step->index);
        return;
    case GSID_EXPRESSION_RATE:
        start(x, motion->rate, BY_RATE);
        return;
    case GSID_EXPRESSION_ANGLE:
        start(x, motion->angle, BY_ANGLE);
        return;
    case GSID_EXPRESSION_COMMAND:
        start(x, motion->command, BY_COMMAND);
        return;
    case GSID_EXPRESSION_UNIT_RAD:
        start(x, motion->unit_rad, -1);
        return;
    default:
        start(x, step->number, -1);
    }
}

static void apply(gsid_expression_kind kind, dual *x) {
    const gsid_real v = x->value;
    gsid_real r;
    switch (kind) {
    case GSID_EXPRESSION_NEGATE:
        chain(x, -v, -1);
        return;
    case GSID_EXPRESSION_ABS:
        chain(x, gsid_fabs(v), v > 0 ? GSID_R(1.0) : v < 0 ? GSID_R(-1.0) : 0);
        return;
    case GSID_EXPRESSION_SQRT:
        r = gsid_sqrt(v);
        chain(x, r, GSID_R(0.5) / r);
        return;
    case GSID_EXPRESSION_EXP:
        r = gsid_exp(v);
        chain(x, r, r);
        return;
    case GSID_EXPRESSION_LOG:
        chain(x, gsid_log(v), 1 / v);
        return;
    case GSID_EXPRESSION_SIN:
        chain(x, gsid_sin(v), gsid_cos(v));
        return;
    case GSID_EXPRESSION_COS:
        chain(x, gsid_cos(v), -gsid_sin(v));
        return;
    default: /* tanh */
        r = gsid_tanh(v);
        chain(x, r, 1 - r * r);
    }
}

/* x^y. The slope by y is computed only where y is not constant. */
static void power(dual *x, const dual *y) {
    const gsid_real a = x->value, b = y->value, value = gsid_pow(a, b);
    const gsid_real by_a = b == 0 ? 0 : b * gsid_pow(a, b - 1), by_b = a == 0 && b > 0 ? 0 : value * gsid_log(a);
    chain2(x, y, value, by_a, by_b);
}

static void combine(gsid_expression_kind kind, dual *x, const dual *y) {
    const gsid_real a = x->value, b = y->value;
    switch (kind) {
    case GSID_EXPRESSION_ADD:
        chain2(x, y, a + b, 1, 1);
        return;
    case GSID_EXPRESSION_SUBTRACT:
        chain2(x, y, a - b, 1, -1);
        return;
    case GSID_EXPRESSION_MULTIPLY:
        chain2(x, y, a * b, b, a);
        return;
    case GSID_EXPRESSION_DIVIDE:
        chain2(x, y, a / b, 1 / b, -a / (b * b));
        return;
    case GSID_EXPRESSION_POWER:
        power(x, y);
        return;
    default: /* min and max */
        if (kind == GSID_EXPRESSION_MIN ? b < a : b > a) {
            *x = *y;
        }
    }
}

static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    const gsid_expression *expression = (const gsid_expression *)item->data;
    dual stack[GSID_EXPRESSION_DEPTH_MAX];
    uint32_t depth = 0;
    for (uint32_t i = 0; i < expression->n_steps; i++) {
        const gsid_expression_step *step = &expression->step[i];
        if (taken[step->kind] == 0) {
            push(step, item, motion, &stack[depth]);
        } else if (taken[step->kind] == 1) {
            apply(step->kind, &stack[depth - 1]);
        } else {
            combine(step->kind, &stack[depth - 2], &stack[depth - 1]);
        }
        depth += 1 - taken[step->kind];
    }
    answer->torque = stack[0].value;
    answer->by_angle = stack[0].by[BY_ANGLE];
    answer->by_rate = stack[0].by[BY_RATE];
    answer->by_command = stack[0].by[BY_COMMAND];
    memcpy(answer->by_value, stack[0].by + BY_VALUE, sizeof answer->by_value);
}

static gsid_status check(const gsid_expression *expression, uint32_t n_parameters) {
    uint32_t depth = 0;
    if (expression->n_steps == 0 || expression->n_steps > GSID_EXPRESSION_STEPS_MAX ||
        n_parameters > GSID_EFFECT_PARAMETERS_MAX) {
        return GSID_E_CONFIG;
    }
    for (uint32_t i = 0; i < expression->n_steps; i++) {
        const gsid_expression_step *step = &expression->step[i];
        if ((uint32_t)step->kind >= GSID_EXPRESSION_N_KINDS || taken[step->kind] > depth) {
            return GSID_E_CONFIG;
        }
        if (step->kind == GSID_EXPRESSION_NUMBER && !gsid_is_finite(step->number)) {
            return GSID_E_NONFINITE;
        }
        if (step->kind == GSID_EXPRESSION_PARAMETER && step->index >= n_parameters) {
            return GSID_E_CONFIG;
        }
        depth += 1 - taken[step->kind];
        if (depth > GSID_EXPRESSION_DEPTH_MAX) {
            return GSID_E_CONFIG;
        }
    }
    return depth == 1 ? GSID_OK : GSID_E_CONFIG;
}

static int looks_at(const gsid_expression *expression, gsid_expression_kind kind) {
    uint32_t i = 0;
    while (i < expression->n_steps && expression->step[i].kind != kind) {
        i++;
    }
    return i < expression->n_steps;
}

gsid_status gsid_expression_effect(const gsid_expression *expression, gsid_effect *effect) {
    if (expression == NULL || expression->step == NULL || effect == NULL) {
        return GSID_E_NULL;
    }
    const gsid_status status = check(expression, effect->n_parameters);
    if (status != GSID_OK) {
        return status;
    }
    effect->stage = GSID_STAGE_TORQUE;
    effect->looks_at_angle = looks_at(expression, GSID_EXPRESSION_ANGLE);
    effect->looks_at_command = looks_at(expression, GSID_EXPRESSION_COMMAND);
    effect->may_be_steep = 1;
    effect->torque = torque;
    return GSID_OK;
}
