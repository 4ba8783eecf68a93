/* A plant's memory: its parts, by what they are for. Shared by plant*.c only. */
#ifndef GSID_PLANT_PARTS_H
#define GSID_PLANT_PARTS_H

#include "gsid/plant.h"
#include "real.h"

/* Columns of z: the value, then its derivatives by the free parameters, then by the state at the start of a period. */
enum { VALUE = 0, FIRST_FREE = 1 };

/* A channel is a place where laws act, with the torque over a step a parabola in time: three more entries of z. */
enum { AXIS = 0, BACKLASH = 1, CHANNELS_MAX = 2, FORCING = 3 };

enum { WHOLE = 0, HALF = 1 };
/* Which linear motion holds between events: the axis held by friction, the gear within its backlash. */
enum { HELD = 1, LOOSE = 2, REGIMES = 4 };

#define NONE UINT32_MAX

/* What the stack of effects is. */
typedef struct {
    gsid_plant_item *item; /* [n_items] copies, made when the values were last found good */
    uint32_t *column;      /* [n_items][GSID_EFFECT_PARAMETERS_MAX] of the sensitivities, 0: not free */
    int has_controller;
    int looks_at_angle;   /* an effect depends on the angle */
    int turns;            /* the output is an angle that no effect depends on */
    int looks_at_command; /* a law depends on the motor's command */
} plant_stack;

/* Shape of z: [n_rows][n_columns]. */
typedef struct {
    uint32_t width;               /* rows that flow: linear.a.n, then the channels' forcing */
    uint32_t n_rows;              /* rows in memory; the last are the laws' memories */
    uint32_t n_columns, n_active; /* in memory; in use */
    uint32_t n_free;              /* columns of free parameters in use: all or none */
    uint32_t n_look, *row;        /* rows of the states; laws depend on the first n_look of them */
} plant_shape;

/* The linear part, z' = A z. */
typedef struct {
    gsid_linear a, draft; /* draft: the next values', until they are found good */
    gsid_real fastest;    /* bound on the rates of A [1/s] */
    uint32_t n_slope_columns, *slope_column; /* columns with a derivative of A */
    gsid_real *square;  /* work: [2][1 + n_free][width][width] */
    gsid_real *term[3]; /* work: as z */
} plant_linear;

/* A torque that is not linear. */
typedef struct {
    const gsid_plant_item *item;
    const uint32_t *column; /* [GSID_EFFECT_PARAMETERS_MAX] of the sensitivities, 0: not free */
    uint32_t channel;
    uint32_t memory; /* row of z, NONE */
    int zone;        /* state: see gsid_motion */
} plant_law;

/* All torques that are not linear. */
typedef struct {
    uint32_t n, n_channels, n_memories;
    plant_law *law;       /* [n] */
    int can_hold;         /* a law can hold the axis at rest */
    int have_side;        /* a law depends on the direction of motion */
    int are_constant;     /* every law is constant between events */
    int may_be_steep;     /* a law may be steep */
    gsid_real unit_rad;   /* radians in a unit of angle */
    gsid_real *torque[3]; /* work: [CHANNELS_MAX][n_columns] at the start, middle and end of a step */
} plant_laws;

/* What is fixed between two events, together with the zones of the laws. */
typedef struct {
    int sticks;     /* the axis is held by friction */
    int is_loose;   /* the gear is within its backlash */
    gsid_real side; /* direction of motion, +1 or -1 */
} plant_regime;

/* exp(A length) and its derivatives: [width][width], then one such for each slope column. */
typedef struct {
    gsid_real length_s;
    gsid_real *map[REGIMES][2]; /* [HELD | LOOSE][WHOLE, HALF]; NULL: never needed */
} plant_flow;

/* A sample has two pieces: before and after the delayed command switches. */
typedef struct {
    uint32_t n_steps;
    plant_flow step;
} plant_piece;

/* The motion through a sample. */
typedef struct {
    gsid_real sample_s;
    plant_piece piece[2];
    gsid_real at_s;   /* time within the sample */
    uint32_t n_moves; /* of this sample so far */
    gsid_real *next;  /* work, as z: at the end of the step */
    gsid_real *stage; /* work, as z: in its middle, then predicted for its end */
    gsid_real *peek;  /* work, as z: at a refresh of the sensor within the step */
} plant_motion;

/* Steps of laws that may be steep. */
typedef struct {
    gsid_real stride_s;       /* length of the next step to try */
    gsid_real largest_torque; /* so far */
    uint32_t n_parts;         /* of this step so far */
    int is_given_up;          /* too steep, or too many moves in a sample */
} plant_steepness;

/* The sensor: its output, and when it is refreshed. */
typedef struct {
    const gsid_plant_item *sampler; /* NULL: refreshed always */
    const uint32_t *column;         /* of the sampler's parameters */
    gsid_real refresh_s, refresh_samples; /* time between refreshes [s], [samples]; 0: no sampler */
    gsid_real to_refresh;    /* from this sample's start to the next refresh [samples] */
    gsid_real since_start_s; /* of the refreshes so far */
    gsid_real time_s;        /* of the disturbances */
    gsid_real *held;         /* [n_columns] its output until the next refresh */
    gsid_real *y;            /* work: [n_columns] */
} plant_sensor;

/* The path of the command to the motor. */
typedef struct {
    uint32_t delay_samples; /* whole ones; the fraction is the first piece */
    uint32_t ring_columns, newest;
    uint32_t ramp; /* row of z with the command of a first-order hold, and GSID_Z_COMMAND its slope; 0: it is held */
    gsid_real *under_way; /* [GSID_PLANT_DELAY_MAX + 1][ring_columns] commands given, latest at `newest` */
    gsid_real *u;         /* work: [n_columns] */
} plant_command;

/* What a controller has measured. */
typedef struct {
    uint32_t newest;
    gsid_real *angle; /* [GSID_RATE_SAMPLES_MAX + 1][n_columns], latest at `newest` */
    gsid_real *rate;  /* [n_columns] */
} plant_controller;

/* The search for the periodic steady state. */
typedef struct {
    uint32_t n, n_max, *row; /* [n] rows that a period's start is searched in */
    gsid_real *start;        /* [n][n_columns] of the period */
    gsid_real *fallback;     /* [n][n_columns] where the last good period ended */
    gsid_real *largest_dy;   /* [n_columns] largest magnitude in a period */
    gsid_real *correction;   /* [n] of the start, the last one */
    void *lsq_mem;
} plant_shooting;

struct gsid_plant_layout {
    plant_stack stack;
    plant_linear linear;
    plant_shape shape;
    gsid_real *z; /* the state, with its derivatives */
    plant_laws laws;
    plant_regime regime;
    plant_motion motion;
    plant_steepness steep;
    plant_sensor sensor;
    plant_command command;
    plant_controller controller;
    plant_shooting shooting;
};

#endif
