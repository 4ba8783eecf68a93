/* A plant's memory. Shared by plant*.c only. */
#ifndef GSID_PLANT_PRIVATE_H
#define GSID_PLANT_PRIVATE_H

#include "gsid/plant.h"
#include "real.h"

/* Columns of z: the value, then its derivatives by the free parameters, then by the state at the start of a period. */
enum { VALUE = 0, FIRST_FREE = 1 };

/* A channel is a place where laws act, with the torque over a step a parabola in time: three more entries of z. */
enum { AXIS = 0, JOINT = 1, CHANNELS_MAX = 2, FORCING = 3 };

enum { WHOLE = 0, HALF = 1 };
/* Which linear motion holds between events: the axis held by friction, the joint within its play. */
enum { HELD = 1, LOOSE = 2, REGIMES = 4 };

#define NONE UINT32_MAX

/* A torque that is not linear. */
typedef struct {
    const gsid_plant_item *item;
    const uint32_t *column; /* [GSID_EFFECT_PARAMETERS_MAX] of the sensitivities, 0: not free */
    uint32_t channel;
    uint32_t memory; /* row of z, NONE */
    int zone;        /* state: see gsid_motion */
} plant_law;

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

struct gsid_plant_layout {
    /* What the stack is. */
    gsid_linear linear, draft;   /* draft: the next values', until they are found good */
    gsid_plant_item *item;       /* [n_items] copies, made when the values were last found good */
    uint32_t *column;            /* [n_items][GSID_EFFECT_PARAMETERS_MAX] of the sensitivities, 0: not free */
    uint32_t n_laws, n_channels, n_memories;
    plant_law *law;              /* [n_laws] */
    int holds, has_side;         /* a law can hold the axis at rest; depends on the direction of motion */
    int looks_at_angle, has_controller, is_constant; /* is_constant: every law between events */
    int may_be_steep, looks_at_command; /* a law */
    gsid_real unit_rad;
    const gsid_plant_item *sampler; /* NULL: the sensor is always fresh */
    const uint32_t *sampler_column;

    /* What its values make of it. */
    gsid_real fastest;           /* bound on the rates of A [1/s] */
    uint32_t delay_samples;      /* whole ones; the fraction is the first piece */
    plant_piece piece[2];
    gsid_real sample_s, refresh_s, refresh; /* time between refreshes [s], [samples]; 0: no sampler */
    uint32_t n_slope_columns, *slope_column; /* columns with a derivative of A */

    /* Shape of z: [n_rows][n_columns]. */
    uint32_t width;              /* rows that flow: linear.n, then the channels' forcing */
    uint32_t n_rows;             /* rows in memory; the last are the laws' memories */
    uint32_t n_columns, n_active; /* in memory; in use */
    uint32_t n_free;             /* columns of free parameters in use: all or none */
    uint32_t n_look, *row;       /* rows of the states; the first n_look are those that laws look at */
    uint32_t n_shoot, n_shoot_max, *shoot_row; /* rows that a period's start is searched in */

    /* State. */
    gsid_real *z;
    int sticks, is_loose;        /* held by friction; within the joint's play */
    gsid_real side;
    gsid_real *under_way;        /* [GSID_PLANT_DELAY_MAX + 1][ring_columns] commands given, latest at `newest` */
    uint32_t ring_columns, newest;
    gsid_real *angle_seen;       /* [GSID_RATE_SAMPLES_MAX + 1][n_columns] by a controller */
    uint32_t angle_newest;       /* row of the latest */
    gsid_real *rate_seen;        /* [n_columns] by a controller */
    gsid_real *held;             /* [n_columns] what the sensor shows until it is refreshed */
    gsid_real to_refresh;        /* from this sample's start to the next refresh [samples] */
    gsid_real since_start_s;     /* of the refreshes so far */
    gsid_real at_s;              /* time within the sample */
    gsid_real time_s;            /* of the disturbances */
    gsid_real stride_s;          /* length that the next step of steep laws is tried with */
    gsid_real largest_torque;    /* of steep laws so far */
    uint32_t n_parts;            /* of this step so far */
    uint32_t n_moves;            /* of this sample so far */
    int is_too_steep;

