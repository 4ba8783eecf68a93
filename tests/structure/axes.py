"""Simulated axes with known structure: rigid body, one or two modes, lag, delay, Coulomb friction.

The body is run by the blind trials' own simulator; modes are added in closed form, since they answer the
command and not the body. Nothing here comes from the product.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "blind"))
import truth

FS_HZ, N = 3000.0, 6000
LINE_MAX = 499  # 249.5 Hz
SNR_DB = 45.0
DRIVE = 10.0  # rms of the command


@dataclass
class Axis:
    """Values of a simulated axis, in the units of the catalogue."""

    gain: float
    rate: float
    stiffness: float
    modes: list[tuple[float, float, float]]  # f_hz, zeta, residue
    lag_s: float
    delay_s: float
    coulomb: float = 0.0  # level over the rms of gain times command
    output: str = "rate"
    refresh_samples: int = 1  # samples that the sensor holds its value

    @property
    def body(self) -> str:
        return "sprung" if self.stiffness else "viscous"

    def params(self, mode: tuple[float, float, float] | None = None) -> dict[str, float]:
        """Parameters of the simulator, with one of the modes or none."""
        values = {
            "fs_hz": FS_HZ,
            "gain": self.gain,
            "viscous_rate": self.rate,
            "spring_stiffness": self.stiffness,
            "sensor_lag_s": self.lag_s,
            "delay_s": self.delay_s,
        }
        if mode is not None:
            values |= dict(zip(("mode_hz", "mode_zeta", "mode_residue"), mode, strict=True))
        return values


def drawn(rng: np.random.Generator, coulomb: float, output: str = "rate") -> Axis:
    """An axis with one or two modes of either sign, with or without spring and lag."""
    f_modes: list[float] = []
    n_modes = int(rng.integers(1, 3))
    while len(f_modes) < n_modes:
        f_hz = float(np.exp(rng.uniform(np.log(25.0), np.log(220.0))))
        if all(abs(np.log(f_hz / other)) > 0.25 for other in f_modes):
            f_modes.append(f_hz)
    modes = [
        (f_hz, float(rng.uniform(0.008, 0.04)), float(rng.choice([-1, 1]) * rng.uniform(0.08, 0.5)))
        for f_hz in sorted(f_modes)
    ]
    rate, stiffness = float(rng.uniform(4, 40)), 0.0
    if rng.integers(0, 2):
        w_body = 2 * np.pi * rng.uniform(1, 6)
        rate, stiffness = float(2 * w_body * rng.uniform(0.05, 0.5)), float(w_body**2)
    return Axis(
        gain=float(rng.uniform(5, 20)),
        rate=rate,
        stiffness=stiffness,
        modes=modes,
        lag_s=float(rng.uniform(0.3e-3, 2.5e-3) * rng.integers(0, 2)),
        delay_s=float(rng.uniform(0.5e-3, 6e-3)),
        coulomb=coulomb,
        output=output,
    )


def command(rng: np.random.Generator, lines: np.ndarray | None = None) -> np.ndarray:
    """One period of a random-phase multisine on odd lines, (N,)."""
    lines = np.arange(1, LINE_MAX + 1, 2) if lines is None else lines
    spectrum = np.zeros(N // 2 + 1, complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    u = np.fft.irfft(spectrum, N)
    return u * DRIVE / np.std(u)


def answer(axis: Axis, u: np.ndarray) -> np.ndarray:
    """One period of the steady answer to a held periodic command, (N,)."""
    level = axis.coulomb * axis.gain * np.std(u)
    y, theta, _, _ = truth.steady(axis.params() | {"coulomb_level": level}, u, tolerance=1e-5, n_steps=8)
    if axis.output == "angle":
        y = theta
    lines = np.arange(1, N // 2)
    f_hz = lines * FS_HZ / N
    body = truth.linear_response(axis.params(), f_hz, output="y" if axis.output == "rate" else "theta")
    spectrum = np.fft.rfft(u)
    added = np.zeros_like(spectrum)
    for mode in axis.modes:
        whole = truth.linear_response(axis.params(mode), f_hz)
        rate = whole - truth.linear_response(axis.params(), f_hz)
        added[lines] += rate * spectrum[lines]
    assert axis.output == "rate" or not axis.modes, body.shape
    y = y + np.fft.irfft(added, N)
    return y[np.arange(N) // axis.refresh_samples * axis.refresh_samples]


def measured(
    axis: Axis, rng: np.random.Generator, n_periods: int = 6, lines: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Samples (u, y) of one realisation with white noise."""
    u = command(rng, lines)
    y = answer(axis, u)
    noise = np.std(y) * 10 ** (-SNR_DB / 20) * rng.standard_normal(n_periods * N)
    return np.tile(u, n_periods), np.tile(y, n_periods) + noise
