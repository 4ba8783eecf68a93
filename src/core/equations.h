/* Least squares over the lines of a response: the triangle of its equations, filled in blocks of rows. */
#ifndef GSID_EQUATIONS_H
#define GSID_EQUATIONS_H

#include "gsid/frd.h"
#include "gsid/lsq.h"
#include "gsid/rational.h"

#define gsid_equations_init GSID_NAME(gsid_equations_init)
#define gsid_equations_next GSID_NAME(gsid_equations_next)
#define gsid_equations_end GSID_NAME(gsid_equations_end)
#define gsid_equations_set GSID_NAME(gsid_equations_set)
#define gsid_equations_check GSID_NAME(gsid_equations_check)
#define gsid_equations_is_finite GSID_NAME(gsid_equations_is_finite)
#define gsid_equations_cost GSID_NAME(gsid_equations_cost)
#define gsid_equations_are_alike GSID_NAME(gsid_equations_are_alike)

/* The unknowns, in the order of the columns: den without the coefficient held at 1, num, delay when it is free. */
typedef struct {
    uint32_t n_den, n_num, n; /* n = n_den + n_num + free_delay */
    uint32_t held;            /* index of the denominator coefficient that is 1 */
    gsid_lsq normal, damped;
    uint32_t n_rows;          /* rows waiting in the block */
    gsid_real *block;         /* [n + 1][GSID_LSQ_BLOCK] */
    gsid_real *step, *bend;   /* [n] */
    gsid_real *length;        /* [n] of the columns of J */
} gsid_equations;

/** Lay out the memory of gsid_estimate_mem_size for a problem, its arguments checked. */
gsid_status gsid_equations_init(gsid_equations *q, const gsid_frd *data, const gsid_rational *model, int free_delay,
                                void *mem, size_t mem_size);

/* Put one complex number into a column, n for the right-hand side, of the two rows being filled. */
static inline void gsid_equations_put(const gsid_equations *q, uint32_t column, gsid_cplx value) {
    gsid_real *at = q->block + (size_t)column * GSID_LSQ_BLOCK + q->n_rows;
    at[0] = value.re;
    at[1] = value.im;
}

/** The two rows are complete. */
gsid_status gsid_equations_next(gsid_equations *q);

/** End of the rows: those waiting in the block go into the triangle. */
gsid_status gsid_equations_end(gsid_equations *q);

/** Write x, in the order of the columns, into a model. */
void gsid_equations_set(const gsid_equations *q, const gsid_real *x, gsid_rational *model);

/** Arguments of the estimators.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_NONFINITE */
gsid_status gsid_equations_check(const gsid_frd *data, const gsid_rational *model);

/** Whether delay and coefficients are finite. The cost does not show it: with an infinite denominator the response is 0. */
int gsid_equations_is_finite(const gsid_rational *model);

/** V, infinite where the model cannot be evaluated.  Eq: EST-3 */
gsid_real gsid_equations_cost(const gsid_frd *data, const gsid_rational *model);

/** Whether the responses of two models differ by no more than this share of the data, both root mean squares over sigma. */
int gsid_equations_are_alike(const gsid_frd *data, const gsid_rational *a, const gsid_rational *b, gsid_real tolerance);

#endif
