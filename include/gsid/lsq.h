/* Small dense least squares by QR, row by row: the memory is that of the triangle, whatever the number of rows. */
#ifndef GSID_LSQ_H
#define GSID_LSQ_H

#include "gsid/types.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GSID_LSQ_COLUMNS_MAX 1024

typedef struct {
    uint32_t n_columns; /* unknowns */
    uint32_t n_rows;    /* rows taken so far */
    uint32_t n_pinned;  /* unknowns that gsid_lsq_solve has pinned to 0 */
    gsid_real *r;       /* private: [n_columns + 1][n_columns + 1] upper triangle of (A | b), row by row */
    gsid_real *row;     /* private: [n_columns + 1] */
} gsid_lsq;

#define GSID_LSQ_MEM_SIZE(n_columns) (((size_t)(n_columns) + 1) * ((size_t)(n_columns) + 2) * sizeof(gsid_real))

/** Bytes that gsid_lsq_init needs; 0 for no columns and for more than GSID_LSQ_COLUMNS_MAX. */
size_t gsid_lsq_mem_size(uint32_t n_columns);

/** Lay out an empty problem min |A x - b|.
 *  @param[in] n_columns  1 .. GSID_LSQ_COLUMNS_MAX
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG; GSID_E_MEMORY */
gsid_status gsid_lsq_init(gsid_lsq *q, uint32_t n_columns, void *mem, size_t mem_size);

/** Forget all rows.
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE */
gsid_status gsid_lsq_reset(gsid_lsq *q);

/** Append one row of A and its right-hand side, by Givens rotations.
 *  @param[in] row  [n_columns] finite
 *  @param[in] rhs  finite
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE; GSID_E_NONFINITE refused, nothing changed
 *  Cost: n_columns rotations, 3 (n_columns + 2)^2 flops. */
gsid_status gsid_lsq_add(gsid_lsq *q, const gsid_real *row, gsid_real rhs);

#define GSID_LSQ_BLOCK 8

/** Append up to GSID_LSQ_BLOCK rows at once, by Householder's reflections: a third of the time of as many gsid_lsq_add.
 *  @param[in]     n_rows  0 .. GSID_LSQ_BLOCK
 *  @param[in,out] block   [n_columns + 1][GSID_LSQ_BLOCK] the rows of A, and of the right-hand side last, column by column;
 *                         finite; used as work space
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE; GSID_E_CONFIG; GSID_E_NONFINITE refused, nothing changed
 *  Cost: n_columns + 1 reflections, 2 GSID_LSQ_BLOCK (n_columns + 2)^2 flops. */
gsid_status gsid_lsq_add_block(gsid_lsq *q, uint32_t n_rows, gsid_real *block);

/** Solve. A column that its predecessors explain, but for rank_tol of its own length, adds no information: its
 *  unknown is pinned to 0. Rows added later do not free it: gsid_lsq_reset does.
 *  @param[in]  rank_tol  >= 0; 0: 8 (n_columns + 1) times the rounding unit
 *  @param[out] x         [n_columns]
 *  @param[out] cost      sum of squared residuals; may be NULL
 *  @return GSID_OK; GSID_RANK unknowns are pinned; GSID_E_NULL; GSID_E_STATE; GSID_E_CONFIG; GSID_E_TOO_FEW fewer rows
 *          than columns; GSID_E_NONFINITE the solution overflows: outputs untouched
 *  Cost: n_columns^2 flops, and one gsid_lsq_add for each pin. */
gsid_status gsid_lsq_solve(gsid_lsq *q, gsid_real rank_tol, gsid_real *x, gsid_real *cost);

/** Solve A'A x = c.
 *  @param[in]  c  [n_columns] finite
 *  @param[out] x  [n_columns]; may be c
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE; GSID_E_TOO_FEW; GSID_E_SINGULAR, also when unknowns are pinned;
 *          GSID_E_NONFINITE the solution overflows: outputs untouched
 *  Cost: 3 n_columns^2 flops. */
gsid_status gsid_lsq_solve_normal(const gsid_lsq *q, const gsid_real *c, gsid_real *x);

/** Inverse of A'A: the covariance of x when the rows have unit variance.
 *  @param[out] cov  [n_columns][n_columns]
 *  @return GSID_OK; GSID_E_NULL; GSID_E_STATE; GSID_E_TOO_FEW; GSID_E_SINGULAR, also when unknowns are pinned;
 *          GSID_E_NONFINITE a variance is beyond the range of numbers: outputs untouched
 *  Cost: n_columns^3 flops. */
gsid_status gsid_lsq_covariance(const gsid_lsq *q, gsid_real *cov);

#ifdef __cplusplus
}
#endif

#endif
