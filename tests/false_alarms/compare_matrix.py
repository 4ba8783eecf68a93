"""How often `gsid compare` rejects a right model of several inputs and outputs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from study import Cell, Study

from gsid.comparison_mimo import compare_mimo
from gsid.excitation.orthogonal import orthogonal_multisines
from gsid.fitting.mimo import fit_mimo
from gsid.records.mimo import MimoRecord
from gsid.response.mimo import frf_mimo

FS_HZ, N = 100.0, 200
BAND = (1.0, 20.0)
POLES = 2 * np.pi * np.array([-0.5 + 4j, -1 + 12j])


@dataclass(frozen=True)
class Setting:
    """Channels, realisations and periods, correlation of the noise, and whether a model is fitted."""

    n_u: int
    n_y: int
    n_realisations: int
    n_periods: int
    correlation: float = 0.5
    fitted: bool = False
    coloured: bool = False


def response(f_hz: np.ndarray, n_y: int, n_u: int) -> np.ndarray:
    """Two modes that all outputs see, (F, n_y, n_u)."""
    shapes = np.random.default_rng(7).uniform(-1, 1, (2, n_y, n_u)) + 2 * np.eye(n_y, n_u)
    s = 2j * np.pi * np.asarray(f_hz)[:, None, None]
    return 20 * sum(
        shape * s / (s**2 - 2 * pole.real * s + abs(pole) ** 2)
        for shape, pole in zip(shapes, POLES, strict=True)
    )


class Truth:
    """The responses as a model without covariance."""

    domain, hold, hold_assumed, fs_hz, cov = "s", "none", False, None, None
    n_parameters = 0

    def __init__(self, n_y: int, n_u: int) -> None:
        self.inputs, self.outputs = (
            [f"{name}{i + 1}" for i in range(n)] for name, n in (("u", n_u), ("y", n_y))
        )
        self.u_units, self.y_units = [""] * n_u, [""] * n_y

    def response(self, f_hz: np.ndarray) -> np.ndarray:
        return response(f_hz, len(self.outputs), len(self.inputs))

    def deviations(self, f_hz: np.ndarray) -> np.ndarray:
        return np.zeros((len(f_hz), len(self.outputs), len(self.inputs), 0))


def records(rng: np.random.Generator, setting: Setting) -> list[MimoRecord]:
    """Orthogonal multisines in exact steady state, and noise correlated between the outputs."""
    how = {"n_realisations": setting.n_realisations, "seed": int(rng.integers(2**32))}
    u = orthogonal_multisines(FS_HZ, N, BAND, [1.0] * setting.n_u, **how).periods
    lines = np.fft.rfft(u, axis=1)
    f_hz = np.arange(1, N // 2 + 1) * FS_HZ / N
    outputs = np.zeros((*lines.shape[:2], setting.n_y), complex)
    outputs[:, 1:] = np.einsum("kij,ekj->eki", response(f_hz, setting.n_y, setting.n_u), lines[:, 1:])
    y = np.tile(np.fft.irfft(outputs, N, axis=1), (1, setting.n_periods, 1))
    mix = setting.correlation * np.ones((setting.n_y,) * 2) + (1 - setting.correlation) * np.eye(setting.n_y)
    noise = rng.standard_normal((len(y), y.shape[1] + 1, setting.n_y)) @ np.linalg.cholesky(mix).T
    y = y + (noise[:, 1:] + 0.8 * noise[:, :-1] if setting.coloured else noise[:, 1:])
    how = {"period_samples": N, "settle_samples": 0, "hold": "none"}
    pairs = zip(np.tile(u, (1, setting.n_periods, 1)), y, strict=True)
    return [MimoRecord(*pair, FS_HZ, **how) for pair in pairs]


def run(cell: Cell, seed: int) -> dict[str, float | bool]:
    setting, rng = cell.setting, cell.rng(seed)
    new = records(rng, setting)
    if not setting.fitted:
        return {"p_value": compare_mimo(Truth(setting.n_y, setting.n_u), new, band=BAND).p_value}
    ours = frf_mimo(records(rng, setting))
    model = fit_mimo(ours, "4/3", delay="none")
    return {"p_value": compare_mimo(model, new, band=BAND).p_value}


STUDY = Study(
    name="compare_matrix",
    title="A correct model of several inputs and outputs",
    about=(
        "Two modes that all outputs see, orthogonal multisines at 39 lines, white noise that is correlated "
        "between the outputs (0.5 unless stated), as many experiments as inputs for each realisation. "
        "`gsid compare` of all outputs together (CMP-4): with the true responses, for which the test is "
        "exact, and with a model that was fitted to other records of the same kind."
    ),
    cells=(
        Cell("true model, 2 x 2, 2 periods, 1 realisation", Setting(2, 2, 1, 2)),
        Cell("true model, 4 x 4, 2 periods, 1 realisation", Setting(4, 4, 1, 2)),
        Cell("true model, 3 x 2, 8 periods, correlation 0.95", Setting(2, 3, 1, 8, 0.95)),
        Cell("true model, 4 x 4, 3 periods, 2 realisations, coloured", Setting(4, 4, 2, 3, coloured=True)),
        Cell("fitted, 2 x 2, 4 periods, 1 realisation", Setting(2, 2, 1, 4, fitted=True)),
        Cell("fitted, 2 x 2, 3 periods, 2 realisations", Setting(2, 2, 2, 3, fitted=True)),
        Cell("fitted, 3 x 3, 6 periods, 2 realisations", Setting(3, 3, 2, 6, fitted=True)),
    ),
    run=run,
    levels=(0.01, 0.05),
    n_seeds=400,
    n_short=4,
)
