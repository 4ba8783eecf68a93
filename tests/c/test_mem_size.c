/* Sizes of memory near the most that a size can say: what does not fit is refused, never wrapped around to something small. */
#include "../../src/core/block.h"
#include "../../src/core/plant_layout.h"
#include "plant_bench.h"

/* Against numbers with room to spare, for sizes of 8 bits: all products and sums there are. */
static void sums_and_products_saturate(void **state) {
    (void)state;
    for (size_t most = 0; most < 256; most += 51) {
        for (size_t a = 0; a <= most; a++) {
            for (size_t b = 0; b <= most; b++) {
                assert_int_equal(gsid_size_plus(a, b, most), a + b < most ? a + b : most);
                assert_int_equal(gsid_size_times(a, b, most), a * b < most ? a * b : most);
            }
        }
    }
    assert_true(gsid_size_plus(SIZE_MAX, 1, SIZE_MAX) == SIZE_MAX);
    assert_true(gsid_size_times(SIZE_MAX / 2, 3, SIZE_MAX) == SIZE_MAX);
}

static void blocks_end_where_sizes_do(void **state) {
    (void)state;
    unsigned char bytes[64];
    gsid_block b = {bytes, 0, 1000};
    assert_ptr_equal(gsid_block_take(&b, 3, 5, 1), bytes);
    assert_int_equal(b.used % GSID_ALIGN_CPLX, 0);
    assert_in_range(b.used, 15, 15 + GSID_ALIGN_CPLX - 1);
    assert_ptr_equal(gsid_block_take(&b, 0, 5, 8), bytes + b.used);
    gsid_block_take(&b, 40, 40, 1);
    assert_int_equal(b.used, b.most);
    assert_null(gsid_block_take(&b, 1, 1, 1));
    assert_int_equal(b.used, b.most);
}

/* As many laws with a memory each, and as many sensitivities: more than 4 GiB, of which 32 bits kept the rest alone. */
enum { N_ITEMS = 12000 };
static gsid_plant_item item[N_ITEMS];
static gsid_plant_free free_parameter[N_ITEMS];

static gsid_plant_cfg large_stack(uint32_t n_items) {
    const gsid_plant_cfg cfg = {
        .fs_hz = (gsid_real)FS, .n_items = n_items, .item = item, .n_free = n_items, .free_parameter = free_parameter};
    for (uint32_t i = 0; i < n_items; i++) {
        item[i].effect = gsid_catalogue_find(i == 0 ? "rigid_body" : "presliding_friction");
        for (uint32_t k = 0; k < item[i].effect->n_parameters; k++) {
            item[i].value[k] = item[i].effect->parameter[k].typical;
        }
        free_parameter[i] = (gsid_plant_free){i, 0};
    }
    return cfg;
}

static void a_plant_larger_than_a_size_is_refused(void **state) {
    (void)state;
    const gsid_plant_cfg small = large_stack(10);
    const size_t needed = gsid_plant_mem_size(&small);
    assert_true(needed > 0);
    assert_true(gsid_plant_size_within(&small, UINT32_MAX) == needed);
    assert_true(gsid_plant_size_within(&small, needed + GSID_ALIGN_CPLX) == needed);
    for (size_t most = 0; most <= needed; most += 8) {
        assert_true(gsid_plant_size_within(&small, most) == 0);
    }
    const gsid_plant_cfg large = large_stack(N_ITEMS);
    assert_true(gsid_plant_size_within(&large, UINT32_MAX) == 0);
#if SIZE_MAX > UINT32_MAX
    assert_true(gsid_plant_mem_size(&large) > UINT32_MAX);
#else
    gsid_plant plant;
    assert_true(gsid_plant_mem_size(&large) == 0);
    assert_int_equal(gsid_plant_init(&plant, &large, item, sizeof item), GSID_E_CONFIG);
#endif
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sums_and_products_saturate),
        cmocka_unit_test(blocks_end_where_sizes_do),
        cmocka_unit_test(a_plant_larger_than_a_size_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
