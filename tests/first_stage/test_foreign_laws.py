"""Laws that are in no list, from a simulator of this file: none of them may get a name.

The axis is u -> rate with inertia, damping and a spring, integrated by Runge and Kutta. The laws are formulas
of the angle a and the rate w over their rms; none is a law of the catalogue. True cogging from the same
simulator keeps its name.
"""

import numpy as np
import pytest

from gsid.diagnosis.missing_torque.stage import first_stage
from gsid.plant.model import PlantModel
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra_of

pytestmark = [pytest.mark.long, pytest.mark.xdist_group("foreign_laws")]  # the module's fixture is made once
FS_HZ, N, PERIODS, SUBSTEPS, SEED = 1000.0, 2000, 8, 2, 31415
GAIN, DAMPING, STIFFNESS = 10.0, 3.0, 25.0
N_RECORDS = 4


def bump(x, at, width):
    return np.exp(-0.5 * ((x - at) / width) ** 2)


# Angle and rate in their rms of the linear axis. The law's rms is a share of the motor's.
FOREIGN = {
    "a detent": lambda a, w: bump(a, 0.5, 0.3),
    "a magnet that snaps": lambda a, w: (a + 0.4) * bump(a, -0.4, 0.35),
    "a step of the angle": lambda a, w: np.tanh(4 * (a - 0.3)),
    "trapezoidal cogging": lambda a, w: np.tanh(4 * np.sin(5 * a + 1)),
    "two cogging frequencies": lambda a, w: np.sin(4 * a) + 0.8 * np.sin(6.3 * a + 2),
    "cogging in one half": lambda a, w: np.sin(7 * a) * (1 + np.tanh(3 * a)),
    "a chirp of the angle": lambda a, w: np.sin(2 * a**2),
    "a spring on one side": lambda a, w: np.maximum(a - 0.2, 0) ** 2,
    "a logarithmic spring": lambda a, w: np.sign(a) * np.log1p(3 * np.abs(a)),
    "a spring with a dead zone": lambda a, w: a - np.clip(a, -0.7, 0.7) + 0.5 * bump(a, 0, 0.4),
    "drag on one side": lambda a, w: np.maximum(w, 0) ** 2,
    "drag of the fifth power": lambda a, w: w**5,
    "a drag that fades": lambda a, w: w * np.exp(-(w**2)),
    "eddy currents": lambda a, w: w / (1 + 2 * w**2),
    "a resonance of the rate": lambda a, w: bump(w, 0.8, 0.3) - bump(w, -0.8, 0.3),
    "drag that depends on the side": lambda a, w: w * np.abs(w) * (1 + 0.8 * np.tanh(2 * a)),
    "damping over the angle": lambda a, w: w * a**2,
    "friction over the angle": lambda a, w: np.tanh(8 * w) * (1 + 0.9 * np.cos(3 * a)),
    "friction at one place": lambda a, w: np.tanh(8 * w) * bump(a, 0.5, 0.4),
    "centrifugal torque": lambda a, w: w**2 * np.sin(a),
    "rate times angle": lambda a, w: w * a,
    "damping that cogs": lambda a, w: w * np.sin(5 * a),
}


def cogging(cycles, phase):
    return lambda a, w: np.sin(cycles * a + phase)


COGGING = {f"cogging {i}": cogging(cycles, 0.6 * i) for i, cycles in enumerate(np.geomspace(6, 25, 10))}


