/* The streaming measurement inside: the work of a tick without the checks that gsid_frf_step has made already, and what the
 * engines of gsid_frf have in common. Shared by spectrum.c, spread.c and frf*.c only. */
#ifndef GSID_STREAMING_H
#define GSID_STREAMING_H

#include "gsid/frf.h"

#define gsid_spectrum_sum GSID_NAME(gsid_spectrum_sum)
#define gsid_spread_take GSID_NAME(gsid_spread_take)
#define gsid_spread_read GSID_NAME(gsid_spread_read)
#define gsid_frf_size_with GSID_NAME(gsid_frf_size_with)
#define gsid_frf_init_with GSID_NAME(gsid_frf_init_with)
#define gsid_frf_add_line GSID_NAME(gsid_frf_add_line)

/* gsid_spectrum_step, gsid_spread_step and gsid_spread_line, of arguments that are known to be good. y is the
 * first channel, u the second, and anything where there is no second. */
gsid_status gsid_spectrum_sum(gsid_spectrum *s, gsid_real u, gsid_real y);
gsid_status gsid_spread_take(gsid_spread *s, gsid_real u, gsid_real y);
gsid_cplx gsid_spread_read(const gsid_spread *s, uint32_t i, uint32_t channel);

/* What makes lines of samples. Reached through a pointer, so that the linker leaves out the engine that nobody initialises. */
struct gsid_frf_engine {
    size_t (*mem_size)(const gsid_spectrum_cfg *cfg); /* 0: refused */
    gsid_status (*init)(gsid_frf *frf, const gsid_spectrum_cfg *cfg, void *mem, size_t mem_size);
    gsid_status (*step)(gsid_frf *frf, gsid_real u, gsid_real y);
    gsid_status (*skip)(gsid_frf *frf, uint32_t n_samples);
    gsid_status (*finish)(gsid_frf *frf);
};

size_t gsid_frf_size_with(const struct gsid_frf_engine *engine, const gsid_frf_cfg *cfg);
gsid_status gsid_frf_init_with(const struct gsid_frf_engine *engine, gsid_frf *frf, const gsid_frf_cfg *cfg, void *mem,
                               size_t mem_size);

/* Let line i of y, and of u when it is measured, of the good period number n_periods + 1 enter the means. */
void gsid_frf_add_line(gsid_frf *frf, uint32_t i, const gsid_cplx *x);

static inline uint32_t gsid_frf_channels(const gsid_frf_cfg *cfg) {
    return cfg->u_known == NULL ? 2 : 1;
}

#endif
