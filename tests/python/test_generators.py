"""Every generator of the core, in both precisions, sample by sample.

Its spectrum line by line, over periods that begin in the middle of one; the same bits in every period and
after a restart; and the table of the desk.

The references are written anew from the formulas of docs/reference/equations.md, in double precision.
"""

import numpy as np
import pytest

from gsid._lib import ffi, ffi32, lib, lib32
from gsid.excitation.generators import Prbs, SteppedSine, Sweep
from gsid.excitation.multisine import Multisine

FS_HZ, PERIODS, BEGIN = 1000.0, 3, 0.37  # whole periods looked at, from this share of one on


class Core:
    """One build of the core; what it is given lives as long as the generator."""

    def __init__(self, precision):
        self.is_double = precision == "double"
        self.ffi, self.lib = (ffi, lib) if self.is_double else (ffi32, lib32)
        self.real, self.cplx = (np.float64, np.complex128) if self.is_double else (np.float32, np.complex64)
        self.epsilon = float(np.finfo(self.real).eps)
        self.keep = []

    def pointer(self, kind, values, dtype):
        array = np.ascontiguousarray(values, dtype)
        self.keep.append(array)
        return self.ffi.from_buffer(f"{kind}[]", array)

    def reals(self, values):
        return self.pointer("gsid_real", values, self.real)

    def lines(self, values):
        return self.pointer("uint32_t", values, np.uint32)

    def twiddle(self, n):
        table = self.pointer("gsid_cplx", np.zeros(n), self.cplx)
        assert self.lib.gsid_twiddle_fill(n, table) == 0
        return table

    def start(self, name, cfg):
        """Initialise anew, and give the function of the next sample."""
        thing = self.ffi.new(f"gsid_{name} *")
        assert getattr(self.lib, f"gsid_{name}_init")(thing, cfg) == 0
        step, u = getattr(self.lib, f"gsid_{name}_step"), self.ffi.new("gsid_real *")

        def samples(n):
            out = np.empty(n, self.real)
            for i in range(n):
                assert step(thing, u) >= 0
                out[i] = u[0]
            return out

        return samples


@pytest.fixture(params=["double", "single"])
def core(request):
    return Core(request.param)


def spectrum(u):
    """Lines 0 .. N/2; |line| is the amplitude of the sine, but for lines 0 and N/2."""
    return np.fft.rfft(np.asarray(u, float)) * 2 / len(u)


def check(core, name, cfg, n, want, tolerance, table):
    """`want` (N/2 + 1,): lines of one period from its first sample on; `tolerance` of a line, in all."""
    begin = int(BEGIN * n)
    u = core.start(name, cfg)((PERIODS + 1) * n + begin)
    lines = spectrum(u[begin : begin + PERIODS * n])
    k = np.arange(len(want))
    turned = want * np.exp(2j * np.pi * (k * begin % n) / n)
    np.testing.assert_allclose(lines[::PERIODS][: len(want)], turned, atol=tolerance)
    between = np.ones(len(lines), bool)
    between[::PERIODS] = False
    # what does not repeat from period to period would stand between the lines; rounding of the transform does
    assert np.abs(lines[between]).max() < 1e-15 * len(u) * np.abs(u).max()
    for p in range(1, PERIODS + 1):
        np.testing.assert_array_equal(u[p * n : (p + 1) * n], u[:n])
    interrupted = core.start(name, cfg)
    interrupted(n + begin)
    np.testing.assert_array_equal(core.start(name, cfg)(n), u[:n])  # a new start, in the middle of a period
    if core.is_double:
        np.testing.assert_array_equal(u[:n], table)
    else:
        np.testing.assert_allclose(u[:n], table, atol=tolerance * np.sqrt(n))


