"""What a structure must not be, whatever its score: elements that the data do not show."""

from __future__ import annotations

import numpy as np

from gsid.structure.elements import Lines, Values, columns
from gsid.structure.projection import Data, Fitted
from gsid.structure.settings import StructureSettings

NOT_ZERO = 1e-3
"""Share of the largest response that counts where all lines near a mode are at an antiresonance."""


def refusal(fitted: Fitted, data: Data, settings: StructureSettings) -> str:
    """Reason to refuse a fitted structure, or an empty text.

    Parameters
    ----------
    fitted : Fitted
    data : Data
    settings : StructureSettings
    """
    return _impossible(fitted.values, data, settings) or _not_shown(fitted, data, settings)


def least_half_width(lines: Lines, settings: StructureSettings) -> float:
    """Half width in rad/s of the narrowest resonance that the lines resolve.

    Parameters
    ----------
    lines : Lines
    settings : StructureSettings
    """
    return settings.resolved_lines * 2 * np.pi * float(np.median(np.diff(lines.f_hz)))


def _impossible(values: Values, data: Data, settings: StructureSettings) -> str:
    """Values outside the band, unresolved, or of the wrong sign."""
    w = data.lines.w
    narrow = least_half_width(data.lines, settings)
    for w_mode, z in values.modes:
        where = f"mode at {w_mode / (2 * np.pi):.4g} Hz"
        if not settings.near_lo * w[0] < w_mode < settings.near_hi * w[-1]:
            return f"{where}: outside the band"
        if z > settings.zeta_max:
            return f"{where}: damping above {settings.zeta_max:g}"
        if z <= max(narrow / w_mode, settings.zeta_min):
            return f"{where}: narrower than the lines resolve"
    if values.structure.n_body and not settings.slow * w[0] < values.rate < settings.fast * w[-1]:
        underdamped = values.structure.body == "sprung" and values.rate**2 < 4 * values.stiffness
        if not (underdamped and values.rate > 2 * settings.zeta_min * np.sqrt(values.stiffness)):
            return "viscous friction outside the band"
    if values.structure.body == "sprung":
        w_body = np.sqrt(values.stiffness)
        if not settings.slow * w[0] < w_body < settings.near_hi * w[-1]:
            return "spring outside the band"
        if values.rate / (2 * w_body) <= settings.zeta_min:  # lines on its flanks show it, however narrow
            return "spring: no damping"
    for tau in values.lags:
        if not settings.lag_short / w[-1] < tau < settings.lag_long / w[0]:
            return "lag outside the band"
    if values.delay_s < settings.delay_min / data.lines.fs_hz:
        return "negative delay"
    return ""


def _not_shown(fitted: Fitted, data: Data, settings: StructureSettings) -> str:
    """Elements that cancel each other, or are small everywhere."""
    structure, f = fitted.structure, data.lines.f_hz
    size = np.abs(columns(fitted.values, data.lines) * fitted.gains)
    measured = np.abs(data.g)
    if np.median(size[:, 0] / measured) > settings.body_size:
        return "the body cancels against another element"
    if fitted.gains[0] == 0:
        return "no body"
    share = np.abs(fitted.gains / fitted.gains[0])
    if structure.residual and share[-1] * data.lines.w[-1] ** 2 > settings.above_max:
        return "modes above the band are larger than the body"
    if structure.n_modes and share[1 : 1 + structure.n_modes].max() > settings.residue_max:
        return "a mode is larger than the body: it is the body"
    total = size.sum(axis=1)
    own = [w / (2 * np.pi) for w, _ in fitted.values.modes]
    for i, f_mode in enumerate(own, 1):
        near = np.abs(f - f_mode) <= settings.cancel_near * f_mode
        if near.any():
            largest = max(measured[near].max(), NOT_ZERO * measured.max())
            if size[near, i].max() > settings.cancel_size * largest:
                return f"mode at {f_mode:.4g} Hz cancels against another element"
        at = int(np.argmin(np.abs(f - f_mode)))
        if size[at, i] < settings.standing_out * (total[at] - size[at, i]):
            return f"mode at {f_mode:.4g} Hz is small beside the other elements"
    if structure.residual and np.max(size[:, -1] / (total - size[:, -1])) < settings.residual_share:
        return "modes above the band are small beside the other elements"
    return ""
