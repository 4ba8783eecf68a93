"""Laws of the drive in closed loop: they act on what the controller asks for, not on the reference.

The truth is a held axis with viscous friction, carried from sample to sample by its closed form.
"""

import numpy as np
import pytest
from plants import plant

from gsid.diagnosis.effect_starts import effect_starts
from gsid.diagnosis.from_records.diagnose import diagnose
from gsid.effects.types import find
from gsid.excitation.multisine import Multisine
from gsid.greybox.fit import fit_plant
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra

SEED = 20260311
FS, N, PERIODS, SETTLE = 3000.0, 1500, 6, 4  # the loop forgets as exp(-50 t)
GAIN, RATE, KP, KV = 9e4, 12.0, 30.0, 1e-3  # a command of 0.3 for a reference of 10 degrees
DRIVES = {
    "drive_dead_zone": lambda u, size: np.sign(u) * max(abs(u) - size, 0.0),
    "drive_saturation": lambda u, size: min(max(u, -size), size),
}


def reference():
    return Multisine.design(FS, N, (2, 60), phases="random", seed=SEED, amplitude=1.0).table()


def simulate(samples=0, drive=lambda u: u):
    """Commands asked for, and angles, over SETTLE + PERIODS periods."""
    decay = np.exp(-RATE / FS)
    glide = (1 - decay) / RATE
    angle = rate = 0.0
    past = [0.0] * (samples + 1)  # angles, the newest first
    commands, angles = [], []
    for r in np.tile(reference(), SETTLE + PERIODS):
        past = [angle, *past[:-1]]
        seen = (angle - past[-1]) * FS / samples if samples else rate
        u = KV * (KP * (r - angle) - seen)
        commands.append(u)
        angles.append(angle)
        push = GAIN * drive(u)
        angle, rate = angle + glide * rate + push * (1 / FS - glide) / RATE, decay * rate + push * glide
    return np.array(commands), np.array(angles)


def record(angles, noise=1e-3):
    noisy = angles + noise * np.random.default_rng(SEED).standard_normal(len(angles))
    return spectra(Record(np.tile(reference(), SETTLE + PERIODS), noisy, FS, N, SETTLE * N, hold="zoh"))


def model(samples=0, scale=1.0):
    stack = {
        "position_velocity_loop": {"kp": KP, "kv": KV, "rate_samples": samples},
        "rigid_body": {"gain": GAIN * scale},
        "viscous_friction": {"rate": RATE / scale},
    }
    return plant(stack, output="angle")


@pytest.mark.parametrize("samples", [0, 2])
def test_the_command_is_the_output_of_the_controller(samples):
    commands, angles = simulate(samples)
    one = record(angles)
    found = model(samples).drive_command(one, model(samples).predict(one))
    # rounding over the steps of a period: 1e-9, as of the plant's answer
    np.testing.assert_allclose(found, commands[-N:], atol=1e-9 * np.max(np.abs(commands)))


LAWS = [("drive_dead_zone", "half_width", 5e-4), ("drive_saturation", "limit", 0.2)]


@pytest.mark.parametrize(("effect", "parameter", "size"), LAWS)
def test_the_start_of_a_law_of_the_drive_is_of_its_size(effect, parameter, size):
    """Not of the size of the reference: the command inside the loop is not in the record."""
    fit = fit_plant(model(scale=1.05), record(simulate(drive=lambda u: DRIVES[effect](u, size))[1]))
    start = effect_starts(fit, find(effect))[0]
    assert size / 3 < start[f"{effect}.{parameter}"].value < 3 * size
    found = fit_plant(start, fit.records[0].spectra).model[f"{effect}.{parameter}"]
    assert abs(found.value - size) < 4 * found.std


@pytest.mark.parametrize(("effect", "parameter", "size"), LAWS)
def test_a_law_of_the_drive_is_named_in_closed_loop(effect, parameter, size):
    """A bug: scored on the reference, it began at a size of the reference and ended far off."""
    angles = simulate(drive=lambda u: DRIVES[effect](u, size))[1]
    found = diagnose(model(scale=1.05), record(angles))
    assert found.verdict == "missing_effect"
    assert found.found == [(effect,)]
    fitted = found.model[f"{effect}.{parameter}"]
    assert abs(fitted.value - size) < 4 * fitted.std
    # one record of 6 periods: pooled variances make the cost scatter by a fifth
    assert found.cost_per_dof_after == pytest.approx(1, abs=0.5)
