/* The facts of every effect: in a file of its own, so that a link with the catalogue alone leaves them out. */
#include "effects.h"

#define ADDRESS(id) &FACTS(id),

const gsid_effect_facts *const gsid_catalogue_facts[] = {EFFECTS(ADDRESS)};
