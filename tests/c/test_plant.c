/* Plants sample by sample: closed forms, delays, stiff laws, and what is refused. */
#include "plant_bench.h"

#ifdef GSID_SINGLE
#define FINE 2e-5 /* rounding of a few hundred samples */
#else
#define FINE 1e-11
#endif

enum { N = 600 };
static bench b;
static gsid_real u[N], y[N];

/* ---- closed forms ---- */

/* A constant command through a delay turns a free axis by gain u t^2 / 2. */
static void free_axis_follows_the_closed_form(void **state) {
    (void)state;
    const double samples[] = {0.0, 0.25, 1.0, 1.5, 16.2, 63.99, 255.9};
    for (size_t k = 0; k < sizeof samples / sizeof samples[0]; k++) {
        for (int output_angle = 0; output_angle <= 1; output_angle++) {
            bench_clear(&b);
            b.cfg.output_angle = output_angle;
            bench_add_with(&b, "rigid_body", 2.0, 0, 0);
            bench_add_with(&b, "transport_delay", samples[k] / FS, 0, 0);
            bench_init(&b);
            for (int n = 0; n < 300; n++) {
                const double t = fmax(0.0, (n - samples[k]) / FS), out = output_angle ? t * t / 2 : t;
                assert_near((double)bench_step(&b, GSID_R(10.0)), 20.0 * out, FINE);
            }
        }
    }
}

/* ---- delay ---- */

/* y is continuous in the delay where the delayed command's switch passes a sample. */
static void delay_passes_whole_samples_smoothly(void **state) {
    (void)state;
    gsid_real before[100], after[100];
    const double whole[] = {1.0, 7.0, 64.0}, hair = sizeof(gsid_real) == 4 ? 1e-5 : 1e-9;
    bench_fill(u, N, 50);
    for (size_t k = 0; k < sizeof whole / sizeof whole[0]; k++) {
        for (int side = 0; side < 2; side++) {
            bench_clear(&b);
            bench_add_source(&b);
            bench_add_with(&b, "coulomb_friction", 5, 0, 0);
            b.item[0].value[0] = (gsid_real)((whole[k] + (side ? hair : -hair)) / FS);
            bench_init(&b);
            for (int n = 0; n < 100; n++) {
                (side ? after : before)[n] = bench_step(&b, u[n]);
            }
        }
        for (int n = 0; n < 100; n++) { /* at most gain u dt, 7.4 * 100 deg/s^2 over two hairs of a sample */
            assert_near((double)before[n], (double)after[n], 740.0 * 2.0 * hair / FS + FINE);
        }
    }
}

/* ---- stiff laws at 3 kHz ---- */

/* Jumps over the whole range, pauses and ramps. */
static gsid_real wild_command(int n) {
    const uint32_t random = (uint32_t)n * 2654435761u >> 16;
    if (n / 300 % 2 == 0) {
        return GSID_R(0.4) * (gsid_real)(n % 100);
    }
    return n % 7 == 0 ? GSID_R(0.0) : GSID_R(179.0) * ((gsid_real)random / GSID_R(32768.0) - 1);
}

static void run_wild(void) {
    gsid_real out, slopes[FREE_MAX];
    bench_free_all(&b);
    bench_init(&b);
    const int n_samples = repeats(600, 150);
    for (int n = 0; n < n_samples; n++) {
        assert_int_equal(gsid_plant_step(&b.plant, wild_command(n), &out, slopes), GSID_OK);
        assert_true(fabs((double)out) < 1e4);
    }
}

/* The gear is damped: repeated impacts without damping make the motion chaotic, and the sensitivities grow beyond any number. */
static void stiff_laws_stay_finite(void **state) {
    (void)state;
    const struct {
        const char *id;
        double value[4];
    } laws[] = {{"coulomb_friction", {200}},
                {"stribeck_friction", {200, 100, 0.01}},
                {"presliding_friction", {200, 1000}},
                {"hard_stop", {0.1, 1e6}},
                {"gear_backlash", {0.02, 1e6, 0.1, 200}},
                {"motor_cogging", {200, 3600}},
                {"viscous_friction", {1e5}},
                {"drive_quantization", {50}}};
    for (size_t k = 0; k < sizeof laws / sizeof laws[0]; k++) {
        for (int with_friction = 0; with_friction < 2; with_friction++) {
            bench_clear(&b);
            bench_add_source(&b);
            gsid_plant_item *item = bench_add(&b, laws[k].id);
            for (int i = 0; i < 4; i++) {
                item->value[i] = (gsid_real)laws[k].value[i];
            }
            if (with_friction) {
                bench_add_with(&b, "coulomb_friction", 50, 0, 0);
            }
            run_wild();
        }
    }
}

/* ---- refusals ---- */

static gsid_status try_init(void) {
    const size_t size = gsid_plant_mem_size(&b.cfg);
    const gsid_status status = gsid_plant_init(&b.plant, &b.cfg, b.memory.bytes, sizeof b.memory);
    assert_true(size > 0 || status != GSID_OK);
    return status;
}

static void start_source(void) {
    bench_clear(&b);
    bench_add_source(&b);
}

