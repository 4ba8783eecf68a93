/* Values that change under a plant: what is taken over, and that a refusal leaves nothing behind. */
#include "plant_bench.h"

enum { N_BEFORE = 100, N = N_BEFORE + 1000 };
static bench b;
static gsid_real twin[N];

static gsid_real command_at(uint32_t n) {
    return (gsid_real)bench_command(600, n % 600, 40);
}

static gsid_real step(uint32_t n) {
    gsid_real out;
    assert_int_equal(gsid_plant_step(&b.plant, command_at(n), &out, NULL), GSID_OK);
    return out;
}

/* An axis with the effect besides.  @return the item of the effect */
static gsid_plant_item *start_with(const gsid_effect *effect) {
    gsid_plant_item *item = NULL;
    bench_clear(&b);
    bench_add_with(&b, "viscous_friction", 11, 0, 0);
    if (effect != gsid_catalogue_find("rigid_body")) {
        bench_add_with(&b, "rigid_body", 7.4, 0, 0);
    }
    item = bench_add(&b, effect->id);
    bench_init(&b);
    return item;
}

static int is_refused(const gsid_effect_parameter *p, gsid_real value) {
    return !(value == p->null_value || (value >= p->lower && value <= p->upper));
}

/* Outputs are those of a plant that was never updated, to the bit. */
static void assert_refused_without_trace(const gsid_effect *effect, uint32_t parameter, gsid_real bad) {
    gsid_plant_item *item = start_with(effect);
    for (uint32_t n = 0; n < N_BEFORE; n++) {
        assert_true(step(n) == twin[n]);
    }
    item->value[parameter] = bad;
    assert_true(gsid_plant_update(&b.plant) < 0);
    for (uint32_t n = N_BEFORE; n < N; n++) {
        const gsid_real now = step(n);
        if (!(now == twin[n])) {
            fail_msg("%s.%s = %g: sample %u is %.9g, was %.9g", effect->id, effect->parameter[parameter].name,
                     (double)bad, n, (double)now, (double)twin[n]);
        }
    }
}

/* The laws read the caller's values: a level of -50 was refused and moved y all the same. */
static void a_refused_update_leaves_the_next_1000_outputs_as_they_were(void **state) {
    (void)state;
    for (uint32_t e = 0; e < gsid_n_catalogue; e++) {
        const gsid_effect *effect = gsid_catalogue[e];
        start_with(effect);
        for (uint32_t n = 0; n < N; n++) {
            twin[n] = step(n);
        }
        for (uint32_t k = 0; k < effect->n_parameters; k++) {
            const gsid_effect_parameter *p = &effect->parameter[k];
            const gsid_real bad[] = {p->lower - 1 - 2 * (gsid_real)fabs((double)p->lower),
                                     p->upper + 1 + (gsid_real)fabs((double)p->upper),
                                     p->lower - GSID_R(50.0),
                                     (gsid_real)NAN,
                                     (gsid_real)INFINITY,
                                     -(gsid_real)INFINITY};
            for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i += (size_t)repeats(1, 3)) {
                if (is_refused(p, bad[i])) {
                    assert_refused_without_trace(effect, k, bad[i]);
                }
            }
        }
    }
}

/* Values count from the next update on, not from the moment they are written. */
static void values_count_from_the_update_on(void **state) {
    (void)state;
    const gsid_effect *coulomb = gsid_catalogue_find("coulomb_friction");
    start_with(coulomb);
    for (uint32_t n = 0; n < N; n++) {
        twin[n] = step(n);
    }
    gsid_plant_item *item = start_with(coulomb);
    item->value[0] = GSID_R(60.0);
    for (uint32_t n = 0; n < N_BEFORE; n++) {
        assert_true(step(n) == twin[n]);
    }
    assert_int_equal(gsid_plant_update(&b.plant), GSID_OK);
    double moved = 0;
    for (uint32_t n = N_BEFORE; n < N; n++) {
        moved = fmax(moved, fabs((double)(step(n) - twin[n])));
    }
    assert_true(moved > 0.1);
}

/* The memory was laid out for the effects of the start. */
static void another_effect_is_refused(void **state) {
    (void)state;
    gsid_plant_item *item = start_with(gsid_catalogue_find("coulomb_friction"));
    item->effect = gsid_catalogue_find("torque_bias");
    assert_int_equal(gsid_plant_update(&b.plant), GSID_E_CONFIG);
    item->effect = gsid_catalogue_find("coulomb_friction");
    assert_int_equal(gsid_plant_update(&b.plant), GSID_OK);
}

/* Lags of 0 count as delays, and all of them move the output alike. Their list had room for the one delay that is always one: the
 * others fell into the list of columns, and from the next update on the delay had no sensitivity. */
static void lags_that_become_delays_find_room(void **state) {
    (void)state;
    gsid_real out, dy[FREE_MAX], largest = 0;
    bench_clear(&b);
    bench_add_source(&b);
    b.item[5].value[0] = 0;
    bench_add_with(&b, "motor_lag", 0, 0, 0);
    b.cfg.n_free = 3;
    b.free_parameter[0] = (gsid_plant_free){0, 0};
    b.free_parameter[1] = (gsid_plant_free){5, 0};
    b.free_parameter[2] = (gsid_plant_free){6, 0};
    bench_init(&b);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(gsid_plant_update(&b.plant), GSID_OK);
    }
    for (uint32_t n = 0; n < N; n++) {
        assert_int_equal(gsid_plant_step(&b.plant, command_at(n), &out, dy), GSID_OK);
        assert_true(dy[0] == dy[1] && dy[0] == dy[2]);
        largest = dy[0] > largest ? dy[0] : largest;
    }
    assert_true(largest > 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_refused_update_leaves_the_next_1000_outputs_as_they_were),
        cmocka_unit_test(values_count_from_the_update_on),
        cmocka_unit_test(another_effect_is_refused),
        cmocka_unit_test(lags_that_become_delays_find_room),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
