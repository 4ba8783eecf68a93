#include "effects.h"

enum { STIFFNESS = 0, UNLOADING = 1, LOADING = 2 };

/* Series instead of differences that cancel. */
#define SMALL GSID_R(0.01)
/* Largest growth of a loading branch with a rate below 0: what grows more overflows in single precision. */
#define GROWTH_MAX GSID_R(40.0)

/* z along the motion as a function of the path since the memory was updated, and its derivatives. */
typedef struct {
    gsid_real z, by_path, by_start, by_unloading, by_loading;
} branch;

static gsid_real limited(gsid_real x) {
    return x < -GROWTH_MAX ? -GROWTH_MAX : x;
}

/* Derivative of the mean (1 - exp(-x)) / x of the fade exp(-x), from both. */
static gsid_real mean_fade_slope(gsid_real x, gsid_real fade, gsid_real mean) {
    if (gsid_fabs(x) < SMALL) {
        return GSID_R(-0.5) + x * (GSID_R(1.0) / 3 - x * (GSID_R(0.125) - x / 30));
    }
    return (fade - mean) / x;
}

/* log(1 + x), exact for small x (W. Kahan). */
static gsid_real log_of_one_and(gsid_real x) {
    const gsid_real sum = 1 + x;
    return sum == 1 ? x : gsid_log(sum) * x / (sum - 1);
}

/* One rate: dz/dpath = 1 - rate z. */
static branch one_rate(gsid_real start, gsid_real path, gsid_real rate, gsid_real *by_rate) {
    const gsid_real x = limited(rate * path), faded = -gsid_expm1(-x);
    const gsid_real fade = 1 - faded, mean = x == 0 ? 1 : faded / x;
    branch b = {0};
    b.z = start * fade + path * mean;
    b.by_path = 1 - rate * b.z;
    b.by_start = fade;
    *by_rate = path * (path * mean_fade_slope(x, fade, mean) - start * fade);
    return b;
}

/* From a start below 0 the unloading ends at 0, after the path log(1 - rate start) / rate. */
static branch follow(gsid_real start, gsid_real path, gsid_real unloading, gsid_real loading) {
    branch b = {0};
    gsid_real by_rate;
    if (start >= 0) {
        b = one_rate(start, path, loading, &by_rate);
        b.by_loading = by_rate;
        return b;
    }
    const gsid_real x = -unloading * start, to_zero = log_of_one_and(x) / unloading;
    if (path <= to_zero) {
        b = one_rate(start, path, unloading, &by_rate);
        b.by_unloading = by_rate;
        return b;
    }
    b = one_rate(0, path - to_zero, loading, &by_rate);
    b.by_loading = by_rate;
    b.by_start = b.by_path / (1 + x);
    const gsid_real shift = x < SMALL ? start * start * (GSID_R(-0.5) + x * (GSID_R(2.0) / 3 - x * GSID_R(0.75)))
                                      : (-start / (1 + x) - to_zero) / unloading; /* of to_zero by the rate */
    b.by_unloading = -b.by_path * shift;
    return b;
}

/* Like Dahl's law it does not know time: dz/dangle = 1 - rate side z while the axis turns one way. */
static void torque(const gsid_plant_item *item, const gsid_motion *motion, gsid_torque *answer) {
    const gsid_real stiffness = item->value[STIFFNESS], side = motion->side;
    const branch b = follow(side * motion->memory, side * motion->turned, item->value[UNLOADING], item->value[LOADING]);
    answer->memory = side * b.z;
    answer->memory_by_turned = b.by_path;
    answer->memory_by_memory = b.by_start;
    answer->memory_by_value[UNLOADING] = side * b.by_unloading;
    answer->memory_by_value[LOADING] = side * b.by_loading;
    answer->torque = stiffness * answer->memory;
    answer->by_turned = stiffness * b.by_path;
    answer->by_memory = stiffness * b.by_start;
    answer->by_value[STIFFNESS] = answer->memory;
    answer->by_value[UNLOADING] = stiffness * answer->memory_by_value[UNLOADING];
    answer->by_value[LOADING] = stiffness * answer->memory_by_value[LOADING];
}

const gsid_effect EFFECT(bouc_wen) = {
    .id = "bouc_wen",
    .sentence = "Hysteresis with its own rate while it is unloaded and while it is loaded (Bouc-Wen, exponent 1).",
    .confused_with = "presliding_friction,coulomb_friction,cable_spring",
    .stage = GSID_STAGE_TORQUE,
    .null_kind = GSID_NULL_ONE_SIDED,
    .n_parameters = 3,
    .parameter = {{"stiffness", "1/s^2", R(750.0), R(0.0), ANY, R(0.0)},
                  {"unloading", "1/deg", R(50.0), R(1e-3), ANY, NAN},
                  {"loading", "1/deg", R(20.0), -ANY, ANY, NAN}},
    .has_memory = 1,
    .torque = torque,
};

static const gsid_real LOADINGS[] = {R(-2.0), R(-1.0), R(-0.5), R(-0.2), R(0.0), R(0.5), R(2.0), R(8.0), R(30.0)};

const gsid_effect_facts FACTS(bouc_wen) = {
    .effect = &EFFECT(bouc_wen),
    .law = "stiffness z, dz/dt = w - r |w| z, r = unloading while z and w have opposite signs, else loading",
    .simpler = "presliding_friction",
    .parameter = {{0},
                  {.grid = {GSID_SPACING_INVERSE, GSID_SHARE_OF_TRAVEL, R(0.02), R(2.0), 0, 5, NULL,
                            "within a fiftieth of the travel it is coulomb_friction, over twice the travel a spring"}},
                  {.grid = {GSID_SPACING_PER, GSID_SHARE_OF_TRAVEL, 0, 0, 0, 9, LOADINGS,
                            "below -2 over the travel the torque grows sevenfold on its way; above 30 it is "
                            "coulomb_friction"}}},
};