static void bad_configurations_are_refused(void **state) {
    (void)state;
    start_source();
    assert_int_equal(try_init(), GSID_OK);
    b.item[1].value[0] = (gsid_real)NAN;
    assert_int_equal(try_init(), GSID_E_NONFINITE);
    start_source();
    b.item[2].value[0] = GSID_R(-1.0);
    assert_int_equal(try_init(), GSID_E_CONFIG);
    start_source();
    bench_add(&b, "rigid_body");
    assert_int_equal(try_init(), GSID_E_CONFIG);
    bench_clear(&b);
    bench_add(&b, "viscous_friction");
    assert_int_equal(try_init(), GSID_E_CONFIG);
    start_source();
    b.item[0].value[0] = (gsid_real)(GSID_PLANT_DELAY_MAX / FS);
    assert_int_equal(try_init(), GSID_E_CONFIG);
    start_source();
    bench_add(&b, "gear_backlash");
    bench_add(&b, "gear_backlash");
    assert_int_equal(try_init(), GSID_E_CONFIG);
    start_source();
    bench_add_with(&b, "hard_stop", 1, 1e9, 0); /* too stiff for 256 steps a sample */
    b.cfg.fs_hz = GSID_R(1.0);
    assert_int_equal(try_init(), GSID_E_CONFIG);
    start_source();
    b.cfg.n_free = 2;
    b.free_parameter[0] = b.free_parameter[1] = (gsid_plant_free){1, 0};
    assert_int_equal(try_init(), GSID_E_CONFIG);
    b.free_parameter[1] = (gsid_plant_free){1, 1};
    assert_int_equal(try_init(), GSID_E_CONFIG);
    b.free_parameter[1] = (gsid_plant_free){6, 0};
    assert_int_equal(try_init(), GSID_E_CONFIG);
    start_source();
    b.cfg.item = NULL;
    assert_int_equal(try_init(), GSID_E_NULL);
    start_source();
    b.cfg.free_parameter = NULL;
    b.cfg.fs_hz = GSID_R(0.5); /* any rate that is positive */
    b.cfg.n_items = 4; /* without the mode, too fast for that */
    assert_int_equal(try_init(), GSID_OK); /* none is free */
    b.cfg.n_free = 1;
    assert_int_equal(try_init(), GSID_E_NULL);
    start_source();
    const size_t size = gsid_plant_mem_size(&b.cfg);
    assert_int_equal(gsid_plant_init(&b.plant, &b.cfg, b.memory.bytes, size - 1), GSID_E_MEMORY);
    assert_int_equal(gsid_plant_init(&b.plant, &b.cfg, b.memory.bytes + 1, size), GSID_E_MEMORY);
    assert_int_equal(gsid_plant_init(&b.plant, &b.cfg, NULL, size), GSID_E_NULL);
    assert_int_equal(gsid_plant_init(&b.plant, &b.cfg, b.memory.bytes, size), GSID_OK);
}

static void a_refused_sample_or_update_changes_nothing(void **state) {
    (void)state;
    gsid_real out = GSID_R(-7.0);
    start_source();
    bench_init(&b);
    bench_fill(u, N, 50);
    for (int n = 0; n < 100; n++) {
        y[n] = bench_step(&b, u[n]);
    }
    assert_int_equal(gsid_plant_reset(&b.plant), GSID_OK);
    for (int n = 0; n < 100; n++) {
        assert_int_equal(gsid_plant_step(&b.plant, (gsid_real)NAN, &out, NULL), GSID_E_NONFINITE);
        assert_true(out == GSID_R(-7.0));
        b.item[2].value[0] = GSID_R(-1.0);
        assert_int_equal(gsid_plant_update(&b.plant), GSID_E_CONFIG);
        b.item[2].value[0] = GSID_R(11.0);
        b.item[0].value[0] = GSID_R(1.0); /* 3000 samples */
        assert_int_equal(gsid_plant_update(&b.plant), GSID_E_CONFIG);
        b.item[0].value[0] = GSID_R(5.4e-3);
        assert_true(bench_step(&b, u[n]) == y[n]);
    }
    gsid_plant none = {0};
    assert_int_equal(gsid_plant_step(&none, 0, &out, NULL), GSID_E_STATE);
    assert_int_equal(gsid_plant_step(NULL, 0, &out, NULL), GSID_E_NULL);
    assert_int_equal(gsid_plant_step(&b.plant, 0, NULL, NULL), GSID_E_NULL);
    assert_int_equal(gsid_plant_reset(&none), GSID_E_STATE);
    assert_int_equal(gsid_plant_update(&none), GSID_E_STATE);
    assert_int_equal(gsid_plant_periodic(&none, N, u, 1, 1, y, NULL, NULL, NULL, NULL), GSID_E_STATE);
    assert_int_equal(gsid_plant_periodic(&b.plant, 0, u, 1, 1, y, NULL, NULL, NULL, NULL), GSID_E_CONFIG);
    u[5] = (gsid_real)INFINITY;
    assert_int_equal(gsid_plant_periodic(&b.plant, N, u, 1, 1, y, NULL, NULL, NULL, NULL), GSID_E_NONFINITE);
}

/* A plant that runs away is said to, and comes back to rest. */
static void overflow_is_an_answer(void **state) {
    (void)state;
    gsid_status status = GSID_OK;
    gsid_real out;
    bench_clear(&b);
    bench_add(&b, "rigid_body");
    bench_add_with(&b, "cubic_spring", -1e8, 0, 0);
    bench_init(&b);
    for (int n = 0; n < 3000 && status == GSID_OK; n++) {
        status = gsid_plant_step(&b.plant, GSID_R(179.0), &out, NULL);
    }
    assert_int_equal(status, GSID_E_NONFINITE);
    assert_true(bench_step(&b, GSID_R(1.0)) == 0);
    bench_fill(u, N, 100);
    assert_int_equal(gsid_plant_periodic(&b.plant, N, u, 5, 5, y, NULL, NULL, NULL, NULL), GSID_E_NONFINITE);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(free_axis_follows_the_closed_form),
        cmocka_unit_test(delay_passes_whole_samples_smoothly),
        cmocka_unit_test(stiff_laws_stay_finite),
        cmocka_unit_test(bad_configurations_are_refused),
        cmocka_unit_test(a_refused_sample_or_update_changes_nothing),
        cmocka_unit_test(overflow_is_an_answer),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
