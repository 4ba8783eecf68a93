"""Random linear axes, with one linear effect that the model lacks; nothing here comes from the product.

An axis is a state space in continuous time. A held command is answered through its matrix exponential, a
continuous one through its response at the line.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares

EFFECTS = ("cable_spring", "viscous_friction", "lag", "flexible_mode", "transport_delay")
FITTED = 200  # lines of the refit, all of them where the cost is near the limit
NEAR = 20.0  # times the limit: each of fewer lines counts for several, and may be the only one that shows it
EVALUATIONS = 100  # of a refit: after 25 a mode may still be on its way to where it replaces the effect
CLEAR = 64.0  # cost of the axis without the effect, refitted, from which it has to be found
Values = dict[str, dict[str, float]]


class DrawError(RuntimeError):
    """These draws have no clear effect: draw again."""


# ---- responses -------------------------------------------------------------------------------------


def matrices(stack: Values, output: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State space (a, b, c) of an axis without its delay.

    Parameters
    ----------
    stack : dict of dict of float
        {effect: {parameter: value}} in the units of the catalogue.
    output : {"rate", "angle"}
    """
    gain = stack["rigid_body"]["gain"]
    modes = [values for name, values in stack.items() if name.startswith("flexible_mode")]
    n = 2 + 2 * len(modes)
    a, b, c = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    a[0, 1] = 1.0
    a[1, 0] = -stack.get("cable_spring", {}).get("stiffness", 0.0)
    a[1, 1] = -stack.get("viscous_friction", {}).get("rate", 0.0)
    b[1] = gain
    for i, mode in enumerate(modes):
        at, w0 = 2 + 2 * i, 2 * np.pi * mode["f_hz"]
        a[at, at + 1] = 1.0
        a[at + 1, at], a[at + 1, at + 1] = -(w0**2), -2 * mode["zeta"] * w0
        b[at + 1] = mode["residue"] * gain
    c[(0 if output == "angle" else 1) :: 2] = 1.0
    for name in ("motor_lag", "sensor_lag"):
        tau = stack.get(name, {}).get("time_constant_s", 0.0)
        if tau > 0:
            a = np.block([[a, np.zeros((len(b), 1))], [c[None, :] / tau, np.array([[-1 / tau]])]])
            b, c = np.append(b, 0.0), np.append(np.zeros(len(b)), 1.0)
    return a, b, c


def response(stack: Values, f_hz: np.ndarray, fs_hz: float, output: str, hold: str) -> np.ndarray:
    """Response of the sampled output to the sampled command, (F,).

    Parameters
    ----------
    stack, output
        As `matrices`.
    f_hz : (F,) ndarray
        Above 0.
    fs_hz : float
    hold : {"zoh", "none"}
    """
    a, b, c = matrices(stack, output)
    delay_s = stack.get("transport_delay", {}).get("delay_s", 0.0)
    if hold == "none":
        s = 2j * np.pi * f_hz
        states = np.linalg.solve(
            s[:, None, None] * np.eye(len(b)) - a, np.broadcast_to(b[:, None], (len(s), len(b), 1))
        )
        return np.exp(-s * delay_s) * (states[:, :, 0] @ c)
    whole, fraction = divmod(delay_s * fs_hz, 1.0)
    held = np.block([[a, b[:, None]], [np.zeros((1, len(b) + 1))]])
    first, second = expm(held * fraction / fs_hz), expm(held * (1 - fraction) / fs_hz)
    phi = second[:-1, :-1] @ first[:-1, :-1]
    old, new = second[:-1, :-1] @ first[:-1, -1], second[:-1, -1]
    z = np.exp(2j * np.pi * f_hz / fs_hz)
    driven = (old / z[:, None] + new) * z[:, None] ** -whole
    states = np.linalg.solve(z[:, None, None] * np.eye(len(b)) - phi, driven[:, :, None])
    return states[:, :, 0] @ c


# ---- trials ----------------------------------------------------------------------------------------


@dataclass
class Trial:
    """Records of an axis, and what the model of it lacks.

    Attributes
    ----------
    effect : str
        One of `EFFECTS`.
    axis : dict of dict of float
    lacking : dict of dict of float
        The axis without the effect.
    drop : float
        Cost of the axis without the effect, refitted, at its least.
    fs_hz : float
    period_samples : int
    output : {"rate", "angle"}
    hold : {"zoh", "none"}
        Of the axis; `declared` whether the records state it.
    records : list of tuple of two ndarray
        u and y of each realisation.
    """

    effect: str
    axis: Values
    lacking: Values
    drop: float
    fs_hz: float
    period_samples: int
    output: str
    hold: str
    declared: bool
    records: list[tuple[np.ndarray, np.ndarray]] = field(repr=False)

    def start(self, rng: np.random.Generator, off: float) -> Values:
        """Values of the model, each a share too large or too small.

        Parameters
        ----------
        rng : Generator
        off : float
        """
        return {
            effect: {name: value * (1 + off * rng.choice([-1, 1])) for name, value in params.items()}
            for effect, params in self.lacking.items()
        }


