/* The guard: its states, every reason to trip, and an axis with a delay that must never leave its range. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "gsid/guard.h"

#define INF ((gsid_real)INFINITY)
#define NOT ((gsid_real)NAN)

enum { N_RAMP = 8 };

static gsid_guard_cfg cfg_of(void) {
    const gsid_guard_cfg cfg = {.fs_hz = 1000,
                                .command_limit = 10,
                                .rate_limit = 50,
                                .angle_lo = -5,
                                .angle_hi = 20,
                                .angle_is_measured = 1,
                                .reaction_s = (gsid_real)0.01,
                                .acceleration_per_command = 100,
                                .deceleration = 500,
                                .n_ramp = N_RAMP,
                                .n_missing_max = 2};
    return cfg;
}

static const gsid_guard_sample at_rest = {0, 0};

static gsid_guard running(const gsid_guard_cfg *cfg) {
    gsid_guard guard;
    gsid_real allowed;
    assert_int_equal(gsid_guard_init(&guard, cfg), GSID_OK);
    assert_int_equal(gsid_guard_start(&guard, 0), GSID_OK);
    for (uint32_t i = 0; i <= cfg->n_ramp; i++) {
        gsid_guard_step(&guard, &at_rest, 0, 0, &allowed);
    }
    assert_int_equal(guard.state, GSID_GUARD_RUN);
    return guard;
}

static void the_excitation_passes_between_its_ramps_and_only_there(void **state) {
    (void)state;
    const gsid_guard_cfg cfg = cfg_of();
    gsid_guard guard;
    gsid_real allowed = 9;
    assert_int_equal(gsid_guard_init(&guard, &cfg), GSID_OK);
    assert_int_equal(gsid_guard_step(&guard, &at_rest, 1, 2, &allowed), GSID_OK);
    assert_true(allowed == 0 && guard.state == GSID_GUARD_OFF);

    assert_int_equal(gsid_guard_start(&guard, 0), GSID_OK);
    for (int i = 1; i <= N_RAMP; i++) {
        assert_int_equal(gsid_guard_step(&guard, &at_rest, 1, 2, &allowed), GSID_SETTLING);
        const double x = (double)i / N_RAMP; /* eighths: the cubic is exact in float too */
        assert_true((double)allowed == 2 * x * x * (3 - 2 * x));
    }
    for (int i = 0; i < 20; i++) {
        assert_int_equal(gsid_guard_step(&guard, &at_rest, 1, 2, &allowed), GSID_OK);
        assert_true(allowed == 2 && guard.state == GSID_GUARD_RUN);
    }
    assert_int_equal(gsid_guard_start(&guard, 0), GSID_E_STATE); /* it runs already */

    assert_int_equal(gsid_guard_stop(&guard), GSID_OK);
    for (int i = N_RAMP - 1; i >= 0; i--) {
        assert_int_equal(gsid_guard_step(&guard, &at_rest, 1, 2, &allowed), GSID_SETTLING);
        const double x = (double)i / N_RAMP;
        assert_true((double)allowed == 2 * x * x * (3 - 2 * x));
    }
    assert_int_equal(gsid_guard_step(&guard, &at_rest, 1, 2, &allowed), GSID_OK);
    assert_true(allowed == 0 && guard.state == GSID_GUARD_OFF);
    assert_int_equal(gsid_guard_stop(&guard), GSID_OK); /* nothing to stop */
    assert_int_equal(guard.state, GSID_GUARD_OFF);
}

static void a_stop_on_the_way_in_turns_round_where_it_is(void **state) {
    (void)state;
    const gsid_guard_cfg cfg = cfg_of();
    gsid_guard guard;
    gsid_real up[3], down[3];
    gsid_guard_init(&guard, &cfg);
    gsid_guard_start(&guard, 0);
    for (int i = 0; i < 3; i++) {
        gsid_guard_step(&guard, &at_rest, 0, 1, &up[i]);
    }
    gsid_guard_stop(&guard);
    for (int i = 0; i < 3; i++) {
        gsid_guard_step(&guard, &at_rest, 0, 1, &down[i]);
    }
    assert_true(down[0] == up[1] && down[1] == up[0] && down[2] == 0);
}

static void without_a_ramp_it_begins_and_ends_at_once(void **state) {
    (void)state;
    gsid_guard_cfg cfg = cfg_of();
    cfg.n_ramp = 0;
    gsid_guard guard;
    gsid_real allowed;
    gsid_guard_init(&guard, &cfg);
    gsid_guard_start(&guard, 0);
    assert_int_equal(gsid_guard_step(&guard, &at_rest, 0, 3, &allowed), GSID_OK);
    assert_true(allowed == 3);
    gsid_guard_stop(&guard);
    assert_int_equal(gsid_guard_step(&guard, &at_rest, 0, 3, &allowed), GSID_OK);
    assert_true(allowed == 0 && guard.state == GSID_GUARD_OFF);
}

