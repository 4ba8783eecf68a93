/* Blocks allocated one after the other from a caller's memory. Sizes do not wrap: they saturate at `most`, which is SIZE_MAX
 * except in tests. */
#ifndef GSID_BLOCK_H
#define GSID_BLOCK_H

#include "real.h"

static inline size_t gsid_size_plus(size_t a, size_t b, size_t most) {
    return a > most || b > most - a ? most : a + b;
}

static inline size_t gsid_size_times(size_t a, size_t b, size_t most) {
    return b > 0 && a > most / b ? most : a * b;
}

/* With a NULL base the bytes are only counted. used == most: the total is more than a size can hold. */
typedef struct {
    unsigned char *base;
    size_t used, most;
} gsid_block;

/* Allocate n_rows times n_columns objects of this size, suitably aligned. Returns NULL while they are only counted. */
static inline void *gsid_block_take(gsid_block *b, size_t n_rows, size_t n_columns, size_t size) {
    const size_t most = b->most, unit = GSID_ALIGN_CPLX;
    const size_t bytes = gsid_size_times(gsid_size_times(n_rows, n_columns, most), size, most);
    const size_t padded = gsid_size_plus(bytes, unit - 1, most) / unit * unit;
    void *const at = b->base == NULL || b->used == most ? NULL : b->base + b->used;
    b->used = bytes == most ? most : gsid_size_plus(b->used, padded, most);
    return at;
}

#define gsid_block_of(type, b, n_rows, n_columns) ((type *)gsid_block_take(b, n_rows, n_columns, sizeof(type)))

#endif
