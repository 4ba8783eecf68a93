/* What fits, the search for missing effects and the documentation need of an effect besides its descriptor (effect.h).
 * Each effect's file has both. Nothing in the core, the effects or firmware refers to the facts: a linker that drops unused
 * sections leaves them out of an image. */
#ifndef GSID_EFFECT_FACTS_H
#define GSID_EFFECT_FACTS_H

#include "gsid/effect.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The linear part of an effect in the frequency domain, s = j 2 pi f, by the values of its parameters. Torques are against
 * the motion and divided by the inertia. A law without linear part, or whose linear part depends on the size of the motion
 * (friction, stops), has none. */
typedef enum {
    GSID_LINEAR_NONE = 0,
    GSID_LINEAR_GAIN = 1,     /* motor torque = value[0] command */
    GSID_LINEAR_DAMPING = 2,  /* torque = value[0] rate */
    GSID_LINEAR_SPRING = 3,   /* torque = value[0] angle */
    GSID_LINEAR_PENDULUM = 4, /* torque = value[0] cos(value[1]) angle, value[1] in degrees, angle in rad */
    GSID_LINEAR_DELAY = 5,    /* exp(-value[0] s) */
    GSID_LINEAR_LAG = 6,      /* 1 / (1 + value[0] s), before the motor or behind the sensor by the effect's stage */
    GSID_LINEAR_HOLD = 7,     /* (1 - exp(-s T)) / (s T), T = 1 / value[0]; 0: 1 */
    GSID_LINEAR_MODE = 8,     /* value[2] s / (s^2 + 2 value[1] w0 s + w0^2), w0 = 2 pi value[0], beside the rigid body */
    GSID_LINEAR_BACKLASH = 9, /* spring value[1] with damper value[3] between load and motor, inertia value[2] */
    GSID_LINEAR_LOOP = 10,    /* command = value[1] (value[0] (reference - angle) - rate), the rate over value[3] samples */
    GSID_LINEAR_DYNAMICS = 11 /* torque = (value[0] s + value[1]) / (s^2 + value[2] s + value[3]) rate */
} gsid_linear_part;

/* What the points of a grid are shares of. */
typedef enum {
    GSID_SHARE_OF_RATE = 0, /* largest rate of the motion */
    GSID_SHARE_OF_ANGLE = 1, /* largest angle */
    GSID_SHARE_OF_TRAVEL = 2, /* travel from end to end */
    GSID_SHARE_OF_COMMAND = 3, /* largest command */
    GSID_SHARE_OF_SAMPLE = 4, /* time of a sample */
    GSID_SHARE_OF_FS = 5, /* sampling rate */
    GSID_SHARE_OF_BAND = 6, /* highest excited line */
    GSID_SHARE_OF_ONE = 7 /* the parameter's unit */
} gsid_share;

/* How its points lie. */
typedef enum {
    GSID_SPACING_NONE = 0,
    GSID_SPACING_GEOMETRIC = 1, /* n points from first to last in equal ratios */
    GSID_SPACING_INVERSE = 2, /* the parameter is 1 over such points */
    GSID_SPACING_FROM_END = 3, /* 1 minus such points */
    GSID_SPACING_TURNS = 4, /* first, first + step, ... up to last, all over the scale */
    GSID_SPACING_LIST = 5, /* n points of a list */
    GSID_SPACING_DECADES = 6, /* n points of a list in each decade, from first to last of the scale */
    GSID_SPACING_ROUNDING = 7, /* the scale over first, first + step, ... up to last: steps in it */
    GSID_SPACING_PER = 8 /* n points of a list, over the scale */
} gsid_spacing;

/* Where the search for missing effects begins, of a parameter that has no derivative where the effect vanishes. */
typedef struct {
    gsid_spacing spacing;
    gsid_share of;
    gsid_real first, last, step;
    uint32_t n;
    const gsid_real *list;
    const char *reason; /* why these points */
} gsid_effect_grid;

typedef struct {
    int in_response; /* the response of the linear part determines it: fitted to that before any simulation */
    const char *axis_field; /* gsid_axis_cfg's name of it (host/axis.h); NULL: the simulated axis has no such law */
    gsid_effect_grid grid;
} gsid_parameter_facts;

typedef struct {
    const gsid_effect *effect;
    const char *law; /* for a reader: u command, w rate, theta angle, y output */
    const char
        *as_c; /* the law in C for gsid export-c, {parameter} for a value; NULL: not exported, or by its linear part */
    gsid_linear_part linear_part;
    int turns_only; /* the law takes an angle: no meaning for an axis whose unit is a length */
    const char *simpler; /* id of the law that it becomes for special values of its shapes; NULL: none */
    const char
        *enlarged; /* rivals from outside the catalogue: expressions with coefficient c, parted by ; NULL: none */
    const char *not_searched; /* why the search for missing effects leaves it out; NULL: it is searched */
    gsid_parameter_facts parameter[GSID_EFFECT_PARAMETERS_MAX];
} gsid_effect_facts;

extern const gsid_effect_facts *const gsid_catalogue_facts[]; /* [gsid_n_catalogue], in the order of gsid_catalogue */

#ifdef __cplusplus
}
#endif

#endif