/* One tick that must trip, and what it must say; then the trip is latched until the reset. */
static void assert_trip(const gsid_guard_cfg *cfg, const gsid_guard_sample *sample, gsid_real command,
                        gsid_real excitation, gsid_trip reason, gsid_real value) {
    gsid_guard guard = running(cfg);
    gsid_real allowed = 9;
    assert_int_equal(gsid_guard_step(&guard, sample, command, excitation, &allowed), GSID_TRIPPED);
    assert_true(allowed == 0);
    assert_int_equal(guard.reason, reason);
    assert_true(guard.value == value || fabs((double)(guard.value - value)) <= 1e-5 * fabs((double)value));
    for (int i = 0; i < 10; i++) { /* all is well again: it stays off */
        allowed = 9;
        assert_int_equal(gsid_guard_step(&guard, &at_rest, 0, 1, &allowed), GSID_TRIPPED);
        assert_true(allowed == 0 && guard.reason == reason);
    }
    gsid_guard_stop(&guard);
    assert_int_equal(gsid_guard_start(&guard, 0), GSID_E_STATE);
    assert_int_equal(guard.state, GSID_GUARD_TRIPPED);
    gsid_guard_reset(&guard);
    assert_int_equal(guard.reason, GSID_TRIP_NONE);
    assert_int_equal(gsid_guard_start(&guard, 0), GSID_OK);
}

static void every_limit_trips_in_its_tick_with_its_reason(void **state) {
    (void)state;
    const gsid_guard_cfg cfg = cfg_of();
#define TRIP(rate, angle, command, excitation, reason, value)                                                          \
    assert_trip(&cfg, &(const gsid_guard_sample){(gsid_real)(rate), (gsid_real)(angle)}, (gsid_real)(command),         \
                (gsid_real)(excitation), reason, (gsid_real)(value))
    TRIP(50.1, 0, 0, 1, GSID_TRIP_RATE, 50.1);
    TRIP(-50.1, 0, 0, 1, GSID_TRIP_RATE, -50.1);
    TRIP(0, 20.1, 0, 1, GSID_TRIP_TRAVEL, 20.1);
    TRIP(0, -5.1, 0, 1, GSID_TRIP_TRAVEL, -5.1);
    TRIP(0, 0, 7, 3.1, GSID_TRIP_COMMAND, 10.1); /* each alone would pass */
    TRIP(0, 0, -7, -3.1, GSID_TRIP_COMMAND, -10.1);
    TRIP(0, 0, 0, INFINITY, GSID_TRIP_COMMAND, INFINITY);
    /* 40 deg/s goes on for 10 ms and takes 40^2 / (2 500) to lose: 0.4 + 1.6 */
    TRIP(40, 18.1, 0, 1, GSID_TRIP_TRAVEL_AHEAD, 20.1);
    TRIP(-40, -3.1, 0, 1, GSID_TRIP_TRAVEL_AHEAD, -5.1);
#undef TRIP
    gsid_guard guard = running(&cfg);
    gsid_real allowed;
    /* just inside of all limits at once, and back again: 10 + 0.4 + 1.6 */
    assert_int_equal(gsid_guard_step(&guard, &(const gsid_guard_sample){40, 10}, 0, 5, &allowed), GSID_OK);
    assert_true(allowed == 5);
    /* 5 units in force for another 10 ms make 45 of it, 46 would be one too many after the next command of 10 */
    assert_int_equal(gsid_guard_step(&guard, &(const gsid_guard_sample){40, 10}, 5, 5, &allowed), GSID_OK);
    assert_true(fabs((double)guard.rate_ahead - 45) < 1e-4);
    assert_int_equal(gsid_guard_step(&guard, &(const gsid_guard_sample){41, 10}, 0, 0, &allowed), GSID_TRIPPED);
    assert_int_equal(guard.reason, GSID_TRIP_RATE_AHEAD);
    assert_true(fabs((double)guard.value - 51) < 1e-4);
}

static void a_limit_itself_is_allowed(void **state) {
    (void)state;
    const gsid_guard_cfg cfg = cfg_of();
    gsid_guard guard = running(&cfg);
    gsid_real allowed;
    assert_int_equal(gsid_guard_step(&guard, &(const gsid_guard_sample){0, -5}, 0, 0, &allowed), GSID_OK);
    assert_int_equal(gsid_guard_step(&guard, &(const gsid_guard_sample){0, 20}, 0, 0, &allowed), GSID_OK);
}

