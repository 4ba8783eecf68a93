/* What a sample of a plant takes at most, whatever its values. */
#include "../../src/core/plant_parts.h"
#include "plant_bench.h"

enum { N = 300, PARTS_MOST = 8001 };
static bench b;

static gsid_real wild(uint32_t n) {
    return n % 7 == 0 ? 0 : 179 * (gsid_real)noise_at(n);
}

/* Moves of the costliest sample, among those that were followed and those that were given up. */
typedef struct {
    uint32_t followed, given_up, n_given_up;
} cost;

static cost run(uint32_t n_samples) {
    cost c = {0, 0, 0};
    bench_init(&b);
    for (uint32_t n = 0; n < n_samples; n++) {
        const gsid_plant_layout *l = b.plant.layout;
        gsid_real y = 7;
        const gsid_status status = gsid_plant_step(&b.plant, wild(n), &y, NULL);
        uint32_t *most = status == GSID_OK ? &c.followed : &c.given_up;
        *most = l->motion.n_moves > *most ? l->motion.n_moves : *most;
        if (status == GSID_OK) {
            continue;
        }
        assert_int_equal(status, GSID_E_STEEP);
        assert_true(y == 7);
        c.n_given_up++;
        for (uint32_t row = GSID_Z_STATES; row < l->linear.a.n; row++) {
            assert_true(l->z[row * l->shape.n_columns] == 0); /* at rest */
        }
    }
    return c;
}

/* A mode of 1 MHz behind a sensor that is refreshed as often, and a stop: a sample took 2 600 000 moves, seconds of time. */
static void a_sample_is_given_up_after_a_stated_number_of_moves(void **state) {
    (void)state;
    bench_clear(&b);
    bench_add(&b, "rigid_body");
    bench_add_with(&b, "hard_stop", 1e-6, 1e5, 0);
    bench_add_with(&b, "sensor_sample_hold", 1e6, 0, 0);
    bench_add_with(&b, "flexible_mode", 1e6, 1e-3, 1e-4);
    const uint32_t n = (uint32_t)repeats(3, 1);
    const cost c = run(n);
    assert_int_equal(c.n_given_up, n);
    assert_in_range(c.given_up, GSID_PLANT_MOVES_MAX, GSID_PLANT_MOVES_MAX + 3 * PARTS_MOST);
    assert_true(c.followed <= GSID_PLANT_MOVES_MAX);
}

static void the_periodic_answer_ends_too(void **state) {
    (void)state;
    static gsid_real u[N], y[N];
    for (uint32_t n = 0; n < N; n++) {
        u[n] = wild(n);
    }
    bench_init(&b);
    assert_int_equal(gsid_plant_periodic(&b.plant, N, u, 1, 3, y, NULL, NULL, NULL, NULL), GSID_E_STEEP);
}

/* Typical values stay far below. */
static void ordinary_samples_take_few_moves(void **state) {
    (void)state;
    for (uint32_t i = 0; i < gsid_n_catalogue; i++) {
        bench_clear(&b);
        bench_add_source(&b);
        if (gsid_catalogue[i]->null_kind != GSID_NULL_NEVER) {
            bench_add(&b, gsid_catalogue[i]->id);
        }
        const cost c = run(N);
        assert_int_equal(c.n_given_up, 0);
        assert_in_range(c.followed, 1, GSID_PLANT_MOVES_MAX / 100);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_sample_is_given_up_after_a_stated_number_of_moves),
        cmocka_unit_test(the_periodic_answer_ends_too),
        cmocka_unit_test(ordinary_samples_take_few_moves),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
