#include "gsid/types.h"

#include "real.h"

#define MEANING_CASE(name, code, meaning, hint)                                                                        \
    case name:                                                                                                         \
        return meaning;
#define HINT_CASE(name, code, meaning, hint)                                                                           \
    case name:                                                                                                         \
        return hint;

const char *gsid_status_str(gsid_status status) {
    switch (status) {
        GSID_STATUS_LIST(MEANING_CASE)
    case GSID_STATUS_END_:
    default:
        return "unknown status";
    }
}

const char *gsid_status_hint(gsid_status status) {
    switch (status) {
        GSID_STATUS_LIST(HINT_CASE)
    case GSID_STATUS_END_:
    default:
        return "";
    }
}

/* Volatile, so that the compiler cannot evaluate the check in advance. */
gsid_status gsid_check_build(void) {
    const volatile gsid_real nan = (gsid_real)NAN;
    return gsid_is_finite(nan) ? GSID_E_BUILD : GSID_OK;
}
