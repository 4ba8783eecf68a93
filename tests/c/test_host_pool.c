/* Averages over neighbouring lines, against sums by hand. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "gsid/host/pool.h"

static void as_few_lines_are_averaged_as_are_needed(void **state) {
    (void)state;
    assert_int_equal(gsid_pool_neighbours(40, 2, 20), 5);
    assert_int_equal(gsid_pool_neighbours(40, 3, 20), 3);
    assert_int_equal(gsid_pool_neighbours(40, 20, 20), 0);
    assert_int_equal(gsid_pool_neighbours(40, 19, 20), 1);
    assert_int_equal(gsid_pool_neighbours(40, INFINITY, 20), 0);
    assert_int_equal(gsid_pool_neighbours(40, 0, 20), 19);
    assert_int_equal(gsid_pool_neighbours(6, 2, 20), 2); /* no more than there are */
    assert_int_equal(gsid_pool_neighbours(1, 2, 20), 0);
    assert_int_equal(gsid_pool_neighbours(0, 2, 20), 0);
}

static void edges_are_reflected_or_shortened(void **state) {
    (void)state;
    const double x[4][2] = {{1, 10}, {2, 20}, {4, 40}, {8, 80}};
    const double reflected[4] = {4.0 / 3, 7.0 / 3, 14.0 / 3, 20.0 / 3}, shortened[4] = {1.5, 7.0 / 3, 14.0 / 3, 6};
    double pooled[4][2];
    assert_int_equal(gsid_pool_lines(4, 2, 1, GSID_EDGES_REFLECTED, x[0], pooled[0]), GSID_OK);
    for (int k = 0; k < 4; k++) {
        assert_true(fabs(pooled[k][0] - reflected[k]) < 1e-14 && fabs(pooled[k][1] - 10 * reflected[k]) < 1e-13);
    }
    assert_int_equal(gsid_pool_lines(4, 2, 1, GSID_EDGES_SHORTENED, x[0], pooled[0]), GSID_OK);
    for (int k = 0; k < 4; k++) {
        assert_true(fabs(pooled[k][0] - shortened[k]) < 1e-14 && fabs(pooled[k][1] - 10 * shortened[k]) < 1e-13);
    }
    assert_int_equal(gsid_pool_lines(4, 2, 0, GSID_EDGES_REFLECTED, x[0], pooled[0]), GSID_OK);
    assert_memory_equal(pooled, x, sizeof x);
}

static void what_cannot_be_is_refused(void **state) {
    (void)state;
    const double x[2] = {1, 2};
    double pooled[2] = {-7, -7};
    assert_int_equal(gsid_pool_lines(2, 1, 0, GSID_EDGES_REFLECTED, NULL, pooled), GSID_E_NULL);
    assert_int_equal(gsid_pool_lines(2, 1, 0, GSID_EDGES_REFLECTED, x, NULL), GSID_E_NULL);
    assert_int_equal(gsid_pool_lines(2, 1, 2, GSID_EDGES_REFLECTED, x, pooled), GSID_E_CONFIG);
    assert_int_equal(gsid_pool_lines(2, 1, 0, (gsid_edges)2, x, pooled), GSID_E_CONFIG);
    assert_int_equal(gsid_pool_lines(0, 1, 0, GSID_EDGES_REFLECTED, NULL, NULL), GSID_OK);
    assert_true(pooled[0] == -7);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(as_few_lines_are_averaged_as_are_needed),
        cmocka_unit_test(edges_are_reflected_or_shortened),
        cmocka_unit_test(what_cannot_be_is_refused),
    };
    return cmocka_run_group_tests_name("host pool", tests, NULL, NULL);
}
