"""Roots of polynomials with real coefficients."""

from __future__ import annotations

import numpy as np

from gsid._lib import check, ffi, lib


def roots_of(coef: np.ndarray) -> np.ndarray:
    """Roots by gsid's own finder, which keeps conjugate pairs exact; [] for a constant."""
    ascending = np.ascontiguousarray(coef[::-1])
    roots = np.empty(max(len(coef) - 1, 1), dtype=complex)
    n_roots = ffi.new("uint32_t *")
    # Scaling to roots near 1 keeps the powers in range; the geometric mean of the roots is known without
    # them.
    nonzero = np.flatnonzero(ascending)
    if len(nonzero) == 0:
        return np.empty(0, dtype=complex)
    low, high = nonzero[0], nonzero[-1]
    scale = abs(ascending[low] / ascending[high]) ** (1 / (high - low)) if high > low else 1.0
    scaled = ascending * scale ** (np.arange(len(coef)) - float(high)) / ascending[high]
    check(
        lib.gsid_poly_roots(
            len(coef) - 1,
            ffi.from_buffer("double[]", scaled),
            ffi.cast("gsid_cplx *", ffi.from_buffer(roots)),
            n_roots,
        ),
        "roots",
    )
    return roots[: n_roots[0]] * scale
