"""What scipy, scikit-rf and Octave make of the benchmark's responses, each as a careful user runs it.

No peer looks for a delay. scipy starts 0.4 ms off the truth, the others are given the true one; they fit
what is left of the response, and what they find is judged with the delay back in it.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.io import loadmat, savemat
from scipy.optimize import least_squares

if TYPE_CHECKING:
    from gsid.response.frf import Frf


TURNS = 3
"""Runs of each job: what other programs take from one of them is not what is measured. As in fit_peers.m."""


class Found(NamedTuple):
    """What a tool made of one response; times in ms, of the wall clock and of the processor."""

    cost: float
    stable: bool
    delay_s: float
    wall_ms: float = 0.0
    cpu_ms: float = 0.0


def timed(job: Callable[[], Found]) -> Found:
    """Run a job three times and note its least times; processor time is that of all threads."""
    wall_s, cpu_s = [], []
    for _ in range(TURNS):
        began, cpu = time.perf_counter(), time.process_time()
        found = job()
        wall_s.append(time.perf_counter() - began)
        cpu_s.append(time.process_time() - cpu)
    return found._replace(wall_ms=1e3 * min(wall_s), cpu_ms=1e3 * min(cpu_s))


class ScipyFit:
    """The same problem for scipy.optimize.least_squares.

    Parameters are den without its 1, num, and the delay in ms; ascending powers of s / w_max.
    """

    def __init__(self, frf: Frf, order: tuple[int, int]) -> None:
        self.n, self.m = order
        self.g, self.weight = frf.g, 1 / np.sqrt(frf.var_g)
        self.w_ms = 2e-3 * np.pi * frf.f_hz
        self.powers = (1j * frf.f_hz / frf.f_hz[-1])[:, None] ** np.arange(max(order) + 1)

    def parts(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return denominator, numerator and delay at every line."""
        den = self.powers[:, : self.n] @ x[: self.n] + self.powers[:, self.n]
        num = self.powers[:, : self.m + 1] @ x[self.n : -1]
        return den, num, np.exp(-1j * self.w_ms * x[-1])

    @staticmethod
    def real(z: np.ndarray) -> np.ndarray:
        """Return real over imaginary parts."""
        return np.concatenate([z.real, z.imag])

    def residual(self, x: np.ndarray) -> np.ndarray:
        """Return the weighted errors."""
        den, num, delay = self.parts(x)
        return self.real((delay * num / den - self.g) * self.weight)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Return the derivatives of the weighted errors."""
        den, num, delay = self.parts(x)
        g = delay * num / den
        by_den = -(g / den)[:, None] * self.powers[:, : self.n]
        by_num = (delay / den)[:, None] * self.powers[:, : self.m + 1]
        columns = np.hstack([by_den, by_num, (-1j * self.w_ms * g)[:, None]])
        return self.real(columns * self.weight[:, None])

    def start(self, delay_s: float) -> np.ndarray:
        """Return the solution of nine reweighted linear problems at the delay given."""
        g = self.g * np.exp(1j * self.w_ms * 1e3 * delay_s)
        rows = np.hstack([g[:, None] * self.powers[:, : self.n], -self.powers[:, : self.m + 1]])
        right, weight = -g * self.powers[:, self.n], self.weight
        for _ in range(9):
            a, b = self.real(rows * weight[:, None]), self.real(right * weight)
            x = np.linalg.lstsq(a, b, rcond=None)[0]
            weight = self.weight / abs(self.powers[:, : self.n] @ x[: self.n] + self.powers[:, self.n])
        return np.append(x, 1e3 * delay_s)

    def solve(self, delay_s: float) -> Found:
        """Search from one start, at the delay given [s]."""
        found = least_squares(
            self.residual, self.start(delay_s), self.jacobian, x_scale="jac", method="trf", max_nfev=2000
        )
        poles = np.roots(np.append(found.x[: self.n], 1.0)[::-1])
        return Found(2 * found.cost, bool(np.all(poles.real < 0)), found.x[-1] * 1e-3)


def vector_fit(frf: Frf, order: tuple[int, int], delay_s: float) -> Found:
    """scikit-rf's vector fitting, which has no weights."""
    import skrf
    from skrf.vectorFitting import VectorFitting

    turn = np.exp(2j * np.pi * frf.f_hz * delay_s)
    network = skrf.Network(f=frf.f_hz, s=(frf.g * turn)[:, None, None], z0=50, f_unit="Hz")
    fitting = VectorFitting(network)
    fitting.vector_fit(
        n_poles_real=order[0] % 2, n_poles_cmplx=order[0] // 2, fit_constant=order[0] == order[1]
    )
    g = fitting.get_model_response(0, 0, frf.f_hz) / turn
    return Found(cost(g, frf), bool(np.all(fitting.poles.real < 0)), delay_s)


def octave(frfs: list[Frf], order: tuple[int, int], delay_s: float) -> tuple[str, dict[str, list[Found]]]:
    """Octave's invfreqs and fitfrd, all responses in one call; its versions, and what they found.

    Without Octave or its packages: why, and nothing found.
    """
    program = shutil.which("octave-cli")
    if program is None:
        return "absent: tools/setup peers", {}
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder, "in.mat"), Path(folder, "out.mat")
        data = {"g": np.array([one.g for one in frfs]), "var_g": np.array([one.var_g for one in frfs])}
        savemat(given, data | {"f_hz": frfs[0].f_hz, "n_poles": float(order[0]), "delay_s": delay_s})
        script = Path(__file__).with_name("fit_peers.m")
        run = subprocess.run(
            [program, "-q", script, given, made], capture_output=True, text=True, check=False
        )  # some versions end with an error after a good run: what was written counts
        if not made.exists():
            return f"its packages are absent: tools/setup peers ({run.stderr.strip().splitlines()[0]})", {}
        out = loadmat(made)
    found = {}
    for i, name in enumerate(("Octave invfreqs", "Octave fitfrd")):
        columns = zip(
            frfs, out["response"][i], out["stable"][i], out["wall_ms"][i], out["cpu_ms"][i], strict=True
        )
        found[name] = [Found(cost(g, frf), bool(s), delay_s, wall, cpu) for frf, g, s, wall, cpu in columns]
    return str(out["versions"][0]), found


def cost(g: np.ndarray, frf: Frf) -> float:
    """Sum of squared errors over their variance (eq. 7.28)."""
    return float(np.sum(abs(g - frf.g) ** 2 / frf.var_g))
