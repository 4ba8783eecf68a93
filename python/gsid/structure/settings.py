"""Constants of the search for a linear structure, each with its unit and reason."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class StructureSettings:
    """Constants of the search. They were set on simulated axes and measured records, none for one record.

    Attributes
    ----------
    first_error, error_max, smooth_error : float
        Error that a linear model is allowed, over the response: at the start, at most, and at least where one
        realisation with smooth phases hides its distortion. A larger one than `error_max` describes nothing.
    second_error : float
        Error at which the rational fits are repeated: with a small one, lines of little distortion alone
        decide, and a fit may end far from all others.
    scale_min : float
        Least factor on the total variance.
    n_rounds : int
        Repetitions of allowed error and selection; 2 to 4 reach a fixed point.
    odds : float
        Difference of scores [nats] within which structures are equal: odds of 1000 to 1.
    slow_lag_odds, acceleration_odds, unit_odds : float
        Odds [nats] against a lag that is slower than the body, which is a friction that is read wrongly,
        against the acceleration as output, and against an output that the unit of y contradicts.
    overdamped_odds : float
        Odds [nats] against the angle of an overdamped spring, which is the same function as the rate of a
        viscous body behind a lag: more than `odds`, so that chance does not decide.
    correlation_max : float
        Largest number of lines that count as one where residuals are smooth over frequency.
    stuck : float
        Rate below which an axis with dry friction may stick, in standard deviations of its measured rate; its
        sign is noise there.
    motion_band, motion_samples : float
        Highest line of the motion, in highest excited lines: friction moves the axis above the excitation.
        Samples per period of that line: the harmonics of a torque that jumps fold back, at 6 below the noise.
    friction_left : float
        Least standard deviation that the comparison with friction leaves of that without it: at changes of
        direction the measured motion is not known better, and its errors are not independent over lines.
    friction_rounds : int
        Repetitions of motion and fit at most. Most reach a fixed point in 5, with a weakly damped mode near
        the body in 12.
    poles_max : int
        Highest order of the rational fits that the search starts from. More poles cost time, and moves add
        what is missing.
    n_refined : int
        Readings of the poles that are refined.
    n_moved : int
        Best structures from which elements are added and dropped.
    n_steps_max : int
        Steps of that search.
    lags_max, modes_max : int
        Elements of a structure.
    lines_min : int
        Least number of lines: a body, a mode, a lag and a delay have 7 parameters.
    near_lo, near_hi : float
        A mode lies in near_lo f_lo .. near_hi f_hi: outside, the data show its flank only.
    zeta_max : float
        Damping ratio up to which a pole pair is a mode; a body may have more.
    resolved_lines : float
        Least half width of the resonance of a mode [line spacings]: narrower ones stand between two lines.
    zeta_min : float
        Least damping ratio, as of a metal without joints.
    slow, fast : float
        Rate of the viscous friction in slow w_lo .. fast w_hi.
    lag_short, lag_long : float
        Time constant of a lag in lag_short / w_hi .. lag_long / w_lo: shorter, it is a delay; longer, a rate.
    delay_min : float
        Least delay [samples]: half a sample of an unknown hold, and its uncertainty.
    cancel_near, cancel_size : float
        A column of more than cancel_size times the largest response within cancel_near (share) of its own
        frequency cancels against another.
    body_size : float
        Largest median size of the body's column over the response.
    residue_max, above_max : float
        Largest gain of a mode, and of the modes above the band, referred to the highest line, over that of
        the body.
    standing_out, residual_share : float
        Least share of a mode at its frequency, and of the residual term anywhere, in the sum of magnitudes:
        friction puts small modes at antiresonances.
    rejected_cost : float
        Cost per line at the largest allowed error from which no structure represents the data.
    scan_zeta : tuple of float
        Damping ratios of the scan for a further mode.
    n_scan : int
        Frequencies of that scan at most, geometric.
    """

    first_error: float = 0.03
    second_error: float = 0.1
    error_max: float = 0.25
    smooth_error: float = 0.2
    scale_min: float = 0.5
    n_rounds: int = 4
    odds: float = float(np.log(1000.0))
    slow_lag_odds: float = 3 * float(np.log(1000.0))
    acceleration_odds: float = float(np.log(1000.0))
    unit_odds: float = float(np.log(1000.0))
    overdamped_odds: float = 2 * float(np.log(1000.0))
    lines_min: int = 10
    correlation_max: float = 10.0
    stuck: float = 4.0
    motion_band: float = 6.0
    motion_samples: float = 6.0
    friction_left: float = 0.1
    friction_rounds: int = 30
    poles_max: int = 7
    n_refined: int = 14
    n_moved: int = 2
    n_steps_max: int = 8
    lags_max: int = 2
    modes_max: int = 8
    near_lo: float = 0.7
    near_hi: float = 1.2
    zeta_max: float = 0.5
    resolved_lines: float = 0.1
    zeta_min: float = 1e-4
    slow: float = 2e-3
    fast: float = 8.0
    lag_short: float = 0.05
    lag_long: float = 5.0
    delay_min: float = -0.55
    cancel_near: float = 0.3
    cancel_size: float = 4.0
    body_size: float = 10.0
    residue_max: float = 100.0
    above_max: float = 10.0
    standing_out: float = 0.2
    residual_share: float = 0.05
    rejected_cost: float = 2.0
    scan_zeta: tuple[float, ...] = (0.005, 0.02, 0.08)
    n_scan: int = 300
