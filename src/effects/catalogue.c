#include "effects.h"

#define ADDRESS(id) &EFFECT(id),

const gsid_effect *const gsid_catalogue[] = {EFFECTS(ADDRESS)};
const uint32_t gsid_n_catalogue = sizeof gsid_catalogue / sizeof gsid_catalogue[0];

static int is_same(const char *a, const char *b) {
    while (*a != '\0' && *a == *b) {
        a++;
        b++;
    }
    return *a == *b;
}

const gsid_effect *gsid_catalogue_find(const char *id) {
    for (uint32_t i = 0; id != NULL && i < gsid_n_catalogue; i++) {
        if (is_same(id, gsid_catalogue[i]->id)) {
            return gsid_catalogue[i];
        }
    }
    return NULL;
}
