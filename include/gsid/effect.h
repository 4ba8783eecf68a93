/* What one physical effect is: a descriptor, and its equations with their derivatives. src/effects has one file for each;
 * the plant (plant.h) combines a stack of them. A user-defined effect is one more such struct. */
#ifndef GSID_EFFECT_H
#define GSID_EFFECT_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GSID_EFFECT_PARAMETERS_MAX 4
/* The most samples over which a controller can difference the angle. */
#define GSID_RATE_SAMPLES_MAX 16

/* Where an effect acts. The plant takes the stages in this order, and within a stage the order of the stack. */
typedef enum {
    GSID_STAGE_CONTROLLER = 0, /* makes the command from a reference */
    GSID_STAGE_ACTUATOR = 1,   /* between command and motor torque */
    GSID_STAGE_TORQUE = 2,     /* on the axis */
    GSID_STAGE_STRUCTURE = 3,  /* between the axis and the sensor */
    GSID_STAGE_SENSOR = 4
} gsid_stage;

/* Whether the first derivative by the strength of an effect is useful where the effect vanishes. */
typedef enum {
    GSID_NULL_SMOOTH = 0,    /* a derivative, of either sign */
    GSID_NULL_ONE_SIDED = 1, /* a derivative, but the strength cannot be negative */
    GSID_NULL_THRESHOLD = 2, /* no useful derivative: compare with finite sizes */
    GSID_NULL_NEVER = 3      /* the effect cannot be left out, or it is known */
} gsid_null_kind;

typedef struct {
    const char *name, *unit;
    gsid_real typical;      /* for a gimbal like that of the thesis */
    gsid_real lower, upper; /* values outside are refused, except null_value */
    gsid_real null_value;   /* the effect vanishes here; NaN: a shape, which has no meaning without the effect */
} gsid_effect_parameter;

typedef struct gsid_effect gsid_effect;

/* One effect in a stack, with its values. */
typedef struct {
    const gsid_effect *effect;
    gsid_real value[GSID_EFFECT_PARAMETERS_MAX];
    const void *data; /* what the effect's functions need besides the values: expression.h, table.h; else NULL */
} gsid_plant_item;

/* ---- torques that are not linear ---- */

/* Inputs of a torque law. Torques are divided by the inertia. */
typedef struct {
    gsid_real angle;    /* of the axis; of an effect with backlash, the twist between motor and load */
    gsid_real rate;     /* of the axis */
    gsid_real command;  /* as it drives the motor: after static maps, delay and lags */
    gsid_real side;     /* +1 or -1: the direction of motion, fixed between two reversals, whatever the sign of rate; for
                           effects that can hold the axis or have a memory */
    int zone;           /* -1, 0, +1: below -edge, between, above edge; fixed between two crossings */
    gsid_real turned;   /* change of the axis's angle since memory was updated */
    gsid_real memory;   /* the law's own state, if it has one */
    gsid_real unit_rad; /* radians in a unit of angle */
} gsid_motion;

/* Results of a torque law: the torque, the memory at the end, and their derivatives. The plant clears them before the call. */
typedef struct {
    gsid_real torque, by_angle, by_rate, by_command, by_turned, by_memory;
    gsid_real by_value[GSID_EFFECT_PARAMETERS_MAX];
    gsid_real memory, memory_by_turned, memory_by_memory;
    gsid_real memory_by_value[GSID_EFFECT_PARAMETERS_MAX];
} gsid_torque;

/* ---- what is linear: z' = A z ---- */

/* Entries of z that every plant has: its inputs, then its states. Of a command that is not held GSID_Z_COMMAND is the slope: an
 * effect is driven by the entry `command` of gsid_linear. */
enum { GSID_Z_COMMAND = 0, GSID_Z_ONE = 1, GSID_Z_ANGLE = 2, GSID_Z_RATE = 3, GSID_Z_STATES = GSID_Z_ANGLE };
#define GSID_Z_MAX 32

/* One entry of A, or of its derivative by a parameter that has the column `by` of the sensitivities. */
typedef struct {
    uint32_t row, column, by;
    gsid_real value;
} gsid_linear_entry;