def drawn(seed: int, effect: str, index: int, clear: float = CLEAR) -> Trial:
    """A trial by its seed, effect and number; draws without a clear effect are repeated.

    Parameters
    ----------
    seed : int
    effect : str
        One of `EFFECTS`.
    index : int
    clear : float
        Cost from which an effect is clear.
    """
    rng = np.random.default_rng([seed, EFFECTS.index(effect), index])
    while True:
        try:
            return _drawn(rng, effect, clear)
        except DrawError:
            continue


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _drawn(rng: np.random.Generator, effect: str, clear: float) -> Trial:
    fs_hz, n = _log(rng, 500, 5000), 2 * int(rng.integers(1000, 4000))
    first = int(rng.integers(1, 5))
    last = int(n * rng.uniform(0.04, 0.2))
    lines = np.arange(first, last, int(rng.integers(1, 3)))
    lines = lines[rng.random(len(lines)) < rng.uniform(0.4, 1.0)]
    output = str(rng.choice(["rate", "angle"]))
    hold = str(rng.choice(["zoh", "zoh", "none"]))
    declared = effect == "transport_delay" or bool(rng.integers(0, 2))
    axis, lacking = _axis(rng, effect, lines * fs_hz / n, fs_hz)
    n_records = int(rng.integers(1, 5))
    n_periods = int(rng.integers(6, 11) if n_records == 1 else rng.integers(3, 9))
    noise = _Noise(rng, n)
    records, spectra = [], []
    for _ in range(n_records):
        u = np.zeros(n // 2 + 1, complex)
        u[lines] = np.exp(2j * np.pi * rng.random(len(lines))) * noise.level
        y = np.zeros_like(u)
        every = np.arange(1, n // 2)
        y[every] = response(axis, every * fs_hz / n, fs_hz, output, hold) * u[every]
        samples, clean = np.fft.irfft(u, n), np.fft.irfft(y, n)
        added, std = noise.added(clean, n_periods)
        offset = np.std(clean) * rng.normal()
        records.append((np.tile(samples, n_periods), np.tile(clean, n_periods) + added + offset))
        spectra.append((u, y, np.sqrt(2 * n_periods) / std))

    def refit(some: np.ndarray, starts: list[Values]) -> tuple[float, Values]:
        share = np.sqrt(len(lines) / len(some))
        measured = [(u[some], y[some]) for u, y, _ in spectra]
        weights = [share * weight[some] for _, _, weight in spectra]
        how = some * fs_hz / n, fs_hz, output, hold, measured, weights
        return min((refitted(start, *how) for start in starts), key=lambda found: found[0])

    every_nth, starts = max(len(lines) // FITTED, 1), _starts(axis, lacking)
    drop, values = refit(lines[::every_nth], starts)
    if clear <= drop < NEAR * clear:
        drop, _ = refit(lines, [values, *starts])
    if drop < clear:
        raise DrawError
    return Trial(effect, axis, lacking, drop, fs_hz, n, output, hold, declared, records)


def _axis(rng: np.random.Generator, effect: str, f_hz: np.ndarray, fs_hz: float) -> tuple[Values, Values]:
    """An axis with the effect, and the same without it."""
    low, high = f_hz[0], f_hz[-1]
    spring = effect == "cable_spring" or rng.random() < 0.4
    least = 0.01 if effect in ("cable_spring", "viscous_friction") else 0.3
    corner = 2 * np.pi * _log(rng, least * low, min(30 * low, 0.3 * high))
    damping = 2 * corner * _log(rng, 0.02, 1.0) if spring else corner
    axis: Values = {
        "rigid_body": {"gain": _log(rng, 0.1, 1000)},
        "viscous_friction": {"rate": damping},
    }
    if spring:
        axis["cable_spring"] = {"stiffness": corner**2}
    for i in range(int(rng.integers(1 if effect == "flexible_mode" else 0, 3))):
        label = "flexible_mode" if i == 0 else f"flexible_mode#{i + 1}"
        mode_hz = _log(rng, max(5 * low, corner / np.pi), 0.9 * high)
        residue = float(rng.choice([-1, 1])) * _log(rng, 1e-3 if effect == "flexible_mode" else 0.02, 0.7)
        axis[label] = {"f_hz": mode_hz, "zeta": _log(rng, 0.003, 0.06), "residue": residue}
    modes = sorted(params["f_hz"] for label, params in axis.items() if label.startswith("flexible_mode"))
    if len(modes) == 2 and modes[1] < 1.2 * modes[0]:
        raise DrawError
    lag = str(rng.choice(["motor_lag", "sensor_lag"]))
    if effect == "lag" or rng.random() < 0.4:
        axis[lag] = {"time_constant_s": _log(rng, 0.02 if effect == "lag" else 0.4, 20.0) / fs_hz}
    axis["transport_delay"] = {
        "delay_s": _log(rng, 0.02 if effect == "transport_delay" else 0.2, 15.0) / fs_hz
    }
    missing = {"lag": lag, "flexible_mode": [x for x in axis if x.startswith("flexible_mode")][-1:]}
    missing = missing.get(effect, effect)
    return axis, {label: params for label, params in axis.items() if label not in (missing, *missing)}


def _starts(axis: Values, lacking: Values) -> list[Values]:
    """Values that a refit without the effect begins from: a mode may take the place of the missing one."""
    missing = [params for label, params in axis.items() if label not in lacking and "f_hz" in params]
    kept = [label for label in lacking if label.startswith("flexible_mode")]
    return [lacking, *(lacking | {label: params} for params in missing for label in kept)]


class _Noise:
    """White noise, noise that is coloured as the output, and a drift."""

    def __init__(self, rng: np.random.Generator, n: int) -> None:
        self.rng, self.n = rng, n
        self.level = _log(rng, 1.0, 1e3)
        self.white = 10 ** (-rng.uniform(-5, 55) / 20)
        self.coloured = self.white * _log(rng, 0.01, 1.0)
        self.drift = self.white * _log(rng, 0.1, 3.0)

    def added(self, clean: np.ndarray, n_periods: int) -> tuple[np.ndarray, np.ndarray]:
        """Noise of one record, and the standard deviation of its lines in a period's transform."""
        n, rng, rms = self.n, self.rng, np.std(clean)
        smooth = np.abs(np.fft.rfft(clean))
        smooth = np.sqrt(np.convolve(smooth**2, np.ones(41) / 41, "same"))
        smooth *= rms * np.sqrt(n) / np.sqrt(np.mean(smooth**2))
        colour = self.coloured * smooth
        long = np.interp(np.arange(n * n_periods // 2 + 1) / n_periods, np.arange(n // 2 + 1), colour)
        spectrum = long * np.sqrt(n_periods / 2) * (rng.standard_normal((2, len(long))).T @ [1, 1j])
        total = np.fft.irfft(spectrum, n * n_periods) + self.white * rms * rng.standard_normal(n * n_periods)
        walk = np.cumsum(rng.standard_normal(n * n_periods))
        total += self.drift * rms * (walk - walk.mean()) / np.std(walk)
        periods = np.fft.rfft(total.reshape(n_periods, n), axis=1)
        power = np.mean(np.abs(periods - periods.mean(axis=0)) ** 2, axis=0) * n_periods / (n_periods - 1)
        wide, narrow = (_local_mean(power, k) for k in (31, 3))  # a drift is steep
        return total, np.sqrt(np.maximum(wide, narrow))


def _local_mean(x: np.ndarray, width: int) -> np.ndarray:
    """Mean over some neighbours; over fewer at both ends."""
    window = np.ones(width)
    return np.convolve(x, window, "same") / np.convolve(np.ones_like(x), window, "same")


def refitted(
    lacking: Values,
    f_hz: np.ndarray,
    fs_hz: float,
    output: str,
    hold: str,
    measured: list[tuple[np.ndarray, np.ndarray]],
    weights: list[np.ndarray],
) -> tuple[float, Values]:
    """Least cost of an axis without its effect, without noise, and its values.

    Parameters
    ----------
    lacking : dict of dict of float
        Values that the fit begins from.
    f_hz : (F,) ndarray
    fs_hz : float
    output, hold : str
    measured : list of two (F,) ndarray
        Lines of u and y of each record.
    weights : list of (F,) ndarray
    """
    names = [(effect, name) for effect, params in lacking.items() for name in params]
    first = np.array([lacking[effect][name] for effect, name in names])

    def stack_of(x: np.ndarray) -> Values:
        stack = {effect: {} for effect in lacking}
        for (effect, name), value in zip(names, x * first, strict=True):
            stack[effect][name] = float(value)
        return stack

    def error(x: np.ndarray) -> np.ndarray:
        g = response(stack_of(x), f_hz, fs_hz, output, hold)
        left = np.concatenate([w * (y - g * u) for (u, y), w in zip(measured, weights, strict=True)])
        return np.concatenate([left.real, left.imag])

    ends = (np.full(len(first), 1e-3), np.full(len(first), 1e3))
    for i, (_, name) in enumerate(names):
        if name == "residue":
            ends[0][i] = -1e3
    fits = []
    for share in (1.0, 1.4):
        start = np.ones(len(first))
        start[[i for i, (effect, _) in enumerate(names) if effect == "transport_delay"]] = share
        found = least_squares(error, start, bounds=ends, x_scale="jac", max_nfev=EVALUATIONS)
        fits.append((2 * found.cost, stack_of(found.x)))
    return min(fits, key=lambda fit: fit[0])
