"""Choose the next excitation from what was measured: amplitude of each line, periods, realisations, time.

Noise falls with amplitude, periods and realisations; distortion falls with realisations only (EXC-11). The
amplitudes give all lines the same ratio of signal to noise, or keep their measured shape if that is faster.
If the least number of periods is more than enough, the amplitude is reduced until the wanted uncertainty is
met, since less motion means less distortion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gsid.excitation.expected import P_MIN, Errors
from gsid.excitation.goals import Goal, goal_of
from gsid.excitation.limits import Model, fit_to_limits, optimise, travel
from gsid.excitation.multisine import Multisine
from gsid.excitation.periodic import Limits
from gsid.response.frf import Frf

M_MIN = 2  # realisations: fewer do not show the distortion
M_MOST = 64


@dataclass(frozen=True, eq=False)
class NextExcitation:
    """The next excitation, and what it is expected to reach.

    Attributes
    ----------
    excitation : Multisine
        First realisation; the others have other seeds of the phases.
    n_periods, n_realisations : int
        P of each realisation, and M.
    wait_periods : int
        Periods to wait before each realisation is measured.
    time_s : float
        Time with waiting [s].
    expected_std : float
        Largest standard deviation over gain at a line, or over value of a parameter.
    expected : (F,) or (p,) ndarray
        The same for each line, or for each parameter of the model.
    limited_by : {"noise", "distortion"}
        Larger part of the variance at the line or parameter of the largest standard deviation.
    reachable : bool
        Whether the wanted standard deviation is reached.
    reason : str
    """

    excitation: Multisine
    n_periods: int
    n_realisations: int
    wait_periods: int
    time_s: float
    expected_std: float
    expected: np.ndarray
    limited_by: str
    reachable: bool
    reason: str

    @property
    def amplitude(self) -> float:
        """Largest command."""
        return self.excitation.peak

    def realisations(self) -> list[Multisine]:
        """All realisations of the excitation."""
        if self.n_realisations == 1:
            return [self.excitation]
        return [_with_phases(self.excitation, seed) for seed in range(self.n_realisations)]

    def to_dict(self) -> dict[str, object]:
        """The values of `gsid next --json`."""
        keys = (
            "amplitude",
            "n_periods",
            "n_realisations",
            "wait_periods",
            "time_s",
            "expected_std",
            "expected",
        )
        more = ("limited_by", "reachable", "reason")
        lines = {"f_hz": self.excitation.f_hz, "line_amplitude": self.excitation.amplitude}
        return {key: getattr(self, key) for key in (*keys, *more)} | lines


def next_excitation(
    measured: Frf,
    *,
    sigma: float | None = None,
    parameter_sigma: float | None = None,
    model: Model | None = None,
    limits: Limits | None = None,
    seed: int = 0,
) -> NextExcitation:
    """Choose the excitation that reaches a wanted uncertainty in the least time.

    Parameters
    ----------
    measured : Frf
        Response of a first measurement with its variance, and with that of the distortion if it is from
        `gsid.response.with_distortion.frf_with_distortion`.
    sigma : float, optional
        Wanted standard deviation over gain at every line, 0 .. 1. Default 0.01, without `parameter_sigma`.
    parameter_sigma : float, optional
        Wanted standard deviation over value of every free parameter of `model`, instead of `sigma`.
    model : RationalModel or PlantModel, optional
        Required for limits of travel, and for `parameter_sigma`. Laws of a stack of effects explain the
        distortion: it is then no error of the parameters.
    limits : Limits, optional
        Without a limit of the command: the peak of the measured lines together. State the limit for a stepped
        sine, whose lines are measured one after another.
    seed : int
        Of the first realisation's phases.

    Returns
    -------
    NextExcitation
        The distortion is assumed to be as large as measured: a smaller amplitude changes it.

    Raises
    ------
    ValueError
        An argument is not valid, or the measurement has no variance.
    """
    if sigma is not None and parameter_sigma is not None:
        raise ValueError("give sigma or parameter_sigma, not both")
    wanted = (0.01 if sigma is None else sigma) if parameter_sigma is None else parameter_sigma
    if not 0 < wanted < 1:
        raise ValueError(f"the relative standard deviation must be between 0 and 1, not {wanted}")
    if parameter_sigma is not None and model is None:
        raise ValueError("the uncertainty of parameters needs a model: --model, or model=")
    errors = Errors.of(measured)
    goal = goal_of(measured, errors, wanted, model if parameter_sigma is not None else None)
    command = limits or Limits()
    if command.command is None:
        command = replace(command, command=_peak(measured))
    wait = max(1, -(-measured.settle_samples // measured.period_samples))
    best: tuple[float, int, int, Multisine] | None = None
    candidates = {
        several: _largest(measured, errors, several, command, model, seed) for several in (False, True)
    }
    for n_realisations in (*range(1, 9), *range(10, M_MOST + 1, 2)):
        if n_realisations < M_MIN and goal.with_distortion:
            continue
        for signal in candidates[n_realisations > 1]:
            n_periods = goal.periods(signal, n_realisations)
            if n_periods is not None:
                time_s = _time_s(measured, wait, n_periods, n_realisations)
                if best is None or time_s < best[0]:
                    best = time_s, n_periods, n_realisations, signal
    reachable = best is not None
    if best is None:
        best = _time_s(measured, wait, P_MIN, M_MOST), P_MIN, M_MOST, candidates[True][0]
    time_s, n_periods, n_realisations, signal = best
    if n_realisations > M_MIN:
        signal = _smallest(signal, n_realisations, command, model)
        n_periods = goal.periods(signal, n_realisations) or n_periods
        time_s = _time_s(measured, wait, n_periods, n_realisations)
    if reachable:
        signal = signal.scaled(goal.least_factor(signal, n_periods, n_realisations))
    expected, by_noise = goal.expected(signal, n_periods, n_realisations)
    worst = int(np.argmax(expected))
    limited_by = "noise" if by_noise[worst] >= 0.5 else "distortion"
    planned = NextExcitation(
        signal,
        n_periods,
        n_realisations,
        wait,
        time_s,
        float(expected[worst]),
        expected,
        limited_by,
        reachable,
        reason="",
    )
    moved = None if model is None else travel(signal, model)
    return replace(planned, reason=_reason(planned, goal, measured, moved))


def _peak(measured: Frf) -> float:
    """Peak of the measured command, from its lines."""
    spectrum = np.zeros(measured.period_samples // 2 + 1, complex)
    spectrum[measured.line] = measured.u * measured.period_samples / 2
    return float(np.abs(np.fft.irfft(spectrum, measured.period_samples)).max())


def _time_s(measured: Frf, wait: int, n_periods: int, n_realisations: int) -> float:
    return n_realisations * (wait + n_periods) * measured.period_samples / measured.fs_hz


def _largest(
    measured: Frf, errors: Errors, several: bool, limits: Limits, model: Model | None, seed: int
) -> list[Multisine]:
    """Candidates as large as the limits allow: equal signal-to-noise ratios, or the measured shape."""
    line, zero = measured.line.astype(np.uint32), np.zeros(len(measured.line))
    level = np.sqrt(errors.noise) / np.maximum(np.abs(measured.g), np.finfo(float).tiny)
    found = []
    for shape in (level, np.abs(measured.u)):
        signal = Multisine(measured.fs_hz, measured.period_samples, line, shape / np.max(shape), zero)
        if not several:
            best = optimise(_with_phases(signal, seed), limits, model)
            found.append(fit_to_limits(best, limits, model))
            continue
        found.append(_smallest(signal, M_MIN, limits, model))
    return found


def _smallest(signal: Multisine, n_realisations: int, limits: Limits, model: Model | None) -> Multisine:
    """The first realisation, with the amplitude that the limits allow to all of them."""
    each = [fit_to_limits(_with_phases(signal, i), limits, model) for i in range(n_realisations)]
    least = min(float(np.max(one.amplitude)) for one in each)
    return each[0].scaled(least / float(np.max(each[0].amplitude)))


def _with_phases(signal: Multisine, seed: int) -> Multisine:
    phase_rad = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(signal.line))
    return replace(signal, phase_rad=phase_rad, seed=seed, optimised=False)


def _measured_signal(measured: Frf) -> Multisine:
    """The excitation that was measured, at its mean amplitudes."""
    line = measured.line.astype(np.uint32)
    return Multisine(measured.fs_hz, measured.period_samples, line, np.abs(measured.u), np.angle(measured.u))


def _reason(planned: NextExcitation, goal: Goal, measured: Frf, moved: float | None) -> str:
    """Why this excitation, and what comes next."""
    worst = goal.names[int(np.argmax(planned.expected))]
    periods = max(measured.n_periods // measured.n_realisations, 1)
    before = goal.expected(_measured_signal(measured), periods, measured.n_realisations)[0]
    text = (
        f"The measurement leaves {np.max(before):.2g} at the worst {goal.what}; {goal.wanted:g} is wanted. "
    )
    if not planned.reachable and goal.what == "parameter":
        return text + (
            f"It is not reached for {worst} with {M_MOST} realisations: its value may be zero, or the "
            "band does not determine it. Try a simpler model or another band."
        )
    if not planned.reachable:
        return text + (
            f"Distortion alone leaves more at {worst} with {M_MOST} realisations: it does not fall with the "
            "number of periods. Reduce the amplitude, or model the effect (`gsid diagnose`)."
        )
    if planned.n_realisations == 1:
        text += "Noise is the larger error: one realisation, with as many periods as it needs. "
    elif planned.n_periods == P_MIN:
        text += "Distortion counts: P = 2 periods show the noise, and the time goes into realisations. "
    elif planned.n_realisations == M_MIN:
        text += "Noise dominates: M = 2 realisations show the distortion, and the time goes into periods. "
    else:
        text += "Noise and distortion both count. "
    text += f"{worst} reaches the wanted value last. "
    if moved is not None:
        text += f"The predicted travel is {moved:.3g} to each side. "
    return text + "Measure, then fit again and compare on a realisation that is kept out."
