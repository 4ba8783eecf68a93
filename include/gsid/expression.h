/* A torque law written as an expression, for example c tanh(w / 0.1): a list of steps for a small stack of numbers, each with
 * its derivatives. Text becomes such a list on the desktop (python/gsid/effects/law_text.py); the core only evaluates. */
#ifndef GSID_EXPRESSION_H
#define GSID_EXPRESSION_H

#include "gsid/effect.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GSID_EXPRESSION_STEPS_MAX 128
#define GSID_EXPRESSION_DEPTH_MAX 16 /* numbers on the stack */

/* X(name, numbers taken from the stack); each step puts one back. */
#define GSID_EXPRESSION_LIST(X)                                                                                        \
    X(NUMBER, 0) /* the step's number */                                                                               \
    X(PARAMETER, 0) /* the item's value of that index */                                                               \
    X(RATE, 0)                                                                                                         \
    X(ANGLE, 0)                                                                                                        \
    X(COMMAND, 0) /* as it drives the motor */                                                                         \
    X(UNIT_RAD, 0) /* radians in a unit of angle */                                                                    \
    X(NEGATE, 1)                                                                                                       \
    X(ABS, 1)                                                                                                          \
    X(SQRT, 1)                                                                                                         \
    X(EXP, 1)                                                                                                          \
    X(LOG, 1)                                                                                                          \
    X(SIN, 1)                                                                                                          \
    X(COS, 1)                                                                                                          \
    X(TANH, 1)                                                                                                         \
    X(ADD, 2)                                                                                                          \
    X(SUBTRACT, 2)                                                                                                     \
    X(MULTIPLY, 2)                                                                                                     \
    X(DIVIDE, 2)                                                                                                       \
    X(POWER, 2)                                                                                                        \
    X(MIN, 2)                                                                                                          \
    X(MAX, 2)

#define GSID_EXPRESSION_ENUM(name, n_taken) GSID_EXPRESSION_##name,
typedef enum { GSID_EXPRESSION_LIST(GSID_EXPRESSION_ENUM) GSID_EXPRESSION_N_KINDS } gsid_expression_kind;

typedef struct {
    gsid_expression_kind kind;
    uint32_t index; /* of a PARAMETER */
    gsid_real number; /* of a NUMBER */
} gsid_expression_step;

typedef struct {
    uint32_t n_steps;
    const gsid_expression_step *step; /* [n_steps] */
} gsid_expression;

/** Make an expression an effect: stage, torque and what it looks at; the caller gives id, sentence and parameters. Items
 *  of it carry the expression as their data.
 *  Where a function has no derivative (abs at 0, min and max of equals) the derivative is that of one side, 0 for abs; sqrt
 *  and powers of what stands still at 0 have the derivative 0.
 *  @param[in,out] effect  with n_parameters, which the steps are checked against
 *  @return GSID_OK; GSID_E_NULL; GSID_E_NONFINITE a number is not finite; GSID_E_CONFIG unknown step or parameter, too many
 *          steps, or a list that does not leave one number.  Context: background. */
gsid_status gsid_expression_effect(const gsid_expression *expression, gsid_effect *effect);

#ifdef __cplusplus
}
#endif

#endif