static void what_is_not_a_number_never_passes(void **state) {
    (void)state;
    gsid_guard_cfg cfg = cfg_of();
    const gsid_real bad[3] = {NOT, INF, -INF};
    for (int limits = 0; limits < 2; limits++) { /* and not either when no limit is watched */
        for (int i = 0; i < 3; i++) {
            assert_trip(&cfg, &(const gsid_guard_sample){bad[i], 0}, 0, 1, GSID_TRIP_SAMPLE, 0);
            assert_trip(&cfg, &(const gsid_guard_sample){0, bad[i]}, 0, 1, GSID_TRIP_SAMPLE, 0);
            gsid_guard guard = running(&cfg);
            gsid_real allowed = 9;
            assert_int_equal(gsid_guard_step(&guard, &at_rest, bad[i], 1, &allowed), GSID_TRIPPED);
            assert_true(guard.reason == GSID_TRIP_COMMAND && allowed == 0);
            guard = running(&cfg);
            assert_int_equal(gsid_guard_step(&guard, &at_rest, 1, bad[i], &allowed), GSID_TRIPPED);
            assert_true(guard.reason == GSID_TRIP_COMMAND && allowed == 0);
        }
        cfg.command_limit = cfg.rate_limit = cfg.angle_hi = cfg.deceleration = INF;
        cfg.angle_lo = -INF;
    }
    cfg.angle_is_measured = 0; /* an angle that nobody looks at may be anything */
    gsid_guard guard = running(&cfg);
    gsid_real allowed;
    const gsid_guard_sample fast = {(gsid_real)1e30, NOT};
    assert_int_equal(gsid_guard_step(&guard, &fast, 0, 1, &allowed), GSID_OK);
    assert_true(allowed == 1);
}

static void missing_samples_are_bridged_for_as_long_as_allowed(void **state) {
    (void)state;
    gsid_guard_cfg cfg = cfg_of();
    gsid_guard guard = running(&cfg);
    gsid_real allowed;
    const gsid_guard_sample moving = {10, 1};
    for (int round = 0; round < 3; round++) { /* two in a row, again and again */
        assert_int_equal(gsid_guard_step(&guard, &moving, 0, 1, &allowed), GSID_OK);
        for (int i = 1; i <= 2; i++) {
            assert_int_equal(gsid_guard_step(&guard, NULL, 0, 1, &allowed), GSID_OK);
            assert_true(fabs((double)guard.angle - (1 + 0.01 * i)) < 1e-6); /* it moves on unseen */
        }
    }
    assert_int_equal(gsid_guard_step(&guard, NULL, 0, 1, &allowed), GSID_TRIPPED);
    assert_int_equal(guard.reason, GSID_TRIP_MISSING);
    assert_true(guard.value == 3 && allowed == 0);

    cfg.n_missing_max = UINT32_MAX; /* unseen it still may not leave its range: 1.01, 1.02 .. to 20 less 0.1 less 0.1 */
    guard = running(&cfg);
    gsid_guard_step(&guard, &moving, 0, 0, &allowed);
    int n = 0;
    while (gsid_guard_step(&guard, NULL, 0, 0, &allowed) == GSID_OK) {
        n++;
    }
    assert_int_equal(guard.reason, GSID_TRIP_TRAVEL_AHEAD);
    assert_in_range(n, 1879, 1881);
}

static void the_angle_is_integrated_from_the_start_where_it_is_not_measured(void **state) {
    (void)state;
    gsid_guard_cfg cfg = cfg_of();
    cfg.angle_is_measured = 0;
    gsid_guard guard;
    gsid_real allowed;
    assert_int_equal(gsid_guard_init(&guard, &cfg), GSID_OK);
    assert_int_equal(gsid_guard_start(&guard, NOT), GSID_E_NONFINITE);
    assert_int_equal(guard.state, GSID_GUARD_OFF);
    assert_int_equal(gsid_guard_start(&guard, 3), GSID_OK);
    const gsid_guard_sample moving = {-20, 0};
    gsid_status status = GSID_OK;
    int n = 0;
    while (status >= 0 && status != GSID_TRIPPED) {
        status = gsid_guard_step(&guard, &moving, 0, 0, &allowed);
        n++;
    }
    /* 3 - 0.02 n - 0.2 - 0.4 passes -5 */
    assert_int_equal(guard.reason, GSID_TRIP_TRAVEL_AHEAD);
    assert_in_range(n, 370, 372);
}

/* A rigid axis with dry friction, driven by noise of the fastest kind its limits allow, many times over: after the trip the
 * excitation is gone, the delayed commands run out, friction stops the axis, and its range was never left. */
