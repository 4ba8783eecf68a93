/* The linear part of a plant: see plant_linear.c. */
#ifndef GSID_PLANT_LINEAR_H
#define GSID_PLANT_LINEAR_H

#include "plant_parts.h"

#define gsid_plant_fastest GSID_NAME(gsid_plant_fastest)
#define gsid_plant_flow_build GSID_NAME(gsid_plant_flow_build)
#define gsid_plant_flow_move GSID_NAME(gsid_plant_flow_move)
#define gsid_plant_linear_build GSID_NAME(gsid_plant_linear_build)
#define gsid_plant_linear_count GSID_NAME(gsid_plant_linear_count)
#define gsid_plant_series_move GSID_NAME(gsid_plant_series_move)
#define gsid_plant_series_parts GSID_NAME(gsid_plant_series_parts)

/* Whether an entry of A, or of a slope of it, acts in a regime: a held axis does not accelerate, and within the backlash
 * the gear's spring, the only term that depends on the twist, is slack. */
static inline int gsid_plant_acts(const gsid_linear *a, int regime, gsid_linear_entry e) {
    return !((regime & HELD) && e.row == GSID_Z_RATE) && !((regime & LOOSE) && e.column == a->twist);
}

/* The regime that holds now, HELD | LOOSE. */
static inline int gsid_plant_regime(const gsid_plant_layout *l) {
    return (l->regime.sticks ? HELD : 0) | (l->regime.is_loose ? LOOSE : 0);
}

/* The largest counts that any values need: states as when every lag is a state, delays as when every lag is a delay. */
void gsid_plant_linear_count(const gsid_plant_cfg *cfg, gsid_linear *to);

/* `to` brings its lists and the columns of the free parameters. */
void gsid_plant_linear_build(const gsid_plant_cfg *cfg, gsid_linear *to);

/* Bound on the rates of A: the largest sum of a row, with angles scaled so that a spring counts with its frequency, and states
 * that follow from the command so that the gain of the body does not count. Inputs cannot make the states faster. */
gsid_real gsid_plant_fastest(const gsid_linear *a);

/* The maps of a flow that are needed, for its length. */
void gsid_plant_flow_build(gsid_plant_layout *l, plant_flow *flow);

/* to = exp(A length) z in the first n_rows of l->shape.row. */
void gsid_plant_flow_move(const gsid_plant_layout *l, const gsid_real *map, uint32_t n_rows, const gsid_real *z,
                          gsid_real *to);

/* Number of parts of a length over which a series is summed. */
uint32_t gsid_plant_series_parts(const gsid_plant_layout *l, gsid_real length_s);

/* As gsid_plant_flow_move, for a length without a map: an event cuts a step anywhere. */
void gsid_plant_series_move(const gsid_plant_layout *l, gsid_real length_s, uint32_t n_rows, const gsid_real *z,
                            gsid_real *to);

#endif