/* The matrix A and its derivatives, while the effects add their entries. */
typedef struct {
    uint32_t n;            /* entries of z so far */
    uint32_t command;      /* entry of z where the actuator chain ends so far */
    uint32_t drive;        /* row that the motor torque acts on */
    uint32_t twist;        /* entry of the twist between motor and load; 0: no backlash */
    uint32_t reaction;     /* row of the motor, on which the gear's torque reacts */
    uint32_t item;         /* number of the item that is adding now */
    uint32_t n_bodies;     /* rigid bodies so far: the number of the last one's item, and its gain */
    uint32_t rigid_body;
    gsid_real gain;
    int output_angle;      /* the sensor measures the angle, not the rate */
    gsid_real delay_s;     /* of the command so far */
    gsid_real instant_s;   /* a lag shorter than this counts as a delay */
    gsid_real signal[GSID_Z_MAX]; /* row vector: the sensor measures signal z */
    const uint32_t *column;       /* private: [n_items][GSID_EFFECT_PARAMETERS_MAX] of the sensitivities, 0: not free */
    uint32_t n_entries, n_slopes, n_delays;     /* private */
    gsid_linear_entry *entry, *slope, *delay;   /* private: NULL while they are counted */
    uint32_t sensor;       /* private: the first of the states that follow the output */
} gsid_linear;

/** Add a state.  @return its entry of z */
uint32_t gsid_linear_state(gsid_linear *to);

/** A[row][column] += value. */
void gsid_linear_add(gsid_linear *to, uint32_t row, uint32_t column, gsid_real value);

/** dA[row][column]/dp += slope, for a parameter p of any item; no effect when that parameter is not free. */
void gsid_linear_slope(gsid_linear *to, uint32_t item, uint32_t parameter, uint32_t row, uint32_t column,
                       gsid_real slope);

/** Delay the command by one of the adding item's parameters.
 *  The plant does not change with time: delaying its command or its output is the same. */
void gsid_linear_delay(gsid_linear *to, uint32_t parameter, gsid_real delay_s);

/* ---- the effect ---- */

/* Functions that an effect does not need are NULL. All are pure, and safe for values within the bounds. */
struct gsid_effect {
    const char *id;
    const char *sentence;      /* what it is, in one sentence */
    const char *confused_with; /* ids, comma-separated: effects that it is easily confused with */
    gsid_stage stage;
    gsid_null_kind null_kind;
    uint32_t n_parameters;
    gsid_effect_parameter parameter[GSID_EFFECT_PARAMETERS_MAX];
    uint32_t n_states;  /* that linear adds, at most */
    int looks_at_angle; /* 0: shifting the angle changes nothing */
    int looks_at_command;
    int is_constant;    /* the torque depends on side and zone only */
    int may_be_steep;   /* the slope is unknown: a step is halved where the torque differs from the one that the step was
                           computed with; if that does not help, the plant stops with GSID_E_STEEP */
    int has_memory;     /* the torque has a state of its own, a function of the angle turned between two reversals */

    /* What is linear. */
    void (*linear)(const gsid_plant_item *item, gsid_linear *to);
    /* Torque against the motion, smooth while side and zone stay. */
    void (*torque)(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer);
    /* The law is smooth on both sides of +-edge, but not across. */
    gsid_real (*edge)(const gsid_plant_item *item);
    /* Largest torque that the effect can hold at rest; required of a torque that depends on side. */
    gsid_real (*holding)(const gsid_plant_item *item);
    /* Static map of the command; by_value [n_parameters]. */
    gsid_real (*command)(const gsid_plant_item *item, gsid_real u, gsid_real *by_u, gsid_real *by_value);
    /* Command from reference, angle and rate, once a sample; by_signal [3], by_value [n_parameters]. */
    gsid_real (*control)(const gsid_plant_item *item, const gsid_real signal[3], gsid_real *by_signal,
                         gsid_real *by_value);
    /* Samples over which the controller differences the angle to obtain the rate; 0 or NULL: it is given the rate. */
    uint32_t (*rate_samples)(const gsid_plant_item *item);
    /* Rate at which the sensor is refreshed [Hz]; 0: always. */
    gsid_real (*refresh_hz)(const gsid_plant_item *item);
    /* Added to the output, not locked to the excitation; by_value [n_parameters]. */
    gsid_real (*disturbance)(const gsid_plant_item *item, gsid_real t_s, gsid_real *by_value);
};

/* A user-defined effect in a shared object, for gsid.effects.load in Python. After its definition write
 *     GSID_SHARE_EFFECT(my_effect);
 * The size reveals a shared object that was compiled with another version of this header. */
typedef struct {
    size_t size;
    const gsid_effect *effect;
} gsid_shared_effect;
#define GSID_SHARE_EFFECT(effect) const gsid_shared_effect GSID_NAME(effect##_shared) = {sizeof(gsid_effect), &effect}

#ifdef __cplusplus
}
#endif

#endif
