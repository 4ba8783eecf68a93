"""Blind trials: records of an axis with something hidden in it, a model that lacks it, a sealed answer.

A trial is drawn from (seed, index) alone. Kinds:

null     nothing is hidden
single   one effect of the catalogue
two      two of them, neither absorbed by the other, nor both by one effect of the catalogue
form     presliding friction, in the form of LuGre instead of Dahl
foreign  an effect that is not in the catalogue, and of which no effect of the catalogue explains all
dirty    one effect of the catalogue and an unlisted one, locked to the period, at -50 dB of the response
fan      a disturbance that is not locked to the period, and nothing else

Every file has coloured gyro noise, the gyro's word length, a constant bias, and something unlisted at
-50 dB of the response; one file in four has a fan. The unlisted part is not locked to the period: at -50 dB
it would else be found, rightly, in every file (its drop would be about 1e4), and no null file would be one.
Locked to the period it comes in the kind "dirty".

The size of what is hidden is such that the predicted drop of the cost comes out as drawn: with the variance
s2 of one period's line and P periods,

    drop = min over the null's parameters of  2 P sum_k |Y(k) - Y_null(k)|^2 / s2(k)

over all lines up to 200 Hz of the records to fit: the likelihood ratio's noncentrality, as chi-square.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections import ChainMap
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import truth
from hidden import (
    BASE,
    CATALOGUE,
    CONTAINED,
    FOREIGN,
    FS_HZ,
    LOCKED,
    PAIRED,
    SINGLE,
    Axis,
    Hidden,
    Params,
    Rng,
    lugre,
)
from nulls import Bench, N, Nulls, amplitudes
from scipy.signal import lfilter
from truth import TruthError
from unexplained import drops_beside_each_other, unexplained_by_another, unexplained_by_cogging

LINE_MAX = 389  # 194.5 Hz
TRAVEL_LINES = 4  # lines below 2 Hz: they make the travel
LEVELS = (6.0, 20.0)  # command rms
UNLISTED = 10 ** (-50 / 20)  # of the response's rms
TARGETS = (4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 1024.0, 4096.0, 1e4)
CLEAR_TARGETS = (128.0, 256.0, 1024.0, 4096.0, 1e4)
FOREIGN_TARGETS = (1024.0, 4096.0, 1e4, 1e5)
DIRTY_TARGET = 1e6
SEPARABLE = 64.0  # of a drop, left beside the best other effect: they can be told apart
KINDS = {"null": 0.30, "single": 0.35, "two": 0.10, "form": 0.03, "foreign": 0.12, "dirty": 0.05, "fan": 0.05}


# ---- noise ---------------------------------------------------------------------------------------


@dataclass
class Noise:
    """What a gyro and a bench add to a record; nothing of it but the word's steps repeats with the period."""

    std: float  # deg/s
    share_low: float  # of the variance, below corner_hz
    corner_hz: float
    unlisted: str
    lsb: float
    bias: float
    fan: tuple[float, float] | None  # f_hz, amplitude

    @staticmethod
    def drawn(rng: Rng) -> Noise:
        std = rng.uniform(0.03, 0.08)
        fan = None
        if rng.random() < 0.25:
            fan = (
                float(np.round(rng.uniform(30, 32) * 2) / 2 + rng.uniform(0.1, 0.4)),
                std * rng.uniform(0.3, 1.5),
            )
        return Noise(
            std,
            rng.uniform(0.1, 0.5),
            rng.uniform(5, 40),
            str(rng.choice(list(_UNLISTED))),
            std * rng.uniform(0.3, 1.0),
            rng.normal(0, 0.2),
            fan,
        )

    def random(self, rng: Rng, y: np.ndarray, n_periods: int) -> np.ndarray:
        """The noise that is independent from period to period, (n_periods * n,); y is one clean period."""
        n = len(y) * n_periods
        noise = self.std * (
            np.sqrt(1 - self.share_low) * rng.standard_normal(n)
            + np.sqrt(self.share_low) * low_passed(rng, n, self.corner_hz)
        )
        rough = _UNLISTED[self.unlisted](rng, np.tile(y, n_periods))
        return noise + rough * (UNLISTED * np.std(y) / np.std(rough))

    def measured(self, rng: Rng, y: np.ndarray, n_periods: int) -> np.ndarray:
        """What the gyro says of n_periods periods of the clean y."""
        total = np.tile(y, n_periods) + self.random(rng, y, n_periods) + self.bias
        if self.fan:
            phase = 2 * np.pi * (self.fan[0] * np.arange(len(total)) / FS_HZ + rng.random())
            total += self.fan[1] * np.sin(phase)
        return self.lsb * np.rint(total / self.lsb)

    def variance(self, rng: Rng, y: np.ndarray) -> np.ndarray:
        """Variance of one period's complex line, (n/2+1,), amplitude normalised, from 48 periods."""
        spectra = amplitudes(self.random(rng, y, 48).reshape(48, -1))
        step = self.lsb**2 / 12 * 4 / len(y)
        return np.mean(np.abs(spectra) ** 2, axis=0) + step