@pytest.mark.parametrize("grid", ["full", "odd", "odd-random", "quasi-log"])
@pytest.mark.parametrize("shape", [0.0, -10.0])
def test_multisine(core, grid, shape):
    n = 500
    m = Multisine.design(FS_HZ, n, (2, 220), grid=grid, seed=5, phases="random", shape_db_per_decade=shape)
    f = len(m.line)
    count, line = core.ffi.new("uint32_t *"), np.zeros(f, np.uint32)
    into = (f, core.ffi.from_buffer("uint32_t[]", line), count)
    lo, hi = 1, 110
    fill = {
        "full": lambda: core.lib.gsid_lines_fill(core.lib.GSID_GRID_FULL, lo, hi, *into),
        "odd": lambda: core.lib.gsid_lines_fill(core.lib.GSID_GRID_ODD, lo, hi, *into),
        "odd-random": lambda: core.lib.gsid_lines_odd_random(lo, hi, 4, 5, *into),
        "quasi-log": lambda: core.lib.gsid_lines_quasi_log(lo, hi, 20, *into),
    }
    assert fill[grid]() == 0
    assert count[0] == f
    np.testing.assert_array_equal(line, m.line)  # the grid does not depend on the precision
    amplitude, phase = (core.reals(np.zeros(f)) for _ in range(2))
    assert core.lib.gsid_amplitude_shape(f, core.lines(line), shape, amplitude) == 0
    assert core.lib.gsid_phase_random(f, 5, phase) == 0
    cfg = core.ffi.new("gsid_multisine_cfg *", [n, f, core.lines(line), amplitude, phase, core.twiddle(n)])
    want = np.zeros(n // 2 + 1, complex)
    want[line] = (line / line[0]) ** (shape / 20) * np.exp(1j * np.asarray(m.phase_rad))
    # a sum of f products, each rounded; phases are given to a turn's precision
    check(core, "multisine", cfg, n, want, 4 * np.sqrt(f) * core.epsilon, m.table())


@pytest.mark.parametrize("n_chips", [251, 257])  # 4 k - 1 and 4 k + 1
def test_quadratic_residue_sequence(core, n_chips):
    p = Prbs(FS_HZ, n_chips, 3, np.arange(1, 80), amplitude=1.5)
    cfg = core.ffi.new("gsid_prbs_cfg *", [core.lib.GSID_PRBS_QUADRATIC_RESIDUE, n_chips, 3, 1.5])
    chips = -np.ones(n_chips)
    chips[np.arange(n_chips) ** 2 % n_chips] = 1
    want = spectrum(1.5 * np.repeat(chips, 3))
    check(core, "prbs", cfg, 3 * n_chips, want, 1e-13, p.table())  # +-1.5 is exact


def test_maximum_length_sequence(core):
    n_chips, n_hold = 255, 2
    p = Prbs(FS_HZ, n_chips, n_hold, np.arange(1, 80), kind="maximum-length")
    cfg = core.ffi.new("gsid_prbs_cfg *", [core.lib.GSID_PRBS_MAXIMUM_LENGTH, n_chips, n_hold, 1.0])
    want = spectrum(p.table())
    k = np.arange(1, len(want))
    hold = np.abs(np.sin(np.pi * k / n_chips) / np.sin(np.pi * k / (n_chips * n_hold)))
    flat = np.where(k % n_chips == 0, 1, np.sqrt(n_chips + 1)) * hold * 2 / (n_chips * n_hold)
    np.testing.assert_allclose(np.abs(want[1:]), flat, atol=1e-13)
    check(core, "prbs", cfg, n_chips * n_hold, want, 1e-13, p.table())


@pytest.mark.parametrize("kind", ["linear", "log"])
@pytest.mark.parametrize("continuous", [True, False])
def test_sweep(core, kind, continuous):
    """Continuous or with a jump of its phase at the period's end: every line, those above the band too."""
    n = 600
    s = Sweep.design(FS_HZ, n, (5, 150), kind=kind, amplitude=2, phase_rad=0.4, continuous=continuous)
    k0, k1 = s.f_start_hz * n / FS_HZ, s.f_stop_hz * n / FS_HZ
    code = core.lib.GSID_SWEEP_LINEAR if kind == "linear" else core.lib.GSID_SWEEP_LOGARITHMIC
    cfg = core.ffi.new("gsid_sweep_cfg *", [code, n, k0, k1, 2, 0.4])
    x = np.arange(n) / n
    ratio = k1 / k0
    turns = x * (k0 + x * (k1 - k0) / 2) if kind == "linear" else k0 * (ratio**x - 1) / np.log(ratio)
    # the phase, of some 40 turns, is rounded at every sample; errors of samples add as their root in a line
    tolerance = 2 * 2 * np.pi * turns[-1] * core.epsilon * 2 / np.sqrt(n)
    check(core, "sweep", cfg, n, spectrum(2 * np.sin(2 * np.pi * turns + 0.4)), tolerance, s.table())


def test_stepped_sine(core):
    """Each estimation part holds its own line and no other; the whole is the same after a restart."""
    n, settle, periods = 200, 57, 2
    s = SteppedSine.design(FS_HZ, n, (5, 400), settle_samples=settle, n_periods=periods)
    amplitude = np.linspace(1, 0.5, len(s.line))
    lines, amplitudes = core.lines(s.line), core.reals(amplitude)
    cfg = core.ffi.new(
        "gsid_stepped_cfg *", [n, len(s.line), settle, periods, lines, amplitudes, core.twiddle(n)]
    )
    each = settle + periods * n
    u = core.start("stepped", cfg)(len(s.line) * each)
    for i, k in enumerate(s.line):
        part = u[i * each + settle : (i + 1) * each]
        want = np.zeros(periods * n // 2 + 1, complex)
        want[periods * k] = amplitude[i] * np.exp(2j * np.pi * (k * settle % n) / n)
        np.testing.assert_allclose(spectrum(part), want, atol=2 * core.epsilon)
    interrupted = core.start("stepped", cfg)
    interrupted(each + settle + 11)
    np.testing.assert_array_equal(core.start("stepped", cfg)(len(u)), u)
    same = np.concatenate([a * np.ones(each) for a in amplitude]) * s.table()
    np.testing.assert_allclose(u, same, atol=2 * core.epsilon)
