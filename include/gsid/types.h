/* Scalars, complex numbers and the one list of status codes. */
#ifndef GSID_TYPES_H
#define GSID_TYPES_H

#include <stddef.h>
#include <stdint.h>

#include "gsid/precision.h"

#ifdef __cplusplus
extern "C" {
#endif

#define GSID_VERSION "0.2.0"

#ifdef GSID_SINGLE
typedef float gsid_real;
#else
typedef double gsid_real;
#endif

/* Complex number, with the same layout as in numpy and FFTW; usable from C++. */
typedef struct {
    gsid_real re, im;
} gsid_cplx;

/* X(name, code, meaning, hint). Negative: the call failed and left its outputs and its object as they were.
 * Positive: the call succeeded, and the code states why it returned. tools/make_errors_page prints docs/reference/errors.md from this list. */
#define GSID_STATUS_LIST(X)                                                                                            \
    X(GSID_OK, 0, "done", "")                                                                                          \
    X(GSID_DONE, 1, "the period, or the sequence, is complete", "")                                                    \
    X(GSID_SETTLING, 2, "sample accepted; the axis is still settling", "")                                             \
    X(GSID_SPOILED, 3, "the period ended, but samples of it were lost: it was left out", "")                           \
    X(GSID_MAX_ITER, 4, "stopped at the iteration limit before the answer had settled",                                \
      "allow more iterations, or start from a better guess")                                                           \
    X(GSID_RANK, 5, "the data do not determine every parameter: the rest were set to zero",                            \
      "lower the order, or widen the band")                                                                            \
    X(GSID_TRIPPED, 6, "the guard has switched the excitation off", "gsid_trip_str names its reason")                  \
    X(GSID_RANGE, 7, "the squares of a line are beyond the range of numbers: its variance is given as infinite",        \
      "scale input and output so that they are near 1, or use double")                                                 \
    X(GSID_E_NULL, -1, "a required pointer is NULL", "")                                                               \
    X(GSID_E_CONFIG, -2, "a configuration value is out of its range", "the header states each field's range")          \
    X(GSID_E_MEMORY, -3, "the memory block is too small or not aligned", "ask the object's _mem_size for the bytes")   \
    X(GSID_E_NONFINITE, -4, "a number is not finite: refused, nothing changed", "")                                    \
    X(GSID_E_STATE, -5, "the object is not initialised, or not in a state for this call",                              \
      "call its _init first; the header lists what else the call needs")                                            \
    X(GSID_E_TOO_FEW, -6, "too few periods or lines for the answer asked", "measure longer, or lower the order")       \
    X(GSID_E_SINGULAR, -7, "the equations are singular", "lower the order, or widen the band")                         \
    X(GSID_E_UNSTABLE, -8, "no stable model was found", "lower the order, or allow unstable models")                   \
    X(GSID_E_NO_MEMORY, -9, "out of memory", "")                                                                       \
    X(GSID_E_BACKEND, -10, "the library that does this was left out of the build", "rebuild with it")                  \
    X(GSID_E_STEEP, -11, "a torque law jumps, runs away or is too steep to follow",                                    \
      "widen its transition, as in tanh(w/width); for friction that sticks take coulomb_friction")                     \
    X(GSID_E_BUILD, -12, "the compiler options prevent the detection of numbers that are not finite",                  \
      "compile without -ffast-math, -ffinite-math-only and -fno-honor-nans")                                            \
    X(GSID_E_STOPPED, -13, "stopped by the caller before the answer was found", "")

#define GSID_STATUS_ENUM(name, code, meaning, hint) name = code,
typedef enum { GSID_STATUS_LIST(GSID_STATUS_ENUM) GSID_STATUS_END_ = 127 } gsid_status;

/** Name a status in one sentence.
 *  @param[in] status  any value
 *  @return the meaning, never NULL; "unknown status" for a value off the list
 *  Memory: none.  Cost: one pass over the list.  Context: ISR-safe. */
const char *gsid_status_str(gsid_status status);

/** Advice on how to resolve a status.
 *  @param[in] status  any value
 *  @return the hint, "" where there is none, never NULL */
const char *gsid_status_hint(gsid_status status);

#ifdef __cplusplus
}
#endif

#endif
