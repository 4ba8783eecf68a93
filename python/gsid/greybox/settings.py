"""Numerical settings of the grey-box fit, in one place. The values of those of the C library stand there.

Each entry has its unit, and where it comes from: an equation, the sweep of `benchmarks/greybox_settings.py`
(results in docs/explanation/decisions.md), or a choice and its reason. "Noise" is the standard deviation of
the mean over the periods unless stated otherwise. The cost is -2 log likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gsid._lib import check, ffi, lib


def _of_c() -> Any:
    """Defaults of the C library (gsid_plant_fit_settings)."""
    settings = ffi.new("gsid_plant_fit_settings *")
    check(lib.gsid_plant_fit_defaults(settings))
    return settings


_C = _of_c()


@dataclass(frozen=True)
class GreyboxSettings:
    """Settings of the weights, the simulation, the search, the result and the linear start.

    Attributes
    ----------
    same_level : float
        Largest ratio of the rms inputs of two records whose variances are pooled (GBX-3). Chosen: 5 % is more
        than the input changes when an experiment is repeated, and less than the step between two levels.
    settled : float, in units of the noise
        Change of a simulated steady state per period at which the simulation stops. Chosen: its square, 1e-4,
        is negligible beside the variance of the noise. Sweep: 0.001 to 0.1 give the same estimates.
    unsettled : float, in units of the noise
        Larger changes per period are reported. Chosen: ten times `settled`; the square is 1 % of the variance
        of the noise.
    noise_floor : float, relative to the largest line
        Least standard deviation of one period. Without it a record without noise would have infinite weights.
        Chosen: about one part in 2^24, the resolution of the best converters. Sweep: with noise of 1 % of the
        output, 1e-9 to 1e-5 give the same estimates.
    silent : float, in units of the noise
        A parameter is held if a change by its size changes all residuals together by less (Euclidean norm).
        Sweep: at most 3e-4 for a constant torque and 0 for a fine quantization, which the data do not
        determine; at least 55 for parameters that they do determine.
    max_iter : int
        Default of the largest number of iterations. Chosen: far above the 6 iterations that the fits of the
        sweep need at most.
    decrease : float
        The search has converged if a full step is predicted to lower the cost by less. A step of d standard
        deviations lowers it by d^2: the estimate is within 0.1 standard deviations of the minimum. Sweep:
        1e-4 moves estimates by at most 0.02 standard deviations and needs 16 iterations in place of 13; 1
        moves them by 0.08.
    singular : float, relative to the largest singular value
        Directions of the scaled Jacobian with a smaller singular value are held. Sweep: at least 0.07 if the
        data determine all parameters, at most 7e-8 if gravity acts like the spring.
    damping_start : float, relative to the squared length of a column
        First damping. Sweep: 1e-5 needs as many iterations as 1e-3, and 0.1 twice as many.
    damping_max : float, relative to the squared length of a column
        The search ends if a step with this damping does not lower the cost. Chosen: such a step is 1e-10 of
        the full step, and its effect on the cost is lost in rounding. Sweep: 1e7 and 1e13 give the same
        estimates.
    damping_fall, damping_growth : float
        Least factor of the damping after a step that lowers the cost; first factor after a step that does
        not, which then doubles each time. From Nielsen, Damping parameter in Marquardt's method (1999).
    stalled : float, relative to the cost
        A search that ends by `damping_max` has converged if the predicted decrease is below this. Chosen:
        far below the scatter of the cost, which is sqrt(2 / n) for n degrees of freedom.
    failed_cost : float, relative to the cost at the start
        Cost of a point that cannot be simulated, for NLopt, which needs a number. Chosen: above every cost
        that its line search accepts.
    involved : float
        Parameters with a larger component in a held direction (of unit length) have no standard deviation.
        Chosen: the standard deviation along such a direction is unknown, and a tenth of it may be large.
    scan_spread : float, relative to the start value
        Range of the scan over the resonance frequency to each side. Sweep: with 0.05 all resonances are found
        from starts up to 10 % off, with 0.15 up to 20 %, with 0.3 nearly all up to 30 %, at twice the time of
        the scan. Chosen: a start value read from a measured response is closer than 15 %.
    scan_step : float, in half-power widths (2 zeta f)
        Step of the scan. Sweep: steps of 0.03 to 3 find the resonance as often. Chosen: the peak has ten
        points, so that one of them is near its top even if the start value of zeta is too large.
    scan_step_min : float
        Least step, as ln of the frequency. Chosen: limits the number of points for a sharp resonance to 303.
    scan_points_max : int
        Largest number of points of the scan. Chosen: above the 303 points of `scan_step_min`, so that it
        limits the time only if `scan_spread` is increased.
    response_floor : float, relative to the response
        Least standard deviation of the measured response in the linear start. Chosen: friction changes the
        response by more than the noise, and the lines with the least noise would dominate. Sweep:
        1e-4 to 1e-2 find all resonances from starts up to 14 % off; at 20 %, 11, 12 and 8 of 12.
    start_tolerance : float, relative to the cost and to the values
        Stopping tolerance of the linear start. Sweep: 1e-3 moves the estimates of the fit that follows by
        4e-6 standard deviations.
    start_evaluations_max : int
        Largest number of evaluations of the linear start. Chosen: limits the time of a start that does not
        converge. Sweep: 20 to 200 give the same estimates.
    """

    same_level: float = 1.05
    settled: float = _C.settled
    unsettled: float = _C.unsettled
    noise_floor: float = _C.noise_floor
    silent: float = _C.silent
    max_iter: int = 50
    decrease: float = _C.search.decrease
    singular: float = _C.search.singular
    damping_start: float = _C.search.damping_start
    damping_max: float = _C.search.damping_max
    damping_fall: float = _C.search.damping_fall
    damping_growth: float = _C.search.damping_growth
    stalled: float = _C.search.stalled
    failed_cost: float = _C.search.failed_cost
    involved: float = _C.involved
    scan_spread: float = 0.15
    scan_step: float = 0.1
    scan_step_min: float = 1e-3
    scan_points_max: int = 400
    response_floor: float = 1e-3
    start_tolerance: float = 1e-5
    start_evaluations_max: int = 60

    def to_c(self, settings: Any) -> None:
        """Enter the settings of the C library.

        Parameters
        ----------
        settings : gsid_plant_fit_settings *
        """
        for part in (settings, settings.search):
            for name in dir(part):
                if name != "search":
                    setattr(part, name, getattr(self, name))


SETTINGS = GreyboxSettings()