def low_passed(rng: Rng, n: int, corner_hz: float) -> np.ndarray:
    """First-order noise of unit variance, stationary from its first sample."""
    pole = np.exp(-2 * np.pi * corner_hz / FS_HZ)
    white = rng.standard_normal(n) * np.sqrt(1 - pole**2)
    return lfilter([1.0], [1.0, -pole], white, zi=[pole * rng.standard_normal()])[0]


def _torque_noise(rng: Rng, y: np.ndarray) -> np.ndarray:
    return low_passed(rng, len(y), 3.0)


def _gain_flutter(rng: Rng, y: np.ndarray) -> np.ndarray:
    """Supply noise between about 20 and 200 Hz: it leaves the mean gain alone."""
    return y * (low_passed(rng, len(y), 200.0) - 0.3 * low_passed(rng, len(y), 20.0))


def _clock_jitter(rng: Rng, y: np.ndarray) -> np.ndarray:
    return np.gradient(y) * rng.standard_normal(len(y))


def _structure_noise(rng: Rng, y: np.ndarray) -> np.ndarray:
    """A light structure that something random shakes at 73 Hz."""
    pole = np.exp((-0.03 + 1j) * 2 * np.pi * 73.0 / FS_HZ)
    return lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], rng.standard_normal(len(y) + 3000))[3000:]


def _spikes(rng: Rng, y: np.ndarray) -> np.ndarray:
    """Rare and large, some 50 a period."""
    hits = (rng.random(len(y)) < 50 / N) * rng.standard_normal(len(y))
    return lfilter([1.0], [1.0, -0.6], hits)


_UNLISTED = {
    "torque_noise": _torque_noise,
    "gain_flutter": _gain_flutter,
    "clock_jitter": _clock_jitter,
    "structure_noise": _structure_noise,
    "spikes": _spikes,
}


# ---- the experiment ------------------------------------------------------------------------------


def draw_base(rng: Rng, without: str | None) -> Params:
    """The axis everybody knows, less the effect that is to be hidden."""
    base = {
        "fs_hz": FS_HZ,
        "gain": rng.uniform(5, 20),
        "delay_s": rng.uniform(1e-3, 6e-3),
        "viscous_rate": rng.uniform(1, 5),
        "spring_stiffness": rng.uniform(15, 40),
        "mode_hz": rng.uniform(150, 185),
        "mode_zeta": rng.uniform(0.01, 0.03),
        "mode_residue": rng.uniform(0.1, 0.4),
        "sensor_lag_s": 1 / (2 * np.pi * rng.uniform(80, 160)),
    }
    for name in CATALOGUE.get(without or "", {}).values():
        base.pop(name, None)
    return base


