/* A plant is a stack of effects: simulated sample by sample, or in its periodic steady state, with the sensitivities of its
 * output to the requested parameters.
 *
 * The command is held over each sample, or linear between samples. It passes static maps and a delay of any length, and
 * drives a linear system that is integrated exactly; torques that are not linear by an exponential Runge-Kutta method of order 3
 * between their events. */
#ifndef GSID_PLANT_H
#define GSID_PLANT_H

#include "gsid/effect.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GSID_PLANT_DELAY_MAX 256 /* samples */
/* Moves that a sample may take: products of a matrix with the state, and parts of a series. Ordinary values take 3 to 500, a steep law
 * 2000. */
#define GSID_PLANT_MOVES_MAX 65536

/* A parameter whose sensitivity is wanted. */
typedef struct {
    uint32_t item, parameter;
} gsid_plant_free;

/* All pointers stay the caller's and must outlive the plant. The values of the items are read by gsid_plant_init and
 * gsid_plant_update only: between them the plant works with a copy. */
typedef struct {
    gsid_real fs_hz;              /* samples per second, > 0 */
    uint32_t n_items;             /* >= 1 */
    const gsid_plant_item *item;  /* [n_items] with exactly one rigid_body */
    uint32_t n_free;
    const gsid_plant_free *free_parameter; /* [n_free] */
    int output_angle;             /* 0: y is the rate, 1: y is the angle */
    gsid_real unit_rad;           /* radians in a unit of angle, for laws with an angle inside a sine; 0: a degree */
    const volatile int *stop;     /* once it is not 0, a search for the steady state ends at its next sample; NULL: never */
    uint64_t *moves_left; /* the same once it is 0: each sample takes its moves times the columns moved from it. It bounds the
                             work on any computer by the same amount; NULL: no bound */
    int first_order_hold; /* 0: a command is held over its sample; 1: from the command before, it is reached linearly at the
                             end of its sample. Not with a controller. It takes one of the GSID_Z_MAX entries of z */
} gsid_plant_cfg;

typedef struct gsid_plant_layout gsid_plant_layout;

typedef struct {
    gsid_plant_cfg cfg;
    gsid_plant_layout *layout; /* private: in the caller's memory */
} gsid_plant;

/** Bytes that gsid_plant_init needs; 0 for a configuration that it refuses, also one that needs more than a size_t can hold. */
size_t gsid_plant_mem_size(const gsid_plant_cfg *cfg);

/** Lay a plant out in the caller's memory, at rest.
 *  @param[in,out] mem  mem_size bytes, aligned for gsid_cplx
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG a value out of its bounds, too long a delay, no rigid body or two, two gears
 *          with backlash, two controllers, a controller with a first-order hold, or a law too stiff for the sample time;
 *          GSID_E_NONFINITE; GSID_E_MEMORY; GSID_E_BUILD.  Context: background. */
gsid_status gsid_plant_init(gsid_plant *plant, const gsid_plant_cfg *cfg, void *mem, size_t mem_size);

/** Take over changed values of the items. The state is kept; if the values change the number of states, the plant is reset.
 *  @return as gsid_plant_init; GSID_E_CONFIG also for another effect than at the start. After a refusal the plant is unchanged,
 *          whatever the caller's items contain.  Context: background, not concurrently with gsid_plant_step. */
gsid_status gsid_plant_update(gsid_plant *plant);

/** Come to rest, with command 0.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE */
gsid_status gsid_plant_reset(gsid_plant *plant);

/** Move the axis to an angle and a rate; the other states stay. A plant with stops has several periodic orbits: from where the
 *  axis was measured, gsid_plant_periodic finds the measured one.
 *  @param[in]  angle, rate  of the axis
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE; GSID_E_NONFINITE a value is not finite: nothing changed */
gsid_status gsid_plant_place(gsid_plant *plant, gsid_real angle, gsid_real rate);

