/* Compare a model with a measurement: is only noise left, and if not, in which bands does the model fail? */
#ifndef GSID_HOST_COMPARE_H
#define GSID_HOST_COMPARE_H

#include "gsid/host/misfit.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Lines between the excited ones show nonlinear distortion. */
typedef enum { GSID_LINE_EXCITED = 0, GSID_LINE_ODD = 1, GSID_LINE_EVEN = 2, GSID_LINE_KINDS = 3 } gsid_line_kind;

/* Pointers stay the caller's. */
typedef struct {
    gsid_misfit_lines lines;  /* of all records, one record after the other; n_lines >= 1 */
    uint32_t n_records;       /* >= 1 */
    const uint32_t *n_of;     /* [n_records] lines of each record, >= 1; their sum is n_lines. NULL with one record */
    const double *f_hz;       /* [n_lines] Hz, finite, >= 0 */
    const uint8_t *kind;      /* [n_lines] gsid_line_kind; NULL: all are excited */
    const gsid_cplx *y;       /* [n_lines] mean output, or response, to which errors are compared; finite */
    double n_fitted;          /* parameters that were fitted to these lines, >= 0; then lines.n_directions is 0 */
} gsid_compare_data;

/* A band in which the model fails. */
typedef struct {
    double f_lo_hz, f_hi_hz;
    gsid_line_kind kind;
    uint32_t n_lines;
    double share;                /* of the excess over all lines, 0 .. 1 */
    double p_value, log_p_value; /* corrected for the number of bands tested; natural logarithm, which does not underflow */
    double db;                   /* error over the response of all lines in the band */
} gsid_compare_band;

typedef struct {
    gsid_misfit misfit;
    double p_value, log_p_value;  /* probability of a misfit this large or larger if the model is correct, and its natural
                                     logarithm, which does not underflow */
    double cost_per_dof;          /* 1 on average for a correct model */
    double deviance;              /* -2 log likelihood apart from a constant */
    double rms_error;             /* of the mean output in time, unit of y */
    double noise_floor_rms;       /* the part that noise alone leaves */
    double model_uncertainty_rms; /* the part that the model's uncertainty leaves on average */
    uint32_t n_bands;             /* that fail */
} gsid_comparison;

/** Test a model over all lines, and find the bands where it fails.  Eq: CMP-1, CMP-2
 *  @param[in]  alpha   false-alarm rate of all bands together, between 0 and 1. The caller compares p_value with it
 *  @param[in]  n_max   most bands to write
 *  @param[out] band    [n_max] those of the largest shares, largest first; NULL with n_max = 0
 *  @param[out] ratio   [n_lines] squared error left over its sample variance; or NULL
 *  @param[out] result
 *  @return GSID_OK; GSID_E_NULL; GSID_E_CONFIG a value is out of its range; GSID_E_NONFINITE; GSID_E_NO_MEMORY: the outputs are
 *          untouched
 *  Memory: twice that of the lines, freed at the end.  Cost: that of two gsid_misfit_test, and one pass over the lines for each
 *  third octave.  Context: any thread. */
gsid_status gsid_compare(const gsid_compare_data *data, double alpha, uint32_t n_max, gsid_compare_band *band,
                         double *ratio, gsid_comparison *result);

#ifdef __cplusplus
}
#endif

#endif
