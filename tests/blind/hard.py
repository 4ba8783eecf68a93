"""Trials under conditions that are hard on purpose, for the study of the diagnosis from records.

Besides what every blind trial has (trials.py: odd lines with one of four left out at random, a word length,
an unlisted part at -50 dB, one record in four with a fan):

drift      the output is a ramp and a random walk besides
offset     the drive has a constant torque of its own: it shifts the working point of a law
loop       noise coloured by the axis (a random torque) or by a loop around the sensor (its sensitivity)
ranges     shapes of hidden effects from wide ranges that are not those of the catalogue's grids; modes of
           either sign; unbalances at any angle

There is a model of the axis without the hidden effect with each of the errors of `ERRORS`. As in trials.py,
a trial is drawn from (seed, index) and its kind alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import trials
import truth
from hidden import (
    CATALOGUE,
    FOREIGN,
    FS_HZ,
    SINGLE,
    Axis,
    Hidden,
    Hiding,
    Params,
    Rng,
    cogging,
    log_uniform,
    mode,
    presliding,
    signed,
    stop,
    stribeck,
    unbalance,
    uniform,
)
from nulls import Bench, Nulls
from scipy.optimize import least_squares
from scipy.signal import lfilter
from truth import TruthError

ERRORS = (0.05, 0.3)  # of each value of a model
KINDS = ("single", "null", "foreign")
N_EACH = 2  # realisations of each level
N_PERIODS = (2, 4, 8)  # of a null; other trials have the last


WIDE: dict[str, Hiding] = SINGLE | {
    "stribeck_friction": stribeck(uniform(0.2, 1.5), log_uniform(0.2, 12.0)),
    "presliding_friction": presliding(log_uniform(0.3, 600.0)),
    "mass_unbalance": unbalance(uniform(-180.0, 180.0)),
    "motor_cogging": cogging(lambda rng: float(np.rint(log_uniform(12, 1500)(rng)))),
    "hard_stop": stop(log_uniform(30, 3000), 0.9),
    "flexible_mode": mode(
        log_uniform(10, 190), log_uniform(0.004, 0.1), lambda rng: float(rng.choice([-1.0, 1.0])), 0.8
    ),
}


# ---- noise -----------------------------------------------------------------------------------------


@dataclass
class HardNoise(trials.Noise):
    """Noise of a blind trial, coloured by a loop, on an output that drifts."""

    colour: str = "axis"  # or "sensitivity"
    colour_share: float = 0.0  # of the standard deviation
    bump_hz: float = 0.0  # of the sensitivity
    bump_zeta: float = 0.0
    slope: float = 0.0  # deg/s per s
    walk: float = 0.0  # deg/s after one period
    axis: Params = field(default_factory=dict)

    @staticmethod
    def hard(rng: Rng, base: Params) -> HardNoise:
        plain = trials.Noise.drawn(rng)
        return HardNoise(
            **vars(plain),
            colour=str(rng.choice(["axis", "sensitivity"])),
            colour_share=rng.uniform(0.5, 1.5),
            bump_hz=log_uniform(8.0, 80.0)(rng),
            bump_zeta=rng.uniform(0.15, 0.5),
            slope=signed(0.0, 0.5)(rng) * plain.std,
            walk=rng.uniform(0.0, 0.5) * plain.std,
            axis=base,
        )

    def random(self, rng: Rng, y: np.ndarray, n_periods: int) -> np.ndarray:
        """As `Noise.random`, with the coloured part and the drift."""
        plain = super().random(rng, y, n_periods)
        walk = np.cumsum(rng.standard_normal(len(plain))) * self.walk / np.sqrt(len(y))
        ramp = self.slope * np.arange(len(plain)) / FS_HZ
        return plain + self._coloured(rng, len(plain)) + walk + ramp

    def _coloured(self, rng: Rng, n: int) -> np.ndarray:
        white = rng.standard_normal(n)
        if self.colour == "axis":
            f_hz = np.arange(1, n // 2 + 1) * FS_HZ / n
            spectrum = np.fft.rfft(white)
            spectrum[0] = 0.0
            spectrum[1:] *= truth.linear_response(self.axis, f_hz)
            noise = np.fft.irfft(spectrum, n)
        else:
            w = 2 * np.pi * self.bump_hz / FS_HZ
            r = np.exp(-self.bump_zeta * w)
            noise = lfilter([1.0, -1.0], [1.0, -2 * r * np.cos(w), r**2], white)
            noise = noise + (white - lfilter([1 - r], [1.0, -r], white))
        return noise * self.colour_share * self.std / np.std(noise)

    def variance(self, rng: Rng, y: np.ndarray, n_periods: int) -> np.ndarray:
        """As `Noise.variance`; the jump of the ramp is the same in all periods, whose mean it shifts."""
        k = np.arange(1, len(y) // 2 + 1)
        jump = np.zeros(len(k) + 1)
        jump[1:] = self.slope * len(y) / FS_HZ / (np.pi * k)
        return super().variance(rng, y) + (n_periods - 1) * jump**2


# ---- a trial ---------------------------------------------------------------------------------------


@dataclass
class HardTrial:
    """Arrays of u and y of each record, a model for each error of its values, the answer."""

    records: list[tuple[np.ndarray, np.ndarray]]
    models: dict[float, dict]
    key: dict
    nulls: Nulls = field(repr=False)
    bench: Bench = field(repr=False)


def hard_base(rng: Rng, without: str | None) -> Params:
    """The axis of a blind trial with wider ranges."""
    base = trials.draw_base(rng, without)
    wide = {
        "viscous_rate": log_uniform(0.6, 8.0)(rng),
        "spring_stiffness": log_uniform(12.0, 60.0)(rng),
        "mode_hz": rng.uniform(90.0, 185.0),
        "mode_zeta": log_uniform(0.005, 0.05)(rng),
        "mode_residue": rng.uniform(0.05, 0.4),
        "sensor_lag_s": 1 / (2 * np.pi * rng.uniform(60, 240)),
    }
    return base | {name: value for name, value in wide.items() if name in base}


def make_hard(seed: int, index: int, kind: str) -> HardTrial:
    """Draw one trial; draws that cannot be simulated or sized are thrown away and drawn anew."""
    number = KINDS.index(kind)
    for attempt in range(80):
        rng = np.random.default_rng([seed, index, attempt, number, 0x4A2D])
        try:
            return _draw(rng, kind)
        except TruthError:
            continue
    raise TruthError(f"{kind} {index} of seed {seed}: no draw of 80 could be simulated")


def _draw(rng: Rng, kind: str) -> HardTrial:
    choice = {"single": WIDE, "foreign": FOREIGN, "null": {}}[kind]
    effects = [str(rng.choice(list(choice)))] if choice else []
    n_periods = int(rng.choice(N_PERIODS)) if kind == "null" else N_PERIODS[-1]
    base = hard_base(rng, effects[0] if kind == "single" else None)
    lines, commands = trials.draw_commands(rng, base, N_EACH)
    noise = HardNoise.hard(rng, base)
    bench = Bench(commands, tolerance=1e-4 * noise.std)
    clean = bench.answers(base, truth.COARSE)
    s2 = np.array([noise.variance(rng, y, n_periods) for y, *_ in clean])
    nulls = Nulls(base, lines, commands, s2, n_periods)
    peak_angle = max(np.abs(angle).max() for _, angle, *_ in clean)
    axis = Axis(base["gain"], max(np.abs(u).max() for u in commands), peak_angle)
    bias = _offset(rng, base, peak_angle)
    drops, added = [], {}
    if effects:
        added, drops = _sized(rng, kind, choice[effects[0]](rng, axis), bias, nulls, bench)
    answers = bench.answers(base | bias | added, truth.FINE)
    if kind == "single" and "spring_stiffness" in base:
        _require_one_rest([angle for _, angle, *_ in answers])
    records = [
        (np.tile(u, n_periods), noise.measured(rng, y, n_periods))
        for u, (y, *_) in zip(commands, answers, strict=True)
    ]
    if kind == "null" and rng.random() < 0.25:
        records = [records[rng.integers(len(records))]]
    key = {
        "kind": kind,
        "effects": [trials.named(effect, added) for effect in effects],
        "predicted_drop": drops,
        "n_periods": n_periods,
        "n_realisations": len(records),
        "truth": base | bias | added,
        "noise": {name: value for name, value in vars(noise).items() if name != "axis"},
    }
    models = {error: trials.null_model(rng, base, error) for error in ERRORS}
    return HardTrial(records, models, key, nulls, bench)


def _require_one_rest(angles: list[np.ndarray]) -> None:
    """A spring of its own holds the axis; a law strong enough to hold it elsewhere is another experiment."""
    rest = [float(np.mean(angle)) for angle in angles]
    motion = max(np.ptp(angle) for angle in angles)
    if np.ptp(rest) > motion:
        raise TruthError(f"rest angles {np.round(rest, 1)} deg, while the axis moves by {motion:.1f}")


def _offset(rng: Rng, base: Params, peak_angle: float) -> Params:
    """A constant torque of the drive, which shifts a sprung axis by up to a third of its travel."""
    if "spring_stiffness" not in base or rng.random() < 0.3:
        return {}
    return {"bias_level": base["spring_stiffness"] * peak_angle * signed(0.0, 0.35)(rng)}


def _sized(
    rng: Rng, kind: str, hidden: Hidden, bias: Params, nulls: Nulls, bench: Bench
) -> tuple[Params, list[float]]:
    """Parameters of the hidden effect at the size that was drawn, and the predicted drop."""
    params = hidden.params
    hidden.params = lambda size: params(size) | bias
    target = float(rng.choice(trials.FOREIGN_TARGETS if kind == "foreign" else trials.TARGETS))
    size, residual, _ = trials.calibrate(nulls, hidden, bench, len(nulls.u), target)
    drop = float(residual @ residual)
    if drop < 2.0 or (kind == "foreign" and not target / 4 < drop < 4 * target):
        raise TruthError("the effect cannot be given the size that was drawn")
    return params(size), [drop]


def left_by(
    trial: HardTrial, effect: str, values: dict[str, float], beside: dict[str, dict[str, float]] | None = None
) -> float:
    """What another law leaves of the hidden effect's drop, fitted by simulation to the answers without noise.

    Parameters
    ----------
    trial : HardTrial
    effect : str
        Of the catalogue.
    values : dict of float
        Start of its parameters.
    beside : dict of dict, optional
        Effects of the model that it was found in, with their values: the fit begins from them, and a
        constant torque is fitted too. Without it, from the trial's own.

    Returns
    -------
    float
        An upper bound; inf where the law cannot be simulated.
    """
    nulls, truth_params = trial.nulls, trial.key["truth"]
    names = [(CATALOGUE[effect][name], value) for name, value in values.items() if name in CATALOGUE[effect]]
    bias = {name: value for name, value in truth_params.items() if name == "bias_level"}
    model = _named(beside or {})
    names += [(name, model[name]) for name in ("bias_level",) if name in model]
    size = np.array([abs(value) or 1.0 for _, value in names])
    start = np.array([value for _, value in names]) / size
    none = np.array([model.get(name, nulls.base[name]) / nulls.base[name] for name in nulls.free])
    none = np.where(none > 0, none, 1.0)  # a sign that is not the truth's

    def law(x: np.ndarray) -> Params:
        return {name: float(value) for (name, _), value in zip(names, x * size, strict=True)}

    def axis(x: np.ndarray) -> Params:
        scaled = {n: nulls.base[n] * s for n, s in zip(nulls.free, x[: len(none)], strict=True)}
        return nulls.base | scaled | bias | law(x[len(none) :])

    def answer(params: Params) -> np.ndarray:
        return nulls.whitened([y for y, *_ in trial.bench.answers(params, truth.COARSE)])

    def slopes(x: np.ndarray) -> np.ndarray:
        here, scale = answer(axis(x)), x[: len(none)]
        steps = 1e-3 * np.eye(len(x))[len(none) :]
        of_law = [(answer(axis(x + step)) - here) / 1e-3 for step in steps]
        return np.column_stack([nulls.slopes(scale, nulls.answer(scale)), *of_law])

    try:
        target = answer(truth_params)
        fit = least_squares(
            lambda x: answer(axis(x)) - target,
            np.concatenate([none, start]),
            slopes,
            bounds=([*0 * none, *np.where(start < 0, -np.inf, 0.0)], np.inf),
            x_scale="jac",
            max_nfev=15,
        )
    except TruthError:
        return np.inf
    return 2 * float(fit.cost)


def _named(effects: dict[str, dict[str, float]]) -> Params:
    """Values of a model under the simulator's names."""
    known = CATALOGUE | {"torque_bias": {"level": "bias_level"}}
    return {
        known[effect][name]: value
        for effect, values in effects.items()
        for name, value in values.items()
        if name in known.get(effect, {})
    }
