/* Blocks taken one after the other out of a caller's memory, with sizes that do not wrap: they saturate at the most that a size
 * may be, SIZE_MAX but in tests. */
#ifndef GSID_BLOCK_H
#define GSID_BLOCK_H

#include "real.h"

static inline size_t gsid_size_plus(size_t a, size_t b, size_t most) {
    return a > most || b > most - a ? most : a + b;
}

static inline size_t gsid_size_times(size_t a, size_t b, size_t most) {
    return b > 0 && a > most / b ? most : a * b;
}

/* Without a base it only counts. used == most: more is needed than a size can hold. */
typedef struct {
    unsigned char *base;
    size_t used, most;
} gsid_block;

/* n_rows times n_columns objects of this size, aligned for what they are; NULL while they are counted. */
static inline void *gsid_block_take(gsid_block *b, size_t n_rows, size_t n_columns, size_t size) {
    const size_t most = b->most, unit = GSID_ALIGN_CPLX;
    const size_t bytes = gsid_size_times(gsid_size_times(n_rows, n_columns, most), size, most);
    const size_t padded = gsid_size_plus(bytes, unit - 1, most) / unit * unit;
    void *const at = b->base == NULL || b->used == most ? NULL : b->base + b->used;
    b->used = bytes == most ? most : gsid_size_plus(b->used, padded, most);
    return at;
}

#endif