def commands(rng):
    """(N_RECORDS, N) odd random-phase lines, more of them low, at two levels."""
    line = np.arange(1, 140, 2)
    found = []
    for i in range(N_RECORDS):
        spectrum = np.zeros(N // 2 + 1, complex)
        size = np.where(line < 8, 6.0, 1.0) * (1.0 if i % 2 else 0.6)
        spectrum[line] = size * np.exp(2j * np.pi * rng.random(len(line)))
        found.append(np.fft.irfft(spectrum) * N / 2)
    return np.array(found)


def simulated(u, laws, sizes):
    """One period of the rate, (laws, N_RECORDS, N), after two periods to settle."""
    angle, rate = np.zeros((2, len(laws), len(u)))
    step = 1 / FS_HZ / SUBSTEPS
    out = np.zeros((len(laws), len(u), N))

    def slope(angle, rate, drive):
        torque = np.array(
            [size * law(a, w) for law, size, a, w in zip(laws, sizes, angle, rate, strict=True)]
        )
        return rate, drive - DAMPING * rate - STIFFNESS * angle - torque

    for k in range(3 * N):
        out[:, :, k % N] = rate
        drive = GAIN * u[:, k % N]
        for _ in range(SUBSTEPS):
            a1, w1 = slope(angle, rate, drive)
            a2, w2 = slope(angle + step / 2 * a1, rate + step / 2 * w1, drive)
            a3, w3 = slope(angle + step / 2 * a2, rate + step / 2 * w2, drive)
            a4, w4 = slope(angle + step * a3, rate + step * w3, drive)
            angle = angle + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            rate = rate + step / 6 * (w1 + 2 * w2 + 2 * w3 + w4)
    return out


def linear_motion(u):
    s = 2j * np.pi * np.fft.rfftfreq(N, 1 / FS_HZ)
    rate = np.fft.irfft(np.fft.rfft(u) * GAIN * s / (s**2 + DAMPING * s + STIFFNESS))
    angle = np.fft.irfft(np.fft.rfft(u) * GAIN / (s**2 + DAMPING * s + STIFFNESS))
    return angle, rate


@pytest.fixture(scope="module")
def conclusions():
    """Conclusion on each law, by its name."""
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    u = commands(rng)
    angle, rate = linear_motion(u)
    a_rms, w_rms = np.std(angle), np.std(rate)
    laws = FOREIGN | COGGING
    scaled = [lambda a, w, law=law: law(a / a_rms, w / w_rms) for law in laws.values()]
    shares = rng.uniform(0.01, 0.03, len(laws)) * [0.4 if name in COGGING else 1.0 for name in laws]
    sizes = [
        share * GAIN * np.std(u) / np.std(law(angle, rate)) for law, share in zip(scaled, shares, strict=True)
    ]
    found = {}
    for name, clean in zip(laws, simulated(u, scaled, sizes), strict=True):
        noise = 0.02 * np.std(clean) * rng.standard_normal((len(u), PERIODS * N))
        measured = [
            Record(np.tile(c, PERIODS), np.tile(y, PERIODS) + e, FS_HZ, N, 0, hold="zoh")
            for c, y, e in zip(u, clean, noise, strict=True)
        ]
        found[name] = first_stage(spectra_of(measured), linear_model())
        print(name, found[name])
    return found


def linear_model():
    values = {"rigid_body": {"gain": 0.95 * GAIN}, "viscous_friction": {"rate": 1.05 * DAMPING}}
    values |= {"cable_spring": {"stiffness": 0.95 * STIFFNESS}}
    effects = [{"effect": effect, "params": params} for effect, params in values.items()]
    return PlantModel.from_dict({"gsid_model": 1, "fs_hz": FS_HZ, "output": "rate", "effects": effects})


# Seen along the motion of these records, half a period of cogging is this law to 0.7 %.
EQUAL = "a spring on one side"
MAY_BE_NAMED = pytest.mark.xfail(strict=True, reason="cogging explains all but 0.7 % of it")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=MAY_BE_NAMED if name == EQUAL else ()) for name in FOREIGN]
)
def test_a_law_that_is_in_no_list_has_no_name(conclusions, name):
    assert conclusions[name].conclusion.kind in ("unknown", "nearest")


def test_true_cogging_keeps_its_name(conclusions):
    """Two leave so much by errors of the measured motion that they are the nearest only."""
    found = [conclusions[name].conclusion for name in COGGING]
    assert {each.effects for each in found} == {("motor_cogging",)}
    assert [each.kind for each in found].count("named") >= 8