def draw_commands(rng: Rng, base: Params, n_each: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Odd random-phase multisines: (lines, commands), n_each realisations of each level, low level first.

    One odd line of four is left out at random; those below 2 Hz stay and are so large that the higher level
    moves the axis by 2..3 deg.
    """
    odd = np.arange(1, LINE_MAX + 1, 2)
    lines = odd[(odd < TRAVEL_LINES) | (rng.random(len(odd)) > 0.25)]
    low = lines < TRAVEL_LINES
    angle = np.abs(truth.linear_response(base, lines[low] * FS_HZ / N, output="theta"))
    travel = rng.uniform(2.0, 3.0)
    shape = np.ones(len(lines))
    # Two lines seldom peak together: 0.85 of their sum.
    shape[low] = travel / 0.85 / len(angle) / angle
    rest = 2 * LEVELS[-1] ** 2 - np.sum(shape[low] ** 2)
    if rest < LEVELS[-1] ** 2 / 2:
        raise TruthError("too little command is left above 2 Hz")
    shape[~low] = np.sqrt(rest / np.count_nonzero(~low))
    commands = []
    for level in LEVELS:
        for _ in range(n_each):
            spectrum = np.zeros(N // 2 + 1, complex)
            spectrum[lines] = shape * level / LEVELS[-1] * np.exp(2j * np.pi * rng.random(len(lines)))
            commands.append(np.fft.irfft(spectrum) * N / 2)
    return lines, commands


# ---- a trial -------------------------------------------------------------------------------------


@dataclass
class Trial:
    """Records to fit and to hold out, as arrays of y and u; the model that lacks something; the answer."""

    name: str
    fit: list[tuple[np.ndarray, np.ndarray]]
    held: list[tuple[np.ndarray, np.ndarray]]
    model: dict
    key: dict = field(repr=False)


def calibrate(nulls: Nulls, hidden: Hidden, bench: Bench, n_fit: int, target: float):
    """(size, whitened residual, slopes) at which the predicted drop is the target, or as near as it gets.

    Secant steps on the logarithms, kept between the sizes known to be too small and too large.
    """
    n_steps = truth.FINE if "gear_stiffness" in hidden.params(1.0) else truth.COARSE
    wanted, slope, last = hidden.size, 2.0, None
    low, high = 0.0, np.inf
    for _ in range(12):
        size = wanted
        answers = bench.answers(nulls.base | hidden.params(size), n_steps, slice(n_fit))
        drop, residual, slopes = nulls.refit([y for y, *_ in answers])
        drop = max(drop, 1e-9)
        if abs(np.log(drop / target)) < 0.15 or (size == hidden.size_max and drop < target):
            break
        if size == hidden.size_min and drop > target:
            break
        low, high = (size, high) if drop < target else (low, size)
        if last and size != last[0]:
            slope = np.clip(np.log(drop / last[1]) / np.log(size / last[0]), 0.5, 8.0)
        last = size, drop
        wanted = size * np.clip((target / drop) ** (1 / slope), 0.03, 30.0)
        if not low < wanted < high:
            wanted = np.sqrt(low * high)
        wanted = float(np.clip(wanted, hidden.size_min, hidden.size_max))
    return size, residual, slopes


def _draw_kind(rng: Rng, kinds: dict[str, float]) -> str:
    share = np.array(list(kinds.values()))
    return str(rng.choice(list(kinds), p=share / share.sum()))


def named(effect: str, params: Params) -> dict:
    names = CATALOGUE.get(effect) or {name: name for name in params}
    return {"id": effect, "params": {n: params[p] for n, p in names.items() if p in params}}


def null_model(rng: Rng, base: Params, error: float = 0.05) -> dict:
    """The model file of what is known, each value off by the error, up or down."""
    effects = []
    for effect in BASE:
        known = {n: base[p] for n, p in CATALOGUE[effect].items() if p in base}
        if known:
            wrong = {
                n: {"value": v * (1 + error * rng.choice([-1, 1])), "free": True} for n, v in known.items()
            }
            effects.append({"effect": effect, "params": wrong})
    return {"gsid_model": 1, "fs_hz": FS_HZ, "output": "rate", "effects": effects}


def make_trial(seed: int, index: int, kinds: dict[str, float] | None = None) -> Trial:
    """Draw one trial; draws that cannot be simulated or sized are thrown away and drawn anew."""
    kind = _draw_kind(np.random.default_rng([seed, index]), kinds or KINDS)
    for attempt in range(50):
        rng = np.random.default_rng([seed, index, attempt])
        try:
            return _draw(rng, f"trial_{seed}_{index:05d}", kind)
        except TruthError:
            continue
    raise TruthError(f"trial {index} of seed {seed}: no draw of 50 could be simulated")


def _choose(rng: Rng, kind: str) -> list[str]:
    match kind:
        case "single" | "dirty":
            return [str(rng.choice(list(SINGLE)))]
        case "two":
            return [str(name) for name in rng.choice(PAIRED, 2, replace=False)]
        case "form":
            return ["presliding_friction"]
        case "foreign":
            return [str(rng.choice(list(FOREIGN)))]
    return []


def _draw(rng: Rng, name: str, kind: str) -> Trial:
    effects = _choose(rng, kind)
    n_periods = int(rng.choice([2, 4, 8])) if kind == "null" else 8
    base = draw_base(rng, effects[0] if kind in ("single", "dirty") else None)
    lines, commands = draw_commands(rng, base, 3)
    fit = [u for i, u in enumerate(commands) if i % 3 < 2]
    held = [u for i, u in enumerate(commands) if i % 3 == 2]
    noise = Noise.drawn(rng)
    bench = Bench(fit + held, tolerance=1e-4 * noise.std)
    # Of the held-out commands too: each search begins at the orbit of its own command.
    clean = bench.answers(base, truth.COARSE)[: len(fit)]
    s2 = np.array([noise.variance(rng, y) for y, *_ in clean])
    nulls = Nulls(base, lines, fit, s2, n_periods)
    axis = Axis(
        base["gain"], max(np.abs(u).max() for u in fit), max(np.abs(angle).max() for _, angle, *_ in clean)
    )

    added, traces, slopes = _hidden(rng, kind, effects, nulls, bench, axis)
    params = _together(base, added)
    unexplained = _unexplained(kind, effects, traces, nulls, params, bench, axis)
    drops = drops_beside_each_other(traces, slopes) if traces else []
    if kind == "two" and min(drops) < 64:
        raise TruthError("one of the two would hide behind the other")

    locked = str(rng.choice(list(LOCKED))) if kind == "dirty" else None
    if locked:
        params |= _locked_at_50_db(params, LOCKED[locked], bench, len(fit) - 1)
    if kind == "fan" and noise.fan is None:
        noise.fan = (float(rng.integers(25, 60) + rng.uniform(0.1, 0.4)), noise.std * rng.uniform(0.3, 3.0))

    measured = [noise.measured(rng, y, n_periods) for y, *_ in bench.answers(params, truth.FINE)]
    records = [(np.tile(u, n_periods), y) for u, y in zip(fit + held, measured, strict=True)]
    if kind == "null" and rng.random() < 0.25:
        keep = rng.integers(len(fit))
        fit, records = [fit[keep]], [records[keep], *records[len(fit) :]]
    key = {
        "name": name,
        "kind": kind,
        "effects": [named(effect, extra) for effect, extra in zip(effects, added, strict=True)],
        "predicted_drop": drops,
        "unexplained": unexplained,
        "n_periods": n_periods,
        "n_realisations": len(fit),
        "truth": params,
        "noise": noise.__dict__,
        "locked": locked,
    }
    return Trial(name, records[: len(fit)], records[len(fit) :], null_model(rng, base), key)


def _hidden(
    rng: Rng, kind: str, effects: list[str], nulls: Nulls, bench: Bench, axis: Axis
) -> tuple[list[Params], list[np.ndarray], np.ndarray | None]:
    """Parameters of the hidden effects, what each leaves of the null, and the null's slopes."""
    targets = {"single": TARGETS, "two": CLEAR_TARGETS, "form": CLEAR_TARGETS, "foreign": FOREIGN_TARGETS}
    added, traces, slopes = [], [], None
    for effect in effects:
        draw = lugre if kind == "form" else (FOREIGN if kind == "foreign" else SINGLE)[effect]
        hidden = draw(rng, axis)
        target = DIRTY_TARGET if kind == "dirty" else float(rng.choice(targets[kind]))
        size, residual, slopes = calibrate(nulls, hidden, bench, len(nulls.u), target)
        added.append(hidden.params(size))
        traces.append(residual)
        drop = residual @ residual
        if drop < 2.0 or (kind in ("foreign", "dirty") and not target / 4 < drop < 4 * target):
            raise TruthError("the effect cannot be given the size that was drawn")
    return added, traces, slopes


def _unexplained(
    kind: str,
    effects: list[str],
    traces: list[np.ndarray],
    nulls: Nulls,
    params: Params,
    bench: Bench,
    axis: Axis,
) -> float | None:
    """What the best other effect of the catalogue leaves of the drop; None where it is not asked."""
    n_fit = len(nulls.u)
    if kind in ("two", "foreign"):
        found = unexplained_by_another(nulls, sum(traces), bench, n_fit, axis)
        if found >= SEPARABLE:
            found = min(found, unexplained_by_cogging(nulls, params, bench, n_fit))
        if found < SEPARABLE:
            raise TruthError("one effect of the catalogue does the same")
        return found
    if kind == "single" and traces[0] @ traces[0] >= SEPARABLE:
        if effects[0] in CONTAINED:
            return 0.0
        return unexplained_by_another(nulls, traces[0], bench, n_fit, axis, but=effects[0])
    return None


def _together(base: Params, added: list[Params]) -> Params:
    return dict(ChainMap(*added[::-1], base))


def _locked_at_50_db(params: Params, extra: Params, bench: Bench, record: int) -> Params:
    which = slice(record, record + 1)
    without, with_it = (bench.answers(params | p, truth.COARSE, which)[0][0] for p in ({}, extra))
    factor = UNLISTED * np.std(without) / np.std(with_it - without)
    return {n: v if n.endswith("cycles") else v * factor for n, v in extra.items()}


# ---- files ---------------------------------------------------------------------------------------


def seal(key: dict, seed: int) -> tuple[str, str]:
    """(text of the key, its SHA-256). Salted, so that the hash of a short answer cannot be looked up."""
    salt = hashlib.sha256(f"{seed} {key['name']} salt".encode()).hexdigest()
    text = json.dumps({**key, "salt": salt}, sort_keys=True, indent=1, default=float)
    return text, hashlib.sha256(text.encode()).hexdigest()


def write_trial(trial: Trial, folder: Path) -> Path:
    """Write the records and the model (not the key) to folder/<name>."""
    place = folder / trial.name
    place.mkdir(parents=True, exist_ok=True)
    for label, records in (("fit", trial.fit), ("held", trial.held)):
        for i, (u, y) in enumerate(records):
            np.savez(
                place / f"{label}_{i}.npz",
                u=u,
                y=y,
                valid=np.ones(len(y), bool),
                fs_hz=FS_HZ,
                period_samples=N,
                settle_samples=0,
                u_unit="command",
                y_unit="deg/s",
                hold="zoh",
            )
    (place / "null.json").write_text(json.dumps(trial.model, indent=1))
    return place


def main() -> None:
    """Write trials, their keys apart; the manifest of sealed keys goes first to standard output."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--output", type=Path, required=True)
    args = parser.parse_args()
    keys = args.output / "keys"
    keys.mkdir(parents=True, exist_ok=True)
    for index in range(args.trials):
        trial = make_trial(args.seed, index)
        text, digest = seal(trial.key, args.seed)
        print(digest, trial.name, flush=True)
        (keys / f"{trial.name}.json").write_text(text)
        write_trial(trial, args.output)
    print(f"{args.trials} trials in {args.output}", file=sys.stderr)


if __name__ == "__main__":
    main()