    /* Work space. */
    gsid_real *next, *stage, *peek, *term[3]; /* as z */
    gsid_real *torque[3];        /* [CHANNELS_MAX][n_columns] */
    gsid_real *square;           /* [2][1 + n_free][width][width] */
    gsid_real *command, *y;      /* [n_columns] */
    gsid_real *start, *fallback, *largest_dy, *correction; /* [n_shoot][n_columns] twice, [n_columns], [n_shoot] */
    void *lsq_mem;
};

/* Whether an entry of A, or of a slope of it, acts in a regime: a held axis does not accelerate, and within the play the
 * joint's spring, which is all that looks at the twist, is slack. */
static inline int acts(const gsid_linear *a, int regime, gsid_linear_entry e) {
    return !((regime & HELD) && e.row == GSID_Z_RATE) && !((regime & LOOSE) && e.column == a->twist);
}

static inline int gsid_plant_regime(const gsid_plant_layout *l) {
    return (l->sticks ? HELD : 0) | (l->is_loose ? LOOSE : 0);
}

/* plant_linear.c */
#define gsid_plant_choose_regime GSID_NAME(gsid_plant_choose_regime)
#define gsid_plant_choose_zones GSID_NAME(gsid_plant_choose_zones)
#define gsid_plant_clear_ring GSID_NAME(gsid_plant_clear_ring)
#define gsid_plant_derivative GSID_NAME(gsid_plant_derivative)
#define gsid_plant_fastest GSID_NAME(gsid_plant_fastest)
#define gsid_plant_flow_build GSID_NAME(gsid_plant_flow_build)
#define gsid_plant_flow_move GSID_NAME(gsid_plant_flow_move)
#define gsid_plant_give GSID_NAME(gsid_plant_give)
#define gsid_plant_health GSID_NAME(gsid_plant_health)
#define gsid_plant_linear_build GSID_NAME(gsid_plant_linear_build)
#define gsid_plant_linear_count GSID_NAME(gsid_plant_linear_count)
#define gsid_plant_output GSID_NAME(gsid_plant_output)
#define gsid_plant_refresh GSID_NAME(gsid_plant_refresh)
#define gsid_plant_run_piece GSID_NAME(gsid_plant_run_piece)
#define gsid_plant_sample GSID_NAME(gsid_plant_sample)
#define gsid_plant_series_parts GSID_NAME(gsid_plant_series_parts)
#define gsid_plant_series_move GSID_NAME(gsid_plant_series_move)
#define gsid_plant_size_within GSID_NAME(gsid_plant_size_within)
#define gsid_plant_start_refresh GSID_NAME(gsid_plant_start_refresh)
#define gsid_plant_take_command GSID_NAME(gsid_plant_take_command)

void gsid_plant_linear_count(const gsid_plant_cfg *cfg, gsid_linear *to);
void gsid_plant_linear_build(const gsid_plant_cfg *cfg, gsid_linear *to);
gsid_real gsid_plant_fastest(const gsid_linear *a);
void gsid_plant_flow_build(gsid_plant_layout *l, plant_flow *flow);
void gsid_plant_flow_move(const gsid_plant_layout *l, const gsid_real *map, uint32_t n_rows, const gsid_real *z,
                          gsid_real *to);
uint32_t gsid_plant_series_parts(const gsid_plant_layout *l, gsid_real length_s);
void gsid_plant_series_move(const gsid_plant_layout *l, gsid_real length_s, uint32_t n_rows, const gsid_real *z,
                            gsid_real *to);

/* plant_motion.c */
void gsid_plant_derivative(const gsid_plant_layout *l, const gsid_real *z, gsid_real *rates);
void gsid_plant_choose_regime(gsid_plant_layout *l);
void gsid_plant_choose_zones(gsid_plant_layout *l);
void gsid_plant_run_piece(gsid_plant_layout *l, const plant_piece *piece);

/* plant.c */
size_t gsid_plant_size_within(const gsid_plant_cfg *cfg, size_t most);
void gsid_plant_output(const gsid_plant_layout *l, gsid_real *y);
void gsid_plant_give(gsid_plant *plant, gsid_real u);
void gsid_plant_take_command(gsid_plant_layout *l);
void gsid_plant_clear_ring(gsid_plant_layout *l, uint32_t first_column);
void gsid_plant_sample(gsid_plant *plant, gsid_real u);
void gsid_plant_refresh(gsid_plant_layout *l, const gsid_real *z);
void gsid_plant_start_refresh(gsid_plant_layout *l);
gsid_status gsid_plant_health(const gsid_plant_layout *l);

#endif
