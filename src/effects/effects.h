/* What every effect's file needs, and the list of them all: a new effect is a file and a line here. */
#ifndef GSID_EFFECTS_H
#define GSID_EFFECTS_H

#include "../core/real.h"
#include "gsid/catalogue.h"
#include "gsid/effect_facts.h"

#define R GSID_R

/* Bound of what has no natural one. */
#define ANY GSID_R(1e9)

#define EFFECT(id) GSID_NAME(gsid_effect_##id)
#define FACTS(id) GSID_NAME(gsid_facts_##id)

#define EFFECTS(X)                                                                                                     \
    X(position_velocity_loop)                                                                                          \
    X(transport_delay)                                                                                                 \
    X(motor_lag)                                                                                                       \
    X(drive_quantization)                                                                                              \
    X(drive_dead_zone)                                                                                                 \
    X(drive_saturation)                                                                                                \
    X(rigid_body)                                                                                                      \
    X(viscous_friction)                                                                                                \
    X(coulomb_friction)                                                                                                \
    X(stribeck_friction)                                                                                               \
    X(presliding_friction)                                                                                             \
    X(bouc_wen)                                                                                                        \
    X(quadratic_drag)                                                                                                  \
    X(cable_spring)                                                                                                    \
    X(quadratic_spring)                                                                                                \
    X(cubic_spring)                                                                                                    \
    X(mass_unbalance)                                                                                                  \
    X(motor_cogging)                                                                                                   \
    X(hard_stop)                                                                                                       \
    X(gear_backlash)                                                                                                   \
    X(torque_bias)                                                                                                     \
    X(flexible_mode)                                                                                                   \
    X(internal_dynamics)                                                                                               \
    X(sensor_lag)                                                                                                      \
    X(sensor_sample_hold)                                                                                              \
    X(periodic_disturbance)

#define DECLARE_EFFECT(id)                                                                                             \
    extern const gsid_effect EFFECT(id);                                                                               \
    extern const gsid_effect_facts FACTS(id);
EFFECTS(DECLARE_EFFECT)

#endif