/** Advance one sample.
 *  @param[in]  u   command, or the reference when the stack has a controller
 *  @param[out] y   at the instant from which u is applied; with a first-order hold, from which the command runs to u
 *  @param[out] dy  [n_free] sensitivities of y, or NULL; give it in every step since the reset, or in none
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE; GSID_E_NONFINITE u is not finite: nothing changed; or the plant left the range
 *          of numbers: it is at rest now; GSID_E_STEEP a law is too steep to follow, or the sample takes more than
 *          GSID_PLANT_MOVES_MAX moves: at rest, too
 *  Cost: a linear stack takes two products of a matrix with the state a sample, always the same. Laws that are not linear
 *  take three for each step of 0.025 rad of the stiffest law, at least one step on each side of the command's switch. A step
 *  with an event (reversal, break-away, impact) takes at most 16 searches of at most 50 series. Laws that may be steep
 *  cut a step into at most 256 parts, each found by at most 20 halvings. A sample that has taken GSID_PLANT_MOVES_MAX moves is
 *  given up after the next three motions, of at most 8001 moves each. Measured by benchmarks/bench_plant.py.
 *  Limits: rounding for linear stacks and Coulomb friction; 3e-5 of the peak for the other laws (tests/c/test_effects.c).
 *  The float build stays within 1e-3 of the peak, except for periodic_disturbance, whose time is a running sum: its error is
 *  a hundredth of its amplitude after 1 s, and it is useless after 10 s (double: 4e-4 after two hours).
 *  Context: a linear stack: ISR-safe, one writer. Other laws: background; their time is bounded, but by far more than a tick has
 *  (docs/reference/budget.md). */
gsid_status gsid_plant_step(gsid_plant *plant, gsid_real u, gsid_real *y, gsid_real *dy);

/** Put the plant on the periodic orbit that it would have without its nonlinear torques: a good start for the search for the
 *  true orbit. From rest, a plant with stops or backlash can reach another orbit, which is periodic too. In closed loop
 *  behind a delay the start is near that orbit, not on it: the delayed commands are those of a period begun at rest.
 *  @param[in]  u         [n_period] one period, as of gsid_plant_periodic
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE; GSID_E_CONFIG n_period is 0; GSID_E_NONFINITE u is not finite: nothing changed;
 *          or the plant left the range of numbers, or GSID_E_STOPPED: it is at rest now.
 *  Cost: one period, with a column for each state.  Context: background. */
gsid_status gsid_plant_start_linear(gsid_plant *plant, uint32_t n_period, const gsid_real *u);

/** Find the periodic steady state by shooting: Newton's method on the state at the period's start, from the state the plant
 *  is in. A state that no equation determines (the angle of an axis without a spring) stays where it is. Such an axis may
 *  turn by a constant angle in each period: y as its angle is then given without this turn, as y[n] - n / n_period turn.
 *  Effects that are not locked to the excitation (periodic_disturbance) are left out. A sensor's refresh starts at the
 *  period's first sample: rate_hz n_period / fs_hz should be whole.
 *  @param[in]  u         [n_period] one period; with a first-order hold the command at each sample, not at its end
 *  @param[in]  n_settle_periods  simulated first
 *  @param[in]  n_newton  at most so many corrections of the values, and again of values and sensitivities
 *  @param[out] y         [n_period] without a turn
 *  @param[out] dy        [n_free][n_period] sensitivities of the periodic answer, the moving initial state included; or NULL
 *  @param[out] angle     [n_period] of the axis, with its turn; or NULL
 *  @param[out] rate      [n_period] of the axis; or NULL
 *  @param[out] residual  bound on how much y changes in one more period (to first order), in units of y; or NULL
 *  @return GSID_OK; GSID_MAX_ITER the residual is above rounding: judge it; GSID_E_NULL; GSID_E_STATE; GSID_E_CONFIG n_period
 *          is 0; GSID_E_NONFINITE u is not finite, or the plant left the range of numbers, or GSID_E_STEEP a law is too
 *          steep to follow, or GSID_E_STOPPED: it is at rest now, the outputs hold what was found until then.
 *  Cost: n_settle_periods with one column; with dy, where a law is not constant between events and no loop is closed, n_newton
 *  + 2 periods at most, mostly 1 to 3, with columns for each state; then n_newton + 2 at most, mostly 2, with columns for the
 *  free parameters too. A drift that no start removes is given up after two of each.  Context: background. */
gsid_status gsid_plant_periodic(gsid_plant *plant, uint32_t n_period, const gsid_real *u, uint32_t n_settle_periods,
                                uint32_t n_newton, gsid_real *y, gsid_real *dy, gsid_real *angle, gsid_real *rate,
                                gsid_real *residual);

#ifdef __cplusplus
}
#endif

#endif