static void a_real_axis_never_leaves_its_range(void **state) {
    (void)state;
    enum { DELAY = 10, TICKS = 20000 };
    uint32_t random = 12345;
    int n_trips[8] = {0};
    for (int run = 0; run < 60; run++) {
        gsid_guard_cfg cfg = cfg_of();
        cfg.angle_is_measured = run % 2;
        const double inertia_gain = 100, friction = 550; /* more than the guard counts on */
        gsid_guard guard;
        gsid_guard_init(&guard, &cfg);
        gsid_guard_start(&guard, 0);
        double rate = 0, angle = 0, queue[DELAY] = {0}, drive = 0;
        for (int n = 0; n < TICKS; n++) {
            if (n % 50 == 0) { /* pieces of constant command: the worst for travel */
                random = random * 1664525u + 1013904223u;
                drive = ((double)(random >> 8) / (1 << 23) - 1) * 10;
            }
            gsid_real allowed;
            const gsid_guard_sample sample = {(gsid_real)rate, (gsid_real)angle};
            gsid_guard_step(&guard, &sample, 0, (gsid_real)drive, &allowed);
            const double torque = inertia_gain * queue[n % DELAY];
            queue[n % DELAY] = (double)allowed;
            const double slowing = fmin(friction * 1e-3, fabs(rate) + fabs(torque) * 1e-3);
            const double pushed = rate + torque * 1e-3;
            rate = fabs(pushed) <= slowing ? 0 : pushed - copysign(slowing, pushed);
            angle += rate * 1e-3;
            assert_true(angle > -5 && angle < 20);
            assert_true(fabs(rate) < 60); /* 50, and what ten delayed commands of another size can add */
        }
        n_trips[guard.reason]++;
    }
    assert_true(n_trips[GSID_TRIP_TRAVEL_AHEAD] > 20); /* the limits were put to the test */
    assert_int_equal(n_trips[GSID_TRIP_TRAVEL], 0);
}

static void every_reason_has_its_words(void **state) {
    (void)state;
#define NAMED(name, code, meaning) assert_string_equal(gsid_trip_str(name), meaning);
    GSID_TRIP_LIST(NAMED)
#undef NAMED
    assert_string_equal(gsid_trip_str((gsid_trip)99), "unknown reason");
}

static void every_refusal(void **state) {
    (void)state;
    const gsid_guard_cfg good = cfg_of();
    gsid_guard guard, untouched;
    memset(&guard, 0, sizeof guard);
    untouched = guard;
    assert_int_equal(gsid_guard_start(&guard, 0), GSID_E_STATE); /* bug: started, with limits of 0 */
#define REFUSED(field, value)                                                                                          \
    do {                                                                                                               \
        gsid_guard_cfg bad = good;                                                                                     \
        bad.field = (value);                                                                                           \
        assert_int_equal(gsid_guard_init(&guard, &bad), GSID_E_CONFIG);                                                \
    } while (0)
    REFUSED(fs_hz, 0);
    REFUSED(fs_hz, NOT);
    REFUSED(fs_hz, INF);
    REFUSED(command_limit, 0);
    REFUSED(command_limit, NOT);
    REFUSED(rate_limit, -1);
    REFUSED(rate_limit, NOT);
    REFUSED(angle_lo, 20);
    REFUSED(angle_hi, NOT);
    REFUSED(reaction_s, -1);
    REFUSED(reaction_s, INF);
    REFUSED(acceleration_per_command, NOT);
    REFUSED(deceleration, 0);
    REFUSED(deceleration, NOT);
#undef REFUSED
    gsid_real allowed = 9;
    assert_int_equal(gsid_guard_init(NULL, &good), GSID_E_NULL);
    assert_int_equal(gsid_guard_init(&guard, NULL), GSID_E_NULL);
    assert_memory_equal(&guard, &untouched, sizeof guard);
    assert_int_equal(gsid_guard_start(NULL, 0), GSID_E_NULL);
    assert_int_equal(gsid_guard_stop(NULL), GSID_E_NULL);
    assert_int_equal(gsid_guard_reset(NULL), GSID_E_NULL);
    assert_int_equal(gsid_guard_step(NULL, &at_rest, 0, 0, &allowed), GSID_E_NULL);
    assert_int_equal(gsid_guard_step(&guard, &at_rest, 0, 0, NULL), GSID_E_NULL);
    assert_true(allowed == 9);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_excitation_passes_between_its_ramps_and_only_there),
        cmocka_unit_test(a_stop_on_the_way_in_turns_round_where_it_is),
        cmocka_unit_test(without_a_ramp_it_begins_and_ends_at_once),
        cmocka_unit_test(every_limit_trips_in_its_tick_with_its_reason),
        cmocka_unit_test(a_limit_itself_is_allowed),
        cmocka_unit_test(what_is_not_a_number_never_passes),
        cmocka_unit_test(missing_samples_are_bridged_for_as_long_as_allowed),
        cmocka_unit_test(the_angle_is_integrated_from_the_start_where_it_is_not_measured),
        cmocka_unit_test(a_real_axis_never_leaves_its_range),
        cmocka_unit_test(every_reason_has_its_words),
        cmocka_unit_test(every_refusal),
    };
    return cmocka_run_group_tests_name("guard", tests, NULL, NULL);
}
