/* Status codes: the list, its texts, and its signs. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "gsid/types.h"

#define CODE(name, code, meaning, hint) name,
static const gsid_status every_status[] = {GSID_STATUS_LIST(CODE)};
#define N_STATUS (sizeof every_status / sizeof every_status[0])

static void each_status_has_a_sentence_of_its_own(void **state) {
    (void)state;
    for (size_t i = 0; i < N_STATUS; i++) {
        const char *meaning = gsid_status_str(every_status[i]);
        assert_true(strlen(meaning) > 3);
        assert_string_not_equal(meaning, "unknown status");
        assert_non_null(gsid_status_hint(every_status[i]));
        for (size_t j = 0; j < i; j++) {
            assert_string_not_equal(meaning, gsid_status_str(every_status[j]));
            assert_int_not_equal(every_status[i], every_status[j]);
        }
    }
    assert_string_equal(gsid_status_str(GSID_E_NULL), "a required pointer is NULL");
    assert_string_equal(gsid_status_hint(GSID_E_STATE),
                        "call its _init first; the header lists what else the call needs");
}

static void failures_are_negative(void **state) {
    (void)state;
#define SIGN(name, code, meaning, hint) assert_int_equal(strncmp(#name, "GSID_E_", 7) == 0, (name) < 0);
    GSID_STATUS_LIST(SIGN)
    assert_int_equal(GSID_OK, 0);
}

static void values_off_the_list_are_unknown(void **state) {
    (void)state;
    const int off[] = {-100, 100, GSID_STATUS_END_};
    for (size_t i = 0; i < sizeof off / sizeof off[0]; i++) {
        assert_string_equal(gsid_status_str((gsid_status)off[i]), "unknown status");
        assert_string_equal(gsid_status_hint((gsid_status)off[i]), "");
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_status_has_a_sentence_of_its_own),
        cmocka_unit_test(failures_are_negative),
        cmocka_unit_test(values_off_the_list_are_unknown),
    };
    return cmocka_run_group_tests_name("types", tests, NULL, NULL);
}
